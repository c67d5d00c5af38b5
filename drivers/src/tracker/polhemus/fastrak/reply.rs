//! Replies of the unit: `'2'`, station, letter, text, CR LF.

use super::limits::STATIONS;
use crate::framing::{Parsed, Refusal};

/// An answer to a command, or an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reply<'a> {
    /// Station as a digit; a blank for an answer of the whole unit (errors); `?` (ISOTRAK II).
    pub station: u8,
    /// The letter of the command that is answered; `E` for an error.
    pub letter: u8,
    /// The rest, without the line end.
    pub text: &'a [u8],
}

/// The unit's settings and name, as the command `S` gives them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Status {
    /// The requested station, as a digit.
    pub station: u8,
    /// Numbers are singles, not text.
    pub binary: bool,
    /// Positions are in cm, not in inches.
    pub centimetres: bool,
    /// Metal compensation is on.
    pub compensated: bool,
    /// Records are sent continuously.
    pub continuous: bool,
    /// The configuration bit.
    pub configured: bool,
    /// Result of the built-in test; three characters.
    pub test: [u8; 3],
    /// Six characters before the version: a blank, the model (`F3`, …) and the sensor map. Their
    /// division is not verified.
    pub model: [u8; 6],
    /// Firmware version.
    pub version: [u8; 6],
    /// Identity text.
    pub identity: [u8; 32],
}

/// Bytes of a status reply, line end included.
pub const STATUS_BYTES: usize = 55;

impl Reply<'_> {
    /// Returns the status, if this is one (FASTRAK's; ISOTRAK's has another format and is
    /// shorter).
    pub fn status(&self) -> Option<Status> {
        if self.letter != b'S' || self.text.len() != STATUS_BYTES - 5 {
            return None;
        }
        let flags = u16::from_str_radix(std::str::from_utf8(self.text.get(..3)?).ok()?, 16).ok()?;
        Some(Status {
            station: self.station,
            binary: flags & 1 != 0,
            centimetres: flags & 2 != 0,
            compensated: flags & 4 != 0,
            continuous: flags & 8 != 0,
            configured: flags & 16 != 0,
            test: self.text[3..6].try_into().ok()?,
            model: self.text[6..12].try_into().ok()?,
            version: self.text[12..18].try_into().ok()?,
            identity: self.text[18..50].try_into().ok()?,
        })
    }

    /// Returns the codes of an output list, if this answers `O`: two columns each.
    pub fn output_list(&self) -> Option<impl Iterator<Item = u8>> {
        let codes = || {
            self.text.chunks(2).map(|code| match code {
                [b' ' | b'0', ones @ b'0'..=b'9'] => Some(ones - b'0'),
                [tens @ b'1'..=b'9', ones @ b'0'..=b'9'] => Some(10 * (tens - b'0') + (ones - b'0')),
                _ => None,
            })
        };
        (self.letter == b'O' && codes().all(|code| code.is_some())).then(|| codes().flatten())
    }

    /// Returns the stations in use, if this answers `l` (FASTRAK: four digits; ISOTRAK II: two).
    pub fn stations(&self) -> Option<[bool; STATIONS]> {
        let known = self.letter == b'l' && matches!(self.text.len(), 2 | STATIONS);
        if !known || !self.text.iter().all(|digit| matches!(digit, b'0' | b'1')) {
            return None;
        }
        let mut stations = [false; STATIONS];
        stations.iter_mut().zip(self.text).for_each(|(station, &digit)| *station = digit == b'1');
        Some(stations)
    }

    /// Returns the error number, if this is an error that gives one: the integer after `EC` (-1
    /// missing field, -2 not numeric, -3 out of range, -4 frequency, -5 buffer, -99 undefined).
    pub fn error_code(&self) -> Option<i32> {
        if self.letter != b'E' {
            return None;
        }
        let text = std::str::from_utf8(self.text).ok()?;
        let (_, code) = text.rsplit_once("EC")?;
        let code = code.trim_start_matches([' ', '=', ':']);
        let end = code.find(|each: char| !each.is_ascii_digit() && each != '-').unwrap_or(code.len());
        code[..end].parse().ok()
    }
}

/// Judges a possible reply, which must end within `longest` bytes.
pub(in crate::tracker::polhemus) fn judge(window: &[u8], longest: usize) -> Parsed<Reply<'_>> {
    if window.get(1).is_some_and(|station| !matches!(station, b'1'..=b'4' | b' ' | b'?'))
        || window.get(2).is_some_and(|letter| !letter.is_ascii_alphabetic())
    {
        return Parsed::skip_byte(Refusal::Header);
    }
    let inside = &window[..window.len().min(longest)];
    match inside.iter().position(|byte| !(0x20..0x7f).contains(byte)) {
        None if inside.len() < longest => Parsed::Short,
        None => Parsed::skip_byte(Refusal::Length),
        Some(end) => match inside[end..] {
            [b'\r'] if inside.len() < longest => Parsed::Short,
            [b'\r', b'\n', ..] if end >= 3 => {
                let reply = Reply { station: inside[1], letter: inside[2], text: &inside[3..end] };
                Parsed::Record { length: end + 2, record: reply }
            }
            _ => Parsed::skip_byte(Refusal::Length),
        },
    }
}
