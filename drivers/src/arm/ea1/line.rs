//! Lines: `$`, fields, `*`, checksum of two hexadecimal digits, CR LF. The checksum is the
//! exclusive or of the bytes between `$` and `*`.

use super::record::{AXES, Framing, Identity, LONGEST_LINE, Record, Sample, flag};
use crate::framing::{Parsed, Refusal};
use crate::numerals;

/// Bytes of `*`, two digits, CR LF.
const END: usize = 5;

#[inline]
pub(super) fn parse(window: &[u8]) -> Parsed<Record<'_>> {
    match sample(window) {
        Some((length, sample)) => Parsed::Record { length, record: Record::Sample(sample) },
        None => any_line(window),
    }
}

/// Reads a whole and valid sample, as nearly every line is. For everything else, [`any_line`]
/// gives the reason.
#[inline]
fn sample(window: &[u8]) -> Option<(usize, Sample)> {
    let mut rest = window.strip_prefix(b"$EA,")?;
    let seq = unsigned(&mut rest)?;
    let t_us = unsigned(&mut rest)?;
    let counts = [signed(&mut rest)?, signed(&mut rest)?, signed(&mut rest)?];
    let (flags, length) = hexadecimal(rest)?;
    let star = window.len() - rest.len() + length;
    let ended = window.get(star..star + END)?.strip_prefix(b"*")?;
    let good = ended == sum_and_end(&window[1..star]) && flags & !flag::KNOWN == 0;
    let buttons = u8::from(flags & flag::BUTTON != 0);
    good.then_some((star + END, Sample { seq, t_us, counts, flags, buttons, framing: Framing::Lines }))
}

#[inline(always)]
fn unsigned(rest: &mut &[u8]) -> Option<u32> {
    let (value, count) = numerals::unsigned(rest)?;
    if rest.get(count) != Some(&b',') {
        return None;
    }
    *rest = &rest[count + 1..];
    Some(value)
}

#[inline(always)]
fn signed(rest: &mut &[u8]) -> Option<i32> {
    let negative = rest.first() == Some(&b'-');
    if negative {
        *rest = &rest[1..];
    }
    in_range(negative, unsigned(rest)?)
}

#[inline(always)]
fn in_range(negative: bool, value: u32) -> Option<i32> {
    if negative { 0_i32.checked_sub_unsigned(value) } else { i32::try_from(value).ok() }
}

/// Reads the hexadecimal digits at the front of `text`; returns their value and number, 1 to 4.
#[inline(always)]
fn hexadecimal(text: &[u8]) -> Option<(u16, usize)> {
    let mut value = 0;
    let mut count = 0;
    while let Some(digit) = text.get(count).copied().and_then(digit) {
        if count == 4 {
            return None;
        }
        value = value << 4 | digit;
        count += 1;
    }
    (count > 0).then_some((value, count))
}

#[inline(always)]
fn digit(byte: u8) -> Option<u16> {
    match byte {
        b'0'..=b'9' => Some(u16::from(byte - b'0')),
        b'A'..=b'F' => Some(u16::from(byte - b'A') + 10),
        b'a'..=b'f' => Some(u16::from(byte - b'a') + 10),
        _ => None,
    }
}

/// Returns the bytes that must follow the star: the checksum in upper case, CR LF.
#[inline]
fn sum_and_end(summed: &[u8]) -> [u8; 4] {
    const DIGITS: [u8; 16] = *b"0123456789ABCDEF";
    let (words, rest) = summed.as_chunks::<8>();
    let mut word = words.iter().fold(0, |sum, word| sum ^ u64::from_le_bytes(*word));
    word ^= word >> 32;
    word ^= word >> 16;
    let sum = rest.iter().fold((word ^ word >> 8) as u8, |sum, byte| sum ^ byte);
    [DIGITS[usize::from(sum >> 4)], DIGITS[usize::from(sum & 0xf)], b'\r', b'\n']
}

/// Reads any line that begins here, or gives the reason for a refusal. Agrees with [`sample`] on
/// samples.
#[cold]
fn any_line(window: &[u8]) -> Parsed<Record<'_>> {
    let inside = &window[..window.len().min(LONGEST_LINE)];
    let is_within = |byte: &u8| matches!(byte, 0x20..=0x7e) && !matches!(byte, b'$' | b'*');
    let Some(star) = inside[1..].iter().position(|byte| !is_within(byte)).map(|before| 1 + before) else {
        return if inside.len() < LONGEST_LINE { Parsed::Short } else { Parsed::skip_byte(Refusal::Length) };
    };
    if inside[star] != b'*' {
        // The line is truncated: a new one may begin here.
        return Parsed::Skip { bytes: star, why: Refusal::Length };
    }
    let [tens, ones, end @ ..] = sum_and_end(&inside[1..star]);
    let expected = [[tens, ones].map(|digit| digit.to_ascii_lowercase()), [tens, ones]];
    for (index, byte) in inside[star + 1..].iter().take(END - 1).enumerate() {
        let (good, why) = match index {
            0 | 1 => (expected.iter().any(|digits| digits[index] == *byte), Refusal::Checksum),
            _ => (end[index - 2] == *byte, Refusal::Length),
        };
        if !good {
            return Parsed::skip_byte(why);
        }
    }
    if inside.len() < star + END {
        return if inside.len() < LONGEST_LINE { Parsed::Short } else { Parsed::skip_byte(Refusal::Length) };
    }
    match std::str::from_utf8(&inside[1..star]).ok().map(record) {
        Some(Ok(record)) => Parsed::Record { length: star + END, record },
        Some(Err(why)) => Parsed::skip_byte(why),
        None => Parsed::skip_byte(Refusal::Field),
    }
}

/// Reads the fields of a line with a correct checksum.
fn record(text: &str) -> Result<Record<'_>, Refusal> {
    let mut fields = text.split(',');
    let kind = fields.next();
    let mut next = || fields.next().ok_or(Refusal::Field);
    let record = match kind {
        Some("EA") => {
            let (seq, t_us) = (number(next()?)?, number(next()?)?);
            let counts = [count(next()?)?, count(next()?)?, count(next()?)?];
            let digits = next()?;
            let flags = match hexadecimal(digits.as_bytes()) {
                Some((flags, count)) if count == digits.len() => flags,
                _ => return Err(Refusal::Field),
            };
            if flags & !flag::KNOWN != 0 {
                return Err(Refusal::Range);
            }
            let buttons = u8::from(flags & flag::BUTTON != 0);
            Record::Sample(Sample { seq, t_us, counts, flags, buttons, framing: Framing::Lines })
        }
        Some("EI") => {
            // Another version or number of joints is another protocol.
            if next()? != "1" {
                return Err(Refusal::Header);
            }
            let (model, serial) = (next()?, next()?);
            if number(next()?)? as usize != AXES {
                return Err(Refusal::Header);
            }
            Record::Identity(Identity {
                model,
                serial,
                counts_per_revolution: [number(next()?)?, number(next()?)?, number(next()?)?],
                tick_hz: number(next()?)?,
                rate_hz: number(next()?)?,
            })
        }
        Some("ET") => Record::Time { token: number(next()?)?, t_us: number(next()?)? },
        Some("EE") => Record::Error(number(next()?)?),
        _ => return Err(Refusal::Header),
    };
    match fields.next() {
        None => Ok(record),
        Some(_) => Err(Refusal::Field),
    }
}

fn number(field: &str) -> Result<u32, Refusal> {
    match numerals::unsigned(field.as_bytes()) {
        Some((value, count)) if count == field.len() => Ok(value),
        _ => Err(Refusal::Field),
    }
}

fn count(field: &str) -> Result<i32, Refusal> {
    let (negative, digits) = field.strip_prefix('-').map_or((false, field), |digits| (true, digits));
    in_range(negative, number(digits)?).ok_or(Refusal::Field)
}

/// Reads three whole numbers with commas between them, ended by LF or CR LF.
pub(super) fn bare_numbers(window: &[u8]) -> Parsed<Record<'_>> {
    // Eleven characters per number, two commas, CR LF.
    const LONGEST: usize = 3 * 11 + 2 + 2;
    let inside = &window[..window.len().min(LONGEST)];
    let Some(end) = inside.iter().position(|byte| !matches!(byte, b'0'..=b'9' | b'-' | b',')) else {
        return if inside.len() < LONGEST { Parsed::Short } else { Parsed::skip_byte(Refusal::Length) };
    };
    let length = match inside[end..] {
        [b'\n', ..] => end + 1,
        [b'\r', b'\n', ..] => end + 2,
        [b'\r'] if inside.len() < LONGEST => return Parsed::Short,
        _ => return Parsed::skip_byte(Refusal::Length),
    };
    let mut fields = inside[..end]
        .split(|&byte| byte == b',')
        .map(|field| std::str::from_utf8(field).map_err(|_| Refusal::Field).and_then(count));
    match (fields.next(), fields.next(), fields.next(), fields.next()) {
        (Some(Ok(a)), Some(Ok(b)), Some(Ok(c)), None) => {
            Parsed::Record { length, record: Record::Unreliable([a, b, c]) }
        }
        _ => Parsed::skip_byte(Refusal::Field),
    }
}

impl Record<'_> {
    /// Appends the record as the arm sends it: a block for a sample of that framing, otherwise a
    /// line.
    pub fn write(&self, to: &mut Vec<u8>) {
        let text = match self {
            Self::Sample(sample) if sample.framing == Framing::Blocks => return super::block::write(sample, to),
            Self::Sample(Sample { seq, t_us, counts: [a, b, c], flags, .. }) => {
                format!("EA,{seq},{t_us},{a},{b},{c},{flags:02X}")
            }
            Self::Identity(Identity { model, serial, counts_per_revolution: [a, b, c], tick_hz, rate_hz }) => {
                format!("EI,1,{model},{serial},{AXES},{a},{b},{c},{tick_hz},{rate_hz}")
            }
            Self::Time { token, t_us } => format!("ET,{token},{t_us}"),
            Self::Error(code) => format!("EE,{code}"),
            Self::Unreliable([a, b, c]) => return to.extend(format!("{a},{b},{c}\n").bytes()),
        };
        to.push(b'$');
        to.extend(text.bytes());
        to.push(b'*');
        to.extend(sum_and_end(text.as_bytes()));
    }
}
