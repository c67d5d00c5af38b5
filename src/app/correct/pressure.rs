//! Correction of the compression of tissue by the probe, against a sweep of the session with light
//! contact.

use std::path::Path;

use serde_json::{Map, Value, json};

use calibration::pressure::NEAR_MM;

use super::note::{Compressions, Correction, CorrectionResult, Kind};
use super::options::{PressureSettings, Stored as _};
use super::slices::{Before, Read};
use crate::failure::Failure;

/// Computes the correction, against the sweep of this number, from 1.
///
/// # Errors
/// [`Failure`] when the session cannot be read, its sweeps do not show pressure, or there is no
/// sweep of this number: it then lists the sweeps.
pub(crate) fn compute(session: &Path, light: usize) -> Result<Correction, Failure> {
    let before = Before::of(session, Kind::Pressure)?;
    let settings = PressureSettings { light, near_mm: NEAR_MM };
    let (compressions, evidence) = compressions(session, &before, settings)?;
    let result = CorrectionResult::Compressions(compressions);
    Ok(Correction::new(Kind::Pressure, &before.poses, settings.stored()?, evidence, result))
}

/// Returns the compressions, and the numbers by which they are judged.
///
/// # Errors
/// As of [`compute`].
pub(super) fn compressions(
    session: &Path,
    before: &Before,
    settings: PressureSettings,
) -> Result<(Compressions, Map<String, Value>), Failure> {
    let Read { slices, numbers, top_row, .. } = before.read_all(session)?;
    let PressureSettings { light, near_mm } = settings;
    let pressure = slices.pressure(light, near_mm).map_err(|why| Failure::new(format!("no correction: {why}")))?;
    // Depths count from the first row with data.
    let top_mm = f64::from(top_row) * before.probe_from_image.matrix3.y_axis.length();
    let found = numbers.into_iter().zip(&pressure.compressions).filter_map(|(number, compression)| {
        let knots = compression.as_ref()?.knots_mm().iter().map(|[depth, by]| [depth + top_mm, *by]);
        Some((number, knots.collect()))
    });
    let mut evidence = json!(pressure.evidence).as_object().cloned().unwrap_or_default();
    evidence.insert("frames_before".to_owned(), json!(before.poses.len()));
    Ok((found.collect(), evidence))
}
