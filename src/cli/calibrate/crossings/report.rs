//! Reports on a check by crossing slices: as text and as JSON.

use std::fmt::Write as _;

use serde::Serialize;

use crate::app::calibrate::crossings::Found;
use crate::app::calibrate::outputs::{Outputs, rows};

/// A number with its standard error.
type Estimate = [f64; 2];

/// The report; its fields are the JSON form.
#[derive(Debug, Serialize)]
pub(super) struct Report<'a> {
    /// Displacement of the image, root mean square, mm.
    shift_mm: f64,
    shift_se_mm: f64,
    /// Largest standard error of a point of the image, mm.
    worst_se_mm: f64,
    has_slipped: bool,
    /// The sweep, from 1, before which the sensor slipped or the body moved, and the image's
    /// displacement there, with its standard error, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    slip: Option<(usize, f64, f64)>,
    /// Whether the sweeps do not tell.
    is_undecided: bool,
    /// Whether the latency in use is off.
    is_late: bool,
    /// Reason not to use the calibration found.
    #[serde(skip_serializing_if = "Option::is_none")]
    unfit: Option<String>,
    /// The image's middle along u, v and the normal, and its turn about these: numbers, errors.
    translation_mm: [[f64; 3]; 2],
    rotation_deg: [[f64; 3]; 2],
    /// Change of the scale along u and v, percent: numbers, standard errors.
    scale_percent: [[f64; 2]; 2],
    /// The tracker's lag beyond the one in use, s, and its standard error.
    lag_s: Estimate,
    /// 16 numbers, row major.
    image_to_probe: [f64; 16],
    lines: usize,
    slices: usize,
    directions: usize,
    /// First and last time of each sweep, s.
    sweeps_s: &'a [[f64; 2]],
    /// Medians along the lines, before and after.
    correlations: [f64; 2],
    inputs: &'a [crate::app::calibrate::outputs::Input],
    /// Sentences for the user.
    notes: Vec<String>,
}

impl<'a> Report<'a> {
    pub(super) fn new(found: &'a Found) -> Self {
        let checked = &found.checked;
        let mut notes = found.notes.clone();
        if found.in_use_ms.is_none() && checked.is_late() {
            notes.push(format!(
                "the sequence's poses are {:.1} ms late; correct that where it is recorded",
                1e3 * checked.lag_s[0]
            ));
        }
        Self {
            shift_mm: checked.shift_mm,
            shift_se_mm: checked.shift_se_mm,
            worst_se_mm: checked.worst_se_mm,
            has_slipped: checked.has_slipped(),
            slip: found.slip.as_ref().map(|slip| (slip.sweep + 1, slip.shift_mm, slip.shift_se_mm)),
            is_undecided: checked.undecided().is_some(),
            is_late: checked.is_late(),
            unfit: checked.unfit().map(|why| why.to_string()),
            translation_mm: checked.translation_mm,
            rotation_deg: checked.rotation_deg,
            scale_percent: checked.scale.map(|scale| scale.map(|part| 100.0 * part)),
            lag_s: checked.lag_s,
            image_to_probe: rows(found.probe_from_image),
            lines: checked.lines,
            slices: checked.slices,
            directions: checked.directions.count,
            sweeps_s: &checked.directions.sweeps_s,
            correlations: checked.correlations,
            inputs: &found.inputs,
            notes,
        }
    }

    /// Formats the report for people.
    pub(super) fn text(&self, outputs: &Outputs) -> String {
        let mut text = String::new();
        let mut say = |label: &str, value: String| {
            // Writing to a string does not fail.
            let _ = writeln!(text, "{label:<16}{value}");
        };
        let list = |[numbers, errors]: [&[f64]; 2], digits: usize| {
            let each = numbers.iter().zip(errors).map(|(x, se)| format!("{x:.digits$} ± {se:.digits$}"));
            each.collect::<Vec<_>>().join(", ")
        };
        let verdict = |is_off: bool| match (self.is_undecided || self.slip.is_some(), is_off) {
            (true, _) => "the sweeps do not tell whether it holds",
            (_, true) => "more than chance explains",
            (_, false) => "the calibration holds",
        };
        let slipped = verdict(self.has_slipped);
        say("image", format!("displaced by {:.2} ± {:.2} mm: {slipped}", self.shift_mm, self.shift_se_mm));
        if let Some((sweep, shift_mm, se_mm)) = self.slip {
            say("slip", format!("before sweep {sweep}, by {shift_mm:.2} ± {se_mm:.2} mm, if the body has not moved"));
        }
        say(
            "translation",
            format!("{} mm along u, v, normal", list([&self.translation_mm[0], &self.translation_mm[1]], 2)),
        );
        say("rotation", format!("{}° about u, v, normal", list([&self.rotation_deg[0], &self.rotation_deg[1]], 2)));
        say("scale", format!("{} % along u, v", list([&self.scale_percent[0], &self.scale_percent[1]], 2)));
        let (late, [lag_ms, se_ms]) = (verdict(self.is_late), self.lag_s.map(|s| 1e3 * s));
        say("lag", format!("{lag_ms:.1} ± {se_ms:.1} ms beyond the one in use: {late}"));
        say(
            "crossings",
            format!(
                "{} of {} slices in {} directions, {} sweeps; correlation {:.3}, before {:.3}",
                self.lines,
                self.slices,
                self.directions,
                self.sweeps_s.len(),
                self.correlations[1],
                self.correlations[0]
            ),
        );
        // Whether it holds or the sweeps do not tell is said already.
        let unfit = self.unfit.iter().filter(|_| self.has_slipped || self.is_late);
        unfit.for_each(|why| say("not to be used", why.clone()));
        self.notes.iter().for_each(|note| say("note", note.clone()));
        outputs.written().for_each(|(what, path)| say(what, path.display().to_string()));
        text
    }
}
