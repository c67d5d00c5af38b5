//! Kinds of arms, and the settings that open one.

use std::path::PathBuf;

use super::ea1::SampleFormat;
use super::microscribe::Family;
use super::settings::Settings;

/// A kind of arm, and its lines.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Model {
    /// An arm with the protocol EA1, or one that sends lines of bare numbers.
    Ea1 {
        /// Serial line.
        path: PathBuf,
        /// Format of its samples.
        format: SampleFormat,
    },
    /// Three US Digital QSBs, base first.
    Qsb {
        /// Serial lines.
        paths: [PathBuf; 3],
    },
    /// A MicroScribe or an Immersion box.
    MicroScribe {
        /// Serial line.
        path: PathBuf,
        /// Family of the device.
        family: Family,
        /// Number of encoders: 5 or 6; for a box 2, 4 or 6.
        encoders: u8,
    },
}

/// Settings for opening an arm.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ArmSettings {
    /// Kind of arm and its lines.
    pub model: Model,
    /// Set-up of the arm.
    pub settings: Settings,
    /// Whether received bytes are also delivered as readings.
    pub keeps_raw: bool,
}
