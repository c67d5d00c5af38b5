//! Poses of a stylus from a recorded session.

use std::path::Path;

use calibration::frames::{Reference, Stylus, Transform};
use drivers::recording::session::{SessionReplay, SessionSettings};
use drivers::{Device as _, Next, Timing};

use super::{Poses, Recording, Taken};
use crate::cli::Failure;
use crate::cli::live::stages::{Kept, instruments};
use crate::ingest::live::{Live, LiveIngest};
use crate::pipeline::live::Precedent;
use crate::refusal::{Reason, Refusal};
use crate::sync::history::{PoseHistory, PoseSample};

/// The frame of what carries the tracked ones.
const TRACKER: &str = "Tracker";
const REFERENCE: &str = "Reference";

/// The tracked frames of a session, each with its poses in the tracker's frame.
struct Tracks {
    named: Vec<(String, Vec<PoseSample>)>,
    refused: Vec<Refusal>,
    longest_gap_ns: i64,
}

impl Tracks {
    /// Reads them by the configuration that the session holds, with times by clocks as when it was live.
    fn read(path: &Path) -> Result<Self, Failure> {
        let bedside = Kept::bedside(path, &Precedent::read(path)?)?;
        let [tracking, _] = instruments(&bedside)?;
        let mut replay = SessionReplay::open(&SessionSettings { images: false, ..SessionSettings::new(path) })?;
        let timing = |replay: &SessionReplay| {
            let device = replay.devices().iter().find(|device| device.name == tracking.name);
            device.map_or_else(Timing::default, |device| device.description.timing)
        };
        let named = tracking.frames.iter().map(|[from, _]| (from.clone(), Vec::new())).collect();
        let mut tracks = Self { named, refused: Vec::new(), longest_gap_ns: bedside.pairing.longest_gap_ns };
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
            match ingest.take(reading) {
                Live::Pose { source, sample, .. } => tracks.named[source].1.push(sample),
                Live::Refused(refusal) => tracks.refused.push(refusal),
                _ => {}
            }
        }
        replay.stop()?;
        Ok(tracks)
    }

    fn of(&self, name: &str) -> Option<&[PoseSample]> {
        self.named.iter().find(|(own, _)| own == name).map(|(_, samples)| samples.as_slice())
    }

    fn names(&self) -> String {
        self.named.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ")
    }
}

/// The stylus's poses at the times at which they were measured, the reference's between its own.
pub(super) fn read(recording: &Recording, path: &Path) -> Result<Poses, Failure> {
    let within = |problem: String| Failure(format!("{}: {problem}", path.display()));
    let tracks = Tracks::read(path)?;
    let unknown = |name: &str, flag: &str| {
        within(format!("nothing is called {name} in it; it tracks {}: name the frame with {flag}", tracks.names()))
    };
    let stylus = tracks.of(&recording.stylus).ok_or_else(|| unknown(&recording.stylus, "--stylus"))?;
    let frame = match &recording.reference {
        Some(name) => name.as_str(),
        None if tracks.of(REFERENCE).is_some() => REFERENCE,
        None => TRACKER,
    };
    let reference = match frame {
        TRACKER => None,
        name => {
            let samples = tracks.of(name).ok_or_else(|| unknown(name, "--reference"))?;
            let mut history = PoseHistory::new(samples.len().max(1), tracks.longest_gap_ns);
            samples.iter().for_each(|sample| history.insert(sample.clone()));
            Some(history)
        }
    };
    let first_ns = tracks.named.iter().filter_map(|(_, samples)| samples.first()).map(|sample| sample.time_ns).min();
    let mut taken = Taken::new(recording)?;
    for refusal in &tracks.refused {
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
