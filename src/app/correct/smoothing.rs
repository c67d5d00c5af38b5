//! Correction by smoothing: the poses of a session's sensors over the time before and after each
//! frame. It averages the tracker's white noise out.

use std::path::Path;

use serde_json::json;

use config::bedside::SettingsOverride;
use pipeline::session::RecordedDecisions;

use super::note::{Correction, CorrectionResult, ERROR_RMS_MM, Kind};
use super::poses;
use super::standing::Standing;
use crate::failure::Failure;

/// Smallest share of the frames that must be smoothed.
const LEAST_SHARE: f64 = 0.5;

/// Computes the correction; `half_width_ms` is the time before and after a frame.
///
/// # Errors
/// [`Failure`] when the session cannot be read, or smoothing its poses would gain nothing: the
/// noise is not white, the samples are too few, or the tracker smooths already.
pub(crate) fn compute(session: &Path, half_width_ms: f64) -> Result<Correction, Failure> {
    let decisions = RecordedDecisions::read(session)?;
    let (mut all, before) = Standing::of(session, &decisions)?.before(Kind::Smoothing);
    let settings: SettingsOverride = [
        ("pairing.smoothing_ms".to_owned(), half_width_ms.into()),
        ("pairing.smoothing_ahead_ms".to_owned(), half_width_ms.into()),
        // A frame waits for the poses after it.
        ("pairing.wait_ms".to_owned(), (2.0 * half_width_ms + 500.0).into()),
    ]
    .into();
    all.extend(settings.clone());
    let computed = poses::poses(session, &all)?;
    let Some(account) = &computed.smoothing else {
        fail!(
            "no correction: the poses of an arm are not smoothed, as its encoders have no noise; give a tracker's session"
        );
    };
    if let Some(sensor) = account.sensors.iter().find(|sensor| !sensor.is_white) {
        let [from, to] = &sensor.sensor;
        fail!(
            "no correction: the noise of {from} in {to} is not white (its third differences correlate by {:.2} and \
             {:.2}, and those of white noise by −0.75); smoothing would state too small an error. Switch the tracker's \
             own filter off, and record again",
            sensor.lag_1[0],
            sensor.lag_1[1]
        );
    }
    let left = account.not_smoothed.values().sum::<u64>();
    let share = account.smoothed as f64 / (account.smoothed + left).max(1) as f64;
    if share < LEAST_SHARE {
        let why = account.not_smoothed.iter().max_by_key(|(_, frames)| **frames).map_or("no frame", |(why, _)| *why);
        fail!(
            "no correction: {} of {} frames can be smoothed, most others not ({why}); record poses at a higher rate",
            account.smoothed,
            account.smoothed + left
        );
    }
    let mut evidence = computed.moved(&before)?;
    evidence.insert("smoothed".to_owned(), json!(account.smoothed));
    evidence.insert("not_smoothed".to_owned(), json!(account.not_smoothed));
    evidence.insert(ERROR_RMS_MM.to_owned(), json!(account.error_rms_mm));
    evidence.insert("sensors".to_owned(), json!(account.sensors));
    let result = CorrectionResult::Poses(computed.poses.into_iter().collect());
    Ok(Correction::new(Kind::Smoothing, &before, settings, evidence, result))
}
