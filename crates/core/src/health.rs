//! State and statistics of a device, for display.

/// State of a device. Silent differs from absent: a silent device is open and sends nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum State {
    /// Not started, or stopped.
    #[default]
    Stopped,
    /// Not present, or cannot be opened; the connection keeps trying.
    Absent,
    /// Open and being set up.
    Starting,
    /// Delivering readings.
    Running,
    /// Open but delivering nothing; it is being set up again.
    Silent,
    /// All readings were delivered.
    Ended,
}

impl State {
    /// Returns the state as one word.
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

/// Counts of received data and its outcome. Every byte is in a record or skipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Received {
    /// Bytes received; frames count by their size in bytes.
    pub bytes: u64,
    /// Readings delivered.
    pub readings: u64,
    /// Readings lost before reception, by the counter of the device or the kernel.
    pub lost: u64,
    /// Records refused because of a wrong checksum or impossible values.
    pub refused: u64,
    /// Bytes that belonged to no record.
    pub skipped: u64,
    /// Number of times the device was opened.
    pub opened: u64,
    /// Number of times the device was set up.
    pub set_up: u64,
}

/// Health of a device.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Health {
    /// Present state.
    pub state: State,
    /// Time of entering the state, host ns; 0 for files, which have no clock.
    pub since_ns: i64,
    /// Reason and remedy; empty if all is well.
    pub why: String,
    /// Data received since the device was first opened.
    pub received: Received,
}

impl Health {
    /// Sets the state and its reason; `since_ns` changes only with the state.
    pub fn enter(&mut self, state: State, why: &str, now_ns: i64) {
        if self.state != state {
            (self.state, self.since_ns) = (state, now_ns);
        }
        if self.why != why {
            why.clone_into(&mut self.why);
        }
    }
}
