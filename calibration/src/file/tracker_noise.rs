//! Noise of a tracker's sensors in a calibration file.

use sonoweave_core::keys::{Entry, FileError, Table};

use super::origin::{self, Origin};
use super::values::line;
use crate::tracker::noise::{RestNoise, TrackerNoise};

/// Keys of the noise of a resting sensor.
const REST: [&str; 2] = ["position_mm", "rotation_deg"];

/// Keys of the part of it from one pose to the next.
const FAST: [&str; 2] = ["fast_position_mm", "fast_rotation_deg"];

/// Largest noise, mm and degrees: beyond it poses are useless.
const MOST: [f64; 2] = [10.0, 10.0];

/// Reads the table of a resting sensor's noise: the noise, and its origin.
pub(super) fn of_rest(entry: &Entry<'_>) -> Result<(RestNoise, Origin), FileError> {
    let table = entry.table(&[&REST[..], &FAST, &origin::KEYS].concat())?;
    let has_fast = FAST.iter().any(|key| table.get(key).is_some());
    let fast = has_fast.then(|| read(&table, FAST)).transpose()?;
    Ok((RestNoise { whole: read(&table, REST)?, fast }, Origin::read(&table)?))
}

/// Writes that table.
pub(super) fn write_rest(noise: RestNoise, origin: &Origin, text: &mut String) {
    line(text, format_args!("\n[tracker_noise]"));
    for (keys, noise) in [(REST, Some(noise.whole)), (FAST, noise.fast)] {
        if let Some(TrackerNoise { position_mm, rotation_deg }) = noise {
            line(text, format_args!("{} = {position_mm:?}\n{} = {rotation_deg:?}", keys[0], keys[1]));
        }
    }
    origin.write_day(text);
    origin.write_inputs("tracker_noise", text);
}

/// Reads the noise from two keys of a table.
pub(super) fn read(table: &Table<'_>, keys: [&str; 2]) -> Result<TrackerNoise, FileError> {
    let of = |key: &str, most: f64| {
        let entry = table.need(key)?;
        match entry.number()? {
            number if (0.0..=most).contains(&number) => Ok(number),
            number => Err(entry.error(format!("must lie between 0 and {most}, not at {number}"))),
        }
    };
    Ok(TrackerNoise { position_mm: of(keys[0], MOST[0])?, rotation_deg: of(keys[1], MOST[1])? })
}
