//! A measurement of a station.

/// A measurement of a station: the fields of its output list.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Station, from 1.
    pub station: u8,
    /// The unit's last error as its letter; a blank for none. It can be older than this record,
    /// so it qualifies the pose but does not invalidate it.
    pub error: u8,
    /// Position in the unit that was set (inches by default, or cm).
    pub position: Option<[f64; 3]>,
    /// Position relative to the last such record, in the same unit.
    pub relative_position: Option<[f64; 3]>,
    /// Azimuth, elevation, roll in degrees.
    pub euler_deg: Option<[f64; 3]>,
    /// Rows of the direction cosine matrix.
    pub cosines: [Option<[f64; 3]>; 3],
    /// Quaternion w, x, y, z as sent, not normalised.
    pub quaternion_wxyz: Option<[f64; 4]>,
    /// Stylus switch as sent: two characters, a blank and a digit.
    pub stylus: Option<[u8; 2]>,
}

impl Pose {
    /// Returns a pose without measurements.
    pub const fn empty(station: u8, error: u8) -> Self {
        Self {
            station,
            error,
            position: None,
            relative_position: None,
            euler_deg: None,
            cosines: [None; 3],
            quaternion_wxyz: None,
            stylus: None,
        }
    }
}
