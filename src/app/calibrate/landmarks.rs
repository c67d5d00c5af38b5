//! A phantom's pose, from touches of its landmarks.

use std::borrow::Cow;
use std::path::Path;

use glam::DVec3;

use calibration::error::CalibrationError;
use calibration::landmarks::{Reading, Registered, Settings, check, register};
use calibration::phantom::Landmark;
use config::phantom::PhantomSettings;

use super::guide::poses::gathered;
use super::guide::{Advice, Advisor};
use super::poses::{Poses, Recording, poses};
pub(crate) use super::tip::tip;
use crate::failure::Failure;

/// A phantom, and the stylus that touches its landmarks.
pub(crate) struct Touches<'a> {
    pub(crate) phantom: &'a PhantomSettings,
    /// The phantom's file.
    pub(crate) file: &'a Path,
    /// The tip in the frame of the stylus's sensor.
    pub(crate) tip_mm: DVec3,
    /// Its error, mm.
    pub(crate) tip_error_mm: f64,
    /// Landmarks that are off by more are refused, mm (root mean square).
    pub(crate) limit_mm: f64,
}

/// A phantom's pose, and what it is based on.
pub(crate) struct Found<'a> {
    pub(crate) recording: Cow<'a, Recording>,
    pub(crate) read: Poses,
    pub(crate) registered: Registered,
    /// Predicted error of the phantom's centre and of its worst point, mm.
    pub(crate) predicted: [f64; 2],
}

impl Touches<'_> {
    /// Finds the phantom's pose in a recording, which is made first if it is still to be made.
    ///
    /// # Errors
    /// [`Failure`] when the recording does not determine the pose.
    pub(crate) fn find<'a>(&self, recording: &'a Recording, advisor: &mut dyn Advisor) -> Result<Found<'a>, Failure> {
        let landmarks = self.phantom.geometry.landmarks();
        check(landmarks).map_err(|e| Failure::new(format!("{}: {e}", self.file.display())))?;
        let recording = gathered(recording, None, advisor, |tracks| {
            Ok(advice(&self.registered(&poses(recording, tracks, recording.path())?)?, landmarks))
        })?;
        let read = recording.read()?;
        let within =
            |e: CalibrationError| Failure::new(format!("{}: {e}{}", recording.path().display(), read.counts.also()));
        let registered = self.registered(&read).map_err(within)?;
        let predicted = predicted(&registered, self.phantom);
        Ok(Found { recording, read, registered, predicted })
    }

    fn registered(&self, read: &Poses) -> Result<Registered, CalibrationError> {
        let accepted = Settings { tip_error_mm: self.tip_error_mm, limit_mm: self.limit_mm, ..Settings::default() };
        let reading = |(time_s, pose): &(f64, _)| Reading { time_s: *time_s, reference_from_stylus: *pose };
        let readings: Vec<Reading> = read.poses.iter().map(reading).collect();
        register(&readings, self.tip_mm, self.phantom.geometry.landmarks(), &accepted)
    }
}

/// Returns the advice on the landmarks to touch next.
fn advice(registered: &Registered, landmarks: &[Landmark]) -> Advice {
    let touched = registered.touched.len();
    let missed: Vec<&str> = registered.missed.iter().map(|missed| landmarks[*missed].name.as_str()).collect();
    let next = match missed.as_slice() {
        [] => String::new(),
        missed => format!("; touch {}, each for two seconds", missed.join(", ")),
    };
    let message = format!(
        "{touched} of {} landmarks are touched, {:.2} mm off (rms){next}",
        landmarks.len(),
        registered.error_mm.rms
    );
    Advice::at(touched as f64 / landmarks.len() as f64, message)
}

/// Returns the predicted registration error of the phantom's centre and of its worst point, mm.
fn predicted(registered: &Registered, phantom: &PhantomSettings) -> [f64; 2] {
    let wires = phantom.geometry.wires().iter().flat_map(|wire| wire.ends_mm);
    let points: Vec<DVec3> =
        wires.chain(phantom.geometry.landmarks().iter().map(|landmark| landmark.position_mm)).collect();
    let middle = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    [registered.sd_at(middle), points.into_iter().map(|point| registered.sd_at(point)).fold(0.0, f64::max)]
}
