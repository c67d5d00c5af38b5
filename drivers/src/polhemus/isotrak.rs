//! The binary wire format of 3SPACE, ISOTRAK and ISOTRAK II; their text is [FASTRAK's](super::fastrak).
//!
//! | | |
//! |---|---|
//! | Clock | none: records carry neither a time nor a number |
//! | Tick | 1/60 s divided by the stations in use (ISOTRAK II; not confirmed by its manual) |
//! | Wrap | nothing to wrap |
//! | Instant | not documented; before the record's first byte by the unit's latency |
//!
//! A logical record is `'0'`, station, error letter or stylus switch, and 16-bit integers, little-endian. On the wire each group of up to seven
//! bytes gives its top bits to a byte that follows it, so that seven bits a byte are left; bit 7 then marks the first byte of a record
//! and no other. Full scale is ±65.48 inches whatever unit was set. Wherever bit 7 turns up before a record's end, that record was cut and another
//! begins. Replies are plain text as FASTRAK's.

use super::fastrak::reply::{self, Reply};
use crate::framing::{Format, Look, Refusal};

/// Centimetres of position to a count.
pub const CM_PER_COUNT: f64 = 166.32 / 32_767.0;
/// Of a quaternion's and a cosine's counts to 1.
pub const UNIT_PER_COUNT: f64 = 1.0 / 32_767.0;
/// Degrees to a count of an angle. Not verified.
pub const DEGREES_PER_COUNT: f64 = 180.0 / 32_767.0;

/// Stylus switch pressed, in the place of the error letter.
pub const PRESSED: u8 = b'@';
/// Stylus switch released.
pub const RELEASED: u8 = b'*';

/// Most stations of a unit.
pub const STATIONS: u8 = 2;

/// Longest reply among records; a status has 21 bytes.
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

    /// The number that stands for it in the command `O`.
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

    /// The item that a number of the command `O` stands for.
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
/// Three of header, and every item once with the line ends: below this.
const MOST_LOGICAL: usize = 56;

/// What every record looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    items: [Item; MOST_ITEMS],
    count: usize,
    logical: usize,
    wire: usize,
}

/// Why a list of codes is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ListError {
    /// A code that these units are not known to have.
    #[error("output item {0} is not known of ISOTRAK in binary; known are 0, 1, 2, 4 to 7 and 11")]
    Unknown(u8),
    /// More entries than there are items.
    #[error("{0} output items are more than the {MOST_ITEMS} that there are")]
    TooMany(usize),
}

impl Layout {
    /// The layout that a list of output codes leads to.
    ///
    /// # Errors
    /// [`ListError`] for codes and lengths that no unit is known to have.
    pub fn new(codes: &[u8]) -> Result<Self, ListError> {
        if codes.len() > MOST_ITEMS {
            return Err(ListError::TooMany(codes.len()));
        }
        let mut items = [Item::Space; MOST_ITEMS];
        let mut logical = 3;
        for (item, &code) in items.iter_mut().zip(codes) {
            *item = Item::from_code(code).ok_or(ListError::Unknown(code))?;
            logical += item.bytes();
        }
        // Eight quaternions would be longer than every item once.
        if logical > MOST_LOGICAL {
            return Err(ListError::TooMany(codes.len()));
        }
        Ok(Self { items, count: codes.len(), logical, wire: logical + logical.div_ceil(7) })
    }

    /// The list, in order.
    pub fn items(&self) -> &[Item] {
        &self.items[..self.count]
    }

    /// Bytes of a record on the wire.
    pub fn length(&self) -> usize {
        self.wire
    }
}

/// What the unit sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Record<'a> {
    /// A station's measurement.
    Pose(Pose),
    /// An answer to a command, or an error.
    Reply(Reply<'a>),
}

/// A station's measurement in counts: what the output list asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pose {
    /// Station, from 1.
    pub station: u8,
    /// The unit's last error as its letter, a blank for none; or the stylus' switch, [`PRESSED`] or [`RELEASED`].
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
    /// Nothing measured yet.
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

    /// Appends the record of this layout as a unit sends it; numbers that the pose lacks are written as 0.
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
}

impl Isotrak {
    /// Of a unit with so many stations in use, at most [`STATIONS`].
    pub fn new(stations: u8, layout: Layout) -> Self {
        Self { layout, stations: stations.min(STATIONS) }
    }

    /// What every record looks like.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    #[inline]
    fn judge_record(&self, window: &[u8]) -> Look<Pose> {
        if window[0] != b'0' | 0x80 {
            return Look::skip_byte(Refusal::Header);
        }
        let Some(inside) = window.get(..self.layout.wire) else {
            return match window[1..].iter().position(|byte| byte & 0x80 != 0) {
                None => Look::Short,
                Some(before) => Look::Skip { bytes: 1 + before, why: Refusal::Length },
            };
        };
        // A group at a time: seven bytes and their top bits.
        let mut logical = [0; MOST_LOGICAL + 8];
        for (index, group) in inside.chunks(8).enumerate() {
            let mut bytes = [0; 8];
            match <[u8; 8]>::try_from(group) {
                Ok(whole) => bytes = whole,
                Err(_) => {
                    // The last group is short; its top bits are its last byte all the same.
                    let (tops, low) = (group[group.len() - 1], &group[..group.len() - 1]);
                    bytes[..low.len()].copy_from_slice(low);
                    bytes[7] = tops;
                }
            }
            let word = u64::from_le_bytes(bytes) & if index == 0 { !0x80 } else { u64::MAX };
            let marks = word & 0x8080_8080_8080_8080;
            if marks != 0 {
                let within = marks.trailing_zeros() as usize / 8;
                // The short group's top bits stand at its end.
                return Look::Skip { bytes: 8 * index + within.min(group.len() - 1), why: Refusal::Length };
            }
            // Bit j of the last byte becomes bit 7 of byte j: no two of the products meet.
            let tops = (word >> 56).wrapping_mul(0x0002_0408_1020_4080) & 0x0080_8080_8080_8080;
            logical[7 * index..7 * index + 8].copy_from_slice(&(word & 0x00ff_ffff_ffff_ffff | tops).to_le_bytes());
        }
        match self.read(&logical) {
            Ok(pose) => Look::Record { length: self.layout.wire, record: pose },
            Err(why) => Look::skip_byte(why),
        }
    }

    #[inline]
    fn read(&self, logical: &[u8; MOST_LOGICAL + 8]) -> Result<Pose, Refusal> {
        let [_, station, error, rest @ ..] = logical;
        let station = station.wrapping_sub(b'0');
        if !(1..=self.stations).contains(&station) || !(0x20..0x7f).contains(error) {
            return Err(Refusal::Header);
        }
        let mut pose = Pose::empty(station, *error);
        let mut rest: &[u8] = rest;
        for item in self.layout.items() {
            match item {
                Item::Space => exactly(&mut rest, *b" ")?,
                Item::CrLf => exactly(&mut rest, *b"\r\n")?,
                Item::Position => pose.position_counts = Some(counts(&mut rest)?),
                Item::Euler => pose.euler_counts = Some(counts(&mut rest)?),
                Item::Cosines(row) => pose.cosine_counts[usize::from(*row)] = Some(unit(&mut rest)?),
                Item::Quaternion => pose.quaternion_wxyz_counts = Some(unit(&mut rest)?),
            }
        }
        Ok(pose)
    }
}

#[inline]
fn take<const N: usize>(rest: &mut &[u8]) -> Result<[u8; N], Refusal> {
    let (first, after) = rest.split_first_chunk().ok_or(Refusal::Length)?;
    *rest = after;
    Ok(*first)
}

#[inline]
fn exactly<const N: usize>(rest: &mut &[u8], what: [u8; N]) -> Result<(), Refusal> {
    if take(rest)? == what { Ok(()) } else { Err(Refusal::Field) }
}

#[inline]
fn counts<const N: usize>(rest: &mut &[u8]) -> Result<[i16; N], Refusal> {
    let mut counts = [0; N];
    for count in &mut counts {
        *count = i16::from_le_bytes(take(rest)?);
    }
    Ok(counts)
}

/// Counts of a vector whose length is 1, within 2 in 100.
#[inline]
fn unit<const N: usize>(rest: &mut &[u8]) -> Result<[i16; N], Refusal> {
    let counts = counts(rest)?;
    let square: i64 = counts.iter().map(|&count| i64::from(count) * i64::from(count)).sum();
    // 0.98² and 1.02² of 32767².
    if (1_031_158_708..=1_117_052_811).contains(&square) { Ok(counts) } else { Err(Refusal::Range) }
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
    fn look<'a>(&mut self, window: &'a [u8]) -> Look<Record<'a>> {
        match window[0] {
            0x80.. => self.judge_record(window).map(Record::Pose),
            b'2' => reply::judge(window, LONGEST_REPLY).map(Record::Reply),
            _ => Look::skip_byte(Refusal::Noise),
        }
    }
}
