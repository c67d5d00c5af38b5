//! What devices deliver. Units and names are those of the wire.

use std::sync::Arc;

/// One delivery of a device.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Reading {
    /// A video frame.
    Frame(Frame),
    /// Raw counts of the arm's joints.
    Counts(Counts),
    /// A station's pose in wire units.
    Pose(Pose),
    /// A transform that knows the frames it maps between (sequence files, OpenIGTLink).
    NamedTransform(NamedTransform),
    /// Clock maps, settings and decisions of an earlier run.
    Recorded(Recorded),
}

/// When something was measured or received.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stamp {
    /// Position in the stream, from 0: frames and transforms of one item of a sequence share it.
    pub item: u64,
    /// Receive time on the host, CLOCK_MONOTONIC nanoseconds; `None` for files.
    pub host_ns: Option<i64>,
    /// Time written by the source, in seconds of the source's own clock. Finite if present.
    pub source_s: Option<f64>,
    /// The source's time before its own filtering, seconds of the same clock.
    pub unfiltered_s: Option<f64>,
}

/// Whether the source vouches for a datum.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum Status {
    /// The source says that it is valid, or is of a kind that never says.
    Ok,
    /// The source says otherwise; its own word (`INVALID`, `MISSING`, …).
    Other(String),
}

/// Scalar type of a pixel's channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "the names are Rust's own type names")]
pub enum PixelType {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl PixelType {
    /// Bytes per channel.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

/// A frame's picture as delivered, and what the source says of it.
#[derive(Debug, Clone)]
pub struct Frame {
    /// When.
    pub stamp: Stamp,
    /// The source's running number, which counts lost frames too, if it gives one.
    pub frame_number: Option<u64>,
    /// Whether the source vouches for the picture.
    pub status: Status,
    /// Pixels along the first (fastest) and second axis as stored.
    pub size: [u32; 2],
    /// Channels per pixel, interleaved.
    pub channels: u32,
    /// Scalar type.
    pub pixel: PixelType,
    /// Orientation code as written by the source (`MFA`, `UN`, …), empty if not given.
    pub orientation: String,
    /// Image type as written by the source (`BRIGHTNESS`, `RF_I_LINE_Q_LINE`, …), empty if not given.
    pub image_type: String,
    /// `size[0]·size[1]·channels` scalars in native byte order, first axis fastest; empty if the device was opened without images or
    /// the sequence holds none.
    pub pixels: Arc<[u8]>,
    /// Further fields of this frame, names and texts as in the source.
    pub fields: Vec<(String, String)>,
}

/// Raw counts of the arm's joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Counts {
    /// When.
    pub stamp: Stamp,
    /// One count a joint, base first.
    pub counts: Vec<i64>,
}

/// A tracked station's pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// When.
    pub stamp: Stamp,
    /// Station, from 1 as on the wire.
    pub station: u8,
    /// Position in cm.
    pub position_cm: [f64; 3],
    /// Orientation as unit quaternion w, x, y, z.
    pub quaternion_wxyz: [f64; 4],
    /// Whether the tracker vouches for it.
    pub status: Status,
}

/// A transform with the names of its frames: maps points of `from` to points of `to`.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedTransform {
    /// When.
    pub stamp: Stamp,
    /// Name of the frame that points come from.
    pub from: String,
    /// Name of the frame that points go to; empty if the source does not say (early sequence files call a transform `Stylus`).
    pub to: String,
    /// 4×4, row major, column vectors, mm (pixels on the image's side). May hold anything that parsed as numbers, NaN included.
    pub matrix: [f64; 16],
    /// Whether the source vouches for it.
    pub status: Status,
}

impl NamedTransform {
    /// The transform's name as files have it, less the word Transform.
    pub fn name(&self) -> String {
        transform_name(&self.from, &self.to)
    }
}

/// `FromToTo`, or the first name alone where a source gives no second.
pub fn transform_name(from: &str, to: &str) -> String {
    if to.is_empty() { from.to_owned() } else { format!("{from}To{to}") }
}

/// A decision or setting of an earlier run, as recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct Recorded {
    /// When.
    pub stamp: Stamp,
    /// What kind of record.
    pub topic: String,
    /// Its text.
    pub text: String,
}
