//! The unit's output list, which determines the columns or bytes of a record.

use super::limits::{FEWEST_REPLY_BYTES, LONGEST_REPLY};
use crate::tracker::polhemus::ListError;

/// One entry of an output list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Item {
    /// A blank.
    Space,
    /// Carriage return and line feed.
    CrLf,
    /// Position x, y, z in the unit that was set.
    Position,
    /// Position relative to the last such record.
    RelativePosition,
    /// Azimuth, elevation, roll in degrees.
    Euler,
    /// Row 0, 1 or 2 of the direction cosine matrix.
    Cosines(u8),
    /// Unit quaternion w, x, y, z.
    Quaternion,
    /// Stylus switch.
    Stylus,
    /// Position in 14 bits a value, ±300 cm whatever unit was set. The scale is that of an
    /// emulation; other sources differ by a factor of 2.
    Position14,
    /// Azimuth, elevation, roll in 14 bits a value.
    Euler14,
    /// Quaternion in 14 bits a value.
    Quaternion14,
}

/// An item, and whether its numbers have extended precision (text only).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Entry {
    /// The item.
    pub item: Item,
    /// Whether it has extended precision: code + 50.
    pub extended: bool,
}

impl Item {
    /// Returns the number of values in the item.
    pub(super) const fn values(self) -> usize {
        match self {
            Self::Space | Self::CrLf | Self::Stylus => 0,
            Self::Quaternion | Self::Quaternion14 => 4,
            _ => 3,
        }
    }

    const fn code(self) -> u8 {
        match self {
            Self::Space => 0,
            Self::CrLf => 1,
            Self::Position => 2,
            Self::RelativePosition => 3,
            Self::Euler => 4,
            Self::Cosines(row) => 5 + row,
            Self::Quaternion => 11,
            Self::Stylus => 16,
            Self::Position14 => 18,
            Self::Euler14 => 19,
            Self::Quaternion14 => 20,
        }
    }

    const fn is_packed(self) -> bool {
        matches!(self, Self::Position14 | Self::Euler14 | Self::Quaternion14)
    }
}

impl Entry {
    /// Returns the entry's code in the command `O`.
    pub const fn code(self) -> u8 {
        self.item.code() + if self.extended { 50 } else { 0 }
    }

    /// Returns the entry with this code in the command `O`.
    pub const fn from_code(code: u8) -> Option<Self> {
        let (plain, extended) = match code {
            52..=57 | 61 | 66 => (code - 50, true),
            _ => (code, false),
        };
        let item = match plain {
            0 => Item::Space,
            1 => Item::CrLf,
            2 => Item::Position,
            3 => Item::RelativePosition,
            4 => Item::Euler,
            5..=7 => Item::Cosines(plain - 5),
            11 => Item::Quaternion,
            16 => Item::Stylus,
            18 => Item::Position14,
            19 => Item::Euler14,
            20 => Item::Quaternion14,
            _ => return None,
        };
        Some(Self { item, extended })
    }

    const fn bytes(self, mode: Mode) -> usize {
        match self.item {
            Item::Space => 1,
            Item::CrLf | Item::Stylus => 2,
            item if item.is_packed() => 2 * item.values(),
            item => {
                item.values()
                    * match mode {
                        Mode::Binary => 4,
                        Mode::Ascii if self.extended => 13,
                        Mode::Ascii => 7,
                    }
            }
        }
    }
}

/// Number format of records.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Text in fixed columns (command `F`, the unit's default).
    Ascii,
    /// Binary: IEEE-754 singles, little-endian (command `f`).
    Binary,
}

/// Maximum number of entries in a list.
pub const MOST_ENTRIES: usize = 32;

/// Longest record that a unit writes, in bytes.
pub const LONGEST_RECORD: usize = 254;

/// Codes that units know.
const KNOWN: &str = "0 to 7, 11, 16, 18 to 20, and 52 to 57, 61, 66 for extended precision";

/// Layout of every record of a station.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    entries: [Entry; MOST_ENTRIES],
    count: usize,
    mode: Mode,
    length: usize,
}

impl Layout {
    /// Returns the layout of this list of output codes.
    ///
    /// A list should end in 0 (blank) or 1 (line end). Without such an end, a byte lost from the
    /// last number of a record stays unnoticed until the next record.
    ///
    /// # Errors
    /// [`ListError`] for codes, lengths and combinations that no unit has.
    pub fn new(mode: Mode, codes: &[u8]) -> Result<Self, ListError> {
        if codes.len() > MOST_ENTRIES {
            return Err(ListError::TooMany { given: codes.len(), most: MOST_ENTRIES });
        }
        let mut entries = [Entry { item: Item::Space, extended: false }; MOST_ENTRIES];
        let mut length = 3;
        for (entry, &code) in entries.iter_mut().zip(codes) {
            *entry = Entry::from_code(code).ok_or(ListError::Unknown { code, known: KNOWN })?;
            if entry.extended && mode == Mode::Binary {
                return Err(ListError::ExtendedBinary(code));
            }
            if entry.item.is_packed() && mode == Mode::Ascii {
                return Err(ListError::PackedText(code));
            }
            length += entry.bytes(mode);
        }
        if length > LONGEST_RECORD {
            return Err(ListError::TooLong { bytes: length, most: LONGEST_RECORD });
        }
        Ok(Self { entries, count: codes.len(), mode, length })
    }

    /// Returns the list, in order.
    pub fn entries(&self) -> &[Entry] {
        &self.entries[..self.count]
    }

    /// Returns the number format.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Returns the length of a record in bytes, its three header bytes included.
    pub fn length(&self) -> usize {
        self.length
    }

    /// Returns the length limit of replies among such records, in bytes.
    pub(super) fn reply_bytes(&self) -> usize {
        (2 * self.length).clamp(FEWEST_REPLY_BYTES, LONGEST_REPLY)
    }
}
