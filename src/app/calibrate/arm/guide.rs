//! Advice while an arm's touches are recorded: their number, and how well they determine the
//! arm.

use std::path::{Path, PathBuf};

use calibration::arm::fit::fit;
use calibration::arm::reach::Reach;
use calibration::arm::{Arm, JOINTS};
use config::bedside::Tracking;
use sync::ingest::live::Live;

use super::super::guide::{Advice, Advisor, Guide, lead};
use super::options::Options;
use super::session::role;
use super::work::Work;
use crate::failure::{Failure, Reason};

/// Records the configured arm until its touches determine it well enough.
///
/// # Errors
/// [`Failure`] when the configuration has no arm, or no joints to begin with.
pub(super) fn gathered(path: &Path, options: &Options, advisor: &mut dyn Advisor) -> Result<PathBuf, Failure> {
    let work = Work { options, session: path };
    let gathered = lead(path, &options.gathering, advisor, |bedside| {
        let Tracking::Arm(_) = bedside.tracking else {
            return Err(work.within("has no [arm]; give a session configuration with an arm"));
        };
        let calibration = &bedside.calibration;
        let (arm, _) = work.start(calibration.arm, calibration.arm_fit_rms_mm)?;
        // Reports a bad file now, and not after all touches.
        options.places.read()?;
        Ok((Touching { work, arm, readings: Vec::new(), begin_ns: None }, vec![role(bedside)]))
    })?;
    Ok(gathered.session)
}

/// The touches so far.
struct Touching<'a> {
    work: Work<'a>,
    arm: Arm,
    readings: Vec<(f64, [f64; JOINTS])>,
    begin_ns: Option<i64>,
}

impl Guide for Touching<'_> {
    fn add(&mut self, _: usize, live: Live) {
        if let Live::Pose { sample, .. } = live
            && sample.invalid.is_none()
        {
            let begin_ns = *self.begin_ns.get_or_insert(sample.time_ns);
            self.readings.push(((sample.time_ns - begin_ns) as f64 * 1e-9, sample.pose.position_mm.to_array()));
        }
    }

    fn advise(&mut self) -> Advice {
        if self.readings.is_empty() {
            return Advice::missing("waiting for a homed arm");
        }
        self.fitted_advice().unwrap_or_else(|Failure(Reason { sentence: why, .. })| Advice::missing(why))
    }
}

impl Touching<'_> {
    fn fitted_advice(&self) -> Result<Advice, Failure> {
        let Work { options, session } = self.work;
        let touched = options.which.touches(session, &self.arm, &self.readings, options.places.read()?)?;
        let known = touched.known();
        let fitted = fit(&self.arm, &known, &touched.touches, &self.work.fit_options(&self.arm, &touched))?;
        let most = Reach::of(&fitted).most_mm;
        let message = format!(
            "{}: the tip is known to {most:.2} mm at worst, the goal is {} mm; touch on, with the arm bent differently each time",
            touched.words(),
            options.goal
        );
        Ok(Advice::at((options.goal / most).powi(2), message))
    }
}
