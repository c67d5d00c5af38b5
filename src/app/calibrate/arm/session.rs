//! Joint counts from a recorded session.

use std::path::Path;

use glam::{DQuat, DVec3};

use calibration::arm::{Arm, JOINTS};
use config::bedside::{Bedside, Tracking};
use pipeline::session::{DeviceRole, Latencies, RecordedDecisions, walk};
use sonoweave_core::clock::SECOND;
use sonoweave_core::refusal::{Reason, Refusal};
use sync::history::Rigid;
use sync::ingest::live::{Gives, Live};

use super::super::poses::{Counts, Taken};
use crate::app::live::stages::{Kept, TRACKING};
use crate::failure::Failure;

/// An arm's data in a session.
pub(crate) struct Recorded {
    /// The configured arm, if any.
    pub(crate) arm: Option<Arm>,
    /// Residual of that arm's fit, mm.
    pub(crate) fit_rms_mm: Option<f64>,
    /// Time, s from the first reading, and the joints' counts.
    pub(crate) readings: Vec<(f64, [f64; JOINTS])>,
    /// Counts of used and refused readings.
    pub(crate) counts: Counts,
}

/// Returns an arm role that delivers its joints' counts instead of its tip's pose. Axes
/// that are read one by one are synchronised as in a session.
pub(crate) fn role(bedside: &Bedside) -> DeviceRole {
    let kinematics = |counts: &[f64]| {
        let position_mm = DVec3::from_array(counts.get(..JOINTS)?.try_into().ok()?);
        Some(Rigid { rotation: DQuat::IDENTITY, position_mm })
    };
    DeviceRole {
        name: TRACKING.to_owned(),
        gives: Gives::Arm { joints: JOINTS, kinematics: Box::new(kinematics), reach: Vec::new() },
        frames: Vec::new(),
        latency_ns: bedside.tracking.latency_ns(),
    }
}

/// Reads the counts between two times, s from the recording's beginning.
///
/// # Errors
/// [`Failure`] when the session cannot be read, holds no arm, or holds no counts of a homed arm.
pub(crate) fn read(path: &Path, from: Option<f64>, to: Option<f64>) -> Result<Recorded, Failure> {
    let bedside = Kept::bedside(path, &RecordedDecisions::read(path)?)?;
    let Tracking::Arm(_) = bedside.tracking else {
        fail!("{}: holds no arm; record a session with [arm] in its configuration", path.display());
    };
    let (mut samples, mut refused) = (Vec::new(), Vec::new());
    walk(path, false, vec![role(&bedside)], Latencies::Given, |_, live| match live {
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
