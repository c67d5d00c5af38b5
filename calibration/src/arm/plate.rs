//! File format of a plate with divots at known places.
//!
//! ```toml
//! format = "sonoweave-plate"
//! version = 1
//! # places on the plate, in the plane that the arm moves in
//! divots_mm = [[0.0, 0.0], [60.0, 0.0], [120.0, 0.0], [0.0, 60.0]]
//! ```

use std::path::Path;

use glam::DVec2;

use sonoweave_core::keys::{FileError, Source, Table};

/// The value of `format`.
pub const FORMAT: &str = "sonoweave-plate";
/// The supported version.
const VERSION: u32 = 1;
/// Size limit in bytes; larger files are refused unread.
const MAX_BYTES: u64 = 1 << 20;

/// Reads the places of a plate's divots, mm.
///
/// # Errors
/// [`FileError`]: unreadable, not TOML, or a key that is unknown, missing or out of range.
pub fn read(path: &Path) -> Result<Vec<DVec2>, FileError> {
    parse(path, &sonoweave_core::keys::read_text(path, MAX_BYTES)?)
}

/// Parses a file's text; `path` is for error messages only.
///
/// # Errors
/// The same as for [`read`], except for I/O.
pub fn parse(path: &Path, text: &str) -> Result<Vec<DVec2>, FileError> {
    let source = Source { path, text };
    let parsed = source.parse()?;
    let format = Table::bare(source, &parsed).need("format")?;
    if format.text()? != FORMAT {
        return Err(format.error(format!("must be \"{FORMAT}\" for a plate with divots")));
    }
    let root = Table::root(source, &parsed, &["format", "version", "divots_mm"])?;
    let version = root.need("version")?;
    if version.whole()? != VERSION {
        return Err(version.error(format!("must be {VERSION}, the version that this program reads")));
    }
    let list = root.need("divots_mm")?;
    let mut divots: Vec<DVec2> = Vec::new();
    for item in list.items("a list of places [x, y] in mm")? {
        let divot = DVec2::from_array(item.numbers()?);
        if divots.contains(&divot) {
            return Err(item.error("is the place of another divot, too; give each place once"));
        }
        divots.push(divot);
    }
    if divots.len() < 2 {
        return Err(list.error("must hold two places at least; touches of a single one need no plate"));
    }
    Ok(divots)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_read_and_bad_files_are_refused_by_line() {
        let of = |text: &str| parse(Path::new("plate.toml"), text).map_err(|e| e.to_string());
        let head = "format = \"sonoweave-plate\"\nversion = 1\n";
        let divots = of(&format!("{head}divots_mm = [[0, 0], [60.0, 0.5]]\n")).unwrap();
        assert_eq!(divots, [DVec2::ZERO, DVec2::new(60.0, 0.5)]);
        for (rest, message) in [
            ("", "divots_mm (line 1): is missing"),
            ("divots_mm = [[0, 0]]\n", "divots_mm (line 3): must hold two places at least"),
            ("divots_mm = [[0, 0],\n[0, 0]]\n", "divots_mm[1] (line 4): is the place of another divot"),
            ("divots_mm = [[0, 0, 0]]\n", "must hold 2 numbers, not 3"),
            ("divots = []\n", "did you mean divots_mm?"),
        ] {
            let refused = of(&format!("{head}{rest}")).unwrap_err();
            assert!(refused.contains(message), "{rest}: {refused}");
        }
        assert!(of("format = \"sonoweave-phantom\"\n").unwrap_err().contains("must be \"sonoweave-plate\""));
        assert!(of(&head.replace('1', "2")).unwrap_err().contains("must be 1"));
    }
}
