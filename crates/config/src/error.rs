//! The error of configurations.

use std::path::PathBuf;

use calibration::error::PresetError;
use sonoweave_core::keys::{BadNumbers, FileError};

/// Reason why a configuration is refused. The display is a sentence with the problem, its place
/// and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Our own file, or reading either kind.
    #[error(transparent)]
    File(#[from] FileError),
    /// The text is not XML, or beyond the limits on it.
    #[error("{path}: line {line}: not readable as XML: {problem}", path = path.display())]
    Xml {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u32,
        /// The problem.
        problem: String,
    },
    /// An attribute is missing or has an invalid value.
    #[error("{path}: {element} {attribute} (line {line}): {problem}", path = path.display())]
    Attribute {
        /// The file.
        path: PathBuf,
        /// Line, from 1; the element's line if the attribute is missing.
        line: u32,
        /// The element's name.
        element: String,
        /// The attribute's name.
        attribute: String,
        /// The problem.
        problem: String,
    },
    /// No preset chosen among several, or an unknown preset.
    #[error("{path}: {problem}", path = path.display())]
    Preset {
        /// The file.
        path: PathBuf,
        /// The presets to choose from.
        problem: PresetError,
    },
    /// A file of one kind in place of another.
    #[error("{path}: is {what}; {expected}", path = path.display())]
    Misplaced {
        /// The file.
        path: PathBuf,
        /// The kind of the file.
        what: &'static str,
        /// The expected kind, and the remedy.
        expected: String,
    },
    /// A device set that is not sufficient for a session.
    #[error("{path}: {problem}", path = path.display())]
    DeviceSet {
        /// The file.
        path: PathBuf,
        /// The missing part, and the remedy.
        problem: String,
    },
    /// Readable settings that cannot be used, such as a pair of contradictory ones.
    #[error("{problem}")]
    Setting {
        /// Names of the settings, separated by `, `; empty if the sentence contains them.
        setting: &'static str,
        /// The problem and the valid values.
        problem: String,
    },
    /// A value cannot be parsed. The sentence has no beginning, for the caller to head with the
    /// value's name.
    #[error("{0}")]
    Value(String),
    /// A key of a settings override.
    #[error("{key}: {problem}")]
    Override {
        /// Dotted.
        key: String,
        /// The problem and its remedy.
        problem: String,
    },
    /// Nothing relates the image to the probe.
    #[error(
        "{path}: [calibration] (line 1): is missing: give file = \"…\" with a calibration file or a PLUS XML, or give \
         image_to_probe",
        path = path.display()
    )]
    Uncalibrated {
        /// The file.
        path: PathBuf,
    },
    /// The calibration file calls itself an example.
    #[error(
        "{path}: provenance: is \"{provenance}\", and the numbers of an example are not this probe's; calibrate the \
         probe into another file, or enter its numbers and their origin",
        path = path.display()
    )]
    Example {
        /// The calibration file.
        path: PathBuf,
        /// Its provenance.
        provenance: String,
    },
    /// XML with other contents.
    #[error(
        "{path}: holds no CoordinateDefinitions, CalibrationResults or VolumeReconstruction element; give a PLUS \
         configuration or calibration result, or a calibration file",
        path = path.display()
    )]
    NothingInside {
        /// The file.
        path: PathBuf,
    },
}

impl Error {
    /// Makes an error of one setting, or of several with an empty name.
    pub(crate) fn setting(setting: &'static str, problem: impl Into<String>) -> Self {
        Self::Setting { setting, problem: problem.into() }
    }
}

impl From<String> for Error {
    fn from(problem: String) -> Self {
        Self::Value(problem)
    }
}

impl From<BadNumbers> for Error {
    fn from(bad: BadNumbers) -> Self {
        Self::Value(bad.to_string())
    }
}
