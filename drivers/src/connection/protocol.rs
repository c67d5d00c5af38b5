//! The exchange on a line, as a state machine that neither waits nor reads a clock.

use std::collections::VecDeque;

use sonoweave_core::Description;
use sonoweave_core::reading::Reading;

/// Default buffer size for one read of a serial line or USB, bytes.
const BUFFER: usize = 4096;

/// Next step of a device's set-up.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SetupStep {
    /// Sends bytes. Result: [`SetupEvent::Done`].
    Send(Vec<u8>),
    /// Changes the line's rate, bits per second. Result: [`SetupEvent::Done`].
    Baud(u32),
    /// Sends nothing for this time, ns, and drops received bytes. Result: [`SetupEvent::Done`].
    Pause(i64),
    /// Drops received bytes until the line was quiet for `quiet_ns`: [`SetupEvent::Quiet`]. Gives
    /// up after `at_most_ns`: [`SetupEvent::Noisy`].
    AwaitQuiet {
        /// Length of the silence, ns.
        quiet_ns: i64,
        /// Limit from the beginning of the step, ns.
        at_most_ns: i64,
    },
    /// Waits for an answer. Received bytes give [`SetupEvent::Received`] until the protocol returns
    /// another step; after this time, ns, the result is [`SetupEvent::NoAnswer`].
    Listen(i64),
    /// Continues to listen until the time given before.
    More,
    /// Ends the set-up successfully. If `keep` is set, the bytes of the last
    /// [`SetupEvent::Received`] are passed to [`Protocol::decode`].
    Finish {
        /// Whether the bytes received last already hold records.
        keep: bool,
    },
    /// The set-up failed, with reason and remedy. It is tried again.
    Fail(String),
}

/// Result of a set-up step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SetupEvent<'a> {
    /// The line was opened, or the set-up restarts.
    Begin,
    /// The step is complete.
    Done,
    /// The line became quiet.
    Quiet,
    /// The line did not become quiet.
    Noisy,
    /// Bytes were received.
    Received(&'a [u8]),
    /// No answer arrived, or no more of it.
    NoAnswer,
}

/// Losses on the line, as counted by the decoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Lost {
    /// Readings that are missing by the device's own counter.
    pub readings: u64,
    /// Records refused.
    pub refused: u64,
    /// Bytes in no record.
    pub skipped: u64,
}

/// Exchange with a device: bytes to the device, readings from it. Uses no clock and no line.
pub trait Protocol: Send {
    /// Resets all state: the device may be another one, or may have been switched off
    /// meanwhile.
    fn reset(&mut self);

    /// Sets the state of a device that has been set up, for reading recorded bytes.
    fn resume(&mut self);

    /// Returns the next set-up step, given the result of the last one.
    fn next_step(&mut self, event: SetupEvent<'_>) -> SetupStep;

    /// Decodes bytes of a device that has been set up; the last of them arrived at `at_ns`, host
    /// ns. Appends the readings to `found`; the caller numbers them.
    fn decode(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>);

    /// Returns the bytes to send to a running device, and the host time, ns, of the next call.
    /// The bytes are a request to a device that answers only requests, or empty. A time that
    /// has passed means after the next received data. `None` if the device is sent nothing.
    fn ask(&mut self, _now_ns: i64) -> Option<(&[u8], i64)> {
        None
    }

    /// Returns how long a running device may send nothing valid, ns.
    fn patience_ns(&self) -> i64;

    /// Marks these axes (one bit per axis) of an arm as being at home now. Returns whether the
    /// device has axes.
    fn home_axes(&mut self, _axes: u8) -> bool {
        false
    }

    /// Returns the fault of a device that still delivers, and the remedy; empty if all is well.
    fn trouble(&self) -> &str {
        ""
    }

    /// Returns the buffer size for one read: more than a device sends between two reads.
    fn buffer_bytes(&self) -> usize {
        BUFFER
    }

    /// Returns why the line is no longer usable, if so. The connection then closes and reopens
    /// it.
    fn broken(&self) -> Option<String> {
        None
    }

    /// Returns whether a silent device is recovered by reopening its line. A line that loses no
    /// bytes cannot be recovered in another way.
    fn begins_by_opening(&self) -> bool {
        false
    }

    /// Returns the bytes to send before the line is closed, so that the device is quiet at the
    /// next opening.
    fn farewell(&self) -> &[u8];

    /// Returns the losses since [`Self::reset`].
    fn lost(&self) -> Lost;

    /// Returns the facts known about the device; there are more after its set-up.
    fn describe(&self) -> &Description;
}
