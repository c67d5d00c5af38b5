//! File format of a phantom.
//!
//! ```toml
//! format = "sonoweave-phantom"
//! version = 1
//! name = "three N's, printed 2024-05-02"
//!
//! [[pattern]]                       # a group of wires; from top to bottom in an MF image
//! [[pattern.wire]]                  # from right to left
//! name = "1a"
//! from_mm = [20.0, 0.0, 10.0]       # its two ends, in the phantom's own frame
//! to_mm = [20.0, 40.0, 10.0]
//!
//! [[landmark]]                      # points to be touched with a stylus; optional
//! name = "#1"
//! position_mm = [95.0, 5.0, 15.0]
//!
//! [phantom_to_reference]            # pose of the phantom on the reference sensor; optional
//! matrix = [ 16 numbers, row major, column vectors ]
//! error_mm = 0.4                    # mean distance at the landmarks; optional
//! ```

use std::fmt::Write as _;
use std::path::Path;

use glam::DVec3;

use sonoweave_core::frames::{Phantom, Reference, Transform};
use sonoweave_core::keys::{Entry, FileError, Source, Table, read_text};

use super::{Geometry, Landmark, Wire};
use crate::error::{CalibrationError, GeometryError};
use crate::file::MAX_BYTES;

/// The value of `format`.
pub const FORMAT: &str = "sonoweave-phantom";
/// The version that is written, and the newest that is read.
pub const VERSION: u32 = 1;

/// Tolerance for a registration's rotation, due to printed digits.
const ROTATION_TOLERANCE: f64 = 1e-2;

/// Pose of the phantom on the reference sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Registration {
    /// The pose; rigid.
    pub reference_from_phantom: Transform<Reference, Phantom>,
    /// Mean distance between landmarks as touched and as mapped, mm, above 0; `None` if
    /// unknown.
    pub error_mm: Option<f64>,
}

impl Registration {
    /// Takes a transform that is rigid up to printed digits.
    ///
    /// # Errors
    /// [`CalibrationError::Geometry`]: the matrix is no rotation, or the error is invalid.
    pub fn new(matrix: Transform<Reference, Phantom>, error_mm: Option<f64>) -> Result<Self, CalibrationError> {
        let rigid = matrix.nearest_rigid(ROTATION_TOLERANCE);
        let (reference_from_phantom, _) = rigid.map_err(|error| GeometryError::NotRigid(error.to_string()))?;
        if let Some(mm) = error_mm.filter(|mm| !(mm.is_finite() && *mm > 0.0)) {
            return Err(GeometryError::RegistrationError { mm }.into());
        }
        Ok(Self { reference_from_phantom, error_mm })
    }
}

/// Contents of a phantom's file.
#[derive(Debug, Clone, PartialEq)]
pub struct PhantomFile {
    /// Its wires and landmarks.
    pub geometry: Geometry,
    /// Its pose, if the file has it.
    pub registration: Option<Registration>,
}

impl PhantomFile {
    /// Reads a file.
    ///
    /// # Errors [`FileError`]: unreadable, too large, not TOML, or a key that is unknown,
    /// missing or out of range.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        Self::parse(path, &read_text(path, MAX_BYTES)?)
    }

    /// Parses a file's text; `path` is for error messages only.
    ///
    /// # Errors
    /// [`FileError`]: not TOML, or a key that is unknown, missing or out of range.
    pub fn parse(path: &Path, text: &str) -> Result<Self, FileError> {
        let source = Source { path, text };
        let parsed = source.parse()?;
        let known = ["format", "version", "name", "pattern", "landmark", "phantom_to_reference"];
        let root = Table::root(source, &parsed, &known)?;
        let format = root.need("format")?;
        if format.text()? != FORMAT {
            return Err(format.error(format!("must be \"{FORMAT}\" for a phantom's file")));
        }
        let version = root.need("version")?;
        if version.whole()? != VERSION {
            return Err(version.error(format!("this program reads version {VERSION}")));
        }
        let name = root.get("name").map(|entry| entry.text()).transpose()?.unwrap_or_default();
        let list = |key: &str| match root.get(key) {
            Some(entry) => entry.items(&format!("a list of tables, each headed [[{key}]]")),
            None => Ok(Vec::new()),
        };
        let patterns = list("pattern")?.iter().map(pattern).collect::<Result<Vec<_>, _>>()?;
        let landmarks = list("landmark")?.iter().map(landmark).collect::<Result<Vec<_>, _>>()?;
        // Errors of the geometry as a whole are reported at the line of `format`.
        let geometry = Geometry::new(name, patterns, landmarks).map_err(|e| format.error(e.to_string()))?;
        let registration = root.get("phantom_to_reference").map(|entry| registration(&entry)).transpose()?;
        Ok(Self { geometry, registration })
    }

    /// Returns the file's text. The digits of the numbers restore them bit for bit.
    pub fn to_text(&self) -> String {
        let mut text = format!("format = \"{FORMAT}\"\nversion = {VERSION}\n");
        let quoted = |name: &str| toml::Value::String(name.to_owned()).to_string();
        // Writing to a String cannot fail.
        if !self.geometry.name().is_empty() {
            let _ = writeln!(text, "name = {}", quoted(self.geometry.name()));
        }
        for pattern in self.geometry.patterns() {
            text.push_str("\n[[pattern]]\n");
            for Wire { name, ends_mm: [from, to] } in &self.geometry.wires()[pattern] {
                let [from, to] = [from, to].map(DVec3::to_array);
                let name = quoted(name);
                let _ = writeln!(text, "[[pattern.wire]]\nname = {name}\nfrom_mm = {from:?}\nto_mm = {to:?}");
            }
        }
        for Landmark { name, position_mm } in self.geometry.landmarks() {
            let (name, position) = (quoted(name), position_mm.to_array());
            let _ = writeln!(text, "\n[[landmark]]\nname = {name}\nposition_mm = {position:?}");
        }
        if let Some(Registration { reference_from_phantom, error_mm }) = &self.registration {
            let rows = reference_from_phantom.to_rows();
            let _ = writeln!(text, "\n[phantom_to_reference]\nmatrix = {rows:?}");
            if let Some(mm) = error_mm {
                let _ = writeln!(text, "error_mm = {mm:?}");
            }
        }
        text
    }
}

fn pattern(entry: &Entry<'_>) -> Result<Vec<Wire>, FileError> {
    let wires = entry.table(&["wire"])?.need("wire")?;
    wires.items("a list of tables, each headed [[pattern.wire]]")?.iter().map(wire).collect()
}

fn wire(entry: &Entry<'_>) -> Result<Wire, FileError> {
    let table = entry.table(&["name", "from_mm", "to_mm"])?;
    let point = |key| table.need(key)?.numbers().map(DVec3::from_array);
    Ok(Wire { name: table.need("name")?.text()?.to_owned(), ends_mm: [point("from_mm")?, point("to_mm")?] })
}

fn landmark(entry: &Entry<'_>) -> Result<Landmark, FileError> {
    let table = entry.table(&["name", "position_mm"])?;
    let position_mm = DVec3::from_array(table.need("position_mm")?.numbers()?);
    Ok(Landmark { name: table.need("name")?.text()?.to_owned(), position_mm })
}

fn registration(entry: &Entry<'_>) -> Result<Registration, FileError> {
    let table = entry.table(&["matrix", "error_mm"])?;
    let matrix = table.need("matrix")?;
    let transform = Transform::from_rows(&matrix.numbers()?).map_err(|e| matrix.error(e.to_string()))?;
    let error_mm = table.get("error_mm").map(|entry| entry.number()).transpose()?;
    Registration::new(transform, error_mm).map_err(|error| entry.error(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::super::geometry::tests::three_ns;
    use super::*;

    fn parse(text: &str) -> Result<PhantomFile, String> {
        PhantomFile::parse(Path::new("phantom.toml"), text).map_err(|e| e.to_string())
    }

    fn full() -> PhantomFile {
        let rows = [0.0, 0.0, -1.0, 9.6, 0.0, -1.0, 0.0, 36.0, -1.0, 0.0, 0.0, 87.9, 0.0, 0.0, 0.0, 1.0];
        let registration = Registration::new(Transform::from_rows(&rows).unwrap(), Some(0.4)).unwrap();
        PhantomFile { geometry: three_ns(), registration: Some(registration) }
    }

    #[test]
    fn written_file_is_read_back() {
        assert_eq!(parse(&full().to_text()).unwrap(), full());
        let bare = PhantomFile { registration: None, ..full() };
        assert_eq!(parse(&bare.to_text()).unwrap(), bare);
    }

    #[test]
    fn errors_are_named_with_their_lines() {
        let whole = full().to_text();
        let refusal = |from: &str, to: &str| {
            assert!(whole.contains(from), "{whole}");
            parse(&whole.replacen(from, to, 1)).unwrap_err()
        };
        let cases = [
            ("from_mm", "form_mm", "pattern[0].wire[0].form_mm (line 8): unknown key; did you mean from_mm?"),
            ("[[landmark]]", "[[landmrk]]", "unknown key; did you mean landmark?"),
            ("[20.0, 0.0, 10.0]", "[20.0, 0.0]", "pattern[0].wire[0].from_mm (line 8): must hold 3 numbers, not 2"),
            ("name = \"1b\"", "name = \"1a\"", "two wires are called 1a"),
            ("error_mm = 0.4", "error_mm = -1", "the registration's error is -1 mm; give a number above 0"),
            ("sonoweave-phantom", "sonoweave-calibration", "format (line 1): must be \"sonoweave-phantom\""),
            ("version = 1", "version = 2", "version (line 2): this program reads version 1"),
            ("-1.0, 9.6", "1.0, 9.6", "the pose mirrors"),
        ];
        for (from, to, expected) in cases {
            let error = refusal(from, to);
            assert!(error.starts_with("phantom.toml: ") && error.contains(expected), "{expected}\n{error}");
        }
        let empty = format!("format = \"{FORMAT}\"\nversion = 1\n");
        assert!(parse(&empty).unwrap_err().contains("neither wires nor landmarks"));
    }
}
