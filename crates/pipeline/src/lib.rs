//! The stages in flow order. Threads between them are started only here.
//!
//! - [`session`]: devices, a recorded session or a recorded sequence to a volume and its picture,
//!   one thread per stage.
//! - [`command`]: the commands to a session.
//! - `inserter`: the inserter, from slices through the mask into the volume.
//! - `masking`: the mask's status, and refusals of another.
//! - `outcome`: the result of a run.
//! - `observer`: observers of frames, slices and the volume.
//! - `pose_noise`: the error of places by a tracker's noise, as far as that is known beforehand.
//! - `smoothing`: the account of smoothed poses.
//! - [`regions`]: a recorded sweep in regions of its volume.

pub mod command;
pub mod control;
mod inserter;
mod masking;
mod observer;
mod outcome;
mod pose_noise;
pub mod regions;
pub mod session;
mod smoothing;
pub mod trace;

pub use inserter::OffPlane;
pub use masking::{MaskOrigin, MaskRefusal, MaskStatus};
pub use observer::{CapturedFrame, InsertedSlice, Observer};
pub use outcome::Outcome;
pub use pose_noise::PoseNoise;
pub use smoothing::{SensorNoise, SmoothingStatus};

use std::ops::Range;

use export::volume::Scalar;
use reconstruct::path_choice::NotPlanar;
use reconstruct::{Refused, RepeatError, SettingsError};
use sonoweave_core::ledger::Ledger;
use sync::NoPath;
use sync::survey::SurveyError;

/// Scalar type of the frames as they reach the reconstructor.
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
    /// Returns the scalar type of the volume.
    pub fn scalar(self) -> Scalar {
        match self {
            Self::U8 => Scalar::U8,
            Self::U16 => Scalar::U16,
            Self::F32 => Scalar::F32,
        }
    }

    /// Returns the grey values of black and white. Floating-point frames have those of 8-bit
    /// frames, because grey values are converted that way.
    pub fn grey_levels(self) -> [f32; 2] {
        match self {
            Self::U8 | Self::F32 => [0.0, 255.0],
            Self::U16 => [0.0, 65_535.0],
        }
    }
}

/// Reason why a run failed as a whole.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// The device failed.
    #[error(transparent)]
    Device(#[from] sonoweave_core::Error),
    /// There is no route from the image to the world.
    #[error(transparent)]
    NoPath(#[from] NoPath),
    /// The mask leaves no pixels.
    #[error(transparent)]
    Mask(#[from] mask::MaskError),
    /// The reconstructor's settings do not fit the frames.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The planar path was requested, but the poses do not permit it.
    #[error("the planar path was requested, but {0}")]
    NotPlanar(#[from] NotPlanar),
    /// The volume exceeds its memory limit.
    #[error("frame {item}: {source}")]
    Memory {
        /// Number of the frame in the recording.
        item: u64,
        /// The missing memory.
        #[source]
        source: Refused,
    },
    /// A slice of the plan cannot be inserted.
    #[error("frame {item}: {source}")]
    Planned {
        /// Number of the frame in the recording.
        item: u64,
        /// Reason.
        #[source]
        source: RepeatError,
    },
    /// The recording is not the planned one.
    #[error(
        "frame {item}: is not as it was when the sweep was planned; leave the recording unchanged, and plan it again"
    )]
    OtherRecording {
        /// Number of the frame in the recording.
        item: u64,
    },
    /// No frame was used.
    #[error("no frame could be used: {0}; check the recording by these reasons")]
    NothingUsed(Box<Ledger>),
    /// The requested frames are not in the recording, or none of them has a usable pose.
    #[error(
        "the frames {start}..{end} hold none that can be used; give a range within 0 to {last}",
        start = frames.start,
        end = if frames.end == u64::MAX { String::new() } else { frames.end.to_string() },
        last = total.saturating_sub(1)
    )]
    NoSuchFrames {
        /// The requested frames.
        frames: Range<u64>,
        /// Frames of the recording.
        total: u64,
    },
    /// There are too few slices to determine the gap between them.
    #[error("the automatic σ needs at least two slices with poses in different places; choose a σ or a resolution")]
    NoGap,
    /// The observer failed.
    #[error(transparent)]
    Observer(Box<dyn std::error::Error + Send + Sync>),
}

impl From<SurveyError> for PipelineError {
    fn from(error: SurveyError) -> Self {
        match error {
            SurveyError::Device(e) => Self::Device(e),
            SurveyError::NoPath(e) => Self::NoPath(e),
        }
    }
}
