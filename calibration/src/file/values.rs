//! Values that stand both in the file itself and in its presets: their text, read and written.

use std::fmt::Write as _;

use sonoweave_core::keys::{Entry, FileError};
use sonoweave_core::region::{ClipRect, Fan};

/// Reads a clip rectangle.
pub(super) fn clip(entry: &Entry<'_>) -> Result<ClipRect, FileError> {
    let table = entry.table(&["x", "y", "width", "height"])?;
    let whole = |key| table.need(key)?.whole();
    ClipRect::new(whole("x")?, whole("y")?, whole("width")?, whole("height")?).map_err(|e| entry.error(e.to_string()))
}

/// Reads a fan.
pub(super) fn fan(entry: &Entry<'_>) -> Result<Fan, FileError> {
    let table = entry.table(&["origin_px", "radii_px", "angles_deg"])?;
    let pair = |key| table.need(key)?.numbers();
    Fan::new(pair("origin_px")?, pair("radii_px")?, pair("angles_deg")?).map_err(|e| entry.error(e.to_string()))
}

/// Returns a matrix as a list with a line for each row.
pub(super) fn matrix_text(rows: &[f64; 16]) -> String {
    let mut text = String::from("[\n");
    for row in rows.chunks_exact(4) {
        line(&mut text, format_args!("    {:?}, {:?}, {:?}, {:?},", row[0], row[1], row[2], row[3]));
    }
    text.push(']');
    text
}

/// Adds a line of text.
pub(super) fn line(text: &mut String, content: std::fmt::Arguments<'_>) {
    // Writing to a String cannot fail.
    let _ = writeln!(text, "{content}");
}
