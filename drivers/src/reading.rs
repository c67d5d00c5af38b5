//! What devices deliver. Units and names are those of the wire.

use std::borrow::Cow;
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
    /// Bytes of a line as they came, for recordings.
    Raw(Raw),
}

impl Reading {
    /// When.
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

    /// When, to be changed.
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

/// When something was measured or received.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stamp {
    /// Position in the stream, from 0: frames and transforms of one item of a sequence share it.
    pub item: u64,
    /// Receive time on the host, CLOCK_MONOTONIC nanoseconds: when its last byte was here, or what the kernel stamped it with; `None` for files. Nothing is
    /// subtracted from it: the device's [`crate::Timing`] says what is to be.
    pub host_ns: Option<i64>,
    /// The device's own clock or counter as on the wire, not unwrapped; what it counts and where it wraps says [`crate::Timing`].
    pub ticks: Option<u64>,
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
    /// The source says otherwise; its own word (`INVALID`, `MISSING`, …), or a driver's sentence for its code.
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

impl PixelType {
    /// All of them.
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
    pub orientation: Cow<'static, str>,
    /// Image type as written by the source (`BRIGHTNESS`, `RF_I_LINE_Q_LINE`, …), empty if not given.
    pub image_type: String,
    /// `size[0]·size[1]·channels` scalars in native byte order, first axis fastest; empty if the device was opened without images or
    /// the sequence holds none.
    pub pixels: Arc<[u8]>,
    /// Further fields of this frame, names and texts as in the source.
    pub fields: Vec<(String, String)>,
}

/// Axes that a source of counts can have.
pub const AXES: usize = 6;

/// Raw counts of the arm's joints. Kinematics, signs and offsets are the calibration's.
#[derive(Debug, Clone, PartialEq)]
pub struct Counts {
    /// When.
    pub stamp: Stamp,
    /// The axis that the first count is of: 0 unless each axis comes by a line of its own.
    pub first: u8,
    /// Counts that there are.
    pub axes: u8,
    /// One count a joint, base first; 0 beyond those that there are.
    pub counts: [i64; AXES],
    /// Bit by axis: its zero is known, so that counts mean a place. Where it is not, the status says so too.
    pub homed: u8,
    /// Bits of the buttons and switches.
    pub buttons: u8,
    /// Whether the device vouches for it.
    pub status: Status,
}

impl Counts {
    /// Those that there are.
    pub fn as_slice(&self) -> &[i64] {
        &self.counts[..usize::from(self.axes).min(AXES)]
    }
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
    /// Orientation as quaternion w, x, y, z, as it was sent: its length is 1 up to the wire's rounding.
    pub quaternion_wxyz: [f64; 4],
    /// Bits of the stylus's or sensor's buttons.
    pub buttons: u8,
    /// The unit's own figure of how distorted its field is, larger is worse; `None` where it has none.
    pub distortion: Option<i32>,
    /// The unit's error letter or number as sent; `None` for none. It may be about an earlier record, or not about the pose at all.
    pub code: Option<u8>,
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

/// Splits `ProbeToTracker` into `Probe` and `Tracker`: at the first `To` that has something before it and an upper-case letter or a digit behind it,
/// so that `To` within a word (`TorsoToTracker`, `ToolToTracker`, `StylusToTool`) does not count. A name without such a `To` is the frame
/// that points come from, and the frame they go to is empty: the source does not say it.
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
    /// When.
    pub stamp: Stamp,
    /// What kind of record.
    pub topic: String,
    /// Its text.
    pub text: String,
}

/// Bytes of a line as one read brought them, before the readings that they complete. Given to the same decoder in this order they make the same readings.
#[derive(Debug, Clone, PartialEq)]
pub struct Raw {
    /// When: the last byte's time.
    pub stamp: Stamp,
    /// Which of the device's lines, from 0.
    pub line: u8,
    /// The bytes.
    pub bytes: Arc<[u8]>,
}
