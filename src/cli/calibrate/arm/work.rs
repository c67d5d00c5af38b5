//! Fits an arm to the touches of a recording, or checks it against them.

use std::path::Path;

use calibration::arm::Arm;
use calibration::arm::check::check;
use calibration::arm::fit::{Fitted, Options, fit};
use calibration::arm::reach::Reach;
use calibration::file::CalibrationFile;

use super::super::outputs::{Input, originates, print};
use super::arguments::{Arguments, Kept};
use super::report::{CheckReport, FitReport, Results};
use super::session::Recorded;
use super::touched::Touched;
use crate::cli::Failure;

/// Largest share of outlying touches at which the report still calls the other touches right.
const MOST_OUTLIERS: f64 = 0.25;

/// The flags, together with the session that they apply to.
#[derive(Clone, Copy)]
pub(super) struct Work<'a> {
    pub(super) arguments: &'a Arguments,
    pub(super) session: &'a Path,
}

impl Work<'_> {
    pub(super) fn within(&self, problem: impl std::fmt::Display) -> Failure {
        Failure(format!("{}: {problem}", self.session.display()))
    }

    /// Returns the arm to begin with, and its fit's residual, mm. Uses the configuration's arm
    /// unless --arm was given.
    pub(super) fn start(
        &self,
        configured: Option<Arm>,
        fit_rms_mm: Option<f64>,
    ) -> Result<(Arm, Option<f64>), Failure> {
        let Some(path) = &self.arguments.arm else {
            let none = "its configuration holds no initial joints; give --arm with a calibration file with \
                [[arm.joint]], and lengths measured by a ruler";
            return Ok((configured.ok_or_else(|| self.within(none))?, fit_rms_mm));
        };
        let file = CalibrationFile::read(path)?;
        let none = "holds no [[arm.joint]]; `sonoweave live --example arm-probe` prints an example";
        let arm = file.arm.ok_or_else(|| Failure(format!("{}: {none}", path.display())))?;
        Ok((arm, file.arm_fit_rms_mm))
    }

    pub(super) fn options(&self, arm: &Arm, touched: &Touched) -> Options {
        let Arguments { tip, tip_sd_mm, counts, keep, .. } = self.arguments;
        let known = touched.known();
        let mut options = Options::of(arm, &known);
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

    pub(super) fn find(&self, arm: &Arm, recorded: &Recorded, touched: &Touched) -> Result<(), Failure> {
        let options = self.options(arm, touched);
        let fitted = fit(arm, &touched.known(), &touched.touches, &options).map_err(|e| self.within(e))?;
        self.accept(&fitted, touched)?;
        let reach = Reach::of(&fitted);
        let results = Results { touched, counts: &recorded.counts, tip_sd_mm: self.arguments.tip_sd_mm };
        let input = Input::of(self.session)?;
        let provenance = format!("{} in {}, {:.3} mm", touched.words(), input.name(), fitted.rms_mm);
        let plate = self.arguments.places.file().map(|path| Input::of(path)).transpose()?;
        let origin = self.arguments.outputs.origin([Some(&input), plate.as_ref()].into_iter().flatten());
        let text = results.of_fit(&fitted, &reach, &options);
        let report = FitReport::new(input, &results, &fitted, &reach, self.arguments.limit);
        let change = |file: &mut CalibrationFile| {
            (file.arm, file.arm_fit_rms_mm) = (Some(fitted.arm), Some(fitted.rms_mm));
            originates(file, "Arm", &provenance);
            file.originates("arm", origin);
        };
        self.arguments.outputs.write_changed(change, &report)?;
        print(&(text + &self.arguments.outputs.summary()))
    }

    fn accept(&self, fitted: &Fitted, touched: &Touched) -> Result<(), Failure> {
        let (out, all) = (fitted.outliers.len(), fitted.residuals_mm.len());
        if out as f64 > MOST_OUTLIERS * all as f64 {
            let listed: Vec<String> = fitted.outliers.iter().map(|at| touched.name(*at)).collect();
            return Err(self.within(format!(
                "{out} of {all} residuals contradict the others ({}); check the touches' order (--order), and rests that \
                were no touches (--skip)",
                listed.join(", ")
            )));
        }
        if fitted.rms_mm > self.arguments.limit {
            return Err(self.within(format!(
                "the touches are {:.2} mm off (root mean square), more than the limit of {} mm; check their order \
                (--order), rests that were no touches (--skip), and the joints' types, signs and counts a turn",
                fitted.rms_mm, self.arguments.limit
            )));
        }
        Ok(())
    }

    /// Checks an arm against its fit.
    pub(super) fn hold(
        &self,
        arm: &Arm,
        fit_rms_mm: Option<f64>,
        recorded: &Recorded,
        touched: &Touched,
    ) -> Result<(), Failure> {
        let options = self.options(arm, touched);
        // If the fit's residual is unknown, only the tip's repeatability limits the residuals.
        let fitted_mm = fit_rms_mm.unwrap_or(0.0);
        let checked =
            check(arm, &touched.known(), &touched.touches, &options, fitted_mm).map_err(|e| self.within(e))?;
        let results = Results { touched, counts: &recorded.counts, tip_sd_mm: self.arguments.tip_sd_mm };
        let text = results.of_check(&checked, fit_rms_mm);
        let report = CheckReport::new(Input::of(self.session)?, &results, &checked, fit_rms_mm);
        self.arguments.outputs.write_changed(|_| {}, &report)?;
        print(&(text + &self.arguments.outputs.summary()))?;
        match checked.changed {
            true => Err(self.within(format!("the arm no longer agrees with its calibration; {}", checked.advice()))),
            false => Ok(()),
        }
    }
}
