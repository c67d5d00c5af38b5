//! A probe's calibration by a point, a stylus or a plane.

mod detector;
mod guide;
mod observe;
pub(crate) mod quality;

use std::path::Path;
use std::time::Instant;

use calibration::error::{CalibrationError, ProbeError};
use calibration::probe::target::{Calibration, Seen, Target, calibrate};
use calibration::probe::{Observation, Recording};

use super::super::guide::Advisor;
use super::super::recorded::Recorded;
use super::super::tip::tip;
use super::options::{Method, Options};
use super::recording::Observed;
use super::reproducibility::{Reproducibility, reproducibility};
use crate::app::reporter::Steps;
use crate::failure::Failure;
use observe::{Names, observe};

/// A calibration by one of these targets, and what it is based on.
pub(crate) struct Found {
    target: Target,
    pub(crate) recorded: Recorded,
    seen: Observed<Seen>,
    pub(crate) found: Calibration,
    /// Name of the frame in which the target rests.
    pub(crate) reference: String,
    /// Time to search the images, and to calibrate, s.
    pub(crate) times_s: [f64; 2],
}

impl Options {
    /// Calibrates by a target; `tip_file` holds the stylus's tip, if it is one. Records the scan
    /// first if it is still to be made.
    ///
    /// # Errors
    /// [`Failure`] when the recording does not determine the image plane.
    pub(crate) fn by_target(
        &self,
        tip_file: Option<&Path>,
        advisor: &mut dyn Advisor,
        steps: Steps<'_>,
    ) -> Result<Found, Failure> {
        let Self { method, target: flags, clip, limit, .. } = self;
        let target = match (method, tip_file) {
            (Method::Plane, _) => Target::Plane,
            (_, Some(file)) => Target::Tip { place_mm: tip(file, &flags.stylus, true)?, error_mm: flags.tip_error },
            _ => Target::Point,
        };
        let reference = if tip_file.is_some() { Some(flags.stylus.as_str()) } else { flags.reference.as_deref() };
        let began = Instant::now();
        let names = Names { probe: "Probe", reference };
        let is_plane = target == Target::Plane;
        let second = self.second(advisor)?;
        let made = self
            .gathering
            .of(self.live.as_ref())?
            .map(|path| guide::gathered(path, self, advisor, target, names))
            .transpose()?;
        let recorded = self.recorded(made.as_deref())?;
        let path = recorded.path();
        let within = |problem: String| Failure::new(format!("{}: {problem}", path.display()));
        let (seen, reference) = observe(&recorded, names, *clip, is_plane, steps)?;
        let second = second.map(|second| observe(&second, names, *clip, is_plane, steps)).transpose()?;
        let second = second.map(|(second, _)| second);
        if second.as_ref().is_some_and(|second| second.size_px != seen.size_px) {
            return Err(within(
                "its frames differ in size from the second recording's; give one of the same size".into(),
            ));
        }
        let searched_s = began.elapsed().as_secs_f64();
        let found = calibrate(target, seen.recording(), second.as_ref().map(Observed::recording)).map_err(|e| {
            let disagree = matches!(e, CalibrationError::Probe(ProbeError::Disagree { .. }));
            let clip = if disagree { "; --clip limits the search to a part of the image" } else { "" };
            within(format!("{e}{clip}{}", seen.also()))
        })?;
        if let Some(errors) = &found.validation
            && errors.mean > *limit
        {
            return Err(within(format!(
                "the result is {:.2} mm off on validation frames, more than --limit {limit} mm; keep the target at rest, and metal away from the tracker",
                errors.mean
            )));
        }
        let times_s = [searched_s, began.elapsed().as_secs_f64() - searched_s];
        Ok(Found { target, recorded, seen, found, reference, times_s })
    }
}

impl Found {
    /// Calibrates again without parts of the recording.
    pub(crate) fn reproducibility(&self) -> Option<Reproducibility> {
        let Self { target, seen, found, .. } = self;
        let without = |observations: &[Observation<Seen>]| {
            let recording = Recording { observations, ..seen.recording() };
            Some(calibrate(*target, recording, None).ok()?.refined.plane)
        };
        reproducibility(seen.recording().observations, found.size_px, &found.refined.plane, without)
    }
}
