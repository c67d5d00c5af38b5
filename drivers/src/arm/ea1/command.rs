//! Commands of the host: `!`, a letter, an optional number, LF.

use std::io::Write;

use super::Framing;

/// A command to the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// `!I`: asks for the arm's identity.
    Identify,
    /// `!R<hz>` or `!B<hz>`: samples per second, as lines or as blocks; 0 for none.
    Stream(Framing, u32),
    /// `!P`: asks for one sample, as a line.
    Poll,
    /// `!Z<mask>`: sets the counters of these joints to 0 at their present position; bit 0 is the
    /// base.
    Zero(u8),
    /// `!T<token>`: asks for the arm's time.
    Time(u32),
}

impl Command {
    /// Returns the bytes to send.
    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.write(&mut bytes);
        bytes
    }

    /// Appends the bytes to send.
    pub fn write(&self, to: &mut Vec<u8>) {
        // Writing to memory cannot fail.
        let _ = match self {
            Self::Identify => to.write_all(b"!I\n"),
            Self::Stream(Framing::Lines, hz) => writeln!(to, "!R{hz}"),
            Self::Stream(Framing::Blocks, hz) => writeln!(to, "!B{hz}"),
            Self::Poll => to.write_all(b"!P\n"),
            Self::Zero(mask) => writeln!(to, "!Z{mask}"),
            Self::Time(token) => writeln!(to, "!T{token}"),
        };
    }

    /// Reads the first command in bytes sent to an arm, and returns it with its length in bytes.
    /// Virtual arms use this. Returns `None` while the line is unfinished; otherwise the command,
    /// or the error [code](super::error) for the answer.
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
