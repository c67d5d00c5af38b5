//! Keeps a device on a line going: opened, set up, read, and all of it again when it goes away or falls silent.
//!
//! ```text
//!            opened              set up               nothing for long
//! absent ──────────────▶ starting ────────▶ running ──────────────────▶ silent ──▶ set up anew
//!    ▲                       │                 │                           │
//!    └───────────────────────┴──── gone ───────┴───────────────────────────┘
//! ```
//!
//! What is said on the line is a [`Protocol`]'s, which neither waits nor reads a clock: it is told what came and says what to do next. So every ladder is tested without
//! a line, and no call of [`Connection::next`] takes longer than its deadline, however long the setting-up takes; but a device that does not take what is sent to it
//! is waited for.

mod protocol;

use std::collections::VecDeque;
use std::os::fd::BorrowedFd;
use std::sync::Arc;

pub use protocol::{Lost, Met, Protocol, Rung};

use crate::clock::{Clock, MS};
use crate::health::{Health, State};
use crate::reading::{Raw, Reading, Stamp};
use crate::transport::{LineError, Opener, Transport};
use crate::{Description, Device, Error, Next};

/// Pause between two attempts to open a line, ns: a device that is plugged in is found within it.
const RETRY: i64 = 200 * MS;
/// Pause after a read that failed, ns, lest a line that fails at once is read without end.
const TROUBLED: i64 = 2 * MS;

/// Where the connection stands.
enum Stage {
    Stopped,
    Absent {
        retry_ns: i64,
    },
    Climbing {
        line: Box<dyn Transport>,
        rung: Rung,
        since_ns: i64,
        heard_ns: i64,
    },
    /// `heard_ns`: the last reading; `read_ns`: the last time that the line was read.
    Running {
        line: Box<dyn Transport>,
        heard_ns: i64,
        read_ns: i64,
        ask_ns: i64,
    },
}

/// A device on a line, whatever it says.
pub struct Connection<P> {
    opener: Box<dyn Opener>,
    clock: Arc<dyn Clock>,
    protocol: P,
    keeps_raw: bool,
    stage: Stage,
    found: VecDeque<Reading>,
    buffer: Box<[u8]>,
    health: Health,
    /// Lost before the last reset.
    before: Lost,
    raw_items: u64,
    items: u64,
}

/// What is to be done after a step.
enum After {
    /// Go on.
    Same,
    /// The line is to be set up from its first rung.
    Anew(Box<dyn Transport>),
    /// The line is gone, or was never there.
    Gone(LineError),
}

impl<P: Protocol> Connection<P> {
    /// Stopped. With `keeps_raw` each piece of what is received is a reading too, before those that it completes.
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

    /// The protocol, for what it knows of the device.
    pub fn protocol(&self) -> &P {
        &self.protocol
    }

    /// The same, to ask something of the device while it runs.
    pub fn protocol_mut(&mut self) -> &mut P {
        &mut self.protocol
    }

    /// What becomes readable when the device says something, so that several can be waited for at once; `None` while its line is not open, or is no file.
    pub(crate) fn wakes_by(&self) -> Option<BorrowedFd<'_>> {
        match &self.stage {
            Stage::Climbing { line, .. } | Stage::Running { line, .. } => line.wakes_by(),
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

    /// The first rung of an open line.
    fn begin(&mut self, line: Box<dyn Transport>) {
        let now_ns = self.clock.now_ns();
        let lost = self.protocol.lost();
        self.before.readings += lost.readings;
        self.before.refused += lost.refused;
        self.before.skipped += lost.skipped;
        self.protocol.reset();
        let rung = self.protocol.climb(Met::Begin);
        self.stage = Stage::Climbing { line, rung, since_ns: now_ns, heard_ns: now_ns };
        // A silent device stays silent, and an absent one absent by its reason, until it is set up.
        if self.health.state != State::Silent {
            self.health.enter(State::Starting, "", now_ns);
        }
    }

    /// Does a rung, or as much of it as there is time for.
    fn climb(&mut self, now_ns: i64, deadline_ns: i64) -> After {
        let Stage::Climbing { line, rung, since_ns, heard_ns } = &mut self.stage else { return After::Same };
        let mut kept = 0;
        let until = match rung {
            Rung::Pause(ns) => *since_ns + *ns,
            Rung::Hush { quiet_ns, at_most_ns } => (*heard_ns + *quiet_ns).min(*since_ns + *at_most_ns),
            Rung::Listen(ns) => *since_ns + *ns,
            _ => now_ns,
        };
        let waits = matches!(rung, Rung::Pause(_) | Rung::Hush { .. } | Rung::Listen(_));
        let met = if waits && now_ns < until {
            let received = match line.read(&mut self.buffer, until.min(deadline_ns)) {
                Ok(received) => received,
                Err(error @ LineError::Gone(_)) => return After::Gone(error),
                // Framing errors while the rate is still looked for.
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
            *heard_ns = received.at_ns;
            if !matches!(rung, Rung::Listen(_)) {
                return After::Same;
            }
            kept = received.bytes;
            Met::Heard(&self.buffer[..kept])
        } else {
            match rung {
                Rung::Send(bytes) => match line.write(bytes) {
                    // One that takes nothing is there: it answers nothing either, and counts as silent.
                    Ok(()) | Err(LineError::Stuck) => Met::Done,
                    Err(error) => return After::Gone(error),
                },
                Rung::Baud(baud) => match line.set_baud(*baud) {
                    Ok(()) => Met::Done,
                    Err(error) => return After::Gone(error),
                },
                Rung::Hush { at_most_ns, .. } if now_ns >= *since_ns + *at_most_ns => Met::Noisy,
                Rung::Hush { .. } => Met::Quiet,
                Rung::Listen(_) => Met::Deaf,
                _ => Met::Done,
            }
        };
        match self.protocol.climb(met) {
            Rung::More => {}
            Rung::Top { keep } => {
                self.health.received.set_up += 1;
                let at_ns = *heard_ns;
                let stage = std::mem::replace(&mut self.stage, Stage::Stopped);
                if let Stage::Climbing { line, .. } = stage {
                    let now_ns = self.clock.now_ns();
                    self.stage = Stage::Running { line, heard_ns: now_ns, read_ns: now_ns, ask_ns: now_ns };
                }
                if keep && kept > 0 {
                    self.take(kept, at_ns);
                }
            }
            Rung::Fall(why) => {
                let stage = std::mem::replace(&mut self.stage, Stage::Stopped);
                self.health.enter(State::Silent, &format!("{}: {why}", self.opener.name()), now_ns);
                if let Stage::Climbing { line, .. } = stage {
                    return After::Anew(line);
                }
            }
            next => {
                *rung = next;
                (*since_ns, *heard_ns) = (self.clock.now_ns(), self.clock.now_ns());
            }
        }
        After::Same
    }

    /// Reads what a device says that was set up.
    fn run(&mut self, now_ns: i64, deadline_ns: i64) -> After {
        let patience = self.protocol.patience_ns();
        let Stage::Running { line, heard_ns, read_ns, ask_ns } = &mut self.stage else { return After::Same };
        let silent_ns = *heard_ns + patience;
        // After a while in which nobody asked, what has come meanwhile is heard first.
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
                let makes_sense = self.take(received.bytes, received.at_ns);
                if let Some(why) = self.protocol.broken() {
                    return After::Gone(LineError::Failed(why));
                }
                if may_wait || makes_sense || was_away { After::Same } else { self.fallen_silent(patience) }
            }
            Err(error @ LineError::Gone(_)) => After::Gone(error),
            Err(error) => {
                // What was damaged is told by the records; without an end to it the device is silent.
                tracing::debug!("{}: {error}", self.opener.name());
                self.clock.wait_until(now_ns + TROUBLED);
                if may_wait { After::Same } else { self.fallen_silent(patience) }
            }
        }
    }

    /// A device that was set up has said nothing that makes sense for so long.
    fn fallen_silent(&mut self, patience: i64) -> After {
        let why = format!("{}: is open and has said nothing for {} ms", self.opener.name(), patience / MS);
        self.health.enter(State::Silent, &why, self.clock.now_ns());
        if self.protocol.begins_by_opening() {
            return After::Gone(LineError::Failed(format!(
                "has said nothing for {} ms; it is connected to anew",
                patience / MS
            )));
        }
        match std::mem::replace(&mut self.stage, Stage::Stopped) {
            Stage::Running { line, .. } => After::Anew(line),
            _ => After::Same,
        }
    }

    /// Gives bytes of the buffer to the protocol. Whether there were readings in them.
    fn take(&mut self, bytes: usize, at_ns: i64) -> bool {
        let bytes = &self.buffer[..bytes];
        if self.keeps_raw {
            let stamp = Stamp { item: self.raw_items, host_ns: Some(at_ns), ..Stamp::default() };
            self.raw_items += 1;
            self.found.push_back(Reading::Raw(Raw { stamp, line: 0, bytes: bytes.into() }));
        }
        let before = self.found.len();
        self.protocol.take(bytes, at_ns, &mut self.found);
        number(self.found.iter_mut().skip(before), &mut self.items);
        let lost = self.protocol.lost();
        let received = &mut self.health.received;
        received.lost = self.before.readings + lost.readings;
        received.refused = self.before.refused + lost.refused;
        received.skipped = self.before.skipped + lost.skipped;
        let makes_sense = self.found.len() > before;
        if makes_sense {
            if let Stage::Running { heard_ns, .. } = &mut self.stage {
                *heard_ns = at_ns;
            }
            // Running is what delivers: the last rung alone proves nothing.
            self.health.enter(State::Running, self.protocol.trouble(), at_ns);
        }
        makes_sense
    }
}

/// Gives readings the numbers that follow.
pub(crate) fn number<'a>(readings: impl Iterator<Item = &'a mut Reading>, next: &mut u64) {
    for reading in readings {
        reading.stamp_mut().item = *next;
        *next += 1;
    }
}

impl<P: Protocol> Device for Connection<P> {
    fn start(&mut self) -> Result<(), Error> {
        if !matches!(self.stage, Stage::Stopped) {
            return Err(Error::Misuse(format!("{}: runs already; stop it first", self.opener.name())));
        }
        let now_ns = self.clock.now_ns();
        self.stage = Stage::Absent { retry_ns: now_ns };
        self.health.enter(State::Absent, "not opened yet", now_ns);
        Ok(())
    }

    fn stop(&mut self) -> Result<(), Error> {
        let stage = std::mem::replace(&mut self.stage, Stage::Stopped);
        if let Stage::Climbing { mut line, .. } | Stage::Running { mut line, .. } = stage
            && let Err(error) = line.write(self.protocol.farewell())
        {
            tracing::debug!("{}: {error}, so that it may go on talking", self.opener.name());
        }
        self.found.clear();
        self.health.enter(State::Stopped, "", self.clock.now_ns());
        Ok(())
    }

    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error> {
        // What has come already is found after the deadline, too: one look is always taken.
        let mut looked = false;
        loop {
            if let Some(reading) = self.found.pop_front() {
                self.health.received.readings += u64::from(!matches!(reading, Reading::Raw(_)));
                return Ok(Next::Reading(reading));
            }
            let now_ns = self.clock.now_ns();
            if looked && now_ns >= deadline_ns {
                return Ok(Next::Pending);
            }
            looked = true;
            let after = match &mut self.stage {
                Stage::Stopped => {
                    return Err(Error::Misuse(format!("{}: is stopped; start it first", self.opener.name())));
                }
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
                Stage::Climbing { .. } => self.climb(now_ns, deadline_ns),
                Stage::Running { .. } => self.run(now_ns, deadline_ns),
            };
            self.after(after);
        }
    }

    fn home(&mut self, axes: u8) -> Result<(), Error> {
        if self.protocol.home_axes(axes) {
            return Ok(());
        }
        Err(Error::Misuse(format!("{}: has no axes to home", self.opener.name())))
    }

    fn describe(&self) -> &Description {
        self.protocol.describe()
    }

    fn health(&self) -> &Health {
        &self.health
    }
}
