//! A correction, and the line of the file that holds it.

use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use config::bedside::SettingsOverride;

/// Name in the evidence of the root mean square error of the corrected poses at an image's corners.
pub(crate) const ERROR_RMS_MM: &str = "error_rms_mm";

/// Kinds of corrections, in the order in which they are applied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Kind {
    /// The sensors' poses are smoothed over the time before and after each frame.
    Smoothing,
    /// The image's pose at the probe and the latency are others.
    Calibration,
    /// Frames at which breathing displaces the body are left out.
    Gate,
}

impl Kind {
    /// Returns its name, which is that of its command.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Smoothing => "smoothing",
            Self::Calibration => "calibration",
            Self::Gate => "gate",
        }
    }

    /// Returns the version of its method. A change of the method's results makes it the next.
    pub(crate) fn version(self) -> u32 {
        match self {
            Self::Smoothing | Self::Calibration | Self::Gate => 1,
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A correction of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Correction {
    /// Number among those of its session, from 1. The number of one that was undone is not used
    /// again.
    pub(crate) id: u64,
    pub(crate) kind: Kind,
    /// Version of the method.
    pub(crate) version: u32,
    /// SHA-256 of the poses that it was computed from.
    pub(crate) inputs: String,
    /// The settings that differ from the session's configuration, by their keys there; those of a
    /// gate, which have none there.
    pub(crate) settings: SettingsOverride,
    /// Numbers by which it was judged.
    pub(crate) evidence: Map<String, Value>,
    pub(crate) result: CorrectionResult,
}

/// Result of a correction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum CorrectionResult {
    /// The poses of all frames that have one: the frame's number, and pixels to world mm, three
    /// rows of four.
    Poses(Vec<(u64, [f64; 12])>),
    /// The numbers of frames that are left out, ascending.
    LeftOut(Vec<u64>),
}

/// A line of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Line {
    /// Day, in universal time.
    pub(super) date: String,
    /// Version and commit of the program that wrote it.
    pub(super) program: String,
    #[serde(flatten)]
    pub(super) note: Note,
}

/// The content of a line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Note {
    /// A correction was accepted.
    Correction(Box<Correction>),
    /// The correction of this number was undone.
    CorrectionUndone(u64),
}
