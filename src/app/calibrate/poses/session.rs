//! Poses of a stylus from a recorded session.

use std::path::Path;

use config::bedside::devices::{REFERENCE_FRAME, STYLUS_FRAME, TRACKER_FRAME};
use pipeline::session::RecordedDecisions;
use sonoweave_core::frames::{Reference, Stylus, Transform};
use sonoweave_core::refusal::{Reason, Refusal};
use sync::history::{PoseHistory, PoseSample};

use super::super::recorded::Tracks;
use super::options::Recording;
use super::samples::Poses;
use crate::app::live::stages::Kept;
use crate::failure::Failure;

/// Reads the stylus's poses from a session.
pub(super) fn read(recording: &Recording, path: &Path) -> Result<Poses, Failure> {
    let bedside = Kept::bedside(path, &RecordedDecisions::read(path)?)?;
    poses(recording, &Tracks::read(path, &bedside)?, path)
}

/// The sensors of a recording.
struct Tracked<'a> {
    stylus: &'a [PoseSample],
    /// The frame of the poses, and its own history unless it is the tracker's.
    frame: &'a str,
    reference: Option<PoseHistory>,
}

/// Returns the samples of the stylus and of its reference. `path` is for messages.
fn tracked<'a>(recording: &'a Recording, tracks: &'a Tracks, path: &Path) -> Result<Tracked<'a>, Failure> {
    let unknown = |name: &str, flag: &str| {
        let station = match (&recording.source.live, name) {
            (Some(_), STYLUS_FRAME) => ", or give [tracker] stylus_station",
            (Some(_), REFERENCE_FRAME) => ", or give [tracker] reference_station",
            _ => "",
        };
        let (path, names) = (path.display(), tracks.names());
        Failure::new(format!("{path}: holds no frame {name}, only {names}; name the frame with {flag}{station}"))
    };
    let [of_stylus, of_reference] = recording.flags;
    let stylus = tracks.of(&recording.stylus).ok_or_else(|| unknown(&recording.stylus, of_stylus))?;
    let frame = match &recording.reference {
        Some(name) => name.as_str(),
        None if tracks.of(REFERENCE_FRAME).is_some() => REFERENCE_FRAME,
        None => TRACKER_FRAME,
    };
    let reference = match frame {
        TRACKER_FRAME => None,
        name => Some(tracks.history(name).ok_or_else(|| unknown(name, of_reference))?),
    };
    Ok(Tracked { stylus, frame, reference })
}

/// Checks before a recording that its devices and flags can give the stylus's poses.
///
/// # Errors
/// [`Failure`] when a frame is not tracked, or `--from` is not before `--to`.
pub(crate) fn check(recording: &Recording, tracks: &Tracks, path: &Path) -> Result<(), Failure> {
    recording.taken()?;
    tracked(recording, tracks, path).map(|_| ())
}

/// Returns the stylus's poses at their measurement times; the reference is interpolated between
/// its samples. `path` is for messages.
///
/// # Errors
/// [`Failure`] when a frame is not tracked, or has no usable pose.
pub(crate) fn poses(recording: &Recording, tracks: &Tracks, path: &Path) -> Result<Poses, Failure> {
    let Tracked { stylus, frame, reference } = tracked(recording, tracks, path)?;
    let first_ns = tracks.first_ns();
    let mut taken = recording.taken()?;
    for refusal in tracks.refused() {
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
        TRACKER_FRAME => vec![recording.stylus.as_str(), TRACKER_FRAME],
        name => vec![recording.stylus.as_str(), TRACKER_FRAME, name],
    };
    let (poses, counts) = taken.all(path)?;
    Ok(Poses { frame: frame.to_owned(), route: route.join(" → "), poses, counts })
}
