//! Pictures for browsers, by the kind of their content.

use std::sync::Arc;

use sonoweave_core::clock::wall_ns;

/// Content of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// The B-mode image.
    Slice = 1,
    /// The volume.
    View = 2,
    /// The plane through the volume across its z axis.
    AcrossZ = 3,
    /// The plane across its y axis.
    AcrossY = 4,
    /// The plane across its x axis.
    AcrossX = 5,
    /// The free plane.
    Free = 6,
}

impl Kind {
    /// All kinds, in the order of their numbers.
    pub(super) const ALL: [Self; KINDS] =
        [Self::Slice, Self::View, Self::AcrossZ, Self::AcrossY, Self::AcrossX, Self::Free];
}

/// Number of kinds.
pub(super) const KINDS: usize = 6;

/// Grey or colour pixels, 8 bits per channel.
#[derive(Debug, Clone)]
pub enum Pixmap {
    /// One byte a pixel.
    Grey(Arc<[u8]>),
    /// Red, green, blue.
    Colour(Arc<[u8]>),
}

/// A picture for browsers.
#[derive(Debug, Clone)]
pub struct EncodedFrame {
    /// The picture's content.
    pub kind: Kind,
    /// Sequence number among pictures of its kind, from 1.
    pub sequence: u32,
    /// Pixels to the right and down.
    pub size: [u32; 2],
    /// The pixels.
    pub pixels: Pixmap,
    /// Number of the frame, or of the last frame in the picture.
    pub item: u64,
    /// Capture time of that frame, ms since the UNIX epoch; `None` for a recording.
    pub captured_ms: Option<f64>,
    /// Whether a finer picture follows.
    pub refining: bool,
    /// Message that precedes the picture.
    pub words: Option<serde_json::Value>,
}

/// Converts host ns to ms since the UNIX epoch, the origin of a browser's clock.
pub(super) fn unix_ms(host_ns: i64) -> f64 {
    wall_ns(host_ns) as f64 / 1e6
}
