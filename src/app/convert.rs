//! Conversion of recordings and volumes between files: stages between a device and a writer.
//!
//! - [`sequence`]: the content of a device as the header of a sequence, for sequence files and
//!   sessions.
//! - [`arrange`]: crop and orientation: maps stored pixels to written ones.
//! - [`identity`]: fields that may identify a person; they are left out on request.
//! - [`anonymous`]: times, words and numbers of anonymous recordings; their subject's pseudonym.
//! - [`blacken`]: makes pixels beside the scanner's picture black.
//! - [`placing`]: poses of a session's sensors at the times of its frames.
//! - [`pictures`]: numbered image files as a device.
//! - `volume`: conversion of a volume; `holes` fills its holes, and `zarr` writes it as OME-Zarr.
//! - [`write`](mod@write): writes sequences, sessions, image files and volumes.

pub mod anonymous;
pub mod arrange;
pub mod blacken;
mod holes;
pub mod identity;
pub mod pictures;
pub mod placing;
pub mod sequence;
pub(crate) mod volume;
pub mod write;
pub(crate) mod zarr;

use std::ops::Range;
use std::path::PathBuf;

use sonoweave_core::region::ClipRect;

use anonymous::Subject;

/// Changes made during a conversion.
#[derive(Debug, Clone, Default)]
pub struct Changes {
    /// The frames to keep, by their number in the input; `None` keeps all.
    pub frames: Option<Range<u64>>,
    /// The part of the frame to keep, in pixels in MF orientation; `None` keeps the whole frame.
    pub crop: Option<ClipRect>,
    /// Orientation of the written frames; `None` leaves it unchanged.
    pub orientation: Option<String>,
    /// Whether everything that may identify a person is left out.
    pub anonymize: bool,
    /// The subject that an anonymous file names, by its pseudonym.
    pub subject: Option<Subject>,
    /// Whether pixels are compressed.
    pub compressed: bool,
}

/// Reason why an input cannot be converted.
#[derive(Debug, thiserror::Error)]
pub enum ConvertError {
    /// An error of a device that replays the input.
    #[error(transparent)]
    Device(#[from] sonoweave_core::Error),
    /// An error of opening the input.
    #[error(transparent)]
    Open(#[from] drivers::Error),
    /// An error of a file.
    #[error("{0}")]
    File(#[from] formats::Error),
    /// An error of an image file.
    #[error(transparent)]
    Picture(#[from] export::ExportError),
    /// The request does not fit the input.
    #[error("{path}: {why}", path = path.display())]
    Unfit {
        /// The input, or the output.
        path: PathBuf,
        /// The problem, and the remedy.
        why: String,
    },
    /// An error while writing the output.
    #[error("{path}: writing failed: {source}", path = path.display())]
    Io {
        /// The output.
        path: PathBuf,
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
}
