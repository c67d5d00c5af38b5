//! An arm's touches, and its fit to them or their check.

mod guide;
mod options;
mod session;
mod touched;
mod work;

use std::path::{Path, PathBuf};

use calibration::arm::Arm;
use calibration::arm::check::{Checked, check};
use calibration::arm::fit::{Fitted, Options as FitOptions, fit};

use super::guide::Advisor;
use super::poses::Counts;
use crate::failure::Failure;
pub(crate) use options::Options;
pub(crate) use touched::Touched;
use work::Work;

/// An arm, and a recording of its touches.
pub(crate) struct TouchedArm<'a> {
    options: &'a Options,
    /// The recording.
    pub(crate) session: PathBuf,
    arm: Arm,
    /// Residual of the arm's last fit, mm.
    pub(crate) fit_rms_mm: Option<f64>,
    pub(crate) counts: Counts,
    pub(crate) touched: Touched,
    pub(crate) fit_options: FitOptions,
}

impl Options {
    /// Returns the files that are read.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        let given = [&self.session, &self.live].into_iter().flatten();
        given.map(PathBuf::as_path).chain(self.plate()).collect()
    }

    /// Returns the file of the touched plate, if there is one.
    pub(crate) fn plate(&self) -> Option<&Path> {
        self.places.file().map(PathBuf::as_path)
    }

    /// Reads the touches; records them first if they are still to be made.
    ///
    /// # Errors
    /// [`Failure`] when they cannot be recorded or read, or do not match their places.
    pub(crate) fn touching(&self, advisor: &mut dyn Advisor) -> Result<TouchedArm<'_>, Failure> {
        let made = self
            .gathering
            .of(self.live.as_ref())?
            .map(|bedside| guide::gathered(bedside, self, advisor))
            .transpose()?;
        // The command line guarantees that one of the two is present.
        let session = made.or_else(|| self.session.clone()).unwrap_or_default();
        let work = Work { options: self, session: &session };
        let recorded = self.which.read(&session)?;
        let (arm, fit_rms_mm) = work.start(recorded.arm, recorded.fit_rms_mm)?;
        let touched = self.which.touches(&session, &arm, &recorded.readings, self.places.read()?)?;
        let fit_options = work.fit_options(&arm, &touched);
        Ok(TouchedArm { options: self, session, arm, fit_rms_mm, counts: recorded.counts, touched, fit_options })
    }
}

impl TouchedArm<'_> {
    fn work(&self) -> Work<'_> {
        Work { options: self.options, session: &self.session }
    }

    /// Fits the arm to the touches.
    ///
    /// # Errors
    /// [`Failure`] when they do not determine it, or contradict each other.
    pub(crate) fn fit(&self) -> Result<Fitted, Failure> {
        let Self { arm, touched, fit_options, .. } = self;
        let fitted = fit(arm, &touched.known(), &touched.touches, fit_options).map_err(|e| self.work().within(e))?;
        self.work().accept(&fitted, touched)?;
        Ok(fitted)
    }

    /// Checks the arm against its last fit.
    ///
    /// # Errors
    /// [`Failure`] when the touches do not determine the answer.
    pub(crate) fn check(&self) -> Result<Checked, Failure> {
        let Self { arm, touched, fit_options, .. } = self;
        // If the fit's residual is unknown, only the tip's repeatability limits the residuals.
        let fitted_mm = self.fit_rms_mm.unwrap_or(0.0);
        check(arm, &touched.known(), &touched.touches, fit_options, fitted_mm).map_err(|e| self.work().within(e))
    }

    /// Returns the refusal of an arm that no longer agrees with its calibration.
    pub(crate) fn changed(&self, checked: &Checked) -> Failure {
        let advice = checked.advice();
        self.work().within(format!("the arm no longer agrees with its calibration; {advice}"))
    }
}
