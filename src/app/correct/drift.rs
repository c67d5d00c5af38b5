//! Correction of slow drift, found by sweeps of the session that cross.

use std::path::Path;

use serde_json::json;

use super::note::{Correction, CorrectionResult, Kind};
use super::poses::{Computed, rows_of};
use super::slices::{Before, Read};
use crate::failure::Failure;

/// Most slices that are compared: pairs of more take longer than they are worth.
const MOST_SLICES: usize = 1000;

/// Computes the correction.
///
/// # Errors
/// [`Failure`] when the session cannot be read, its sweeps do not cross, or they agree without it.
pub(crate) fn compute(session: &Path) -> Result<Correction, Failure> {
    let before = Before::of(session, Kind::Drift)?;
    let (computed, mut evidence) = poses(session, &before)?;
    evidence.extend(computed.moved(&before.poses)?);
    let result = CorrectionResult::Poses(computed.poses.into_iter().collect());
    Ok(Correction::new(Kind::Drift, &before.poses, [].into(), evidence, result))
}

/// Returns the poses without drift, and the numbers by which they are judged. Frames between sweeps
/// have none.
///
/// # Errors
/// As of [`compute`].
pub(super) fn poses(
    session: &Path,
    before: &Before,
) -> Result<(Computed, serde_json::Map<String, serde_json::Value>), Failure> {
    let Read { slices, size, .. } = before.read(session, MOST_SLICES)?;
    let drift = slices.drift().map_err(|why| Failure::new(format!("no correction: {why}")))?;
    let corrected = before.frames.iter().filter_map(|(frame, time_s, world_from_image)| {
        Some((*frame, rows_of(drift.corrected(*time_s, *world_from_image, before.probe_from_image)?)))
    });
    let evidence = json!({
        "sweeps": drift.sweeps.len(),
        "lines": drift.lines,
        "shift_mm": [drift.shift_mm, drift.shift_se_mm],
        "correlation": drift.correlations,
    });
    let computed = Computed { poses: corrected.collect(), size, smoothing: None };
    Ok((computed, evidence.as_object().cloned().unwrap_or_default()))
}
