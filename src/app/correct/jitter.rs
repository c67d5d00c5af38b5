//! Correction of frames within their planes, by the images of their neighbours.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::{Map, Value, json};

use super::note::{Correction, CorrectionResult, Kind};
use super::poses::{Computed, Poses, rows_of};
use super::slices::{Before, Read};
use crate::failure::Failure;

/// Computes the correction.
///
/// # Errors
/// [`Failure`] when the session cannot be read, the tracker's noise is unknown, or the images do
/// not show it.
pub(crate) fn compute(session: &Path) -> Result<Correction, Failure> {
    let before = Before::of(session, Kind::Jitter)?;
    let (computed, mut evidence) = poses(session, &before)?;
    evidence.extend(computed.moved(&before.poses)?);
    let result = CorrectionResult::Poses(computed.poses.into_iter().collect());
    Ok(Correction::new(Kind::Jitter, &before.poses, [].into(), evidence, result))
}

/// Returns the corrected poses, and the numbers by which they are judged.
///
/// # Errors
/// As of [`compute`].
pub(super) fn poses(session: &Path, before: &Before) -> Result<(Computed, Map<String, Value>), Failure> {
    if before.settings.keys().any(|key| key.starts_with("pairing.smoothing")) {
        fail!("no correction: the poses are smoothed, which corrects more; keep that, or undo it before this one");
    }
    let Some(noise) = before.bedside.sensor_noise() else {
        fail!("no correction: the noise of the tracker is unknown; run `sonoweave calibrate tracker` before recording")
    };
    let Read { slices, numbers, size, .. } = before.read_all(session)?;
    let jitter = slices.jitter(noise).map_err(|why| Failure::new(format!("no correction: {why}")))?;
    let places: BTreeMap<u64, usize> = numbers.iter().copied().zip(0..).collect();
    let corrected: Poses = before
        .frames
        .iter()
        .map(|(frame, _, world_from_image)| {
            let slice = places.get(frame);
            (*frame, rows_of(slice.map_or(*world_from_image, |slice| jitter.corrected(*slice, *world_from_image))))
        })
        .collect();
    let evidence = json!({
        "corrected": jitter.corrected,
        "differences": jitter.differences,
        "held_out": jitter.fall(),
        "correlation": jitter.correlation,
        "chi2": jitter.chi2,
    });
    let computed = Computed { poses: corrected, size, smoothing: None };
    Ok((computed, evidence.as_object().cloned().unwrap_or_default()))
}
