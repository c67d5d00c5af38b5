//! A stylus's tip, from a file.

use std::path::Path;

use glam::DVec3;

use super::super::Failure;
use crate::config::Settings as Config;

/// Where a file says that the tip is in the frame of its stylus's sensor, mm; `asked` tells a file that was named for it from one that was not.
///
/// # Errors
/// [`Failure`] when the file cannot be read, or does not say it.
pub(super) fn tip(path: &Path, stylus: &str, asked: bool) -> Result<DVec3, Failure> {
    let missing = || {
        let hint = if asked { "find it with `calibrate pivot`" } else { "name the file that does with --stylus-tip" };
        Failure(format!(
            "{}: does not say where the tip of {stylus} is (no StylusTipTo{stylus}); {hint}",
            path.display()
        ))
    };
    let text = calibration::file::read_text(path, crate::config::MAX_BYTES)?;
    // Our phantom's file holds no transforms of a stylus.
    if !asked && !text.trim_start().starts_with('<') {
        return Err(missing());
    }
    let known = Config::parse(path, &text, None)?.transforms;
    let found = known.iter().find_map(|t| match (t.from.as_str(), t.to.as_str()) {
        ("StylusTip", to) if to == stylus => Some(t.affine),
        (from, "StylusTip") if from == stylus => Some(t.affine.inverse()),
        _ => None,
    });
    found.map(|affine| affine.translation).ok_or_else(missing)
}
