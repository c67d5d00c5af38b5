//! Kinds of configuration files, determined by their content.

use std::path::Path;

use sonoweave_core::keys::Source;

use crate::bedside::schema;
use crate::error::Error;

/// Size above which files are refused unread, bytes. PLUS's calibration results hold every
/// frame's points: about 1 MB.
pub const MAX_BYTES: u64 = 16 << 20;

/// Kind of a configuration file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Our own calibration file.
    Calibration,
    /// A session configuration.
    Bedside,
    /// A PLUS configuration or calibration result.
    Plus,
    /// Other TOML, or TOML without a format.
    Other,
}

/// Determines a text's kind by its content.
///
/// # Errors
/// [`Error`] when it is neither XML nor TOML.
pub fn kind_of(path: &Path, text: &str) -> Result<Kind, Error> {
    // TOML cannot begin with '<', and XML always does.
    if text.trim_start().starts_with('<') {
        return Ok(Kind::Plus);
    }
    let parsed = Source { path, text }.parse()?;
    let format = parsed.get_ref().get("format").and_then(|value| value.get_ref().as_str());
    Ok(match format {
        Some(schema::FORMAT) => Kind::Bedside,
        Some(calibration::file::FORMAT) => Kind::Calibration,
        _ => Kind::Other,
    })
}
