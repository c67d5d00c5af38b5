//! The unit's output list, which determines the body of a frame.

use super::limits::HEADER;
use crate::tracker::polhemus::ListError;

/// One entry of an output list. The codes differ from FASTRAK's: the quaternion is 7 here and 11
/// there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Item {
    /// A blank.
    Space,
    /// Carriage return and line feed.
    CrLf,
    /// Position x, y, z in the unit that was set.
    Position,
    /// Position in extended precision; in binary it is the same as [`Position`](Self::Position).
    PositionExtended,
    /// Azimuth, elevation, roll in degrees.
    Euler,
    /// Angles in extended precision; in binary they are the same as [`Euler`](Self::Euler).
    EulerExtended,
    /// Direction cosine matrix, row by row. Not verified: that the unit sends all nine numbers.
    Cosines,
    /// Quaternion w, x, y, z.
    Quaternion,
    /// Milliseconds since the unit's clock was last set to 0.
    Timestamp,
    /// Frame number.
    FrameCount,
    /// Stylus switch.
    Stylus,
    /// Distortion level, 0 to 2.
    Distortion,
    /// Flag of the external sync input.
    ExternalSync,
}

impl Item {
    /// All items, indexed by their code in the command `O`.
    const ALL: [Self; 13] = [
        Self::Space,
        Self::CrLf,
        Self::Position,
        Self::PositionExtended,
        Self::Euler,
        Self::EulerExtended,
        Self::Cosines,
        Self::Quaternion,
        Self::Timestamp,
        Self::FrameCount,
        Self::Stylus,
        Self::Distortion,
        Self::ExternalSync,
    ];

    /// Returns the item's code in the command `O`.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// Returns the item with this code in the command `O`.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    const fn bytes(self) -> usize {
        match self {
            Self::Space => 1,
            Self::CrLf => 2,
            Self::Position | Self::PositionExtended | Self::Euler | Self::EulerExtended => 12,
            Self::Cosines => 36,
            Self::Quaternion => 16,
            Self::Timestamp | Self::FrameCount | Self::Stylus | Self::Distortion | Self::ExternalSync => 4,
        }
    }
}

/// Maximum number of entries in a list.
pub const MOST_ITEMS: usize = 32;

/// Longest body of a frame, in bytes.
pub const LONGEST_BODY: usize = 1000;

/// Layout of the body of every frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    items: [Item; MOST_ITEMS],
    count: usize,
    body: usize,
}

impl Layout {
    /// Returns the layout of this list of output codes.
    ///
    /// Frames have no checksum. A byte lost within a frame shifts all later fields, which shows
    /// in the length of the quaternion; the quaternion should therefore come last.
    ///
    /// # Errors
    /// [`ListError`] for codes and lengths that no unit has.
    pub fn new(codes: &[u8]) -> Result<Self, ListError> {
        if codes.len() > MOST_ITEMS {
            return Err(ListError::TooMany { given: codes.len(), most: MOST_ITEMS });
        }
        let mut items = [Item::Space; MOST_ITEMS];
        let mut body = 0;
        for (item, &code) in items.iter_mut().zip(codes) {
            *item = Item::from_code(code).ok_or(ListError::Unknown { code, known: "0 to 12" })?;
            body += item.bytes();
        }
        if body > LONGEST_BODY {
            return Err(ListError::TooLong { bytes: body, most: LONGEST_BODY });
        }
        Ok(Self { items, count: codes.len(), body })
    }

    /// Returns the list, in order.
    pub fn items(&self) -> &[Item] {
        &self.items[..self.count]
    }

    /// Returns the length of a frame's body, in bytes.
    pub fn body(&self) -> usize {
        self.body
    }

    /// Returns the length of a frame, in bytes.
    pub fn length(&self) -> usize {
        HEADER + self.body
    }
}
