//! Correction of the calibration and the latency, found by slices of the session that cross.

use std::path::Path;

use serde_json::{Map, Value, json};

use config::bedside::{SettingsOverride, Tracking};
use pipeline::session::RecordedDecisions;
use sonoweave_core::frames::{Image, Probe, Transform};

use super::note::{Correction, CorrectionResult, Kind};
use super::poses::{self, IMAGE_TO_PROBE};
use super::standing::Standing;
use crate::app::calibrate::crossings::Options;
use crate::app::live::stages::Kept;
use crate::failure::Failure;

/// Computes the correction.
///
/// # Errors
/// [`Failure`] when the session cannot be read, its sweeps do not determine a calibration, or the
/// one that it was recorded with holds.
pub(crate) fn compute(session: &Path) -> Result<Correction, Failure> {
    let decisions = RecordedDecisions::read(session)?;
    let (mut all, before) = Standing::of(session, &decisions)?.before(Kind::Calibration);
    if !decisions.notes("latency").is_empty() {
        fail!("no correction: a latency was changed while {} was recorded; record another session", session.display());
    }
    let found = Options::of_session(session).find()?;
    let checked = &found.checked;
    if let Some(why) = checked.unfit() {
        fail!("no correction: {why}");
    }
    if !checked.has_slipped() && !checked.is_late() {
        fail!(
            "no correction: the calibration holds, within {:.2} ± {:.2} mm; keep it",
            checked.shift_mm,
            checked.shift_se_mm
        );
    }
    let mut settings = SettingsOverride::new();
    let image_to_probe: Transform<Probe, Image> = Transform::from_affine(found.probe_from_image);
    settings.insert(IMAGE_TO_PROBE.to_owned(), json!(image_to_probe.to_rows()));
    if let Some([_, tracker_ms]) = found.in_use_ms {
        let section = match Kept::bedside(session, &decisions)?.tracking {
            Tracking::Tracker(_) => "tracker",
            Tracking::Arm(_) => "arm",
            Tracking::Remote(_) => "remote",
        };
        settings.insert(format!("{section}.latency_ms"), json!(tracker_ms + 1e3 * checked.lag_s[0]));
    }
    all.extend(settings.clone());
    let computed = poses::poses(session, &all)?;
    let mut evidence = computed.moved(&before)?;
    let checks: Map<String, Value> = [
        ("shift_mm", json!([checked.shift_mm, checked.shift_se_mm])),
        ("worst_se_mm", json!(checked.worst_se_mm)),
        ("lag_ms", json!(checked.lag_s.map(|s| 1e3 * s))),
        ("correlation", json!(checked.correlations)),
    ]
    .map(|(name, value)| (name.to_owned(), value))
    .into_iter()
    .collect();
    evidence.extend(checks);
    let result = CorrectionResult::Poses(computed.poses.into_iter().collect());
    Ok(Correction::new(Kind::Calibration, &before, settings, evidence, result))
}
