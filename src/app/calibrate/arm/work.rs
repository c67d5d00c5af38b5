//! The beginning and the limits of an arm's fit to the touches of a recording.

use std::path::Path;

use calibration::arm::Arm;
use calibration::arm::fit::{Fitted, Options as FitOptions};
use calibration::file::CalibrationFile;

use super::options::{Kept, Options};
use super::touched::Touched;
use crate::failure::Failure;

/// Largest share of outlying touches at which the report still calls the other touches right.
const MOST_OUTLIERS: f64 = 0.25;

/// The flags, together with the session that they apply to.
#[derive(Clone, Copy)]
pub(crate) struct Work<'a> {
    pub(crate) options: &'a Options,
    pub(crate) session: &'a Path,
}

impl Work<'_> {
    pub(crate) fn within(&self, problem: impl std::fmt::Display) -> Failure {
        Failure::new(format!("{}: {problem}", self.session.display()))
    }

    /// Returns the arm to begin with, and its fit's residual, mm. Uses the configuration's arm
    /// unless --arm was given.
    pub(crate) fn start(
        &self,
        configured: Option<Arm>,
        fit_rms_mm: Option<f64>,
    ) -> Result<(Arm, Option<f64>), Failure> {
        let Some(path) = &self.options.arm else {
            let none = "its configuration holds no initial joints; give --arm with a calibration file with \
                [[arm.joint]], and lengths measured by a ruler";
            return Ok((configured.ok_or_else(|| self.within(none))?, fit_rms_mm));
        };
        let file = CalibrationFile::read(path)?;
        let none = "holds no [[arm.joint]]; `sonoweave live --example arm-probe` prints an example";
        let arm = file.arm.ok_or_else(|| Failure::new(format!("{}: {none}", path.display())))?;
        Ok((arm, file.arm_fit_rms_mm))
    }

    pub(crate) fn fit_options(&self, arm: &Arm, touched: &Touched) -> FitOptions {
        let Options { tip, tip_sd_mm, counts, keep, .. } = self.options;
        let known = touched.known();
        let mut options = FitOptions::of(arm, &known);
        (options.tip_mm, options.tip_sd_mm, options.counts_per_unit) = (*tip, *tip_sd_mm, *counts);
        // A user who fixes numbers is responsible for fixing the scale.
        if keep.iter().any(|kept| matches!(kept, Kept::Length(_))) {
            options.lengths = arm.joints().map(|joint| joint.kind == calibration::arm::Kind::Revolute);
        }
        for kept in keep {
            match *kept {
                Kept::Length(joint) => options.lengths[joint] = false,
                Kept::Zero(joint) => options.zeros[joint] = false,
                Kept::Direction(joint) => options.directions[joint] = false,
            }
        }
        options
    }

    /// Refuses a fit that its touches contradict.
    ///
    /// # Errors
    /// [`Failure`] with the reason.
    pub(crate) fn accept(&self, fitted: &Fitted, touched: &Touched) -> Result<(), Failure> {
        let (out, all) = (fitted.outliers.len(), fitted.residuals_mm.len());
        if out as f64 > MOST_OUTLIERS * all as f64 {
            let listed: Vec<String> = fitted.outliers.iter().map(|at| touched.name(*at)).collect();
            return Err(self.within(format!(
                "{out} of {all} residuals contradict the others ({}); check the touches' order (--order), and rests that \
                were no touches (--skip)",
                listed.join(", ")
            )));
        }
        if fitted.rms_mm > self.options.limit {
            return Err(self.within(format!(
                "the touches are {:.2} mm off (root mean square), more than the limit of {} mm; check their order \
                (--order), rests that were no touches (--skip), and the joints' types, signs and counts a turn",
                fitted.rms_mm, self.options.limit
            )));
        }
        Ok(())
    }
}
