//! EA1: what an arm built around a microcontroller speaks. `docs/ea1.md` is its description for those who build one.
//!
//! | | |
//! |---|---|
//! | Clock | the arm's own microseconds, and a number that counts samples |
//! | Tick | 1 µs; the crystal's tolerance is the host's to find |
//! | Wrap | both at 2³²: the time after 71.6 minutes, the number at 1 kHz after 49.7 days |
//! | Instant | the one at which all counters were latched |
//!
//! Samples come as lines with a checksum of 8 bits or as blocks (COBS) with one of 16; all other answers are lines. Both may come in any order on the same
//! port and are told apart by their first byte: `$`, or a code below 29. Lines of three bare numbers, which carry no checksum and no time,
//! are read only by a decoder that was made to.

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

/// Longest line, its end included.
pub const LONGEST_LINE: usize = 128;

/// Longest sample: as a line with every number at its longest.
pub const LONGEST_SAMPLE: usize = 71;

/// What a sample's flags say.
pub mod flag {
    /// Joint 0, 1, 2: its counter was zeroed at a known place since power came on.
    pub const HOMED: [u16; 3] = [1, 1 << 1, 1 << 2];
    /// Joint 0, 1, 2: its counter is not to be believed any more (impossible transition, too fast).
    pub const FAULT: [u16; 3] = [1 << 3, 1 << 4, 1 << 5];
    /// A button is pressed.
    pub const BUTTON: u16 = 1 << 6;
    /// Samples were taken that could not be sent.
    pub const OVERRUN: u16 = 1 << 7;
    /// All that have a meaning.
    pub const KNOWN: u16 = 0xff;
}

/// What the arm sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Record<'a> {
    /// The joints' counts at an instant.
    Sample(Sample),
    /// Who the arm is.
    Identity(Identity<'a>),
    /// The answer to a time ping.
    Time {
        /// The ping's.
        token: u32,
        /// The arm's time when it read the ping, µs.
        t_us: u32,
    },
    /// A command was not obeyed; its [code](error).
    Error(u32),
    /// Three bare numbers: counts at an unknown instant, unprotected.
    Unreliable([i32; AXES]),
}

/// Codes of errors.
pub mod error {
    /// No such command.
    pub const UNKNOWN_COMMAND: u32 = 1;
    /// A parameter that is no number or that the arm cannot do.
    pub const BAD_PARAMETER: u32 = 2;
    /// More samples a second than the line carries.
    pub const TOO_FAST: u32 = 3;
}

/// The joints' counts at an instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sample {
    /// Number of the sample; counts those that were not sent too.
    pub seq: u32,
    /// The arm's time at which all counters were latched, µs; wraps at 2³².
    pub t_us: u32,
    /// Counts, base first; wrap at 2³².
    pub counts: [i32; AXES],
    /// See [`flag`].
    pub flags: u16,
    /// Buttons, a bit each; of a line the one that its flags have.
    pub buttons: u8,
    /// How it was sent.
    pub framing: Framing,
}

/// How samples are sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Framing {
    /// As lines.
    Lines,
    /// As blocks.
    Blocks,
}

/// Who the arm is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Identity<'a> {
    /// What its maker calls it.
    pub model: &'a str,
    /// Which one of them.
    pub serial: &'a str,
    /// Counts a revolution (of a sliding joint: a metre), base first; 0 where the arm does not know.
    pub counts_per_revolution: [u32; AXES],
    /// Ticks of its clock a second.
    pub tick_hz: u32,
    /// Samples a second that it sends now; 0 for none.
    pub rate_hz: u32,
}

/// Reads lines and blocks.
#[derive(Debug, Clone)]
pub struct Ea1 {
    bare_numbers: bool,
    /// Whether a line may begin here, which matters for bare numbers only.
    line_begins: bool,
}

impl Ea1 {
    /// Of an arm that speaks EA1.
    pub fn new() -> Self {
        Self { bare_numbers: false, line_begins: true }
    }

    /// Of an arm that may also send lines of three bare numbers. Nothing protects them: what is left of a damaged line can look like one.
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
        // What comes next may be anything's middle.
        self.line_begins = false;
    }
}
