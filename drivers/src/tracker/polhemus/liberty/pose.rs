//! A measurement of a station, with the header of its frame.

/// Model of the unit: the first two bytes of each frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Tag {
    /// `LY`: LIBERTY.
    #[default]
    Liberty,
    /// `PA`: PATRIOT.
    Patriot,
    /// `LU`: Latus and LIBERTY HS, wireless.
    Latus,
}

impl Tag {
    /// Returns the two letters.
    pub const fn bytes(self) -> [u8; 2] {
        match self {
            Self::Liberty => *b"LY",
            Self::Patriot => *b"PA",
            Self::Latus => *b"LU",
        }
    }

    pub(super) const fn from_bytes(bytes: [u8; 2]) -> Option<Self> {
        match &bytes {
            b"LY" => Some(Self::Liberty),
            b"PA" => Some(Self::Patriot),
            b"LU" => Some(Self::Latus),
            _ => None,
        }
    }
}

/// Header of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// Model.
    pub tag: Tag,
    /// Station, from 1.
    pub station: u8,
    /// The command that the frame answers: `C`, `P`, another letter, or 0x01 to 0x1A for a
    /// control character.
    pub command: u8,
    /// Error code:
    ///
    /// - 0 or a blank: none.
    /// - 0x01 to 0x18: error of the command.
    /// - `a` to `g`: error of the source.
    /// - `u`: outside the map.
    /// - `A` to `G`: error of the source and the built-in test.
    /// - `I`: error of the test.
    pub error: u8,
}

impl Header {
    /// Returns whether the unit reports no error.
    pub fn is_well(&self) -> bool {
        matches!(self.error, 0 | b' ')
    }
}

/// A measurement of a station: the fields of the output list.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Header, with the station.
    pub header: Header,
    /// Position in the unit that was set (inches by default, or cm).
    pub position: Option<[f32; 3]>,
    /// Azimuth, elevation, roll in degrees.
    pub euler_deg: Option<[f32; 3]>,
    /// Direction cosine matrix, row by row.
    pub cosines: Option<[[f32; 3]; 3]>,
    /// Quaternion w, x, y, z as sent, not normalised.
    pub quaternion_wxyz: Option<[f32; 4]>,
    /// The unit's clock in ms; wraps at 2³².
    pub timestamp_ms: Option<u32>,
    /// Frame number, which counts lost frames too; wraps at 2³².
    pub frame_count: Option<u32>,
    /// Stylus switch.
    pub stylus: Option<i32>,
    /// Distortion level, 0 to 2.
    pub distortion: Option<i32>,
    /// Flag of the external sync input.
    pub external_sync: Option<i32>,
}

impl Pose {
    /// Returns a pose without measurements.
    pub const fn empty(header: Header) -> Self {
        Self {
            header,
            position: None,
            euler_deg: None,
            cosines: None,
            quaternion_wxyz: None,
            timestamp_ms: None,
            frame_count: None,
            stylus: None,
            distortion: None,
            external_sync: None,
        }
    }
}
