//! Files of contours: TOML, described in `docs/regions.md`.

use std::path::Path;

use glam::{DVec2, DVec3};

use sonoweave_core::keys::{Entry, FileError, Source, Table, read_text};

use crate::contour::Contour;
use crate::contours::Contours;
use crate::error::SegmentError;

/// The value of `format`.
const FORMAT: &str = "sonoweave-contours";
/// The newest supported version.
const VERSION: u32 = 1;
/// Largest file size, bytes; larger files are refused unread.
const MAX_BYTES: u64 = 16 << 20;
/// Most contours of a file.
const MOST: usize = 1000;
/// Largest coordinate, mm.
const FARTHEST: f64 = 1e6;

impl Contours {
    /// Reads a file of contours.
    ///
    /// # Errors
    /// [`FileError`]: unreadable, larger than 16 MiB, not TOML, of another format or version, or
    /// contours of which no body can be made, with the sentence of [`SegmentError`].
    pub fn read(path: &Path) -> Result<Self, FileError> {
        Self::parse(path, &read_text(path, MAX_BYTES)?)
    }

    /// Parses a file's text; `path` is only used in messages.
    ///
    /// # Errors
    /// Same as [`Self::read`], but for reading.
    pub fn parse(path: &Path, text: &str) -> Result<Self, FileError> {
        let source = Source { path, text: text.strip_prefix('\u{feff}').unwrap_or(text) };
        let parsed = source.parse()?;
        let root = Table::bare(source, &parsed);
        let format = root.need("format")?;
        if format.text()? != FORMAT {
            return Err(format.error(format!("must be \"{FORMAT}\" for contours")));
        }
        let version = root.need("version")?;
        if version.whole()? != VERSION {
            return Err(version.error(format!("this program reads version {VERSION}, not {}", version.whole()?)));
        }
        let root = Table::root(source, &parsed, &["format", "version", "frame", "contour"])?;
        let frame = root.get("frame").map_or(Ok("World"), |frame| frame.text())?;
        let items = match root.get("contour") {
            Some(list) => list.items("a list of contours")?,
            None => Vec::new(),
        };
        if items.len() > MOST {
            return Err(format.error(format!("the number of contours must be at most {MOST}, not {}", items.len())));
        }
        let refuse = |error: SegmentError| {
            error.contour().and_then(|number| items.get(number - 1)).unwrap_or(&format).error(error.to_string())
        };
        let mut list = Vec::with_capacity(items.len());
        for (at, item) in items.iter().enumerate() {
            list.push(contour(at + 1, item)?.map_err(refuse)?);
        }
        Self::new(list, frame.to_owned()).map_err(refuse)
    }
}

/// Reads a contour. The inner error is one of its numbers together.
fn contour(number: usize, item: &Entry) -> Result<Result<Contour, SegmentError>, FileError> {
    let table = item.table(&["origin", "across", "along", "points"])?;
    let vector = |key: &str| near::<3>(&table.need(key)?).map(DVec3::from_array);
    let (origin, axes) = (vector("origin")?, [vector("across")?, vector("along")?]);
    let points = table.need("points")?.items("a list of points")?;
    let points = points.iter().map(|point| near::<2>(point).map(DVec2::from_array)).collect::<Result<Vec<_>, _>>()?;
    Ok(Contour::new(number, origin, axes, &points))
}

/// Reads numbers that are not so large that distances lose their digits.
fn near<const N: usize>(entry: &Entry) -> Result<[f64; N], FileError> {
    let numbers = entry.numbers::<N>()?;
    match numbers.iter().find(|number| number.abs() > FARTHEST) {
        Some(number) => Err(entry.error(format!("must hold numbers from -{FARTHEST} to {FARTHEST}, not {number}"))),
        None => Ok(numbers),
    }
}
