//! How a device is, in words that can be shown.

/// Where a device stands. Silent is not absent: a silent one is open and says nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum State {
    /// It was not started, or was stopped.
    #[default]
    Stopped,
    /// It is not there, or cannot be opened; it is tried again.
    Absent,
    /// It is open and being set up.
    Starting,
    /// It delivers.
    Running,
    /// It is open and delivers nothing; it is being set up anew.
    Silent,
    /// It has delivered all there is.
    Ended,
}

impl State {
    /// One word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Stopped => "stopped",
            Self::Absent => "absent",
            Self::Starting => "starting",
            Self::Running => "running",
            Self::Silent => "silent",
            Self::Ended => "ended",
        }
    }
}

/// What was received, and what became of it. Every byte is in a record or skipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Received {
    /// Bytes, or frames' bytes.
    pub bytes: u64,
    /// Readings delivered.
    pub readings: u64,
    /// Readings that the device or the kernel says were lost before they came, by its own counter.
    pub lost: u64,
    /// Records refused: a wrong checksum, numbers that cannot be.
    pub refused: u64,
    /// Bytes that belonged to no record.
    pub skipped: u64,
    /// Times that the device was opened.
    pub opened: u64,
    /// Times that it was set up.
    pub set_up: u64,
}

/// How a device is.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Health {
    /// Where it stands.
    pub state: State,
    /// Since when, host ns; 0 for files, which have no clock.
    pub since_ns: i64,
    /// Why, and what to do; empty where all is well.
    pub why: String,
    /// What was received since it was opened for the first time.
    pub received: Received,
}

impl Health {
    /// Notes a state and why; the time stays where the state does.
    pub(crate) fn enter(&mut self, state: State, why: &str, now_ns: i64) {
        if self.state != state {
            (self.state, self.since_ns) = (state, now_ns);
        }
        if self.why != why {
            why.clone_into(&mut self.why);
        }
    }
}
