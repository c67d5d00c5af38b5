//! Latencies in a calibration file.

use std::fmt::Write as _;

use serde::Serialize;

use sonoweave_core::keys::{Entry, FileError};

use super::origin::{self, Origin};

/// Delays of the devices' times after their measurements, beyond those that the drivers know;
/// ms.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Latency {
    /// Latency of the video frames.
    pub video_ms: f64,
    /// Latency of the poses. Its excess over `video_ms` is the lag, which alone affects the
    /// slices' positions.
    pub tracker_ms: f64,
    /// Standard error of the lag, if known.
    pub lag_se_ms: Option<f64>,
}

/// Limit of a latency, ms; a session configuration has the same limit.
const MOST_MS: f64 = 1000.0;

/// Reads the table: the latencies, and their origin.
pub(super) fn read(entry: &Entry<'_>) -> Result<(Latency, Origin), FileError> {
    let own = ["video_ms", "tracker_ms", "lag_se_ms"];
    let table = entry.table(&[&own[..], &origin::KEYS].concat())?;
    let of = |key| {
        let entry = table.need(key)?;
        let ms = entry.number()?;
        match ms.abs() <= MOST_MS {
            true => Ok(ms),
            false => Err(entry.error(format!("must lie between -{MOST_MS} and {MOST_MS}, not at {ms}"))),
        }
    };
    let (video_ms, tracker_ms) = (of("video_ms")?, of("tracker_ms")?);
    let lag_se_ms = match table.get("lag_se_ms") {
        None => None,
        Some(entry) => match entry.number()? {
            ms if ms >= 0.0 => Some(ms),
            ms => return Err(entry.error(format!("must be 0 or more, not {ms}"))),
        },
    };
    Ok((Latency { video_ms, tracker_ms, lag_se_ms }, Origin::read(&table)?))
}

/// Writes the table.
pub(super) fn write(latency: &Latency, origin: &Origin, text: &mut String) {
    let Latency { video_ms, tracker_ms, lag_se_ms } = latency;
    // Writing to a String cannot fail.
    let _ = writeln!(text, "\n[latency]\nvideo_ms = {video_ms:?}\ntracker_ms = {tracker_ms:?}");
    if let Some(ms) = lag_se_ms {
        let _ = writeln!(text, "lag_se_ms = {ms:?}");
    }
    origin.write_day(text);
    origin.write_inputs("latency", text);
}
