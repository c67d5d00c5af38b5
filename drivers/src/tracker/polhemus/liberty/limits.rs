//! Number of stations, lengths of headers and replies, and the measuring range.

/// Bytes before a frame's body.
pub const HEADER: usize = 8;

/// Maximum number of stations of any of these units.
pub const MOST_STATIONS: u8 = 16;

/// Length limit of a reply among short frames, in bytes: a false beginning of a reply must not
/// delay frames.
pub(super) const FEWEST_REPLY_BYTES: usize = 64;

/// Limit of a position coordinate, in the unit that was set.
pub(super) const FARTHEST: f32 = 500.0;
