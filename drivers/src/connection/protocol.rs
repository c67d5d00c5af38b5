//! What is said on a line, by who neither waits nor reads a clock.

use std::collections::VecDeque;

use crate::Description;
use crate::reading::Reading;

/// Bytes that one read may bring of a serial line or USB.
const BUFFER: usize = 4096;

/// What to do next to set a device up.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Rung {
    /// Sends bytes. Then: [`Met::Done`].
    Send(Vec<u8>),
    /// Changes the line's rate, bits a second. Then: [`Met::Done`].
    Baud(u32),
    /// Says nothing for so long, ns; what comes meanwhile is dropped. Then: [`Met::Done`].
    Pause(i64),
    /// Drops what comes until nothing has come for `quiet_ns`: [`Met::Quiet`]; or `at_most_ns` have passed: [`Met::Noisy`].
    Hush {
        /// Length of a silence.
        quiet_ns: i64,
        /// From the beginning.
        at_most_ns: i64,
    },
    /// Waits for an answer: [`Met::Heard`] for all that comes, until another rung is asked for; [`Met::Deaf`] when so many ns have passed.
    Listen(i64),
    /// Goes on listening, until the time said before.
    More,
    /// The device is set up. What [`Met::Heard`] told last goes to [`Protocol::take`] if it is kept.
    Top {
        /// Whether what was heard last holds records already.
        keep: bool,
    },
    /// It cannot be set up; why, and what to do. It is tried again.
    Fall(String),
}

/// What has come of a rung.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Met<'a> {
    /// The line was opened, or everything begins anew.
    Begin,
    /// It was done.
    Done,
    /// Silence.
    Quiet,
    /// No silence.
    Noisy,
    /// Bytes.
    Heard(&'a [u8]),
    /// No answer, or no more of it.
    Deaf,
}

/// What was lost on the line, by the decoder's count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Lost {
    /// Readings that the device's own counter says there were.
    pub readings: u64,
    /// Records refused.
    pub refused: u64,
    /// Bytes in no record.
    pub skipped: u64,
}

/// What is said on a line: bytes to a device, readings from it. Knows no clock and no line.
pub trait Protocol: Send {
    /// Everything begins anew: the device may be another one, or have been switched off meanwhile.
    fn reset(&mut self);

    /// As if the device had been set up: bytes come that a recording has of one.
    fn resume(&mut self);

    /// The next rung of setting up.
    fn climb(&mut self, met: Met<'_>) -> Rung;

    /// Takes bytes of a device that was set up; the last of them were here at `at_ns`. Adds the readings in them, which are numbered by who asks.
    fn take(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>);

    /// What to send to a device that was set up (a question to one that speaks only when asked, or nothing for now), and when to look here again, host ns: a time that has
    /// come already means after what is received next. `None` for a device that is sent nothing.
    fn ask(&mut self, _now_ns: i64) -> Option<(&[u8], i64)> {
        None
    }

    /// So long may a device that was set up say nothing that makes sense, ns.
    fn patience_ns(&self) -> i64;

    /// These axes (bit by axis) of an arm are at home now. Whether the device has any.
    fn home_axes(&mut self, _axes: u8) -> bool {
        false
    }

    /// What is the matter with a device that delivers, and what to do; empty where all is well.
    fn trouble(&self) -> &str {
        ""
    }

    /// Bytes that one read may bring: more than a device sends between two reads.
    fn buffer_bytes(&self) -> usize {
        BUFFER
    }

    /// Why nothing more is to be made of this line, if so: it is closed, and opened anew.
    fn broken(&self) -> Option<String> {
        None
    }

    /// Whether a device that has fallen silent is to be found by opening its line anew. A line that has lost nothing has nothing else to be set right by.
    fn begins_by_opening(&self) -> bool {
        false
    }

    /// What to send before the line is closed, so that the device is found quiet.
    fn farewell(&self) -> &[u8];

    /// What was lost since [`Self::reset`].
    fn lost(&self) -> Lost;

    /// What is known of the device: more once it was set up.
    fn describe(&self) -> &Description;
}
