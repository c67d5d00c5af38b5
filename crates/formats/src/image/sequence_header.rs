//! Header of a sequence file to be written.

use sonoweave_core::reading::{NamedTransform, PixelType, Stamp, Status};

/// Header of a sequence file.
#[derive(Debug, Clone, PartialEq)]
pub struct SequenceHeader {
    /// Pixels along the first (fastest) and second axis; both 0 for a sequence without images.
    pub size: [u32; 2],
    /// Scalar type.
    pub pixel: PixelType,
    /// Channels per pixel, interleaved, 1 to 4.
    pub channels: u32,
    /// Orientation code (`MFA`, …); not written if empty.
    pub orientation: String,
    /// Image type (`BRIGHTNESS`, …); not written if empty.
    pub image_type: String,
    /// Whether to compress the pixels with zlib.
    pub compressed: bool,
    /// Further fields of the whole file.
    pub fields: Vec<(String, String)>,
    /// Metadata of each frame (or tracker sample).
    pub items: Vec<SequenceItem>,
}

/// Metadata of one frame in a sequence file.
#[derive(Debug, Clone, PartialEq)]
pub struct SequenceItem {
    /// Time of the frame; only `source_s` and `unfiltered_s` are written.
    pub stamp: Stamp,
    /// The source's running number.
    pub frame_number: Option<u64>,
    /// Whether the source declares the frame valid.
    pub status: Status,
    /// Transforms of the frame; their own stamps are not written.
    pub transforms: Vec<NamedTransform>,
    /// Further fields.
    pub fields: Vec<(String, String)>,
}
