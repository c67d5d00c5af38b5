//! Our private elements: the block of group 0009 that the creator SONOWEAVE has reserved.
//!
//! Doubles are stored as such (OD), so that poses and places keep all their bits. Lists of texts
//! are lines (UT).

/// Group of the elements.
pub const GROUP: u16 = 0x0009;
/// Creator of the block.
pub const CREATOR: &str = "SONOWEAVE";
/// Poses of the frames: sixteen doubles a frame, row by row, from a pixel (column, row, 0, 1) to mm
/// of the world; NaN if a frame has no pose.
pub const POSES: u8 = 0x01;
/// Name of the world (LO).
pub const WORLD: u8 = 0x02;
/// Times of the frames by the source's clock, s: a double a frame, NaN if a frame has none.
pub const TIMES: u8 = 0x03;
/// Times before the source's own filter, s; absent if no frame has one.
pub const UNFILTERED_TIMES: u8 = 0x04;
/// Status of the frames' poses, a line a frame: OK, or the source's word. Absent without poses.
pub const STATUSES: u8 = 0x05;
/// The source's numbers of the frames, a line a frame, empty for a frame without one; absent if no
/// frame has one.
pub const NUMBERS: u8 = 0x06;
/// Place of a volume: fifteen doubles, its origin, its spacing (mm), and its first, second and
/// third axis.
pub const PLACE: u8 = 0x10;
/// Further fields of a volume, a line each: NAME = VALUE.
pub const FIELDS: u8 = 0x11;
