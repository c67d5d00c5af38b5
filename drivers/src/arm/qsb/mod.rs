//! US Digital QSB: one encoder, one serial port, lines of text. An arm has three of them.
//!
//! | | |
//! |---|---|
//! | Clock | a counter in each QSB, set to 0 by the driver; three QSBs have three clocks |
//! | Tick | 1/512 s |
//! | Wrap | 2³²: after 97 days |
//! | Instant | not documented; assumed to be the instant at which the count was read |
//!
//! A line is a letter, a register of two hexadecimal digits, a value of eight, a time of eight if
//! enabled, `!` and the line end. Blanks separate the parts if enabled. There is no checksum, but
//! each part of a line is unambiguous. Setting DTR low and high again resets the unit. It then
//! sends a [banner](Record::Banner), and its count and its clock restart.

mod lines;
pub(super) mod unit;

pub use lines::Arm;
pub use unit::Unit;

use crate::framing::{Format, Parsed, Refusal};
use crate::numerals;

/// Clock frequency, ticks per second.
pub const TICK_HZ: u32 = 512;

/// Bytes of a line with blanks, time, CR and LF, as [`Command::FORMAT`] selects.
const LINE: usize = 26;

/// Registers.
#[allow(missing_docs, reason = "the names are the manual's")]
pub mod register {
    pub const MODE: u8 = 0x00;
    pub const COUNT_MODE: u8 = 0x03;
    pub const DIRECTION: u8 = 0x04;
    pub const PRESET: u8 = 0x08;
    pub const STREAM_THRESHOLD: u8 = 0x0b;
    pub const STREAM_INTERVAL: u8 = 0x0c;
    pub const RESET_TIME: u8 = 0x0d;
    pub const COUNT: u8 = 0x0e;
    pub const VERSION: u8 = 0x14;
    pub const REPLY_FORMAT: u8 = 0x15;
}

/// A line from the unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Record<'a> {
    /// The value of a register.
    Value(Value),
    /// `e`: the unit refused a command. The meaning of the rest of the line is not documented.
    Error(&'a [u8]),
    /// `QSB-…!`: the unit has been reset.
    Banner,
}

/// The value of a register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Value {
    /// Why it was sent.
    pub cause: Cause,
    /// Register number.
    pub register: u8,
    /// The value; a [count](register::COUNT) is signed.
    pub value: u32,
    /// Time of the value, in ticks of [`TICK_HZ`]; wraps at 2³². `None` if the unit is not set to
    /// send it.
    pub ticks: Option<u32>,
}

/// Why a value was sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Cause {
    /// The host read it.
    Read,
    /// The host wrote it.
    Written,
    /// The unit streams it.
    Streamed,
}

impl Cause {
    const fn letter(self) -> u8 {
        match self {
            Self::Read => b'r',
            Self::Written => b'w',
            Self::Streamed => b's',
        }
    }

    const fn from_letter(letter: u8) -> Option<Self> {
        match letter {
            b'r' => Some(Self::Read),
            b'w' => Some(Self::Written),
            b's' => Some(Self::Streamed),
            _ => None,
        }
    }
}

impl Record<'_> {
    /// Appends the line as a unit writes it after [`Command::FORMAT`].
    pub fn write(&self, to: &mut Vec<u8>) {
        match *self {
            Self::Value(Value { cause, register, value, ticks }) => {
                to.push(cause.letter());
                to.extend(format!(" {register:02X} {value:08X} ").bytes());
                if let Some(ticks) = ticks {
                    to.extend(format!("{ticks:08X} ").bytes());
                }
                to.extend(b"!\r\n");
            }
            Self::Error(text) => {
                to.push(b'e');
                to.extend(text);
                to.extend(b"!\r\n");
            }
            Self::Banner => to.extend(b"QSB-D  0E!\r\n"),
        }
    }
}

/// A command to the unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// `R`: asks for a register's value. Reading any register also ends a stream.
    Read(u8),
    /// `W`: writes a register.
    Write(u8, u32),
    /// `S`: streams a register.
    Stream(u8),
}

impl Command {
    /// Selects lines with LF, CR, time and blanks.
    pub const FORMAT: Self = Self::Write(register::REPLY_FORMAT, 0xf);

    /// Returns the bytes to send.
    pub fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Read(register) => format!("R{register:02X}\n"),
            Self::Write(register, value) => format!("W{register:02X}{value:X}\n"),
            Self::Stream(register) => format!("S{register:02X}\n"),
        }
        .into_bytes()
    }

    /// Reads the first command in bytes sent to a unit, and returns it with its length in bytes.
    /// Virtual units use this. Returns `None` while the line is unfinished, and no command for an
    /// unknown one.
    pub fn read(bytes: &[u8]) -> Option<(Option<Self>, usize)> {
        let end = bytes.iter().position(|&byte| byte == b'\n')?;
        let of_line = |line: &[u8]| {
            let text =
                std::str::from_utf8(line).ok().filter(|text| text.bytes().all(|byte| byte.is_ascii_alphanumeric()))?;
            let register = u8::from_str_radix(text.get(1..3)?, 16).ok()?;
            match (line[0], &text[3..]) {
                (b'R', "") => Some(Self::Read(register)),
                (b'S', "") => Some(Self::Stream(register)),
                (b'W', value) => u32::from_str_radix(value, 16).ok().map(|value| Self::Write(register, value)),
                _ => None,
            }
        };
        Some((of_line(bytes[..end].trim_ascii_end()), end + 1))
    }
}

/// Reads a unit's lines.
#[derive(Debug, Clone, Copy, Default)]
pub struct Qsb;

impl Format for Qsb {
    type Record<'a> = Record<'a>;

    fn window(&self) -> usize {
        LINE + 2
    }

    fn lock_bytes(&self) -> usize {
        3 * LINE
    }

    #[inline]
    fn parse<'a>(&mut self, window: &'a [u8]) -> Parsed<Record<'a>> {
        match usual(window) {
            Some(value) => Parsed::Record { length: LINE, record: Record::Value(value) },
            None => any_line(window),
        }
    }
}

/// Reads a value in the selected format. For everything else, [`any_line`] gives the reason.
#[inline]
fn usual(window: &[u8]) -> Option<Value> {
    let &[letter, b' ', high, low, b' ', ref rest @ ..] = window.first_chunk::<LINE>()? else {
        return None;
    };
    let (value, rest) = rest.split_first_chunk::<8>()?;
    let (ticks, rest) = rest.strip_prefix(b" ")?.split_first_chunk::<8>()?;
    if rest != b" !\r\n" {
        return None;
    }
    let register = numerals::hex([b'0', b'0', b'0', b'0', b'0', b'0', high, low])? as u8;
    let cause = Cause::from_letter(letter)?;
    Some(Value { cause, register, value: numerals::hex(*value)?, ticks: Some(numerals::hex(*ticks)?) })
}

/// Reads a line in any format of a unit.
#[cold]
fn any_line(window: &[u8]) -> Parsed<Record<'_>> {
    let inside = &window[..window.len().min(LINE)];
    let first = inside[0];
    let may_follow = |byte: &u8| match first {
        b'r' | b'w' | b's' => byte.is_ascii_hexdigit() || *byte == b' ',
        _ => matches!(byte, 0x20..=0x7e),
    };
    if !matches!(first, b'r' | b'w' | b's' | b'e' | b'Q') {
        return Parsed::skip_byte(Refusal::Noise);
    }
    if inside.iter().zip(b"QSB-").any(|(byte, letter)| first == b'Q' && byte != letter) {
        return Parsed::skip_byte(Refusal::Header);
    }
    // The search for `!` starts after the first byte.
    let end = inside[1..].iter().position(|byte| *byte == b'!' || !may_follow(byte)).map(|before| 1 + before);
    let Some(end) = end else {
        return if inside.len() < LINE { Parsed::Short } else { Parsed::skip_byte(Refusal::Length) };
    };
    if inside[end] != b'!' {
        return Parsed::skip_byte(Refusal::Length);
    }
    // The unit's settings determine its line end.
    let length = match window[end + 1..] {
        [] | [b'\r'] => return Parsed::Short,
        [b'\r', b'\n', ..] => end + 3,
        [b'\r' | b'\n', ..] => end + 2,
        _ => end + 1,
    };
    let record = match first {
        b'e' => Some(Record::Error(&inside[1..end])),
        b'Q' => Some(Record::Banner),
        _ => value(&inside[..end]).map(Record::Value),
    };
    record.map_or(Parsed::skip_byte(Refusal::Field), |record| Parsed::Record { length, record })
}

/// Reads a letter, 2, 8 and optionally 8 more digits, and blanks anywhere.
fn value(line: &[u8]) -> Option<Value> {
    let cause = Cause::from_letter(line[0])?;
    let mut digits = [b'0'; 18];
    let mut count = 0;
    for &digit in line[1..].iter().filter(|&&byte| byte != b' ') {
        *digits.get_mut(count)? = digit;
        count += 1;
    }
    let [high, low, rest @ ..] = digits;
    let (value, ticks) = rest.split_first_chunk::<8>()?;
    let ticks = match count {
        10 => None,
        18 => Some(numerals::hex(ticks.try_into().ok()?)?),
        _ => return None,
    };
    let register = numerals::hex([b'0', b'0', b'0', b'0', b'0', b'0', high, low])? as u8;
    Some(Value { cause, register, value: numerals::hex(*value)?, ticks })
}
