//! Files: image sequences and volumes, and recorded sessions.
//!
//! - [`image`]: MetaImage, NRRD and NIfTI, read and written; DICOM, read.
//! - [`session`]: the readings, decisions and notes of a session, as MCAP.
//! - [`whole`]: files that appear whole or not at all.
//!
//! Functions of images and sessions return [`Error`].

mod error;
pub mod image;
pub mod session;
pub mod whole;

pub use error::{Error, NoImage, NoSession, Unreadable, Unwritable};

/// Upper bounds that keep a damaged or hostile file from exhausting the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of header. The parsed header takes about twice as much memory, and ten times at
    /// worst (millions of frames with one short field each).
    pub header_bytes: u64,
    /// Bytes of one decompressed frame.
    pub frame_bytes: u64,
    /// Number of frames (or tracker samples, or a volume's slices).
    pub items: u64,
    /// Bytes of all frames together if they must be in memory at once: the list is the first
    /// axis, so each frame is spread over the whole file.
    pub transposed_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { header_bytes: 128 << 20, frame_bytes: 64 << 20, items: 1 << 24, transposed_bytes: 2 << 30 }
    }
}
