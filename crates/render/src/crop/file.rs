//! Crops as files.
//!
//! A crop file is TOML; points and lengths are mm of the world:
//!
//! ```toml
//! format = "sonoweave-crop"
//! version = 1
//!
//! [[operation]]                       # any number, in their order
//! hide = "outside_box"
//! low = [-20.0, -30.0, 0.0]
//! high = [20.0, 30.0, 60.0]
//!
//! [[operation]]
//! hide = "beyond_plane"               # the side to which the normal points
//! point = [0.0, 0.0, 10.0]
//! normal = [0.0, 0.0, -1.0]
//!
//! [[operation]]
//! hide = "ball"
//! centre = [3.0, 4.0, 25.0]
//! radius = 5.0
//! ```
//!
//! The other kinds are `before_surface`, `lasso` and `nothing`, with the fields of
//! [`Operation`](super::Operation).

use std::path::Path;

use sonoweave_core::keys::{FileError, Source, Table, read_text};

use super::Crop;
use crate::error::RenderError;

/// The value of `format`.
pub const FORMAT: &str = "sonoweave-crop";
/// The newest supported version.
pub const VERSION: u32 = 1;
/// Largest file size, bytes; larger files are refused unread.
pub const MAX_BYTES: u64 = 16 << 20;

/// All fields of operations.
const FIELDS: [&str; 17] = [
    "hide", "low", "high", "point", "normal", "origin", "across", "along", "heights", "centre", "radius", "right",
    "down", "eye", "outline", "outside", "depth",
];

impl Crop {
    /// Reads a crop file.
    ///
    /// # Errors
    /// [`FileError`]: unreadable, larger than [`MAX_BYTES`], not TOML, of another format or
    /// version, or an operation that is unknown or impossible.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        Self::parse(path, &read_text(path, MAX_BYTES)?)
    }

    /// Parses a crop file's text; `path` is only used in messages.
    ///
    /// # Errors
    /// Same as [`Self::read`], but for reading.
    pub fn parse(path: &Path, text: &str) -> Result<Self, FileError> {
        let source = Source { path, text: text.strip_prefix('\u{feff}').unwrap_or(text) };
        let parsed = source.parse()?;
        let root = Table::bare(source, &parsed);
        let format = root.need("format")?;
        if format.text()? != FORMAT {
            return Err(format.error(format!("must be \"{FORMAT}\" for a crop")));
        }
        let version = root.need("version")?;
        if version.whole()? != VERSION {
            return Err(version.error(format!("this program reads version {VERSION}, not {}", version.whole()?)));
        }
        let root = Table::root(source, &parsed, &["format", "version", "operation"])?;
        let items = match root.get("operation") {
            Some(list) => list.items("a list of operations")?,
            None => Vec::new(),
        };
        let operations = items.iter().map(|item| item.table(&FIELDS)?.read()).collect::<Result<_, _>>()?;
        Self::new(operations).map_err(|error| {
            let at = match error {
                RenderError::Crop { number, .. } => items.get(number - 1),
                _ => None,
            };
            at.unwrap_or(&format).error(error.to_string())
        })
    }
}
