//! Answers of the unit in text, its mode at start: lines that end in CR LF.
//!
//! Measurements in text cannot be split into fields, because times and counts vary in width. They
//! are therefore only recognised here and never read; the driver switches a unit that streams
//! text to binary.

use crate::framing::{Format, Parsed, Refusal};

/// Longest line, in bytes, including its end.
pub const LONGEST_LINE: usize = 512;

/// A line of text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Line<'a> {
    /// An answer to a command: two digits of station, the command, error, a blank, and the text.
    Reply {
        /// Station; 0 for an answer of the whole unit.
        station: u8,
        /// The command's letter, or its control character.
        command: u8,
        /// Error; a blank for none.
        error: u8,
        /// The rest of the line.
        body: &'a [u8],
    },
    /// A measurement: two digits of station, error, a blank, and columns. If the error is a
    /// letter and two blanks follow, the line reads as a reply.
    Measurement {
        /// Station, from 1.
        station: u8,
        /// Error; a blank for none.
        error: u8,
    },
    /// Any other line: the further lines of long answers.
    Other(&'a [u8]),
}

impl Line<'_> {
    /// Appends the line as a unit writes it.
    pub fn write(&self, to: &mut Vec<u8>) {
        match *self {
            Line::Reply { station, command, error, body } => {
                to.extend(format!("{station:02}").bytes());
                to.extend([command, error, b' ']);
                to.extend(body);
            }
            Line::Measurement { station, error } => {
                to.extend(format!("{station:02}").bytes());
                to.extend([error, b' ']);
            }
            Line::Other(text) => to.extend(text),
        }
        to.extend(b"\r\n");
    }
}

/// Reads lines of text.
#[derive(Debug, Clone, Copy, Default)]
pub struct LibertyText;

impl Format for LibertyText {
    type Record<'a> = Line<'a>;

    fn window(&self) -> usize {
        LONGEST_LINE
    }

    /// Two lines: one corrupted by noise, and the next.
    fn lock_bytes(&self) -> usize {
        2 * LONGEST_LINE
    }

    fn parse<'a>(&mut self, window: &'a [u8]) -> Parsed<Line<'a>> {
        let inside = &window[..window.len().min(LONGEST_LINE)];
        let is_text = |byte: &u8| matches!(byte, 0x01..=0x09 | 0x0b..=0x0c | 0x0e..=0x7e);
        match inside.iter().position(|byte| !is_text(byte)) {
            None if inside.len() < LONGEST_LINE => Parsed::Short,
            None => Parsed::skip_byte(Refusal::Length),
            Some(end) => match inside[end..] {
                [b'\r'] if inside.len() < LONGEST_LINE => Parsed::Short,
                [b'\r', b'\n', ..] => Parsed::Record { length: end + 2, record: line(&inside[..end]) },
                // The bytes before a non-text byte cannot be part of a line, whatever follows.
                _ => Parsed::Skip { bytes: end + 1, why: Refusal::Noise },
            },
        }
    }
}

fn line(text: &[u8]) -> Line<'_> {
    match *text {
        [tens @ b'0'..=b'9', ones @ b'0'..=b'9', ref rest @ ..] => {
            let station = 10 * (tens - b'0') + (ones - b'0');
            match *rest {
                [command @ (0x01..=0x1a | b'A'..=b'Z' | b'a'..=b'z' | b'@'), error, b' ', ref body @ ..] => {
                    Line::Reply { station, command, error, body }
                }
                [error @ 0x20..=0x7e, b' ', ..] => Line::Measurement { station, error },
                _ => Line::Other(text),
            }
        }
        _ => Line::Other(text),
    }
}
