//! Transfer functions as files.
//!
//! A transfer file is TOML. Intensities are the volume's grey levels, gradients are grey levels
//! per mm, opacities and colours run from 0 to 1:
//!
//! ```toml
//! format = "sonoweave-transfer"
//! version = 1
//!
//! unit_mm = 1.0                       # opacities are meant over this length; 1 mm without it
//!
//! # A factor on the opacity over the gradient's magnitude; 1 without it.
//! gradient = [[0.0, 0.1], [25.0, 1.0]]
//!
//! [opacity]                           # exactly one of the three:
//! curve = [[40.0, 0.0], [120.0, 0.2], [255.0, 0.8]]
//! # region = [[60.0, 0.0], [120.0, 0.5], [255.0, 1.0]]
//! # isovalue = { value = 110.0, thickness_mm = 1.0, opacity = 0.9 }
//!
//! [colour]                            # exactly one of the three; without it grey from 0 to 255
//! perceptual = [0.0, 255.0]
//! # grey = [0.0, 255.0]
//! # list = [[0.0, 0.0, 0.0, 0.0], [128.0, 0.8, 0.3, 0.2], [255.0, 1.0, 1.0, 0.9]]
//! ```
//!
//! - `opacity.curve`: points [intensity, opacity].
//! - `opacity.region`: points [intensity, opacity] of the regions whose borders are shown:
//!   [`Opacity::Region`].
//! - `opacity.isovalue`: the surface at one intensity: [`Opacity::Isovalue`].
//! - `gradient`: points [grey levels per mm, factor].
//! - `colour.grey`, `colour.perceptual`: the intensities of the first and the last colour.
//! - `colour.list`: points [intensity, red, green, blue], display values (sRGB).
//!
//! Values are linear between points and constant beyond the first and the last. Points ascend in
//! their first number. `format`, `version` and `opacity` are required; keys that are not listed
//! here are refused.

use std::path::Path;

use sonoweave_core::keys::{Entry, FileError, Source, Table};

use super::{Colour, CurveError, Opacity, Piecewise, Transfer, TransferError};

/// The value of `format`.
pub const FORMAT: &str = "sonoweave-transfer";
/// The newest supported version.
pub const VERSION: u32 = 1;
/// Largest file size, bytes; larger files are refused unread.
pub const MAX_BYTES: u64 = 1 << 20;
/// Default of `unit_mm`.
const DEFAULT_UNIT_MM: f64 = 1.0;
/// Default of `colour`: the range of 8 bits.
const DEFAULT_WINDOW: [f64; 2] = [0.0, 255.0];

impl Transfer {
    /// Reads a transfer file.
    ///
    /// # Errors
    /// [`FileError`]: unreadable, larger than [`MAX_BYTES`], not TOML, or a key that is unknown,
    /// missing or out of range.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        Self::parse(path, &sonoweave_core::keys::read_text(path, MAX_BYTES)?)
    }

    /// Parses a transfer file's text; `path` is only used in messages.
    ///
    /// # Errors
    /// [`FileError`]: not TOML, or a key that is unknown, missing or out of range.
    pub fn parse(path: &Path, text: &str) -> Result<Self, FileError> {
        let source = Source { path, text: text.strip_prefix('\u{feff}').unwrap_or(text) };
        let parsed = source.parse()?;
        let root = Table::root(source, &parsed, &["format", "version", "unit_mm", "gradient", "opacity", "colour"])?;
        check_version(&root)?;

        let classification = root.need("opacity")?;
        let opacity = opacity(&classification)?;
        let colour = match root.get("colour") {
            Some(entry) => colour(&entry)?,
            None => Colour::grey(DEFAULT_WINDOW).map_err(|e| classification.error(e.to_string()))?,
        };
        let unit = root.get("unit_mm");
        let unit_mm = unit.as_ref().map_or(Ok(DEFAULT_UNIT_MM), Entry::number)?;
        let mut transfer = Self::new(opacity, unit_mm, colour).map_err(|e| {
            let at = if let (TransferError::Unit(_), Some(unit)) = (&e, &unit) { unit } else { &classification };
            at.error(e.to_string())
        })?;
        if let Some(entry) = root.get("gradient") {
            let curve = curve(&entry, "points [grey levels per mm, factor]")?;
            transfer = transfer.with_gradient(curve).map_err(|e| entry.error(e.to_string()))?;
        }
        Ok(transfer)
    }
}

fn check_version(root: &Table<'_>) -> Result<(), FileError> {
    let format = root.need("format")?;
    if format.text()? != FORMAT {
        return Err(format.error(format!("must be \"{FORMAT}\" for a transfer function")));
    }
    let version = root.need("version")?;
    match version.whole()? {
        VERSION => Ok(()),
        other => Err(version.error(format!("this program reads version {VERSION}, not {other}"))),
    }
}

fn opacity(entry: &Entry<'_>) -> Result<Opacity, FileError> {
    let (kind, value) = only(entry, &["curve", "region", "isovalue"])?;
    match kind {
        "curve" => curve(&value, "points [intensity, opacity]").map(Opacity::Curve),
        "region" => curve(&value, "points [intensity, opacity]").map(Opacity::Region),
        _ => {
            let table = value.table(&["value", "thickness_mm", "opacity"])?;
            let number = |key| table.need(key)?.number();
            Ok(Opacity::Isovalue {
                value: number("value")?,
                thickness_mm: number("thickness_mm")?,
                opacity: number("opacity")?,
            })
        }
    }
}

fn colour(entry: &Entry<'_>) -> Result<Colour, FileError> {
    let (kind, value) = only(entry, &["grey", "perceptual", "list"])?;
    let window = |make: fn([f64; 2]) -> Result<Colour, TransferError>| {
        make(value.numbers()?).map_err(|e| value.error(e.to_string()))
    };
    match kind {
        "grey" => window(Colour::grey),
        "perceptual" => window(Colour::perceptual),
        _ => {
            let points = points(&value, "points [intensity, red, green, blue]", |[x, r, g, b]| (x, [r, g, b]))?;
            Ok(Colour::Map(points))
        }
    }
}

/// Returns the only key that a table of alternatives holds.
fn only<'a>(entry: &Entry<'a>, kinds: &[&'static str]) -> Result<(&'static str, Entry<'a>), FileError> {
    let table = entry.table(kinds)?;
    let mut given = kinds.iter().filter_map(|kind| Some((*kind, table.get(kind)?)));
    match (given.next(), given.next()) {
        (Some(one), None) => Ok(one),
        (Some((first, _)), Some((second, value))) => {
            Err(value.error(format!("{first} is given already; keep {first} or {second}")))
        }
        (None, _) => Err(entry.error(format!("is empty; give one of {}", kinds.join(", ")))),
    }
}

fn curve(entry: &Entry<'_>, expected: &str) -> Result<super::Curve, FileError> {
    points(entry, expected, |[position, value]| (position, [value]))
}

fn points<const M: usize, const N: usize>(
    entry: &Entry<'_>,
    expected: &str,
    point: fn([f64; M]) -> (f64, [f64; N]),
) -> Result<Piecewise<N>, FileError> {
    let items = entry.items(&format!("a list of {expected}"))?;
    let points = items.iter().map(|item| Ok(point(item.numbers()?))).collect::<Result<Vec<_>, FileError>>()?;
    Piecewise::through(&points).map_err(|e: CurveError| {
        let at = e.index().and_then(|index| items.get(index)).unwrap_or(entry);
        at.error(e.to_string())
    })
}
