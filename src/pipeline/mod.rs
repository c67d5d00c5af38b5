//! The stages in flow order, and the only place that spawns threads between them.
//!
//! - `offline`: a recorded sequence, synchronously: device → ingest → pairing → loom.
//! - [`live`]: devices to a volume and its picture, a thread a stage.
//! - `loom`: slices through the mask into the volume, whoever brings them.
//! - `onlooker`: who sees the volume after each slice.

pub mod live;
mod loom;
mod offline;
mod onlooker;

pub use loom::OffPlane;
pub use offline::{Job, Outcome, Progress, reconstruct};
pub use onlooker::{Onlooker, Woven};

use std::ops::Range;

use crate::export::volume::Scalar;
use crate::ledger::Ledger;
use crate::path::NotPlanar;
use crate::reconstruct::{Refused, SettingsError};
use crate::sync::NoPath;
use crate::sync::survey::SurveyError;

/// Scalar type of the pictures as they reach the reconstructor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelKind {
    /// 8 bit unsigned.
    U8,
    /// 16 bit unsigned.
    U16,
    /// Single precision.
    F32,
}

impl PixelKind {
    /// The scalar type that a volume of them is kept in.
    pub fn scalar(self) -> Scalar {
        match self {
            Self::U8 => Scalar::U8,
            Self::U16 => Scalar::U16,
            Self::F32 => Scalar::F32,
        }
    }

    /// Black and white. Of floating point they are as in pictures of 8 bits: that is how grey levels are converted.
    pub fn grey_levels(self) -> [f32; 2] {
        match self {
            Self::U8 | Self::F32 => [0.0, 255.0],
            Self::U16 => [0.0, 65_535.0],
        }
    }
}

/// Why a run failed as a whole.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// The device.
    #[error(transparent)]
    Device(#[from] drivers::Error),
    /// The image cannot be placed in the world.
    #[error(transparent)]
    NoPath(#[from] NoPath),
    /// The mask leaves nothing.
    #[error(transparent)]
    Mask(#[from] calibration::region::BadRegion),
    /// The reconstructor's settings do not fit the pictures.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The planar path was asked for, and the poses are none for it.
    #[error("--path planar: {0}")]
    NotPlanar(#[from] NotPlanar),
    /// The volume does not fit the memory it may take.
    #[error("frame {item}: {source}")]
    Memory {
        /// Number of the frame in the recording.
        item: u64,
        /// How much is missing.
        #[source]
        source: Refused,
    },
    /// No frame was used.
    #[error("no frame could be used: {0}")]
    NothingUsed(Box<Ledger>),
    /// The frames asked for are not in the recording, or none of them has a usable pose.
    #[error(
        "--frames {start}..{end} holds no frame that can be used: the recording has frames 0 to {last}",
        start = frames.start,
        end = if frames.end == u64::MAX { String::new() } else { frames.end.to_string() },
        last = total.saturating_sub(1)
    )]
    NoSuchFrames {
        /// The frames asked for.
        frames: Range<u64>,
        /// Frames of the recording.
        total: u64,
    },
    /// There are too few slices to tell the gap between them.
    #[error("--sigma auto needs at least two slices with poses in different places; give --sigma or --resolution")]
    NoGap,
    /// Who looked on could not go on.
    #[error(transparent)]
    Onlooker(Box<dyn std::error::Error + Send + Sync>),
}

impl From<SurveyError> for PipelineError {
    fn from(error: SurveyError) -> Self {
        match error {
            SurveyError::Device(e) => Self::Device(e),
            SurveyError::NoPath(e) => Self::NoPath(e),
        }
    }
}
