//! LIBERTY's wire format, which PATRIOT, LIBERTY HS and Latus share, over serial and USB alike.
//!
//! | | |
//! |---|---|
//! | Clock | the unit's own: a frame count and a time in ms, if the output list has them (items 9 and 8) |
//! | Tick | the frame, 1/240 s, 1/120 s or 1/60 s as set; the time's tick is 1 ms |
//! | Wrap | both at 2³²: the time after 49.7 days, the count at 240 Hz after 207 days; `Q` sets them to 0 |
//! | Instant | all stations of a frame are sampled at once, 3.5 ms before its first byte (without filters); which instant the time marks is not documented, so the frame count is the better clock |
//!
//! A binary frame states its own length: `LY`, `PA` or `LU`, station, the command that it
//! answers, error, a meaningless byte, length of the body as 16 bits, body. It has no checksum. A
//! measurement (`C`, `P`) is accepted if its length follows from the output list. Its numbers
//! must also be plausible, unless the unit reports an error with it. Other frames are
//! [replies](Reply).
//!
//! The unit answers in text until the host selects binary. Measurements in text cannot be split
//! into fields, because times and counts vary in width: text is noise here.

pub mod command;
mod limits;
mod list;
mod pose;
mod record;
mod unit;
mod write;

pub use command::Command;
pub use limits::{HEADER, MOST_STATIONS};
pub use list::{Item, LONGEST_BODY, Layout, MOST_ITEMS};
pub use pose::{Header, Pose, Tag};
pub use unit::{LibertyProtocol, Question, Unit, status_of};

use crate::framing::{Format, Parsed, Refusal};
use limits::FEWEST_REPLY_BYTES;

/// A frame from the unit.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(
    clippy::large_enum_variant,
    reason = "almost every record is a pose, handed over by reference; a box would allocate per record"
)]
pub enum Record<'a> {
    /// A measurement of a station.
    Pose(Pose),
    /// An answer to a command.
    Reply(Reply<'a>),
}

/// An answer to a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reply<'a> {
    /// Header, with the command that is answered.
    pub header: Header,
    /// Body of the answer.
    pub body: &'a [u8],
}

impl Reply<'_> {
    /// Returns the detected and the active stations, if this answers `^U`: one bit each, from
    /// station 1.
    pub fn station_map(&self) -> Option<[u16; 2]> {
        match (self.header.command, self.body) {
            (command::ACTIVE_STATIONS, &[a, b, c, d]) => Some([u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d])]),
            _ => None,
        }
    }

    /// Returns whether positions are in cm, if this answers `U`: a whole number, 1 for cm and 0
    /// for inches. Its width is not verified.
    pub fn centimetres(&self) -> Option<bool> {
        let [unit @ (0 | 1), rest @ ..] = self.body else { return None };
        (self.header.command == b'U' && rest.iter().all(|byte| *byte == 0)).then_some(*unit == 1)
    }

    /// Returns the codes of an output list, if this answers `O`: 32-bit numbers, ended by -1.
    /// Their width is not verified.
    pub fn output_list(&self) -> Option<impl Iterator<Item = u8>> {
        let (numbers, rest) = self.body.as_chunks::<4>();
        let ended = numbers.last() == Some(&[0xff; 4]) && rest.is_empty();
        let codes = &numbers[..numbers.len().saturating_sub(1)];
        let small = codes.iter().all(|&[low, rest @ ..]| rest == [0; 3] && low < 13);
        (self.header.command == b'O' && ended && small).then(|| codes.iter().map(|&[low, ..]| low))
    }
}

/// Reads binary frames.
#[derive(Debug, Clone)]
pub struct Liberty {
    /// Layout of measurements; `None` while measurements are skipped.
    layout: Option<Layout>,
    stations: u8,
    longest_reply: usize,
}

impl Liberty {
    /// Creates a format for a unit with stations 1 to `stations`, which share one output list.
    pub fn new(stations: u8, layout: Layout) -> Self {
        let longest_reply = (2 * layout.length()).clamp(FEWEST_REPLY_BYTES, HEADER + LONGEST_BODY);
        Self { layout: Some(layout), stations: stations.min(MOST_STATIONS), longest_reply }
    }

    /// Creates a format for set-up: replies are read, measurements are skipped.
    pub fn replies() -> Self {
        Self { layout: None, stations: MOST_STATIONS, longest_reply: HEADER + LONGEST_BODY }
    }

    #[inline]
    fn judge<'a>(&self, window: &'a [u8]) -> Parsed<Record<'a>> {
        let Some(&[tag0, tag1, station, command, error, _, low, high]) = window.first_chunk::<HEADER>() else {
            return self.judge_beginning(window);
        };
        let Some(tag) = Tag::from_bytes([tag0, tag1]) else {
            return Parsed::skip_byte(Refusal::Noise);
        };
        let header = Header { tag, station, command, error };
        if !self.is_station(station, command) || !is_command(command) {
            return Parsed::skip_byte(Refusal::Header);
        }
        let length = HEADER + usize::from(u16::from_le_bytes([low, high]));
        let measured = matches!(command, b'C' | b'P');
        let good = match &self.layout {
            Some(layout) if measured => length == layout.length(),
            _ => length <= self.longest_reply,
        };
        if !good {
            return Parsed::skip_byte(Refusal::Length);
        }
        let Some(body) = window.get(HEADER..length) else {
            return Parsed::Short;
        };
        match &self.layout {
            Some(layout) if measured => match record::read(header, body, layout) {
                Ok(pose) => Parsed::Record { length, record: Record::Pose(pose) },
                Err(why) => Parsed::skip_byte(why),
            },
            // A measurement with an unknown list is skipped whole.
            None if measured => Parsed::Skip { bytes: length, why: Refusal::Header },
            _ => Parsed::Record { length, record: Record::Reply(Reply { header, body }) },
        }
    }

    /// Judges a window shorter than a header; bytes that cannot begin a frame are not held back.
    #[cold]
    fn judge_beginning<'a>(&self, window: &'a [u8]) -> Parsed<Record<'a>> {
        match *window {
            [b'L' | b'P'] => Parsed::Short,
            [tag0, tag1, ..] if Tag::from_bytes([tag0, tag1]).is_some() => match window[2..] {
                [station, command, ..] if !self.is_station(station, command) || !is_command(command) => {
                    Parsed::skip_byte(Refusal::Header)
                }
                _ => Parsed::Short,
            },
            _ => Parsed::skip_byte(Refusal::Noise),
        }
    }

    /// Returns whether the station is valid. Replies that concern no station may have any number
    /// here.
    fn is_station(&self, station: u8, command: u8) -> bool {
        match command {
            b'C' | b'P' => (1..=self.stations).contains(&station),
            _ => station <= MOST_STATIONS || station == u8::MAX,
        }
    }
}

const fn is_command(command: u8) -> bool {
    matches!(command, 0x01..=0x1a | b'A'..=b'Z' | b'a'..=b'z' | b'@')
}

impl Format for Liberty {
    type Record<'a> = Record<'a>;

    fn window(&self) -> usize {
        self.longest_reply
    }

    /// Three frames; during set-up, the longest reply and a frame.
    fn lock_bytes(&self) -> usize {
        self.layout.map_or(2 * self.longest_reply, |layout| layout.length() + self.longest_reply)
    }

    #[inline]
    fn parse<'a>(&mut self, window: &'a [u8]) -> Parsed<Record<'a>> {
        self.judge(window)
    }
}
