//! Reads settings from a file of either kind.

use std::path::Path;

use calibration::error::PresetError;
use calibration::file::CalibrationFile;
use sonoweave_core::keys::read_text;

use super::Settings;
use crate::error::Error;
use crate::kind::{Kind, MAX_BYTES, kind_of};
use crate::plus;

impl Settings {
    /// Reads a file of either kind, and its preset of that name, or the only one.
    ///
    /// # Errors
    /// [`Error`] naming file, line and key or element.
    pub fn read(path: &Path, preset: Option<&str>) -> Result<Self, Error> {
        Self::parse(path, &read_text(path, MAX_BYTES)?, preset)
    }

    /// Reads a file's text; `path` is for messages only.
    ///
    /// # Errors
    /// [`Error`] naming file, line and key or element.
    pub fn parse(path: &Path, text: &str, preset: Option<&str>) -> Result<Self, Error> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        match kind_of(path, text)? {
            Kind::Plus => match preset {
                None => return plus::parse(path, text),
                Some(name) => {
                    let none = PresetError::Unknown { name: name.to_owned(), known: Vec::new() };
                    return Err(Error::Preset { path: path.to_owned(), problem: none });
                }
            },
            // For another kind, the parser's error names the found and the expected format.
            Kind::Calibration | Kind::Other => {}
            Kind::Bedside => {
                return Err(Error::Misplaced {
                    path: path.to_owned(),
                    what: "a session configuration, for `live`",
                    expected: "a calibration is wanted here: give the file named in its section [calibration]".into(),
                });
            }
        }
        let mut file = CalibrationFile::parse(path, text)?;
        let no_preset = |problem| Error::Preset { path: path.to_owned(), problem };
        let preset = file.choose(preset).map_err(no_preset)?;
        Ok(Self { path: Some(path.to_owned()), preset, ..Self::of_file(&file) })
    }
}
