//! Poses of a stylus from a recorded session.

use std::path::Path;

use calibration::frames::{Reference, Stylus, Transform};
use drivers::recording::session::{SessionReplay, SessionSettings};
use drivers::{Device as _, Next, Timing};

use super::{Poses, Recording, Taken};
use crate::cli::Failure;
use crate::cli::live::stages::{Kept, instruments};
use crate::config::bedside::Bedside;
use crate::ingest::live::{Live, LiveIngest};
use crate::pipeline::live::Precedent;
use crate::refusal::{Reason, Refusal};
use crate::sync::history::{PoseHistory, PoseSample};

/// The frame of what carries the tracked ones.
const TRACKER: &str = "Tracker";
const REFERENCE: &str = "Reference";

/// The tracked frames of a session, each with its poses in the tracker's frame.
pub struct Tracks {
    named: Vec<(String, Vec<PoseSample>)>,
    refused: Vec<Refusal>,
    longest_gap_ns: i64,
}

impl Tracks {
    /// None yet, of a bedside's sensors.
    ///
    /// # Errors
    /// [`Failure`] for an arm without kinematics.
    pub fn of(bedside: &Bedside) -> Result<Self, Failure> {
        let [tracking, _] = instruments(bedside)?;
        let named = tracking.frames.iter().map(|[from, _]| (from.clone(), Vec::new())).collect();
        Ok(Self { named, refused: Vec::new(), longest_gap_ns: bedside.pairing.longest_gap_ns })
    }

    /// What the tracker gave, at its time.
    pub fn take(&mut self, live: Live) {
        match live {
            Live::Pose { source, sample, .. } => self.named[source].1.push(sample),
            Live::Refused(refusal) => self.refused.push(refusal),
            _ => {}
        }
    }

    /// Whether there is no pose at all.
    pub fn is_empty(&self) -> bool {
        self.named.iter().all(|(_, samples)| samples.is_empty())
    }

    /// Reads them by the configuration that the session holds, with times by clocks as when it was live.
    fn read(path: &Path) -> Result<Self, Failure> {
        let bedside = Kept::bedside(path, &Precedent::read(path)?)?;
        let mut tracks = Self::of(&bedside)?;
        let [tracking, _] = instruments(&bedside)?;
        let mut replay = SessionReplay::open(&SessionSettings { images: false, ..SessionSettings::new(path) })?;
        let timing = |replay: &SessionReplay| {
            let device = replay.devices().iter().find(|device| device.name == tracking.name);
            device.map_or_else(Timing::default, |device| device.description.timing)
        };
        let mut ingest = LiveIngest::new(tracking.gives, timing(&replay), tracking.latency_ns);
        replay.start()?;
        loop {
            let reading = match replay.next(drivers::NO_DEADLINE)? {
                Next::Reading(reading) => reading,
                Next::Pending => continue,
                Next::End => break,
            };
            if replay.source() != Some(tracking.name.as_str()) {
                continue;
            }
            tracks.take(ingest.take(reading));
        }
        replay.stop()?;
        Ok(tracks)
    }

    /// The poses of a frame, in the tracker's.
    pub fn samples_of(&self, name: &str) -> Option<&[PoseSample]> {
        self.named.iter().find(|(own, _)| own == name).map(|(_, samples)| samples.as_slice())
    }

    fn names(&self) -> String {
        self.named.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ")
    }
}

/// The stylus's poses at the times at which they were measured, the reference's between its own.
pub(super) fn read(recording: &Recording, path: &Path) -> Result<Poses, Failure> {
    Tracks::read(path)?.poses(recording, path)
}

impl Tracks {
    /// The stylus's poses at the times at which they were measured, the reference's between its own; `path` is for sentences.
    ///
    /// # Errors
    /// [`Failure`] where a frame is not tracked, or has no pose that can be used.
    pub fn poses(&self, recording: &Recording, path: &Path) -> Result<Poses, Failure> {
        let within = |problem: String| Failure(format!("{}: {problem}", path.display()));
        let unknown = |name: &str, flag: &str| {
            within(format!("nothing is called {name} in it; it tracks {}: name the frame with {flag}", self.names()))
        };
        let stylus = self.samples_of(&recording.stylus).ok_or_else(|| unknown(&recording.stylus, "--stylus"))?;
        let frame = match &recording.reference {
            Some(name) => name.as_str(),
            None if self.samples_of(REFERENCE).is_some() => REFERENCE,
            None => TRACKER,
        };
        let reference = match frame {
            TRACKER => None,
            name => {
                let samples = self.samples_of(name).ok_or_else(|| unknown(name, "--reference"))?;
                let mut history = PoseHistory::new(samples.len().max(1), self.longest_gap_ns);
                samples.iter().for_each(|sample| history.insert(sample.clone()));
                Some(history)
            }
        };
        let first_ns = self.named.iter().filter_map(|(_, samples)| samples.first()).map(|sample| sample.time_ns).min();
        let mut taken = Taken::new(recording)?;
        for refusal in &self.refused {
            taken.put(0.0, Err(refusal.clone()));
        }
        for (item, sample) in (0..).zip(stylus) {
            let refuse = |reason, detail: String| Err(Refusal::new(item, reason, detail));
            let pose = match (&sample.invalid, &reference) {
                (Some(word), _) => refuse(Reason::PoseInvalid, format!("{} has status {word}", recording.stylus)),
                (None, None) => Ok(sample.pose.affine()),
                (None, Some(history)) => match history.at(sample.time_ns) {
                    Ok(found) => Ok(found.pose().inverse().affine() * sample.pose.affine()),
                    Err(why) => refuse(Reason::PoseMissing, format!("{frame}: {why}")),
                },
            };
            let time_s = (sample.time_ns - first_ns.unwrap_or(sample.time_ns)) as f64 * 1e-9;
            taken.put(time_s, pose.map(Transform::<Reference, Stylus>::from_affine));
        }
        let route = match frame {
            TRACKER => vec![recording.stylus.as_str(), TRACKER],
            name => vec![recording.stylus.as_str(), TRACKER, name],
        };
        taken.poses(path, frame.to_owned(), route.join(" → "))
    }
}
