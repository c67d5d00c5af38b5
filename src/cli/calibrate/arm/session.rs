//! Joints' counts from a recorded session.

use std::path::Path;

use calibration::arm::{Arm, JOINTS};
use drivers::clock::SECOND;
use glam::{DQuat, DVec3};

use super::super::poses::{Counts, Taken};
use crate::cli::Failure;
use crate::cli::live::stages::{Kept, TRACKING};
use crate::config::bedside::{Bedside, Tracking};
use crate::ingest::live::{Gives, Live};
use crate::pipeline::live::{Instrument, Latencies, Precedent, walk};
use crate::refusal::{Reason, Refusal};
use crate::sync::history::Rigid;

/// What a session says of an arm.
pub(super) struct Recorded {
    /// The arm that it was configured by, if it was.
    pub(super) arm: Option<Arm>,
    /// What that arm's fit left, mm.
    pub(super) fit_rms_mm: Option<f64>,
    /// When, s from the first reading on, and the joints' counts.
    pub(super) readings: Vec<(f64, [f64; JOINTS])>,
    /// What became of what was recorded.
    pub(super) counts: Counts,
}

/// An arm that gives its joints' counts in the place of its tip's: axes that are read one by one are brought together as in a session.
pub(super) fn instrument(bedside: &Bedside) -> Instrument {
    let kinematics = |counts: &[f64]| {
        let position_mm = DVec3::from_array(counts.get(..JOINTS)?.try_into().ok()?);
        Some(Rigid { rotation: DQuat::IDENTITY, position_mm })
    };
    Instrument {
        name: TRACKING.to_owned(),
        gives: Gives::Arm { joints: JOINTS, kinematics: Box::new(kinematics) },
        frames: Vec::new(),
        latency_ns: bedside.tracking.latency_ns(),
    }
}

/// Reads the counts between two times, s from the recording's beginning.
///
/// # Errors
/// [`Failure`] when it cannot be read, holds no arm, or no counts of one that is homed.
pub(super) fn read(path: &Path, from: Option<f64>, to: Option<f64>) -> Result<Recorded, Failure> {
    let bedside = Kept::bedside(path, &Precedent::read(path)?)?;
    let Tracking::Arm(_) = bedside.tracking else {
        return Err(Failure(format!(
            "{}: holds no arm, as a tracker carried the probe; record a session whose configuration has [arm]",
            path.display()
        )));
    };
    let (mut samples, mut refused) = (Vec::new(), Vec::new());
    walk(path, false, vec![instrument(&bedside)], Latencies::Given, |_, live| match live {
        Live::Pose { sample, .. } => samples.push(sample),
        Live::Refused(refusal) => refused.push(refusal),
        _ => {}
    })?;
    let mut taken = Taken::new("readings of the arm", from, to)?;
    for refusal in refused {
        taken.put(0.0, Err(refusal));
    }
    let first_ns = samples.first().map_or(0, |sample| sample.time_ns);
    for (item, sample) in (0..).zip(samples) {
        let time_s = (sample.time_ns - first_ns) as f64 / SECOND as f64;
        taken.put(
            time_s,
            match &sample.invalid {
                Some(word) => Err(Refusal::new(item, Reason::PoseInvalid, word.to_string())),
                None => Ok(sample.pose.position_mm.to_array()),
            },
        );
    }
    let (readings, counts) = taken.all(path)?;
    let settings = bedside.calibration;
    Ok(Recorded { arm: settings.arm, fit_rms_mm: settings.arm_fit_rms_mm, readings, counts })
}
