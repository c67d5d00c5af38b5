//! Reads the items of one record, as text in columns or as numbers.

use super::limits::FARTHEST;
use super::list::{Item, Layout, Mode};
use super::pose::Pose;
use crate::framing::Refusal;
use crate::numerals;

/// Tolerance of the length 1 of a quaternion or a cosine row.
const UNIT_LENGTH_TOLERANCE: f64 = 0.02;

/// Scale of the 14-bit items: ±300 cm, ±180°, ±1, over 2¹⁵ (the lowest two of 16 bits are not
/// sent).
pub(super) const PACKED_CM: f64 = 300.0 / 32_768.0;
pub(super) const PACKED_DEG: f64 = 180.0 / 32_768.0;
pub(super) const PACKED_UNIT: f64 = 1.0 / 32_768.0;

/// Reads a whole record of this layout; `bytes` has its length, and its header is already
/// checked.
#[inline(always)]
pub(super) fn read(bytes: &[u8], layout: &Layout, pose: &mut Pose) -> Result<(), Refusal> {
    *pose = Pose::empty(bytes[1] - b'0', bytes[2]);
    match layout.mode() {
        Mode::Ascii => read_items::<false>(&bytes[3..], layout, pose),
        Mode::Binary => read_items::<true>(&bytes[3..], layout, pose),
    }
}

#[inline(always)]
fn read_items<const BINARY: bool>(bytes: &[u8], layout: &Layout, pose: &mut Pose) -> Result<(), Refusal> {
    let mut reader = Reader::<BINARY> { rest: bytes, packed_begun: false };
    for entry in layout.entries() {
        reader.item(entry.item, entry.extended, pose)?;
    }
    Ok(())
}

struct Reader<'a, const BINARY: bool> {
    rest: &'a [u8],
    /// Whether the first 14-bit value has been read; only its first byte has bit 7 set.
    packed_begun: bool,
}

impl<const BINARY: bool> Reader<'_, BINARY> {
    #[inline(always)]
    fn item(&mut self, item: Item, extended: bool, pose: &mut Pose) -> Result<(), Refusal> {
        match item {
            Item::Space => self.exactly(*b" ")?,
            Item::CrLf => self.exactly(*b"\r\n")?,
            Item::Position => pose.position = Some(self.near::<4>(extended)?),
            Item::RelativePosition => pose.relative_position = Some(self.near::<4>(extended)?),
            Item::Euler => pose.euler_deg = Some(self.within(extended, 360.0)?),
            Item::Cosines(row) => pose.cosines[usize::from(row)] = Some(self.unit(extended)?),
            Item::Quaternion => pose.quaternion_wxyz = Some(self.unit(extended)?),
            Item::Stylus => {
                let switch: [u8; 2] = self.bytes()?;
                if switch[0] != b' ' || !switch[1].is_ascii_digit() {
                    return Err(Refusal::Field);
                }
                pose.stylus = Some(switch);
            }
            Item::Position14 => pose.position = Some(self.packed(PACKED_CM)?),
            Item::Euler14 => pose.euler_deg = Some(self.packed(PACKED_DEG)?),
            Item::Quaternion14 => pose.quaternion_wxyz = Some(self.packed(PACKED_UNIT)?),
        }
        Ok(())
    }

    #[inline(always)]
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], Refusal> {
        let (first, rest) = self.rest.split_first_chunk().ok_or(Refusal::Length)?;
        self.rest = rest;
        Ok(*first)
    }

    #[inline(always)]
    fn exactly<const N: usize>(&mut self, what: [u8; N]) -> Result<(), Refusal> {
        if self.bytes()? == what { Ok(()) } else { Err(Refusal::Length) }
    }

    /// Reads `N` numbers, in text with `WHOLE` columns before the point.
    #[inline(always)]
    fn numbers<const N: usize, const WHOLE: u32>(&mut self, extended: bool) -> Result<[f64; N], Refusal> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = if BINARY {
                f64::from(f32::from_le_bytes(self.bytes()?))
            } else if extended {
                extended_number(&self.bytes()?).ok_or(Refusal::Field)?
            } else {
                let (negative, digits) = numerals::fixed_point::<WHOLE>(self.bytes()?).ok_or(Refusal::Field)?;
                let value = f64::from(digits) / if WHOLE == 4 { 1e2 } else { 1e4 };
                if negative { -value } else { value }
            };
        }
        Ok(values)
    }

    #[inline(always)]
    fn near<const WHOLE: u32>(&mut self, extended: bool) -> Result<[f64; 3], Refusal> {
        // Text is accepted over the whole range of its columns.
        self.within(extended, if BINARY { FARTHEST } else { f64::INFINITY })
    }

    #[inline(always)]
    fn within(&mut self, extended: bool, limit: f64) -> Result<[f64; 3], Refusal> {
        let values = self.numbers::<3, 4>(extended)?;
        // This form also refuses NaN.
        if values.iter().all(|value| value.abs() < limit) { Ok(values) } else { Err(Refusal::Range) }
    }

    #[inline(always)]
    fn unit<const N: usize>(&mut self, extended: bool) -> Result<[f64; N], Refusal> {
        let values = self.numbers::<N, 2>(extended)?;
        let square = values.iter().fold(0.0, |sum, value| sum + value * value);
        let low = (1.0 - UNIT_LENGTH_TOLERANCE) * (1.0 - UNIT_LENGTH_TOLERANCE);
        let high = (1.0 + UNIT_LENGTH_TOLERANCE) * (1.0 + UNIT_LENGTH_TOLERANCE);
        if !BINARY || (low..=high).contains(&square) { Ok(values) } else { Err(Refusal::Range) }
    }

    fn packed<const N: usize>(&mut self, scale: f64) -> Result<[f64; N], Refusal> {
        let mut values = [0.0; N];
        for value in &mut values {
            let [low, high]: [u8; 2] = self.bytes()?;
            if (low & 0x80 != 0) == self.packed_begun || high & 0x80 != 0 {
                return Err(Refusal::Field);
            }
            self.packed_begun = true;
            let counts = u16::from(low & 0x7f) << 2 | u16::from(high) << 9;
            *value = f64::from(counts.cast_signed()) * scale;
        }
        Ok(values)
    }
}

/// Reads a number of extended precision: sign or blank, digit, point, five digits, `E`, sign, two
/// digits, blank.
fn extended_number(field: &[u8; 13]) -> Option<f64> {
    let [_, whole, point, fraction @ .., e, sign, tens, ones, blank] = field;
    let digits = [whole, tens, ones].into_iter().chain(fraction).all(u8::is_ascii_digit);
    if !digits || *point != b'.' || *e != b'E' || !matches!(sign, b'+' | b'-') || *blank != b' ' {
        return None;
    }
    let text = std::str::from_utf8(&field[..12]).ok()?;
    match field[0] {
        b' ' => text[1..].parse().ok(),
        b'+' | b'-' => text.parse().ok(),
        _ => None,
    }
}
