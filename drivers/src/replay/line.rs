//! Replays the recorded bytes of a line: the same bytes, in the same pieces, through the same
//! decoder.

use std::collections::VecDeque;

use sonoweave_core::clock::Clock;
use sonoweave_core::health::{Health, State};
use sonoweave_core::reading::{Raw, Reading};
use sonoweave_core::{Description, Device, Error, Next};

use crate::connection::{Protocol, number};
use crate::replay::pace::{Pace, Pacer};

/// Opens the recorded pieces of a line from the beginning; called at every start of a replay.
pub type Source = Box<dyn FnMut() -> Box<dyn Iterator<Item = Result<Raw, Error>> + Send> + Send>;

/// A recorded line as a device. Its readings are those of the session, with the session's
/// stamps.
pub struct LineReplay<P> {
    source: Source,
    left: Option<Box<dyn Iterator<Item = Result<Raw, Error>> + Send>>,
    /// The piece that is not due yet.
    held: Option<Raw>,
    protocol: P,
    pacer: Pacer,
    items: u64,
    found: VecDeque<Reading>,
    health: Health,
}

impl<P: Protocol> LineReplay<P> {
    /// Creates a replay of `source` through `protocol`, which has the settings of the session.
    pub fn new(source: Source, protocol: P, pace: Pace) -> Self {
        Self::by(source, protocol, Pacer::new(pace))
    }

    /// Creates a replay paced by the given clock.
    pub fn with_clock(source: Source, protocol: P, pace: Pace, clock: std::sync::Arc<dyn Clock>) -> Self {
        Self::by(source, protocol, Pacer::by(pace, clock))
    }

    fn by(source: Source, protocol: P, pacer: Pacer) -> Self {
        let (found, health) = (VecDeque::new(), Health::default());
        Self { source, left: None, held: None, protocol, pacer, items: 0, found, health }
    }
}

impl<P: Protocol> Device for LineReplay<P> {
    fn start(&mut self) -> Result<(), Error> {
        if self.left.is_some() {
            return Err(Error::Running(self.describe().name.clone()));
        }
        self.left = Some((self.source)());
        self.protocol.reset();
        self.protocol.resume();
        self.pacer.rewind();
        self.items = 0;
        self.health = Health::default();
        self.health.enter(State::Running, "", 0);
        Ok(())
    }

    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error> {
        loop {
            if let Some(reading) = self.found.pop_front() {
                self.health.received.readings += 1;
                return Ok(Next::Reading(reading));
            }
            let Some(left) = &mut self.left else {
                return Err(Error::Stopped(self.protocol.describe().name.clone()));
            };
            let piece = match self.held.take() {
                Some(piece) => piece,
                None => match left.next() {
                    None => {
                        self.health.enter(State::Ended, "", 0);
                        return Ok(Next::End);
                    }
                    Some(Ok(piece)) => piece,
                    Some(Err(error)) => {
                        self.health.enter(State::Ended, &error.to_string(), 0);
                        self.left = None;
                        return Err(error);
                    }
                },
            };
            if !self.pacer.is_due(piece.stamp.host_ns, deadline_ns) {
                self.held = Some(piece);
                return Ok(Next::Pending);
            }
            self.protocol.decode(&piece.bytes, piece.stamp.host_ns.unwrap_or(0), &mut self.found);
            number(self.found.iter_mut(), &mut self.items);
            let lost = self.protocol.lost();
            let received = &mut self.health.received;
            received.bytes += piece.bytes.len() as u64;
            (received.lost, received.refused, received.skipped) = (lost.readings, lost.refused, lost.skipped);
        }
    }

    fn stop(&mut self) -> Result<(), Error> {
        (self.left, self.held) = (None, None);
        self.found.clear();
        self.health.enter(State::Stopped, "", 0);
        Ok(())
    }

    fn describe(&self) -> &Description {
        self.protocol.describe()
    }

    fn health(&self) -> &Health {
        &self.health
    }
}
