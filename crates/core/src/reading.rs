//! Data that devices deliver, in the units and names of the wire.

use std::borrow::Cow;
use std::sync::Arc;

/// One item delivered by a device.
#[derive(Debug, Clone)]
pub enum Reading {
    /// A video frame.
    Frame(Frame),
    /// Raw counts of the arm's joints.
    Counts(Counts),
    /// A station's pose in wire units.
    Pose(Pose),
    /// A transform with the names of its source and target frames (sequence files,
    /// OpenIGTLink).
    NamedTransform(NamedTransform),
    /// Clock maps, settings and decisions of an earlier run.
    Recorded(Recorded),
    /// Bytes of a line as received, for recordings.
    Raw(Raw),
}

impl Reading {
    /// Returns the reading's stamp.
    pub fn stamp(&self) -> &Stamp {
        match self {
            Self::Frame(Frame { stamp, .. })
            | Self::Counts(Counts { stamp, .. })
            | Self::Pose(Pose { stamp, .. })
            | Self::NamedTransform(NamedTransform { stamp, .. })
            | Self::Recorded(Recorded { stamp, .. })
            | Self::Raw(Raw { stamp, .. }) => stamp,
        }
    }

    /// Returns the reading's stamp, for modification.
    pub fn stamp_mut(&mut self) -> &mut Stamp {
        match self {
            Self::Frame(Frame { stamp, .. })
            | Self::Counts(Counts { stamp, .. })
            | Self::Pose(Pose { stamp, .. })
            | Self::NamedTransform(NamedTransform { stamp, .. })
            | Self::Recorded(Recorded { stamp, .. })
            | Self::Raw(Raw { stamp, .. }) => stamp,
        }
    }
}

/// Time of a measurement or its reception.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stamp {
    /// Position in the stream, from 0. Frames and transforms of one item of a sequence share
    /// it.
    pub item: u64,
    /// Receive time on the host, CLOCK_MONOTONIC nanoseconds: arrival of the last byte, or the
    /// kernel's stamp. `None` for files. No latency is subtracted; [`crate::Timing`] gives the
    /// latencies to subtract.
    pub host_ns: Option<i64>,
    /// The device's own clock or counter as on the wire, not unwrapped. [`crate::Timing`] gives
    /// its meaning and wrap value.
    pub ticks: Option<u64>,
    /// Time written by the source, in seconds of the source's own clock. Finite if present.
    pub source_s: Option<f64>,
    /// Time before the source's own filtering, in seconds of the same clock.
    pub unfiltered_s: Option<f64>,
}

/// Whether the source declares a datum valid.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum Status {
    /// The source declares the datum valid, or never gives a status.
    Ok,
    /// The source declares the datum invalid. Holds its own word (`INVALID`, `MISSING`, …), or
    /// a driver's sentence for its code.
    Other(Cow<'static, str>),
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

impl std::fmt::Display for PixelType {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&format!("{self:?}").to_lowercase())
    }
}

impl PixelType {
    /// All pixel types.
    pub const ALL: [Self; 10] =
        [Self::U8, Self::I8, Self::U16, Self::I16, Self::U32, Self::I32, Self::U64, Self::I64, Self::F32, Self::F64];

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

/// A video frame as delivered, with the source's information about it.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Time.
    pub stamp: Stamp,
    /// The source's running number, which also counts lost frames; `None` if it gives none.
    pub frame_number: Option<u64>,
    /// Whether the source declares the frame valid.
    pub status: Status,
    /// Pixels along the first (fastest) and second axis as stored.
    pub size: [u32; 2],
    /// Channels per pixel, interleaved.
    pub channels: u32,
    /// Scalar type of a channel.
    pub pixel: PixelType,
    /// Orientation code as written by the source (`MFA`, `UN`, …), empty if not given.
    pub orientation: Cow<'static, str>,
    /// Image type as written by the source (`BRIGHTNESS`, `RF_I_LINE_Q_LINE`, …), empty if not
    /// given.
    pub image_type: String,
    /// `size[0]·size[1]·channels` scalars in native byte order, first axis fastest. Empty if
    /// the device was opened without images or the sequence holds none.
    pub pixels: Arc<[u8]>,
    /// Further fields of this frame, with the source's names and texts.
    pub fields: Vec<(String, String)>,
}

/// Maximum number of axes of a source of counts.
pub const AXES: usize = 6;

/// Raw counts of the arm's joints. The calibration holds kinematics, signs and offsets.
#[derive(Debug, Clone, PartialEq)]
pub struct Counts {
    /// Time.
    pub stamp: Stamp,
    /// Axis of the first count: 0 unless each axis has its own line.
    pub first: u8,
    /// Number of counts present.
    pub axes: u8,
    /// One count per joint, base first; 0 beyond `axes`.
    pub counts: [i64; AXES],
    /// One bit per axis: the axis is homed, so that its counts give a position. An axis without
    /// its bit also shows in the status.
    pub homed: u8,
    /// Button and switch bits.
    pub buttons: u8,
    /// Whether the device declares the counts valid.
    pub status: Status,
}

impl Counts {
    /// Returns the counts present.
    pub fn as_slice(&self) -> &[i64] {
        &self.counts[..usize::from(self.axes).min(AXES)]
    }
}

/// A tracked station's pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// Time.
    pub stamp: Stamp,
    /// Station, from 1 as on the wire.
    pub station: u8,
    /// Position in cm.
    pub position_cm: [f64; 3],
    /// Orientation as quaternion w, x, y, z, as sent: its length is 1 up to the wire's
    /// rounding.
    pub quaternion_wxyz: [f64; 4],
    /// Button bits of the stylus or sensor.
    pub buttons: u8,
    /// The unit's own measure of field distortion; larger is worse. `None` if the unit gives
    /// none.
    pub distortion: Option<i32>,
    /// The unit's error letter or number as sent; `None` for none. It may concern an earlier
    /// record, or not the pose at all.
    pub code: Option<u8>,
    /// Whether the tracker declares the pose valid.
    pub status: Status,
}

/// A transform that maps points of the frame `from` to points of the frame `to`.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedTransform {
    /// Time.
    pub stamp: Stamp,
    /// Name of the source frame.
    pub from: String,
    /// Name of the target frame; empty if the source gives none (early sequence files call a
    /// transform `Stylus`).
    pub to: String,
    /// 4×4, row major, for column vectors, mm (pixels on the image's side). May hold anything
    /// that parsed as numbers, including NaN.
    pub matrix: [f64; 16],
    /// Whether the source declares the transform valid.
    pub status: Status,
}

impl NamedTransform {
    /// Returns the transform's name as used in files, without the word Transform.
    pub fn name(&self) -> String {
        transform_name(&self.from, &self.to)
    }
}

/// Returns `FromToTo`, or the first name alone if `to` is empty.
pub fn transform_name(from: &str, to: &str) -> String {
    if to.is_empty() { from.to_owned() } else { format!("{from}To{to}") }
}

/// Splits `ProbeToTracker` into `Probe` and `Tracker`. The split is at the first `To` that has
/// text before it and an upper-case letter or a digit after it. A `To` within a word
/// (`TorsoToTracker`, `ToolToTracker`, `StylusToTool`) does not count. A name without such a
/// `To` is the source frame; the target frame is then empty, because the source does not give
/// it.
pub fn split_transform_name(base: &str) -> (String, String) {
    let at = base.match_indices("To").map(|(at, _)| at).find(|&at| {
        let next = base[at + 2..].chars().next();
        at > 0 && next.is_some_and(|next| next.is_uppercase() || next.is_ascii_digit())
    });
    match at {
        Some(at) => (base[..at].to_owned(), base[at + 2..].to_owned()),
        None => (base.to_owned(), String::new()),
    }
}

/// A decision or setting of an earlier run, as recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct Recorded {
    /// Time.
    pub stamp: Stamp,
    /// Kind of record.
    pub topic: String,
    /// The record's text.
    pub text: String,
}

/// Bytes of a line as returned by one read; delivered before the readings that they complete.
/// The same decoder, fed in this order, produces the same readings.
#[derive(Debug, Clone, PartialEq)]
pub struct Raw {
    /// Time of the last byte.
    pub stamp: Stamp,
    /// Index of the device's line, from 0.
    pub line: u8,
    /// The bytes.
    pub bytes: Arc<[u8]>,
}
