//! Numbers of stations, lengths of replies and the measuring range.

/// Maximum number of stations of a unit.
pub const STATIONS: usize = 4;

/// Longest reply, in bytes: the answer to `O` with a full list has 69 bytes, the status 55.
pub const LONGEST_REPLY: usize = 128;

/// Length limit of a reply among short records, in bytes: a false beginning of a reply must not
/// delay records. A status still fits.
pub(super) const FEWEST_REPLY_BYTES: usize = 56;

/// Limit of a binary position coordinate, in the unit that was set.
pub(super) const FARTHEST: f64 = 500.0;
