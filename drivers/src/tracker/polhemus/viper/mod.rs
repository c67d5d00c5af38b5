//! VIPER's wire format, over USB and RS-422 alike.
//!
//! | | |
//! |---|---|
//! | Clock | a frame count; frames carry no time |
//! | Tick | the frame: 1/30 s to 1/960 s as set, 1/240 s by default |
//! | Wrap | 2³²: at 960 Hz after 51 days; starting the stream can set it to 0 |
//! | Instant | not documented; before the frame's first byte by the unit's latency |
//!
//! Every frame is binary: `VPRC` (commands and replies) or `VPRP` (measurements), the number of
//! following bytes, the body, and CRC-16/ARC over everything before it, as 32 bits. All numbers
//! are little-endian.

pub mod command;
mod frame;
mod unit;
pub mod write;

pub use command::{Action, Command, Nak, Reply};
pub use frame::{Frame, LONGEST_SIZE, MOST_SENSORS, OrientationUnit, PositionUnit, Sensor};
pub use unit::{Question, Unit, ViperProtocol};

use crate::framing::{Format, Parsed, Refusal};
use command::REPLY_HEADER;
use frame::{CRC, FRAME_HEADER, HEADER, SENSOR, TRAILER, frame};

/// A frame from the unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Record<'a> {
    /// A frame of measurements.
    Frame(Frame<'a>),
    /// An answer to a command.
    Reply(Reply<'a>),
}

/// Reads frames of either kind; a virtual unit reads its commands with it too.
#[derive(Debug, Clone)]
pub struct Viper {
    sensors: usize,
}

impl Viper {
    /// Creates a format for at most `sensors` sensors; larger frames are refused.
    pub fn new(sensors: usize) -> Self {
        Self { sensors: sensors.min(MOST_SENSORS) }
    }
}

impl Format for Viper {
    type Record<'a> = Record<'a>;

    fn window(&self) -> usize {
        HEADER + LONGEST_SIZE
    }

    /// A false beginning of the longest reply, and two frames.
    fn lock_bytes(&self) -> usize {
        LONGEST_SIZE + 2 * (HEADER + FRAME_HEADER + SENSOR * self.sensors + TRAILER)
    }

    #[inline]
    fn parse<'a>(&mut self, window: &'a [u8]) -> Parsed<Record<'a>> {
        let Some(&[p0, p1, p2, p3, s0, s1, s2, s3]) = window.first_chunk::<HEADER>() else {
            let begins = |preamble: &[u8; 4]| window.iter().zip(preamble).all(|(byte, letter)| byte == letter);
            return match begins(b"VPRC") || begins(b"VPRP") {
                true => Parsed::Short,
                false => Parsed::skip_byte(Refusal::Noise),
            };
        };
        let measured = match &[p0, p1, p2, p3] {
            b"VPRP" => true,
            b"VPRC" => false,
            _ => return Parsed::skip_byte(Refusal::Noise),
        };
        let size = u32::from_le_bytes([s0, s1, s2, s3]) as usize;
        let good = if measured {
            size >= FRAME_HEADER + TRAILER
                && size <= FRAME_HEADER + TRAILER + SENSOR * self.sensors
                && (size - FRAME_HEADER - TRAILER).is_multiple_of(SENSOR)
        } else {
            (REPLY_HEADER + TRAILER..=LONGEST_SIZE).contains(&size)
        };
        if !good {
            return Parsed::skip_byte(Refusal::Length);
        }
        let length = HEADER + size;
        let Some((summed, sum)) = window.get(..length).and_then(|frame| frame.split_last_chunk::<TRAILER>()) else {
            return Parsed::Short;
        };
        if u32::from(CRC.checksum(summed)) != u32::from_le_bytes(*sum) {
            return Parsed::skip_byte(Refusal::Checksum);
        }
        let body = &summed[HEADER..];
        let record = if measured { frame(body).map(Record::Frame) } else { Reply::read(body).map(Record::Reply) };
        match record {
            Some(record) => Parsed::Record { length, record },
            None => Parsed::skip_byte(Refusal::Field),
        }
    }
}
