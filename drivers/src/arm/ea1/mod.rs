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
mod record;
pub(super) mod unit;

pub use command::Command;
pub use record::{AXES, Framing, Identity, LONGEST_LINE, Record, Sample, error, flag};
pub use unit::{SampleFormat, Unit};

use crate::framing::{Format, Parsed, Refusal};

/// Longest sample, in bytes: a line with every number at its longest.
pub const LONGEST_SAMPLE: usize = 71;

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
    fn parse<'a>(&mut self, window: &'a [u8]) -> Parsed<Record<'a>> {
        let parsed = match window[0] {
            b'$' => line::parse(window),
            block::FEWEST_CODE..=block::MOST_CODE => block::parse(window),
            b'0'..=b'9' | b'-' if self.bare_numbers && self.line_begins => line::bare_numbers(window),
            _ => Parsed::skip_byte(Refusal::Noise),
        };
        match parsed {
            Parsed::Record { .. } => self.line_begins = true,
            Parsed::Skip { bytes, .. } => self.line_begins = window[bytes - 1] == b'\n',
            Parsed::Short => {}
        }
        parsed
    }

    fn interrupted(&mut self) {
        // The next byte may be in the middle of a line.
        self.line_begins = false;
    }
}
