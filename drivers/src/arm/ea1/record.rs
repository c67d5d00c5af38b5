//! Records that an arm sends: samples, its identity, answers and refusals.

/// Joints of an arm.
pub const AXES: usize = 3;

/// Longest line, in bytes, including its end.
pub const LONGEST_LINE: usize = 128;

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
