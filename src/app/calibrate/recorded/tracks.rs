//! Poses of a session's sensors.

use std::path::Path;

use calibration::probe::track::{Poses, Track};
use config::bedside::Bedside;
use config::bedside::devices::TRACKER_FRAME;
use pipeline::session::{DeviceRole, Latencies, walk};
use sonoweave_core::frames::Transform;
use sonoweave_core::refusal::Refusal;
use sync::history::{PoseHistory, PoseSample};
use sync::ingest::live::Live;

use super::times::seconds;
use crate::app::live::stages::roles;
use crate::failure::Failure;

/// Index of the grabber among a session's roles.
pub(crate) const GRABBER: usize = 1;

/// The tracked frames of a session, each with its poses in the tracker's frame, by the session's
/// clocks and without latency correction.
pub(crate) struct Tracks {
    named: Vec<(String, Vec<PoseSample>)>,
    refused: Vec<Refusal>,
    pictures: u64,
    longest_gap_ns: i64,
}

impl Tracks {
    /// Creates empty tracks for the devices of a session.
    pub(crate) fn of_roles(roles: &[DeviceRole], bedside: &Bedside) -> Self {
        let frames = roles.iter().flat_map(|role| &role.frames);
        let named = frames.map(|[from, _]| (from.clone(), Vec::new())).collect();
        Self { named, refused: Vec::new(), pictures: 0, longest_gap_ns: bedside.pairing.longest_gap_ns }
    }

    /// Reads the tracks of a recording.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read.
    pub(crate) fn read(path: &Path, bedside: &Bedside) -> Result<Self, Failure> {
        let roles = without_latency(bedside)?;
        let mut tracks = Self::of_roles(&roles, bedside);
        walk(path, false, roles, Latencies::Given, |device, live| tracks.add(device, live))?;
        Ok(tracks)
    }

    /// Takes a sample of the device with the given index.
    pub(crate) fn add(&mut self, device: usize, live: Live) {
        match live {
            _ if device == GRABBER => self.pictures += 1,
            Live::Pose { source, sample, .. } => self.named[source].1.push(sample),
            Live::Refused(refusal) => self.refused.push(refusal),
            _ => {}
        }
    }

    /// Whether there is no pose at all.
    pub(crate) fn is_empty(&self) -> bool {
        self.named.iter().all(|(_, samples)| samples.is_empty())
    }

    /// Returns the first time over all frames, ns.
    pub(crate) fn first_ns(&self) -> Option<i64> {
        self.named.iter().filter_map(|(_, samples)| samples.first()).map(|sample| sample.time_ns).min()
    }

    /// Returns the refused readings.
    pub(crate) fn refused(&self) -> &[Refusal] {
        &self.refused
    }

    /// Returns the number of images recorded with them.
    pub(super) fn pictures(&self) -> u64 {
        self.pictures
    }

    /// Returns a frame's poses, including the invalid ones; `None` for an unknown name.
    pub(crate) fn of(&self, name: &str) -> Option<&[PoseSample]> {
        self.named.iter().find(|(own, _)| own == name).map(|(_, samples)| samples.as_slice())
    }

    /// Returns the same poses as a history by time.
    pub(crate) fn history(&self, name: &str) -> Option<PoseHistory> {
        let samples = self.of(name)?;
        let mut history = PoseHistory::new(samples.len(), self.longest_gap_ns);
        samples.iter().for_each(|sample| history.insert(sample.clone()));
        Some(history)
    }

    /// Returns the names of the tracked frames.
    pub(crate) fn names(&self) -> String {
        self.named.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ")
    }

    /// Returns a sensor's valid poses, with the reference's at the same times.
    ///
    /// # Errors
    /// A sentence when one of them is not tracked.
    pub(crate) fn track(&self, sensor: &str, reference: &str) -> Result<Track, String> {
        let named = |name: &str, what: &str| {
            self.history(name).ok_or_else(|| format!("holds no frame {name}, {what}, only {}", self.names()))
        };
        let own = named(sensor, "the sensor of the probe")?;
        let other = match reference {
            TRACKER_FRAME => None,
            name => Some(named(name, "in which the target rests")?),
        };
        let poses = self.of(sensor).unwrap_or_default().iter().filter_map(|sample| {
            let at = |history: &PoseHistory| Some(history.at(sample.time_ns).ok()?.pose().affine());
            Some(Poses {
                time_s: seconds(sample.time_ns),
                tracker_from_probe: Transform::from_affine(at(&own)?),
                tracker_from_reference: match &other {
                    None => None,
                    Some(other) => Some(Transform::from_affine(at(other)?)),
                },
            })
        });
        Ok(Track::new(poses.collect()).with_longest_gap(seconds(self.longest_gap_ns)))
    }
}

/// Returns a session's devices with zero latency: the search is for the whole latency.
pub(crate) fn without_latency(bedside: &Bedside) -> Result<Vec<DeviceRole>, Failure> {
    let roles = roles(bedside)?;
    Ok(roles.into_iter().map(|role| DeviceRole { latency_ns: 0, ..role }).collect())
}
