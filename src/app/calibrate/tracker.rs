//! A tracker's noise and its field's distortion, from recordings of its sensors.

mod options;

use std::path::PathBuf;

use glam::DAffine3;

use calibration::error::{CalibrationError, TrackerError};
use calibration::tracker::distortion::{self, Map, Pair};
use calibration::tracker::noise::{self, Noise};

use super::guide::poses::gathered;
use super::guide::{Advice, Advisor};
use super::poses::{Counts, Poses, Recording, poses};
use crate::failure::Failure;
pub(crate) use options::Options;

/// Rest that determines a sensor's noise, s.
const STILL_S: f64 = 10.0;
/// Number of cells in a usual scanning room, at which the guide's progress bar is full.
const USUAL_CELLS: f64 = 200.0;

/// The result of a recording.
pub(crate) struct Found {
    /// The recording's file.
    pub(crate) path: PathBuf,
    pub(crate) counts: Counts,
    pub(crate) result: Measured,
}

/// The noise of one sensor, or the field's distortion by two.
pub(crate) enum Measured {
    Noise(Noise),
    Map(Map),
}

impl Options {
    /// Returns the recording of the sensor, relative to another frame.
    pub(crate) fn recording(&self, reference: &str) -> Recording {
        Recording {
            source: self.source.clone(),
            gathering: self.gathering.clone(),
            stylus: self.sensor.clone(),
            reference: Some(reference.to_owned()),
            flags: ["--sensor", if self.other.is_some() { "--other" } else { "--tracker" }],
            from: self.from,
            to: self.to,
        }
    }

    /// Measures the tracker. Records its sensors first if they are still to be recorded.
    ///
    /// # Errors
    /// [`Failure`] when the recording does not determine the result.
    pub(crate) fn find(&self, advisor: &mut dyn Advisor) -> Result<Found, Failure> {
        let recording = self.recording(&self.tracker);
        let second = self.other.as_deref().map(|other| self.recording(other));
        let made = gathered(&recording, second.as_ref(), advisor, |tracks| match &second {
            None => Ok(stillness(&poses(&recording, tracks, recording.path())?)),
            Some(second) => {
                let one = poses(&recording, tracks, recording.path())?;
                let between = poses(second, tracks, recording.path())?;
                Ok(self.coverage(&self.mapped(&pairs(&one, &between))?))
            }
        })?;
        let recording = made.as_ref();
        let read = recording.read()?;
        let path = recording.path().to_owned();
        let within =
            |e: CalibrationError, counts: &Counts| Failure::new(format!("{}: {e}{}", path.display(), counts.also()));
        let Some(other) = &self.other else {
            let noise = noise(&read).map_err(|e| within(e, &read.counts))?;
            return Ok(Found { path, counts: read.counts, result: Measured::Noise(noise) });
        };
        // The first sensor in the second one's frame, at the same times. This locates the second
        // sensor whenever both were tracked.
        let between = Recording { reference: Some(other.clone()), ..recording.clone() }.read()?;
        let map = self.mapped(&pairs(&read, &between)).map_err(|e| within(e, &between.counts))?;
        Ok(Found { path, counts: between.counts, result: Measured::Map(map) })
    }

    fn mapped(&self, pairs: &[Pair]) -> Result<Map, CalibrationError> {
        distortion::map(pairs, &distortion::Options { cell_mm: self.cell, limit_mm: self.limit })
    }

    /// Returns advice with the covered part of the room.
    fn coverage(&self, map: &Map) -> Advice {
        let cells = map.cells.len();
        let beyond = map.zones.len();
        let message = format!(
            "{cells} cells of {} mm were visited, {beyond} of them beyond {} mm; continue through the scanning area, \
            and end by Ctrl-C",
            self.cell, self.limit
        );
        // Only the operator knows the size of the room, so the progress never reaches 1.
        Advice::at((cells as f64 / USUAL_CELLS).min(0.99), message)
    }
}

/// Returns the noise of a sensor at rest.
fn noise(read: &Poses) -> Result<Noise, CalibrationError> {
    let poses: Vec<DAffine3> = read.poses.iter().map(|(_, pose)| pose.affine()).collect();
    let ends = |(first, last): (&(f64, _), &(f64, _))| last.0 - first.0;
    let seconds = read.poses.first().zip(read.poses.last()).map_or(0.0, ends);
    noise::of(&poses, seconds)
}

/// Returns poses of both sensors at the same times; `between` is the first one's in the frame of
/// the second.
fn pairs(read: &Poses, between: &Poses) -> Vec<Pair> {
    let mut seen = between.poses.iter().peekable();
    let mut pairs = Vec::new();
    for (time_s, one) in &read.poses {
        while seen.next_if(|(earlier, _)| earlier < time_s).is_some() {}
        if let Some((_, other_from_one)) = seen.next_if(|(same, _)| same == time_s) {
            let one = one.affine();
            pairs.push(Pair { one, other: one * other_from_one.affine().inverse() });
        }
    }
    pairs
}

/// Returns advice with the time since the sensor was last moved.
fn stillness(read: &Poses) -> Advice {
    let end_s = read.poses.last().map_or(0.0, |(time_s, _)| *time_s);
    let still = |seconds: f64| {
        let from = read.poses.partition_point(|(time_s, _)| *time_s < end_s - seconds);
        let poses: Vec<DAffine3> = read.poses[from..].iter().map(|(_, pose)| pose.affine()).collect();
        noise::of(&poses, seconds)
    };
    // A slow tracker gives too few poses in a second to judge; this does not count as motion.
    let lies = |seconds: &f64| {
        *seconds <= end_s && !matches!(still(*seconds), Err(CalibrationError::Tracker(TrackerError::Moved { .. })))
    };
    let whole = (1..=STILL_S as u32).map(f64::from).take_while(lies);
    let seconds = whole.last().unwrap_or(0.0);
    let message =
        format!("the sensor lies still for {seconds:.0} of {STILL_S:.0} s; lay it down, let go of it, and keep away");
    Advice { from_s: Some(end_s - seconds), ..Advice::at(seconds / STILL_S, message) }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use glam::DVec3;
    use sonoweave_core::frames::Transform;

    use super::*;

    /// Returns poses of a sensor that is carried for five seconds and then laid down, at
    /// `rate_hz`.
    fn laid(rate_hz: u32, seconds: u32) -> Poses {
        let pose = |n: u32| {
            let time_s = f64::from(n) / f64::from(rate_hz);
            let at = DVec3::X * 40.0 * (5.0 - time_s).max(0.0);
            (time_s, Transform::from_affine(DAffine3::from_translation(at)))
        };
        let poses: Vec<_> = (0..=rate_hz * seconds).map(pose).collect();
        let counts = Counts { read: 0, usable: 0, refused: BTreeMap::new(), first_refusal: None };
        Poses { frame: "Tracker".into(), route: String::new(), poses, counts }
    }

    #[test]
    fn stillness_counts_from_sensor_laid_down() {
        for rate_hz in [10, 60, 240] {
            let early = stillness(&laid(rate_hz, 9));
            assert!((early.share - 0.4).abs() < 1e-9, "{rate_hz}: {early:?}");
            let enough = stillness(&laid(rate_hz, 16));
            assert!(enough.share >= 1.0 && (enough.from_s.unwrap() - 6.0).abs() < 1e-9, "{rate_hz}: {enough:?}");
        }
        assert!(stillness(&laid(60, 4)).share < 0.1);
    }
}
