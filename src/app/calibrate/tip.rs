//! A stylus's tip, from a file.

use std::path::Path;

use glam::DVec3;

use config::Settings as Config;

use crate::failure::Failure;

/// Reads the tip in the frame of its stylus's sensor, mm. `is_given` marks a file that the user
/// named for this.
///
/// # Errors
/// [`Failure`] when the file cannot be read, or does not hold the tip.
pub(crate) fn tip(path: &Path, stylus: &str, is_given: bool) -> Result<DVec3, Failure> {
    let missing = || {
        let hint = if is_given { "measure it with `calibrate pivot`" } else { "give its file with --stylus-tip" };
        Failure::new(format!(
            "{}: lacks the position of the tip of {stylus} (no StylusTipTo{stylus}); {hint}",
            path.display()
        ))
    };
    let text = sonoweave_core::keys::read_text(path, config::MAX_BYTES)?;
    // Our phantom file holds no transforms of a stylus.
    if !is_given && !text.trim_start().starts_with('<') {
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
