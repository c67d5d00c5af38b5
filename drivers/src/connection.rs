//! Keeps a device on a line connected: opens it, sets it up and reads it; repeats this after a
//! loss or a silence.
//!
//! ```text
//!            opened              set up               nothing for long
//! absent ──────────────▶ starting ────────▶ running ──────────────────▶ silent ──▶ set up anew
//!    ▲                       │                 │                           │
//!    └───────────────────────┴──── gone ───────┴───────────────────────────┘
//! ```
//!
//! A [`Protocol`] defines the exchange on the line. It neither waits nor reads a clock: it
//! receives bytes and returns the next step. Every set-up sequence can therefore be tested
//! without a line. No call of [`Connection::next`] exceeds its deadline, however long the
//! set-up takes. The exception is a device that does not accept the bytes sent to it: the call
//! waits for that write.

mod protocol;

use std::collections::VecDeque;
use std::os::fd::BorrowedFd;
use std::sync::Arc;

pub use protocol::{Lost, Protocol, SetupEvent, SetupStep};

use crate::transport::{LineError, Opener, Transport};
use sonoweave_core::clock::{Clock, MS};
use sonoweave_core::health::{Health, State};
use sonoweave_core::reading::{Raw, Reading, Stamp};
use sonoweave_core::{Description, Device, Error, Next};

/// Pause between two attempts to open a line, ns: the time within which a newly plugged device
/// is found.
const RETRY: i64 = 200 * MS;
/// Pause after a failed read, ns, so that a line that fails at once is not polled in a busy
/// loop.
const TROUBLED: i64 = 2 * MS;

/// State of the connection.
enum Stage {
    Stopped,
    Absent {
        retry_ns: i64,
    },
    SettingUp {
        line: Box<dyn Transport>,
        step: SetupStep,
        since_ns: i64,
        received_ns: i64,
    },
    /// `received_ns`: time of the last reading; `read_ns`: time of the last read of the line.
    Running {
        line: Box<dyn Transport>,
        received_ns: i64,
        read_ns: i64,
        ask_ns: i64,
    },
}

/// A device on a line, for any protocol.
pub struct Connection<P> {
    opener: Box<dyn Opener>,
    clock: Arc<dyn Clock>,
    protocol: P,
    keeps_raw: bool,
    stage: Stage,
    found: VecDeque<Reading>,
    buffer: Box<[u8]>,
    health: Health,
    /// Losses before the last reset.
    before: Lost,
    raw_items: u64,
    items: u64,
}

/// Action to take after a step.
enum After {
    /// Continue.
    Same,
    /// Set up the line again from its first step.
    Anew(Box<dyn Transport>),
    /// The line is gone, or could not be opened.
    Gone(LineError),
}

impl<P: Protocol> Connection<P> {
    /// Creates a stopped connection. With `keeps_raw`, each received piece also becomes a
    /// [`Reading::Raw`], before the readings that it completes.
    pub fn new(opener: Box<dyn Opener>, clock: Arc<dyn Clock>, protocol: P, keeps_raw: bool) -> Self {
        let buffer = vec![0; protocol.buffer_bytes()].into();
        Self {
            opener,
            clock,
            protocol,
            keeps_raw,
            stage: Stage::Stopped,
            found: VecDeque::with_capacity(64),
            buffer,
            health: Health::default(),
            before: Lost::default(),
            raw_items: 0,
            items: 0,
        }
    }

    /// Returns the protocol, which holds the facts known about the device.
    pub fn protocol(&self) -> &P {
        &self.protocol
    }

    /// Returns the protocol, to send the device a request while it runs.
    pub fn protocol_mut(&mut self) -> &mut P {
        &mut self.protocol
    }

    /// Returns a descriptor that becomes readable when the device sends data, for waiting on
    /// several devices. `None` while the line is not open or has no descriptor.
    pub(crate) fn wakes_by(&self) -> Option<BorrowedFd<'_>> {
        match &self.stage {
            Stage::SettingUp { line, .. } | Stage::Running { line, .. } => line.wakes_by(),
            Stage::Stopped | Stage::Absent { .. } => None,
        }
    }

    fn after(&mut self, after: After) {
        let now_ns = self.clock.now_ns();
        match after {
            After::Same => {}
            After::Anew(line) => self.begin(line),
            After::Gone(error) => {
                self.stage = Stage::Absent { retry_ns: now_ns + RETRY };
                self.health.enter(State::Absent, &format!("{} {error}", self.opener.name()), now_ns);
            }
        }
    }

    /// Starts the set-up sequence on an open line.
    fn begin(&mut self, line: Box<dyn Transport>) {
        let now_ns = self.clock.now_ns();
        let lost = self.protocol.lost();
        self.before.readings += lost.readings;
        self.before.refused += lost.refused;
        self.before.skipped += lost.skipped;
        self.protocol.reset();
        let step = self.protocol.next_step(SetupEvent::Begin);
        self.stage = Stage::SettingUp { line, step, since_ns: now_ns, received_ns: now_ns };
        // The states silent and absent, with their reasons, stay until the set-up succeeds.
        if self.health.state != State::Silent {
            self.health.enter(State::Starting, "", now_ns);
        }
    }

    /// Performs one set-up step, or as much of it as the deadline allows.
    fn set_up(&mut self, now_ns: i64, deadline_ns: i64) -> After {
        let Stage::SettingUp { line, step, since_ns, received_ns } = &mut self.stage else { return After::Same };
        let mut kept = 0;
        let until = match step {
            SetupStep::Pause(ns) => *since_ns + *ns,
            SetupStep::AwaitQuiet { quiet_ns, at_most_ns } => (*received_ns + *quiet_ns).min(*since_ns + *at_most_ns),
            SetupStep::Listen(ns) => *since_ns + *ns,
            _ => now_ns,
        };
        let waits = matches!(step, SetupStep::Pause(_) | SetupStep::AwaitQuiet { .. } | SetupStep::Listen(_));
        let event = if waits && now_ns < until {
            let received = match line.read(&mut self.buffer, until.min(deadline_ns)) {
                Ok(received) => received,
                Err(error @ LineError::Gone(_)) => return After::Gone(error),
                // Framing errors are normal while the baud rate is still being searched.
                Err(error) => {
                    tracing::debug!("{}: {error}", self.opener.name());
                    self.clock.wait_until(now_ns + TROUBLED);
                    return After::Same;
                }
            };
            self.health.received.bytes += received.bytes as u64;
            if received.bytes == 0 {
                return After::Same;
            }
            *received_ns = received.at_ns;
            if !matches!(step, SetupStep::Listen(_)) {
                return After::Same;
            }
            kept = received.bytes;
            SetupEvent::Received(&self.buffer[..kept])
        } else {
            match step {
                SetupStep::Send(bytes) => match line.write(bytes) {
                    // A device that accepts no bytes is present; it will not answer either and
                    // counts as silent.
                    Ok(()) | Err(LineError::Stuck) => SetupEvent::Done,
                    Err(error) => return After::Gone(error),
                },
                SetupStep::Baud(baud) => match line.set_baud(*baud) {
                    Ok(()) => SetupEvent::Done,
                    Err(error) => return After::Gone(error),
                },
                SetupStep::AwaitQuiet { at_most_ns, .. } if now_ns >= *since_ns + *at_most_ns => SetupEvent::Noisy,
                SetupStep::AwaitQuiet { .. } => SetupEvent::Quiet,
                SetupStep::Listen(_) => SetupEvent::NoAnswer,
                _ => SetupEvent::Done,
            }
        };
        match self.protocol.next_step(event) {
            SetupStep::More => {}
            SetupStep::Finish { keep } => {
                self.health.received.set_up += 1;
                let at_ns = *received_ns;
                let stage = std::mem::replace(&mut self.stage, Stage::Stopped);
                if let Stage::SettingUp { line, .. } = stage {
                    let now_ns = self.clock.now_ns();
                    self.stage = Stage::Running { line, received_ns: now_ns, read_ns: now_ns, ask_ns: now_ns };
                }
                if keep && kept > 0 {
                    self.decode(kept, at_ns);
                }
            }
            SetupStep::Fail(why) => {
                let stage = std::mem::replace(&mut self.stage, Stage::Stopped);
                self.health.enter(State::Silent, &format!("{}: {why}", self.opener.name()), now_ns);
                if let Stage::SettingUp { line, .. } = stage {
                    return After::Anew(line);
                }
            }
            next => {
                *step = next;
                (*since_ns, *received_ns) = (self.clock.now_ns(), self.clock.now_ns());
            }
        }
        After::Same
    }

    /// Reads from a device that has been set up.
    fn run(&mut self, now_ns: i64, deadline_ns: i64) -> After {
        let patience = self.protocol.patience_ns();
        let Stage::Running { line, received_ns, read_ns, ask_ns } = &mut self.stage else { return After::Same };
        let silent_ns = *received_ns + patience;
        // After a pause of the caller, buffered data is read before the device counts as
        // silent.
        let was_away = now_ns - *read_ns > patience / 2;
        if now_ns >= *ask_ns {
            match self.protocol.ask(now_ns) {
                Some((question, again_ns)) => {
                    *ask_ns = again_ns;
                    match if question.is_empty() { Ok(()) } else { line.write(question) } {
                        Ok(()) | Err(LineError::Stuck) => {}
                        Err(error) => return After::Gone(error),
                    }
                }
                None => *ask_ns = i64::MAX,
            }
        }
        let ask_ns = if *ask_ns > now_ns { *ask_ns } else { i64::MAX };
        let received = line.read(&mut self.buffer, deadline_ns.min(silent_ns).min(ask_ns).max(now_ns));
        *read_ns = self.clock.now_ns();
        let may_wait = *read_ns < silent_ns;
        match received {
            Ok(received) if received.bytes == 0 => {
                if may_wait {
                    After::Same
                } else {
                    self.fallen_silent(patience)
                }
            }
            Ok(received) => {
                self.health.received.bytes += received.bytes as u64;
                let makes_sense = self.decode(received.bytes, received.at_ns);
                if let Some(why) = self.protocol.broken() {
                    return After::Gone(LineError::Failed(why));
                }
                if may_wait || makes_sense || was_away { After::Same } else { self.fallen_silent(patience) }
            }
            Err(error @ LineError::Gone(_)) => After::Gone(error),
            Err(error) => {
                // The decoder counts damaged records; a line with endless errors counts as
                // silent.
                tracing::debug!("{}: {error}", self.opener.name());
                self.clock.wait_until(now_ns + TROUBLED);
                if may_wait { After::Same } else { self.fallen_silent(patience) }
            }
        }
    }

    /// Handles a running device that sent nothing valid for `patience`, ns.
    fn fallen_silent(&mut self, patience: i64) -> After {
        let why = format!("{}: is open and has sent nothing for {} ms", self.opener.name(), patience / MS);
        self.health.enter(State::Silent, &why, self.clock.now_ns());
        if self.protocol.begins_by_opening() {
            return After::Gone(LineError::Failed(format!(
                "has sent nothing for {} ms; it is reconnected",
                patience / MS
            )));
        }
        match std::mem::replace(&mut self.stage, Stage::Stopped) {
            Stage::Running { line, .. } => After::Anew(line),
            _ => After::Same,
        }
    }

    /// Passes bytes of the buffer to the protocol. Returns whether they contained readings.
    fn decode(&mut self, bytes: usize, at_ns: i64) -> bool {
        let bytes = &self.buffer[..bytes];
        if self.keeps_raw {
            let stamp = Stamp { item: self.raw_items, host_ns: Some(at_ns), ..Stamp::default() };
            self.raw_items += 1;
            self.found.push_back(Reading::Raw(Raw { stamp, line: 0, bytes: bytes.into() }));
        }
        let before = self.found.len();
        self.protocol.decode(bytes, at_ns, &mut self.found);
        number(self.found.iter_mut().skip(before), &mut self.items);
        let lost = self.protocol.lost();
        let received = &mut self.health.received;
        received.lost = self.before.readings + lost.readings;
        received.refused = self.before.refused + lost.refused;
        received.skipped = self.before.skipped + lost.skipped;
        let makes_sense = self.found.len() > before;
        if makes_sense {
            if let Stage::Running { received_ns, .. } = &mut self.stage {
                *received_ns = at_ns;
            }
            // Only readings prove that the device runs; a completed set-up sequence does not.
            self.health.enter(State::Running, self.protocol.trouble(), at_ns);
        }
        makes_sense
    }
}

/// Numbers readings consecutively, from `next`.
pub(crate) fn number<'a>(readings: impl Iterator<Item = &'a mut Reading>, next: &mut u64) {
    for reading in readings {
        reading.stamp_mut().item = *next;
        *next += 1;
    }
}

impl<P: Protocol> Device for Connection<P> {
    fn start(&mut self) -> Result<(), Error> {
        if !matches!(self.stage, Stage::Stopped) {
            return Err(Error::Running(self.opener.name().to_owned()));
        }
        let now_ns = self.clock.now_ns();
        self.stage = Stage::Absent { retry_ns: now_ns };
        self.health.enter(State::Absent, "not opened yet", now_ns);
        Ok(())
    }

    fn stop(&mut self) -> Result<(), Error> {
        let stage = std::mem::replace(&mut self.stage, Stage::Stopped);
        if let Stage::SettingUp { mut line, .. } | Stage::Running { mut line, .. } = stage
            && let Err(error) = line.write(self.protocol.farewell())
        {
            tracing::debug!("{}: {error}, so that it may go on talking", self.opener.name());
        }
        self.found.clear();
        self.health.enter(State::Stopped, "", self.clock.now_ns());
        Ok(())
    }

    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error> {
        // Reads at least once, even after the deadline, so that data already received is found.
        let mut has_read = false;
        loop {
            if let Some(reading) = self.found.pop_front() {
                self.health.received.readings += u64::from(!matches!(reading, Reading::Raw(_)));
                return Ok(Next::Reading(reading));
            }
            let now_ns = self.clock.now_ns();
            if has_read && now_ns >= deadline_ns {
                return Ok(Next::Pending);
            }
            has_read = true;
            let after = match &mut self.stage {
                Stage::Stopped => return Err(Error::Stopped(self.opener.name().to_owned())),
                Stage::Absent { retry_ns } if now_ns < *retry_ns => {
                    self.clock.wait_until((*retry_ns).min(deadline_ns));
                    continue;
                }
                Stage::Absent { .. } => match self.opener.open() {
                    Ok(line) => {
                        self.health.received.opened += 1;
                        After::Anew(line)
                    }
                    Err(error) => After::Gone(error),
                },
                Stage::SettingUp { .. } => self.set_up(now_ns, deadline_ns),
                Stage::Running { .. } => self.run(now_ns, deadline_ns),
            };
            self.after(after);
        }
    }

    fn home(&mut self, axes: u8) -> Result<(), Error> {
        if self.protocol.home_axes(axes) {
            return Ok(());
        }
        Err(Error::NoAxes(self.opener.name().to_owned()))
    }

    fn describe(&self) -> &Description {
        self.protocol.describe()
    }

    fn health(&self) -> &Health {
        &self.health
    }
}
