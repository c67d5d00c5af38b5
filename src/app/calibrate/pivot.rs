//! A stylus's tip, from a recording of its swings.

use std::borrow::Cow;

use calibration::error::CalibrationError;
use calibration::pivot::{Pivot, Settings, calibrate};
use sonoweave_core::frames::{Reference, Stylus, Transform};

use super::guide::poses::gathered;
use super::guide::{Advice, Advisor};
use super::poses::{Poses, Recording, poses};
use crate::failure::Failure;

/// Shortest recording, s. A slip of the tip shows only in the samples after it.
const LEAST_S: f64 = 10.0;

/// Limits of a tip's error, mm.
pub(crate) struct Swings {
    /// A tip that strays by more is refused (root mean square).
    pub(crate) limit_mm: f64,
    /// Standard deviation at which a recording has enough.
    pub(crate) goal_mm: f64,
}

/// A tip, and what it is based on.
pub(crate) struct Found<'a> {
    pub(crate) recording: Cow<'a, Recording>,
    pub(crate) read: Poses,
    pub(crate) pivot: Pivot,
}

impl Swings {
    /// Finds the tip in a recording, which is made first if it is still to be made.
    ///
    /// # Errors
    /// [`Failure`] when the recording does not determine the tip.
    pub(crate) fn find<'a>(&self, recording: &'a Recording, advisor: &mut dyn Advisor) -> Result<Found<'a>, Failure> {
        let recording =
            gathered(recording, None, advisor, |tracks| self.advice(&poses(recording, tracks, recording.path())?))?;
        let read = recording.read()?;
        let within =
            |e: CalibrationError| Failure::new(format!("{}: {e}{}", recording.path().display(), read.counts.also()));
        let pivot = self.tip(&read).map_err(within)?;
        Ok(Found { recording, read, pivot })
    }

    fn tip(&self, read: &Poses) -> Result<Pivot, CalibrationError> {
        let poses: Vec<Transform<Reference, Stylus>> = read.poses.iter().map(|(_, pose)| *pose).collect();
        calibrate(&poses, &Settings { limit_mm: self.limit_mm, ..Settings::default() })
    }

    /// Returns the next advice from the tip so far.
    fn advice(&self, read: &Poses) -> Result<Advice, Failure> {
        let pivot = self.tip(read)?;
        let worst = sds(&pivot).into_iter().fold(0.0, f64::max);
        let seconds = read.poses.last().map_or(0.0, |(time_s, _)| *time_s);
        let share = (self.goal_mm / worst).powi(2).min(seconds / LEAST_S);
        let message = format!(
            "the tip is known to {worst:.3} mm, the goal is {} mm, after {seconds:.0} s of at least {LEAST_S:.0}; swing on to all sides, with the tip in its place",
            self.goal_mm
        );
        Ok(Advice::at(share, message))
    }
}

/// Returns the tip's standard deviations, mm.
pub(crate) fn sds(pivot: &Pivot) -> [f64; 3] {
    [0, 1, 2].map(|i| pivot.tip_covariance_mm2[i][i].sqrt())
}
