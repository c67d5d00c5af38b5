//! Recordings and volumes from one file to another: stages between a device and a writer.
//!
//! - [`sequence`]: what a device delivers, as the header of a sequence: of sequence files and sessions alike.
//! - [`arrange`]: which stored pixel comes where: crop and orientation.
//! - [`identity`]: what may tell of whom a recording is, and is left out if asked for.
//! - [`placing`]: where a session's sensors were when its pictures were seen.
//! - [`pictures`]: numbered pictures as a device.
//! - [`write`](mod@write): to sequences, sessions and pictures; volumes to volumes.

pub mod arrange;
pub mod identity;
pub mod pictures;
pub mod placing;
pub mod sequence;
pub mod write;

use std::ops::Range;
use std::path::PathBuf;

use calibration::region::ClipRect;

/// What is changed on the way.
#[derive(Debug, Clone, Default)]
pub struct Changes {
    /// Which frames, by their number in the input; all without.
    pub frames: Option<Range<u64>>,
    /// Which part of the picture, by its pixels in MF orientation; all without.
    pub crop: Option<ClipRect>,
    /// The orientation that pictures are written in; as they are without.
    pub orientation: Option<String>,
    /// Whether what may identify somebody is left out.
    pub anonymize: bool,
    /// Whether pixels are compressed; as they are without.
    pub compressed: bool,
}

/// Why something cannot be converted.
#[derive(Debug, thiserror::Error)]
pub enum ConvertError {
    /// A file, as its driver has it.
    #[error(transparent)]
    File(#[from] drivers::Error),
    /// A picture's file.
    #[error(transparent)]
    Picture(#[from] crate::export::picture::PictureError),
    /// What is asked for does not go with what is there.
    #[error("{path}: {why}", path = path.display())]
    Unfit {
        /// The input, or the output.
        path: PathBuf,
        /// What does not go, and what to do.
        why: String,
    },
    /// The output, while it is written.
    #[error("{path}: writing failed: {source}", path = path.display())]
    Io {
        /// The output.
        path: PathBuf,
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
}
