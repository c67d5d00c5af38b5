//! Checks a running arm against its calibration.

use super::fit::{Fitted, Found, Known, Options, Touch, fit};
use super::{Arm, JOINTS};
use crate::error::CalibrationError;

/// An arm has changed if its touches are this many times as far from the divots as at the fit.
const CHANGED: f64 = 3.0;
/// A joint's zero explains the change if correcting it leaves less than this share of the
/// residuals.
const EXPLAINS: f64 = 0.5;

/// Result of checking an arm without changing it.
#[derive(Debug, Clone)]
pub struct Checked {
    /// Root mean square of the touches' residuals, mm; only the position of the plate was
    /// fitted.
    pub rms_mm: f64,
    /// The largest residual, mm.
    pub most_mm: f64,
    /// Residual of each touch, mm, as in [`Fitted::residuals_mm`].
    pub residuals_mm: Vec<f64>,
    /// The arm no longer matches its calibration.
    pub changed: bool,
    /// The one joint zero that explains the change, if there is one: the encoder has slipped or
    /// was not homed.
    pub slipped: Option<Found>,
}

impl Checked {
    /// Returns advice for the user; empty if the arm is unchanged.
    pub fn advice(&self) -> String {
        match (&self.slipped, self.changed) {
            (_, false) => String::new(),
            (Some(found), true) => format!(
                "the zero of joint {} has moved by {:.1} counts (±{:.1}): home the arm again, or calibrate it anew",
                found.joint,
                found.value - found.before,
                found.sd
            ),
            (None, true) => {
                "no single joint explains the change: check whether a link is bent or loose, and calibrate the arm anew"
                    .into()
            }
        }
    }
}

/// Checks an arm by touches; `fitted_mm` is the root mean square distance that its fit left (of
/// [`Fitted::rms_mm`]).
///
/// Touches of a freely placed plate cannot check the first joint's zero. Homing that joint
/// relies on its own index mark.
///
/// # Errors
/// [`CalibrationError`] if there are too few touches, or none of known places.
pub fn check(
    arm: &Arm,
    known: &Known<'_>,
    touches: &[Touch],
    options: &Options,
    fitted_mm: f64,
) -> Result<Checked, CalibrationError> {
    let placed = |zeros| Options {
        lengths: [false; JOINTS],
        zeros,
        counts_per_unit: false,
        directions: [false; JOINTS],
        ..*options
    };
    let as_it_is = fit(arm, known, touches, &placed([false; JOINTS]))?;
    // Outliers count here: an arm that is right at most places only is not right.
    let rms = |fitted: &Fitted| {
        let squares: f64 = fitted.residuals_mm.iter().map(|mm| mm * mm).sum();
        (squares / fitted.residuals_mm.len() as f64).sqrt()
    };
    let most_mm = as_it_is.residuals_mm.iter().copied().fold(0.0, f64::max);
    let rms_mm = rms(&as_it_is);
    let changed = rms_mm > CHANGED * fitted_mm.max(options.tip_sd_mm);
    let mut slipped: Option<(f64, Found)> = None;
    for joint in (1..JOINTS).filter(|_| changed) {
        let mut zeros = [false; JOINTS];
        zeros[joint] = true;
        // A joint zero that the touches do not determine explains nothing.
        let Ok(with) = fit(arm, known, touches, &placed(zeros)) else { continue };
        let left = rms(&with);
        if left < EXPLAINS * rms_mm && slipped.as_ref().is_none_or(|(best, _)| left < *best) {
            slipped = with.found.into_iter().next().map(|found| (left, found));
        }
    }
    Ok(Checked {
        rms_mm,
        most_mm,
        residuals_mm: as_it_is.residuals_mm,
        changed,
        slipped: slipped.map(|(_, found)| found),
    })
}
