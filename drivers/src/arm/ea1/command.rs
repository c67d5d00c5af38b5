//! What the host sends: `!`, a letter, a number or none, LF.

use std::io::Write;

use super::Framing;

/// A command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// `!I`: who the arm is.
    Identify,
    /// `!R<hz>` or `!B<hz>`: so many samples a second, as lines or as blocks; 0 for none.
    Stream(Framing, u32),
    /// `!P`: one sample, as a line.
    Poll,
    /// `!Z<mask>`: the counters of these joints become 0 where they are, bit 0 the base's.
    Zero(u8),
    /// `!T<token>`: what time the arm has.
    Time(u32),
}

impl Command {
    /// The bytes to send.
    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.write(&mut bytes);
        bytes
    }

    /// Appends them.
    pub fn write(&self, to: &mut Vec<u8>) {
        // Writing to memory does not fail.
        let _ = match self {
            Self::Identify => to.write_all(b"!I\n"),
            Self::Stream(Framing::Lines, hz) => writeln!(to, "!R{hz}"),
            Self::Stream(Framing::Blocks, hz) => writeln!(to, "!B{hz}"),
            Self::Poll => to.write_all(b"!P\n"),
            Self::Zero(mask) => writeln!(to, "!Z{mask}"),
            Self::Time(token) => writeln!(to, "!T{token}"),
        };
    }

    /// The command at the front of what was sent to an arm, and its bytes; what a virtual arm reads. `None` while the line is not ended;
    /// otherwise the command, or the [code](super::error) to answer with.
    pub fn read(bytes: &[u8]) -> Option<(Result<Self, u32>, usize)> {
        let end = bytes.iter().position(|&byte| byte == b'\n')?;
        Some((Self::of_line(bytes[..end].trim_ascii_end()), end + 1))
    }

    fn of_line(line: &[u8]) -> Result<Self, u32> {
        let number = |text: &[u8]| {
            let text = std::str::from_utf8(text).ok().filter(|text| text.bytes().all(|byte| byte.is_ascii_digit()));
            text.and_then(|text| text.parse::<u32>().ok()).ok_or(super::error::BAD_PARAMETER)
        };
        match line {
            b"!I" => Ok(Self::Identify),
            b"!P" => Ok(Self::Poll),
            [b'!', b'R', hz @ ..] => number(hz).map(|hz| Self::Stream(Framing::Lines, hz)),
            [b'!', b'B', hz @ ..] => number(hz).map(|hz| Self::Stream(Framing::Blocks, hz)),
            [b'!', b'T', token @ ..] => number(token).map(Self::Time),
            [b'!', b'Z', mask @ ..] => match number(mask)? {
                mask @ 0..=7 => Ok(Self::Zero(mask as u8)),
                _ => Err(super::error::BAD_PARAMETER),
            },
            _ => Err(super::error::UNKNOWN_COMMAND),
        }
    }
}
