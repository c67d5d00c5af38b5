//! A correction, and the line of the file that holds it.

use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use config::bedside::SettingsOverride;

use super::poses::{self, Poses};

/// Name in the evidence of the corrected poses' error at an image's corners, root mean square.
pub(crate) const ERROR_RMS_MM: &str = "error_rms_mm";

/// Kinds of corrections, in the order in which they are applied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Kind {
    /// The sensors' poses are smoothed over the time before and after each frame.
    Smoothing,
    /// The image's pose at the probe and the latency are others.
    Calibration,
    /// Poses drift slowly from sweep to sweep.
    Drift,
    /// Frames are displaced within their planes, by the images of their neighbours.
    Jitter,
    /// Tissue is compressed by the probe.
    Pressure,
    /// Frames at which breathing displaces the body are left out.
    Gate,
}

impl Kind {
    /// Returns its name, which is that of its command.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Smoothing => "smoothing",
            Self::Calibration => "calibration",
            Self::Drift => "drift",
            Self::Jitter => "jitter",
            Self::Pressure => "pressure",
            Self::Gate => "gate",
        }
    }

    /// Returns the version of its method. A change of the method's results makes it the next.
    pub(crate) fn version(self) -> u32 {
        match self {
            Self::Smoothing | Self::Calibration | Self::Drift | Self::Jitter | Self::Pressure | Self::Gate => 1,
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

impl Correction {
    /// Returns a correction that was computed from these poses; it gets its number when it is
    /// stored.
    pub(super) fn new(
        kind: Kind,
        before: &Poses,
        settings: SettingsOverride,
        evidence: Map<String, Value>,
        result: CorrectionResult,
    ) -> Self {
        Self { id: 0, kind, version: kind.version(), inputs: poses::hash(before), settings, evidence, result }
    }

    /// Returns the numbers by which it was judged, in words.
    pub(crate) fn words(&self) -> String {
        let number = |name: &str| self.evidence.get(name).and_then(Value::as_f64).unwrap_or(f64::NAN);
        let motion_mm = |at: usize| {
            let motion = self.evidence.get("motion_mm").and_then(|motion| motion.get(at)?.as_f64());
            motion.unwrap_or(f64::NAN)
        };
        match &self.result {
            CorrectionResult::Poses(poses) => format!(
                "{} of {} frames have a pose; corners of images moved by {:.2} mm (rms; at most {:.2})",
                poses.len(),
                number("frames_before"),
                number("moved_rms_mm"),
                number("moved_most_mm")
            ),
            CorrectionResult::Compressions(compressions) => format!(
                "the images of {} of {} frames are stretched; the skin was pressed by {:.2} mm (rms; at most {:.2})",
                compressions.len(),
                number("frames_before"),
                number("skin_rms_mm"),
                number("skin_max_mm")
            ),
            CorrectionResult::LeftOut(_) => {
                let motion = if self.evidence.contains_key("motion_mm") {
                    format!(
                        "the body moves by {:.2} mm (standard deviation) in these, and by {:.2} mm in all",
                        motion_mm(1),
                        motion_mm(0)
                    )
                } else {
                    format!("markers are {:.1} s apart", number("period_s"))
                };
                format!(
                    "{} of {} frames are used; {motion}; a sweep at {:.1} mm/s leaves no holes",
                    number("frames"),
                    number("frames_before"),
                    number("speed_mm_s")
                )
            }
        }
    }
}

/// Displacement of tissue over depth, by the frame's number: depth below the image's first row, and
/// displacement towards greater depth, mm.
pub(super) type Compressions = Vec<(u64, Vec<[f64; 2]>)>;

/// Result of a correction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum CorrectionResult {
    /// The poses of all frames that have one: the frame's number, and pixels to world mm, three
    /// rows of four.
    Poses(Vec<(u64, [f64; 12])>),
    /// The displacement of tissue in frames: the frame's number, and knots of depth below the
    /// image's first row and of displacement towards greater depth, mm.
    Compressions(Compressions),
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
