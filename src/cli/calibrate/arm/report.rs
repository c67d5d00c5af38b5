//! Reports on an arm, as text and as JSON. JSON field names contain the units.

use std::fmt::Write as _;

use serde::Serialize;

use calibration::arm::check::Checked;
use calibration::arm::fit::{Fitted, Found, Options};
use calibration::arm::reach::Reach;
use calibration::arm::{JOINTS, Joint};

use crate::app::calibrate::arm::Touched;
use crate::app::calibrate::outputs::Input;
use crate::app::calibrate::poses::Counts;

/// Returns the decimals of a number: enough that its standard deviation has two significant
/// digits.
fn digits(sd: f64) -> usize {
    if sd > 0.0 { (1.0 - sd.log10().floor()).clamp(0.0, 9.0) as usize } else { 6 }
}

/// The touches that a result is based on.
pub(super) struct Results<'a> {
    pub(super) touched: &'a Touched,
    pub(super) counts: &'a Counts,
    pub(super) tip_sd_mm: f64,
}

/// A fitted number.
#[derive(Debug, Serialize)]
struct NumberReport {
    joint: usize,
    number: &'static str,
    unit: &'static str,
    before: f64,
    value: f64,
    sd: f64,
}

impl From<&Found> for NumberReport {
    fn from(found: &Found) -> Self {
        let Found { joint, what, before, value, sd } = *found;
        Self { joint, number: what.name(), unit: what.unit(), before, value, sd }
    }
}

/// A touch, or the two touches of a distance.
#[derive(Debug, Serialize)]
struct TouchReport {
    of: String,
    from_s: f64,
    to_s: f64,
    off_mm: f64,
    /// Left out, because it lies far from all others.
    outlier: bool,
}

/// Report of a fit.
#[derive(Debug, Serialize)]
pub(super) struct FitReport<'a> {
    kind: &'static str,
    input: Input,
    readings: &'a Counts,
    joints: [Joint; JOINTS],
    found: Vec<NumberReport>,
    rms_mm: f64,
    most_mm: f64,
    /// Ratio of the residuals to the tip's repeatability in a divot.
    spread: f64,
    #[serde(rename = "seat_mm")]
    tip_sd_mm: f64,
    limit_mm: f64,
    condition: f64,
    tip_mm: [f64; 2],
    predicted_error: &'a Reach,
    touches: Vec<TouchReport>,
}

/// Report of a check.
#[derive(Debug, Serialize)]
pub(super) struct CheckReport<'a> {
    kind: &'static str,
    input: Input,
    readings: &'a Counts,
    rms_mm: f64,
    most_mm: f64,
    fit_rms_mm: Option<f64>,
    #[serde(rename = "seat_mm")]
    tip_sd_mm: f64,
    changed: bool,
    slipped: Option<NumberReport>,
    advice: String,
    touches: Vec<TouchReport>,
}

impl<'a> FitReport<'a> {
    pub(super) fn new(input: Input, results: &Results<'a>, fitted: &Fitted, reach: &'a Reach, limit_mm: f64) -> Self {
        let Fitted { rms_mm, most_mm, spread, condition, .. } = *fitted;
        Self {
            kind: "arm",
            input,
            readings: results.counts,
            joints: *fitted.arm.joints(),
            found: fitted.found.iter().map(NumberReport::from).collect(),
            rms_mm,
            most_mm,
            spread,
            tip_sd_mm: results.tip_sd_mm,
            limit_mm,
            condition,
            tip_mm: fitted.tip_mm.to_array(),
            predicted_error: reach,
            touches: results.touches(&fitted.residuals_mm, &fitted.outliers),
        }
    }
}

impl<'a> CheckReport<'a> {
    pub(super) fn new(input: Input, results: &Results<'a>, checked: &Checked, fit_rms_mm: Option<f64>) -> Self {
        let Checked { rms_mm, most_mm, changed, .. } = *checked;
        Self {
            kind: "arm_check",
            input,
            readings: results.counts,
            rms_mm,
            most_mm,
            fit_rms_mm,
            tip_sd_mm: results.tip_sd_mm,
            changed,
            slipped: checked.slipped.as_ref().map(NumberReport::from),
            advice: checked.advice(),
            touches: results.touches(&checked.residuals_mm, &[]),
        }
    }
}

impl Results<'_> {
    fn touches(&self, residuals_mm: &[f64], outliers: &[usize]) -> Vec<TouchReport> {
        let of = |(at, off_mm): (usize, &f64)| {
            let [from_s, to_s] = self.touched.time_s(at);
            TouchReport { of: self.touched.name(at), from_s, to_s, off_mm: *off_mm, outlier: outliers.contains(&at) }
        };
        residuals_mm.iter().enumerate().map(of).collect()
    }

    fn lines(&self, residuals_mm: &[f64], outliers: &[usize], text: &mut String) {
        for TouchReport { of, from_s, to_s, off_mm, outlier } in self.touches(residuals_mm, outliers) {
            let left_out = if outlier { ", left out: it lies far from all others" } else { "" };
            // Writing to a string does not fail.
            let _ = writeln!(text, "  {of:24} {off_mm:.3} mm off, {from_s:.1} to {to_s:.1} s{left_out}");
        }
    }

    /// Formats a fit as text.
    pub(super) fn of_fit(&self, fitted: &Fitted, reach: &Reach, options: &Options) -> String {
        let mut text = format!(
            "{}: {:.3} mm off (rms; at most {:.3}), {:.2} times the seat's repeatability{}\n",
            self.touched.words(),
            fitted.rms_mm,
            fitted.most_mm,
            fitted.spread,
            self.counts.refusals()
        );
        for found in &fitted.found {
            let Found { joint, what, before, value, sd } = found;
            let places = digits(*sd);
            let _ = writeln!(
                text,
                "  {:24} {value:.places$} ± {sd:.places$} {} (was {before})",
                format!("{} of joint {joint}", what.name()),
                what.unit()
            );
        }
        let is_kept = |joint: &usize| {
            let turns = fitted.arm.joints()[*joint].kind == calibration::arm::Kind::Revolute;
            turns && !options.lengths[*joint]
        };
        for joint in (0..JOINTS).filter(is_kept) {
            let mm = fitted.arm.joints()[joint].length_mm;
            let _ = writeln!(text, "  {:24} {mm} mm, unchanged", format!("length of joint {}", joint + 1));
        }
        let _ = writeln!(
            text,
            "the tip is known to {:.3} mm in the touches' part of the reach (rms; at most {:.3}), one standard deviation; rounding of the encoders adds up to {:.3} mm",
            reach.rms_mm, reach.most_mm, reach.rounding_mm
        );
        for ring in &reach.rings {
            let [from, to] = ring.mm;
            let _ = writeln!(
                text,
                "  {:24} {:.3} mm, at most {:.3}",
                format!("{from:.0} to {to:.0} mm from base"),
                ring.rms_mm,
                ring.most_mm
            );
        }
        self.lines(&fitted.residuals_mm, &fitted.outliers, &mut text);
        text
    }

    /// Formats a check as text.
    pub(super) fn of_check(&self, checked: &Checked, fit_rms_mm: Option<f64>) -> String {
        let fit = match fit_rms_mm {
            Some(mm) => format!("its fit had {mm:.3}"),
            None => "its fit's residual is unknown".to_owned(),
        };
        let mut text = format!(
            "{}: {:.3} mm off (rms; at most {:.3}); {fit}{}\n",
            self.touched.words(),
            checked.rms_mm,
            checked.most_mm,
            self.counts.refusals()
        );
        self.lines(&checked.residuals_mm, &[], &mut text);
        if !checked.changed {
            text += "the arm agrees with its calibration\n";
        }
        text
    }
}
