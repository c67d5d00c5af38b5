//! EA1: the protocol of arms built around a microcontroller. `docs/ea1.md` describes it for arm
//! builders.
//!
//! | | |
//! |---|---|
//! | Clock | the arm's own microseconds, and a number that counts samples |
//! | Tick | 1 µs; the host must determine the crystal's deviation |
//! | Wrap | both at 2³²: the time after 71.6 minutes, the number at 1 kHz after 49.7 days |
//! | Instant | the one at which all counters were latched |
//!
//! Samples are lines with a checksum of 8 bits, or blocks (COBS) with one of 16; all other
//! answers are lines. Both may alternate on the same port and differ in their first byte: `$`, or
//! a code below 29. Lines of three bare numbers carry no checksum and no time; only a decoder
//! created for them reads them.

mod block;
pub mod command;
mod follow;
mod line;
pub(super) mod unit;

pub use command::Command;
pub use unit::{Speech, Unit};

use crate::framing::{Format, Look, Refusal};

/// Joints of an arm.
pub const AXES: usize = 3;

/// Longest line, in bytes, including its end.
pub const LONGEST_LINE: usize = 128;

/// Longest sample, in bytes: a line with every number at its longest.
pub const LONGEST_SAMPLE: usize = 71;

/// Flags of a sample.
pub mod flag {
    /// Joint 0, 1, 2: its counter was zeroed at a known position since power-on.
    pub const HOMED: [u16; 3] = [1, 1 << 1, 1 << 2];
    /// Joint 0, 1, 2: its counter is no longer reliable (impossible transition, too fast).
    pub const FAULT: [u16; 3] = [1 << 3, 1 << 4, 1 << 5];
    /// A button is pressed.
    pub const BUTTON: u16 = 1 << 6;
    /// Some samples were taken but not sent.
    pub const OVERRUN: u16 = 1 << 7;
    /// All defined flags.
    pub const KNOWN: u16 = 0xff;
}

/// A record from the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Record<'a> {
    /// The joints' counts at an instant.
    Sample(Sample),
    /// The arm's identity.
    Identity(Identity<'a>),
    /// The answer to a time ping.
    Time {
        /// Token of the ping.
        token: u32,
        /// The arm's time when it read the ping, µs.
        t_us: u32,
    },
    /// The arm refused a command, with this [code](error).
    Error(u32),
    /// Three bare numbers: counts at an unknown instant, unprotected.
    Unreliable([i32; AXES]),
}

/// Error codes.
pub mod error {
    /// The command does not exist.
    pub const UNKNOWN_COMMAND: u32 = 1;
    /// A parameter is not a number, or the arm does not support it.
    pub const BAD_PARAMETER: u32 = 2;
    /// The line cannot carry this many samples per second.
    pub const TOO_FAST: u32 = 3;
}

/// The joints' counts at an instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sample {
    /// Number of the sample; unsent samples are counted too.
    pub seq: u32,
    /// The arm's time at which all counters were latched, µs; wraps at 2³².
    pub t_us: u32,
    /// Counts, base first; wrap at 2³².
    pub counts: [i32; AXES],
    /// See [`flag`].
    pub flags: u16,
    /// Buttons, one bit each; a line has only the one in its flags.
    pub buttons: u8,
    /// Framing of the sample.
    pub framing: Framing,
}

/// Framing of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Framing {
    /// Text lines.
    Lines,
    /// Binary blocks.
    Blocks,
}

/// The arm's identity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Identity<'a> {
    /// Model name.
    pub model: &'a str,
    /// Serial number.
    pub serial: &'a str,
    /// Counts per revolution (of a sliding joint: per metre), base first; 0 if the arm does not
    /// know.
    pub counts_per_revolution: [u32; AXES],
    /// Clock frequency, ticks per second.
    pub tick_hz: u32,
    /// Present sample rate, samples per second; 0 for none.
    pub rate_hz: u32,
}

/// Reads lines and blocks.
#[derive(Debug, Clone)]
pub struct Ea1 {
    bare_numbers: bool,
    /// Whether a line may begin here; used for bare numbers only.
    line_begins: bool,
}

impl Ea1 {
    /// Creates a format for an EA1 arm.
    pub fn new() -> Self {
        Self { bare_numbers: false, line_begins: true }
    }

    /// Creates a format for an arm that may also send lines of three bare numbers. These have no
    /// protection: the rest of a damaged line can look like one.
    pub fn or_bare_numbers() -> Self {
        Self { bare_numbers: true, line_begins: true }
    }
}

impl Default for Ea1 {
    fn default() -> Self {
        Self::new()
    }
}

impl Format for Ea1 {
    type Record<'a> = Record<'a>;

    fn window(&self) -> usize {
        LONGEST_LINE
    }

    /// Three samples at their longest.
    fn lock_bytes(&self) -> usize {
        3 * LONGEST_SAMPLE
    }

    #[inline]
    fn look<'a>(&mut self, window: &'a [u8]) -> Look<Record<'a>> {
        let look = match window[0] {
            b'$' => line::look(window),
            block::FEWEST_CODE..=block::MOST_CODE => block::look(window),
            b'0'..=b'9' | b'-' if self.bare_numbers && self.line_begins => line::bare_numbers(window),
            _ => Look::skip_byte(Refusal::Noise),
        };
        match look {
            Look::Record { .. } => self.line_begins = true,
            Look::Skip { bytes, .. } => self.line_begins = window[bytes - 1] == b'\n',
            Look::Short => {}
        }
        look
    }

    fn interrupted(&mut self) {
        // The next byte may be in the middle of a line.
        self.line_begins = false;
    }
}
