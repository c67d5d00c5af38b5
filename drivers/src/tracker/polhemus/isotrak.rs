//! The binary wire format of 3SPACE, ISOTRAK and ISOTRAK II; their text is
//! [FASTRAK's](crate::tracker::polhemus::fastrak).
//!
//! | | |
//! |---|---|
//! | Clock | none: records carry neither a time nor a number |
//! | Tick | 1/60 s divided by the stations in use (ISOTRAK II; not confirmed by its manual) |
//! | Wrap | nothing to wrap |
//! | Instant | not documented; before the record's first byte by the unit's latency |
//!
//! A logical record is `'0'`, station, error letter or stylus switch, and 16-bit integers,
//! little-endian. On the wire, a further byte after each group of up to seven bytes holds their
//! top bits, which leaves seven bits a byte. Bit 7 then marks the first byte of a record and no
//! other. Full scale is ±65.48 inches whatever unit was set. If bit 7 occurs before a record's
//! end, that record was truncated and another begins. Replies are plain text like FASTRAK's.

mod unit;

pub use unit::{IsotrakProtocol, Question, Unit};

use super::fastrak::reply::{self, Reply};
use crate::framing::{Format, Parsed, Refusal};
use crate::tracker::polhemus::ListError;

/// Position, cm per count.
pub const CM_PER_COUNT: f64 = 166.32 / 32_767.0;
/// Quaternion or cosine, units per count.
pub const UNIT_PER_COUNT: f64 = 1.0 / 32_767.0;
/// Angle, degrees per count. Not verified.
pub const DEGREES_PER_COUNT: f64 = 180.0 / 32_767.0;

/// Stylus switch pressed, in the place of the error letter.
pub const PRESSED: u8 = b'@';
/// Stylus switch released.
pub const RELEASED: u8 = b'*';

/// Maximum number of stations of a unit.
pub const STATIONS: u8 = 2;

/// Longest reply among records, in bytes; a status has 21 bytes.
const LONGEST_REPLY: usize = 56;

/// An entry of the output list, which all stations share.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Item {
    /// A blank.
    Space,
    /// Carriage return and line feed.
    CrLf,
    /// Position.
    Position,
    /// Azimuth, elevation, roll.
    Euler,
    /// Row 0, 1 or 2 of the direction cosine matrix.
    Cosines(u8),
    /// Quaternion w, x, y, z.
    Quaternion,
}

impl Item {
    const fn bytes(self) -> usize {
        match self {
            Self::Space => 1,
            Self::CrLf => 2,
            Self::Quaternion => 8,
            _ => 6,
        }
    }

    /// Returns the item's code in the command `O`.
    pub const fn code(self) -> u8 {
        match self {
            Self::Space => 0,
            Self::CrLf => 1,
            Self::Position => 2,
            Self::Euler => 4,
            Self::Cosines(row) => 5 + row,
            Self::Quaternion => 11,
        }
    }

    /// Returns the item with this code in the command `O`.
    pub const fn from_code(code: u8) -> Option<Self> {
        Some(match code {
            0 => Self::Space,
            1 => Self::CrLf,
            2 => Self::Position,
            4 => Self::Euler,
            5..=7 => Self::Cosines(code - 5),
            11 => Self::Quaternion,
            _ => return None,
        })
    }
}

const MOST_ITEMS: usize = 8;
/// Upper limit of a logical record, in bytes: header (three bytes) and every item once, with the
/// line ends.
const MOST_LOGICAL: usize = 56;

/// Layout of every record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    items: [Item; MOST_ITEMS],
    count: usize,
    logical: usize,
    wire: usize,
}

impl Layout {
    /// Returns the layout of this list of output codes.
    ///
    /// # Errors
    /// [`ListError`] for codes and lengths that no unit is known to have.
    pub fn new(codes: &[u8]) -> Result<Self, ListError> {
        if codes.len() > MOST_ITEMS {
            return Err(ListError::TooMany { given: codes.len(), most: MOST_ITEMS });
        }
        let mut items = [Item::Space; MOST_ITEMS];
        let mut logical = 3;
        for (item, &code) in items.iter_mut().zip(codes) {
            *item = Item::from_code(code).ok_or(ListError::Unknown { code, known: "0, 1, 2, 4 to 7 and 11" })?;
            logical += item.bytes();
        }
        // Eight quaternions would be longer than every item once.
        if logical > MOST_LOGICAL {
            return Err(ListError::TooMany { given: codes.len(), most: MOST_ITEMS });
        }
        Ok(Self { items, count: codes.len(), logical, wire: logical + logical.div_ceil(7) })
    }

    /// Returns the list, in order.
    pub fn items(&self) -> &[Item] {
        &self.items[..self.count]
    }

    /// Returns the length of a record on the wire, in bytes.
    pub fn length(&self) -> usize {
        self.wire
    }
}

/// A record or reply from the unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Record<'a> {
    /// A measurement of a station.
    Pose(&'a Pose),
    /// An answer to a command, or an error.
    Reply(Reply<'a>),
}

/// A measurement of a station in counts: the fields of the output list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pose {
    /// Station, from 1.
    pub station: u8,
    /// The unit's last error as its letter, a blank for none; or the stylus switch, [`PRESSED`]
    /// or [`RELEASED`].
    pub error: u8,
    /// Position; a count is [`CM_PER_COUNT`].
    pub position_counts: Option<[i16; 3]>,
    /// Azimuth, elevation, roll; a count is [`DEGREES_PER_COUNT`].
    pub euler_counts: Option<[i16; 3]>,
    /// Rows of the direction cosine matrix; a count is [`UNIT_PER_COUNT`].
    pub cosine_counts: [Option<[i16; 3]>; 3],
    /// Quaternion w, x, y, z, to be normalised; a count is [`UNIT_PER_COUNT`].
    pub quaternion_wxyz_counts: Option<[i16; 4]>,
}

impl Pose {
    /// Returns a pose without measurements.
    pub const fn empty(station: u8, error: u8) -> Self {
        Self {
            station,
            error,
            position_counts: None,
            euler_counts: None,
            cosine_counts: [None; 3],
            quaternion_wxyz_counts: None,
        }
    }

    /// Appends the record in this layout as a unit sends it; missing numbers are written as 0.
    pub fn write(&self, layout: &Layout, to: &mut Vec<u8>) {
        let mut logical = vec![b'0', b'0' + self.station, self.error];
        for &item in layout.items() {
            let counts: &[i16] = match item {
                Item::Space => {
                    logical.push(b' ');
                    continue;
                }
                Item::CrLf => {
                    logical.extend(b"\r\n");
                    continue;
                }
                Item::Position => &self.position_counts.unwrap_or_default(),
                Item::Euler => &self.euler_counts.unwrap_or_default(),
                Item::Cosines(row) => &self.cosine_counts[usize::from(row)].unwrap_or_default(),
                Item::Quaternion => &self.quaternion_wxyz_counts.unwrap_or_default(),
            };
            counts.iter().for_each(|count| logical.extend(count.to_le_bytes()));
        }
        let first = to.len();
        for group in logical.chunks(7) {
            to.extend(group.iter().map(|byte| byte & 0x7f));
            to.push(group.iter().rev().fold(0, |tops, byte| tops << 1 | byte >> 7));
        }
        to[first] |= 0x80;
    }
}

/// Reads binary ISOTRAK records, and replies.
#[derive(Debug, Clone)]
pub struct Isotrak {
    layout: Layout,
    stations: u8,
    /// The last record.
    pose: Pose,
}

impl Isotrak {
    /// Creates a format for a unit with at most [`STATIONS`] stations in use.
    pub fn new(stations: u8, layout: Layout) -> Self {
        Self { layout, stations: stations.min(STATIONS), pose: Pose::empty(0, b' ') }
    }

    /// Returns the layout of every record.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    #[inline]
    fn judge_record(&mut self, window: &[u8]) -> Parsed<()> {
        if window[0] != b'0' | 0x80 {
            return Parsed::skip_byte(Refusal::Header);
        }
        let inside = &window[1..window.len().min(self.layout.wire)];
        if inside.iter().fold(0, |marks, byte| marks | byte) & 0x80 != 0 {
            // The record is truncated where the next begins.
            let before = inside.iter().position(|byte| byte & 0x80 != 0).unwrap_or(0);
            return Parsed::Skip { bytes: 1 + before, why: Refusal::Length };
        }
        let Some(record) = window.get(..self.layout.wire) else {
            return Parsed::Short;
        };
        match self.read(Unpacked { groups: record, bits: 0, count: 0 }) {
            Some(Ok(())) => Parsed::Record { length: record.len(), record: () },
            Some(Err(why)) => Parsed::skip_byte(why),
            // Cannot happen, because the layout determines the length.
            None => Parsed::skip_byte(Refusal::Length),
        }
    }

    #[inline(always)]
    fn read(&mut self, mut from: Unpacked<'_>) -> Option<Result<(), Refusal>> {
        let (_, station, error) = (from.byte()?, from.byte()?.wrapping_sub(b'0'), from.byte()?);
        if !(1..=self.stations).contains(&station) || !(0x20..0x7f).contains(&error) {
            return Some(Err(Refusal::Header));
        }
        self.pose = Pose::empty(station, error);
        let pose = &mut self.pose;
        for item in self.layout.items() {
            let good = match item {
                Item::Space => from.byte()? == b' ',
                Item::CrLf => from.byte()? == b'\r' && from.byte()? == b'\n',
                Item::Position => {
                    pose.position_counts = Some(from.counts()?);
                    true
                }
                Item::Euler => {
                    pose.euler_counts = Some(from.counts()?);
                    true
                }
                Item::Cosines(row) => {
                    let row = &mut pose.cosine_counts[usize::from(*row)];
                    row.insert(from.counts()?).is_unit()
                }
                Item::Quaternion => pose.quaternion_wxyz_counts.insert(from.counts()?).is_unit(),
            };
            if !good {
                let number = matches!(item, Item::Cosines(_) | Item::Quaternion);
                return Some(Err(if number { Refusal::Range } else { Refusal::Field }));
            }
        }
        Some(Ok(()))
    }
}

/// The logical bytes of a record whose marks are already checked.
struct Unpacked<'a> {
    /// Groups that are still packed.
    groups: &'a [u8],
    /// Unpacked bits that are not taken yet, the next lowest.
    bits: u128,
    count: u32,
}

impl Unpacked<'_> {
    /// Unpacks at least 16 more bits, if available.
    #[inline(always)]
    fn refill(&mut self) {
        let (word, bytes) = match self.groups.split_first_chunk::<8>() {
            Some((group, rest)) => {
                self.groups = rest;
                (u64::from_le_bytes(*group), 7)
            }
            None => {
                let Some((tops, low)) = self.groups.split_last() else { return };
                let word = low.iter().rev().fold(0, |word, &byte| word << 8 | u64::from(byte));
                self.groups = &[];
                (word | u64::from(*tops) << 56, low.len() as u32)
            }
        };
        // Bit j of the group's last byte becomes bit 7 of byte j: the partial products do not
        // overlap.
        let tops = (word >> 56).wrapping_mul(0x0002_0408_1020_4080) & 0x0080_8080_8080_8080;
        // This mask also clears the mark of the first byte, whose own top bit is 0.
        let seven = word & 0x007f_7f7f_7f7f_7f7f | tops;
        self.bits |= u128::from(seven) << self.count;
        self.count += 8 * bytes;
    }

    #[inline(always)]
    fn bits(&mut self, bits: u32) -> Option<u16> {
        if self.count < bits {
            self.refill();
        }
        self.count = self.count.checked_sub(bits)?;
        let value = self.bits as u16;
        self.bits >>= bits;
        Some(value)
    }

    #[inline(always)]
    fn byte(&mut self) -> Option<u8> {
        // The upper half belongs to the next byte.
        self.bits(8).map(|value| value as u8)
    }

    #[inline(always)]
    fn counts<const N: usize>(&mut self) -> Option<[i16; N]> {
        let mut counts = [0; N];
        for count in &mut counts {
            *count = self.bits(16)?.cast_signed();
        }
        Some(counts)
    }
}

trait UnitLength {
    /// Returns whether this vector of counts has length 1, within 2 %.
    fn is_unit(&self) -> bool;
}

impl<const N: usize> UnitLength for [i16; N] {
    #[inline(always)]
    fn is_unit(&self) -> bool {
        let square: i64 = self.iter().map(|&count| i64::from(count) * i64::from(count)).sum();
        // 0.98² and 1.02² of 32767².
        (1_031_158_708..=1_117_052_811).contains(&square)
    }
}

impl Format for Isotrak {
    type Record<'a> = Record<'a>;

    fn window(&self) -> usize {
        self.layout.wire.max(LONGEST_REPLY)
    }

    fn lock_bytes(&self) -> usize {
        3 * self.layout.wire
    }

    #[inline]
    fn parse<'a>(&'a mut self, window: &'a [u8]) -> Parsed<Record<'a>> {
        match window[0] {
            0x80.. => self.judge_record(window).map(|()| Record::Pose(&self.pose)),
            b'2' => reply::judge(window, LONGEST_REPLY).map(Record::Reply),
            _ => Parsed::skip_byte(Refusal::Noise),
        }
    }
}
