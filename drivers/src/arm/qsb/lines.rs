//! Three QSBs, each on its own line, as one arm.

use std::sync::Arc;

use sonoweave_core::clock::{Clock, MS};
use sonoweave_core::health::{Health, Received, State};
use sonoweave_core::reading::Reading;
use sonoweave_core::{Description, Device, Error, Next};

use super::Unit;
use crate::arm::Settings;
use crate::connection::{Connection, number};
use crate::transport::{self, Opener};

/// Axes of an arm.
const AXES: usize = 3;
/// Longest common wait for all lines, ns. Then the silent lines are checked too, which may have
/// to be opened or reported as silent.
const TOGETHER: i64 = 5 * MS;
/// Time for reading one line before the next, ns, if the lines are not files that can be polled
/// together. Data on the other lines is stamped late by up to two of these, a quarter of the
/// unit's own tick. Nothing depends on this stamp, because the ticks give the time.
const TURN: i64 = MS / 4;

/// The device: readings of one axis each, with the ticks of that axis's unit.
///
/// A missing or silent line does not delay the others: their readings continue, and
/// [`Device::health`] names the axis.
pub struct Arm {
    lines: [Connection<Unit>; AXES],
    clock: Arc<dyn Clock>,
    /// Index of the line that is read now.
    turn: usize,
    /// Readings so far, and raw pieces so far.
    items: [u64; 2],
    description: Description,
    health: Health,
}

impl Arm {
    /// Creates an arm of these lines, base first. If `keeps_raw` is set, each received piece is
    /// also a reading, with the number of its line.
    ///
    /// # Errors
    /// [`crate::Error::Setting`] for settings that no QSB has.
    pub fn new(
        openers: [Box<dyn Opener>; AXES],
        clock: Arc<dyn Clock>,
        settings: &Settings,
        keeps_raw: bool,
    ) -> Result<Self, crate::Error> {
        let line = |axis, opener: Box<dyn Opener>| -> Result<_, crate::Error> {
            let unit = Unit::new(opener.name(), settings.clone(), axis, AXES as u8)?;
            Ok(Connection::new(opener, Arc::clone(&clock), unit, keeps_raw))
        };
        let [a, b, c] = openers;
        let lines = [line(0, a)?, line(1, b)?, line(2, c)?];
        let timing = lines[0].describe().timing;
        let name = lines.each_ref().map(|line| line.describe().name.clone()).join(", ");
        let description = Description { name, timing, ..Description::default() };
        Ok(Self { lines, clock, turn: 0, items: [0; 2], description, health: Health::default() })
    }

    /// Homes these axes (bit by axis): their counts are 0 in the next reading of each.
    pub fn home(&mut self, axes: u8) {
        for (axis, line) in self.lines.iter_mut().enumerate().filter(|(axis, _)| axes & 1 << axis != 0) {
            tracing::debug!("axis {} is at home", axis + 1);
            line.protocol_mut().home();
        }
    }

    /// Reports the worst health of the three axes, and names the axis.
    fn update_health(&mut self, now_ns: i64) {
        let rank = |state: State| match state {
            State::Stopped => 5,
            State::Absent => 4,
            State::Silent => 3,
            State::Starting => 2,
            State::Running => 1,
            State::Ended => 0,
        };
        let trouble = |line: &Connection<Unit>| (rank(line.health().state), !line.health().why.is_empty());
        // The first of equals wins, so that the text does not alternate.
        let mut worst = 0;
        for axis in 1..AXES {
            if trouble(&self.lines[axis]) > trouble(&self.lines[worst]) {
                worst = axis;
            }
        }
        let health = self.lines[worst].health();
        let is_new = match self.health.why.strip_prefix(PREFIXES[worst]) {
            Some(why) => why != health.why,
            None => !(health.why.is_empty() && self.health.why.is_empty()),
        };
        if is_new || self.health.state != health.state {
            let why = if health.why.is_empty() { String::new() } else { format!("{}{}", PREFIXES[worst], health.why) };
            self.health.enter(health.state, &why, now_ns);
        }
        self.health.received =
            self.lines.iter().map(|line| line.health().received).fold(Received::default(), |sum, each| Received {
                bytes: sum.bytes + each.bytes,
                readings: sum.readings + each.readings,
                lost: sum.lost + each.lost,
                refused: sum.refused + each.refused,
                skipped: sum.skipped + each.skipped,
                opened: sum.opened + each.opened,
                set_up: sum.set_up + each.set_up,
            });
    }

    /// Returns the next reading of the current line.
    fn next_of_turn(&mut self, deadline_ns: i64) -> Result<Option<Reading>, Error> {
        let set_up = self.health.received.set_up;
        let next = self.lines[self.turn].next(deadline_ns)?;
        self.update_health(self.clock.now_ns());
        if self.health.received.set_up != set_up {
            self.describe_all();
        }
        let Next::Reading(mut reading) = next else { return Ok(None) };
        let is_raw = matches!(reading, Reading::Raw(_));
        if let Reading::Raw(raw) = &mut reading {
            raw.line = self.turn as u8;
        }
        number(std::iter::once(&mut reading), &mut self.items[usize::from(is_raw)]);
        Ok(Some(reading))
    }

    /// Collects the fields of all units, after all were set up.
    fn describe_all(&mut self) {
        let of = |(axis, line): (usize, &Connection<Unit>)| {
            let fields = line.describe().fields.iter();
            fields.map(|(name, value)| (format!("Axis{}{name}", axis + 1), value.clone())).collect::<Vec<_>>()
        };
        self.description.fields = self.lines.iter().enumerate().flat_map(of).collect();
    }
}

/// Prefixes of an axis's health text.
const PREFIXES: [&str; AXES] = ["axis 1 of 3: ", "axis 2 of 3: ", "axis 3 of 3: "];

impl Device for Arm {
    fn home(&mut self, axes: u8) -> Result<(), Error> {
        Arm::home(self, axes);
        Ok(())
    }

    fn start(&mut self) -> Result<(), Error> {
        for line in &mut self.lines {
            line.start()?;
        }
        self.update_health(self.clock.now_ns());
        Ok(())
    }

    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error> {
        loop {
            // Polls each line once, without waiting, from the one that delivered last. Readings
            // that arrived together are returned together.
            for _ in 0..AXES {
                let now_ns = self.clock.now_ns();
                if let Some(reading) = self.next_of_turn(now_ns)? {
                    return Ok(Next::Reading(reading));
                }
                self.turn = (self.turn + 1) % AXES;
            }
            let now_ns = self.clock.now_ns();
            if now_ns >= deadline_ns {
                return Ok(Next::Pending);
            }
            let lines = self.lines.each_ref().map(Connection::wakes_by);
            if lines.iter().any(Option::is_some) {
                transport::wait(lines, (deadline_ns - now_ns).min(TOGETHER));
                continue;
            }
            if let Some(reading) = self.next_of_turn(deadline_ns.min(now_ns + TURN))? {
                return Ok(Next::Reading(reading));
            }
            self.turn = (self.turn + 1) % AXES;
        }
    }

    fn stop(&mut self) -> Result<(), Error> {
        let stopped = self.lines.each_mut().map(Device::stop);
        self.update_health(self.clock.now_ns());
        stopped.into_iter().collect()
    }

    fn describe(&self) -> &Description {
        &self.description
    }

    fn health(&self) -> &Health {
        &self.health
    }
}
