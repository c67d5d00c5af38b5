//! Sets a QSB up as it is found, and turns its lines into readings of one axis.
//!
//! A QSB keeps no place: opening its line resets it (DTR), and its count begins at 0 wherever the joint is then. So each time that it is set up its axis is not homed,
//! until its user says that it is; the host notes the count there, as nothing in the unit is known to set it. A recording's bytes do not tell when that was.
//!
//! Its lines have no checksum. One that reads well and cannot be, as the joint would have had to fly, is refused; a digit that came as another and could be is not noticed.

use std::collections::VecDeque;

use super::{Cause, Command, Qsb, Record, TICK_HZ, Value, register};
use crate::arm::Settings;
use crate::arm::homing::{Between, HOME_IT, Homing, Passed};
use crate::clock::{MS, SECOND};
use crate::connection::{Lost, Met, Protocol, Rung};
use crate::framing::Decoder;
use crate::reading::{AXES, Counts, Reading, Stamp, Status};
use crate::{Description, Error, Ticks, Timing};

/// Bits a second that are usual.
pub(in crate::arm) const BAUD: u32 = 230_400;
/// A unit that was told to be quiet and says nothing for so long is.
const QUIET: i64 = 40 * MS;
/// What it may take to be quiet, ns.
const HUSHED: i64 = 250 * MS;
/// What an answer may take, ns.
const ANSWER: i64 = 150 * MS;
/// Between two readings of one unit the clock says no less than it was, and no more than so many ticks.
const MOST_TICKS: i64 = 5 * TICK_HZ as i64;
/// One tick, ns: so much more time may have passed than the ticks say.
const TICK: i64 = SECOND / TICK_HZ as i64;
/// Bytes of a line.
const BYTES: i64 = 26;
/// Bits that a byte takes on the wire.
const BITS: i64 = 10;

/// Where the setting-up stands.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    Line,
    Stop,
    Hush,
    /// Asked for its version, or told the setting with this index.
    Sent(Option<usize>),
    Told(Option<usize>),
    Stream,
    Done,
}

/// A reading before it is told whether it is believed.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Taken {
    ticks: u32,
    at_ns: i64,
}

/// What is known of a unit that sends counts.
#[derive(Debug)]
struct Follower {
    axis: u8,
    of: u8,
    interval: u32,
    homing: Homing<Taken>,
    last: Option<u32>,
    lost: u64,
    refused: u64,
    trouble: String,
}

/// A QSB on a line.
pub struct Unit {
    settings: Settings,
    decoder: Decoder<Qsb>,
    step: Step,
    follower: Follower,
    description: Description,
}

impl Unit {
    /// Of this axis, from 0, of an arm of `of`.
    ///
    /// # Errors
    /// [`Error::Misuse`] for settings that no QSB has.
    pub fn new(name: &str, settings: Settings, axis: u8, of: u8) -> Result<Self, Error> {
        settings.check(TICK_HZ)?;
        let interval = (TICK_HZ + settings.rate_hz / 2) / settings.rate_hz;
        let baud = settings.baud.unwrap_or(BAUD);
        let timing = Timing {
            ticks: Ticks::Time,
            tick_hz: Some(f64::from(TICK_HZ)),
            wraps_at: Some(1 << 32),
            rate_hz: Some(f64::from(TICK_HZ) / f64::from(interval)),
            wire_ns: BYTES * BITS * SECOND / i64::from(baud),
            ..Timing::default()
        };
        let description = Description { name: format!("QSB on {name}"), timing, ..Description::default() };
        let homing = Homing::new(axis, 1, of, 32, settings.fastest, TICK);
        let follower = Follower { axis, of, interval, homing, last: None, lost: 0, refused: 0, trouble: String::new() };
        Ok(Self { settings, decoder: Decoder::new(Qsb), step: Step::Line, follower, description })
    }

    /// The joint is at home now: its count is 0 in the next reading.
    pub fn home(&mut self) {
        self.follower.homing.home(1);
    }

    fn baud(&self) -> u32 {
        self.settings.baud.unwrap_or(BAUD)
    }

    /// What sets the unit up, in order.
    fn commands(&self) -> [(u8, u32); 6] {
        [
            (register::REPLY_FORMAT, 0xf),
            (register::MODE, 0),
            // All four edges of a line count.
            (register::COUNT_MODE, 3),
            // Counts are sent whether they have changed or not: a joint at rest is not a silent one.
            (register::STREAM_THRESHOLD, 0),
            (register::STREAM_INTERVAL, self.follower.interval),
            (register::RESET_TIME, 1),
        ]
    }

    /// Asks for the version, or writes a register.
    fn tell(&mut self, index: Option<usize>) -> Rung {
        let command = match index {
            None => Command::Read(register::VERSION),
            Some(index) => match self.commands().get(index) {
                Some((register, value)) => Command::Write(*register, *value),
                None => {
                    self.step = Step::Stream;
                    return Rung::Send(Command::Stream(register::COUNT).bytes());
                }
            },
        };
        self.step = Step::Sent(index);
        Rung::Send(command.bytes())
    }

    /// The answer to that.
    fn told(&mut self, index: Option<usize>, bytes: &[u8]) -> Rung {
        let (register, wanted) = match index {
            None => (register::VERSION, None),
            // What the clock's register says after it was reset is not documented.
            Some(index) => match self.commands()[index] {
                (register::RESET_TIME, _) => (register::RESET_TIME, None),
                (register, value) => (register, Some(value)),
            },
        };
        let cause = if index.is_none() { Cause::Read } else { Cause::Written };
        let (mut said, mut refused) = (None, false);
        self.decoder.feed(bytes, &mut |record, _| match record {
            Record::Value(value) if value.cause == cause && value.register == register => said = Some(value.value),
            Record::Error(_) => refused = true,
            _ => {}
        });
        match said {
            None if refused => {
                self.fall(format!("refuses register {register:02X}; its firmware may be of another kind"))
            }
            None => Rung::More,
            Some(said) if wanted.is_some_and(|wanted| wanted != said) => self.fall(format!(
                "was told {wanted:?} for register {register:02X} and keeps {said}; switch it off and on"
            )),
            Some(said) => {
                if index.is_none() {
                    // Serial number above bit 11, type of unit above bit 7, firmware.
                    self.description.fields = vec![
                        ("Serial".into(), (said >> 12).to_string()),
                        ("Type".into(), (said >> 8 & 0xf).to_string()),
                        ("Firmware".into(), (said & 0xff).to_string()),
                        ("Baud".into(), self.baud().to_string()),
                    ];
                }
                self.tell(Some(index.map_or(0, |index| index + 1)))
            }
        }
    }

    fn fall(&mut self, why: String) -> Rung {
        self.step = Step::Line;
        Rung::Fall(why)
    }
}

impl Follower {
    fn take(&mut self, record: &Record<'_>, at_ns: i64, found: &mut VecDeque<Reading>) {
        match *record {
            Record::Value(value) => self.count(value, at_ns, found),
            Record::Banner => {
                // It streams no more, either: it is silent until it is set up anew.
                let (axis, of) = (self.axis + 1, self.of);
                self.homing.distrust(1, &format!("axis {axis} of {of} was reset{HOME_IT}"));
            }
            Record::Error(_) => {}
        }
    }

    fn count(&mut self, value: Value, at_ns: i64, found: &mut VecDeque<Reading>) {
        let Value { cause: Cause::Streamed, register: register::COUNT, value, ticks: Some(ticks) } = value else {
            return;
        };
        let mut shown = [0; AXES];
        shown[0] = value.cast_signed().into();
        let passed = self.homing.take(Taken { ticks, at_ns }, shown, between);
        self.pass(passed, found);
    }

    fn pass(&mut self, passed: Passed<Taken>, found: &mut VecDeque<Reading>) {
        self.refused += passed.refused;
        let jumped = passed.held.is_some();
        for (Taken { ticks, at_ns }, counts) in [passed.held, passed.this].into_iter().flatten() {
            if let Some(last) = self.last.replace(ticks) {
                // Lines come each so many ticks: what is missing was lost on the way.
                let intervals = (ticks.wrapping_sub(last) + self.interval / 2) / self.interval;
                self.lost += u64::from(intervals.saturating_sub(1));
            }
            let homed = self.homing.homed();
            let mut status = self.homing.status(homed, 0);
            if jumped && status != Status::Ok {
                status = Status::Other(self.homing.why().to_owned().into());
            }
            let trouble = match &status {
                Status::Other(why) if self.homing.why().is_empty() => why,
                Status::Other(_) => self.homing.why(),
                Status::Ok => "",
            };
            if self.trouble != trouble {
                trouble.clone_into(&mut self.trouble);
            }
            let stamp = Stamp { host_ns: Some(at_ns), ticks: Some(ticks.into()), ..Stamp::default() };
            let homed = homed << self.axis;
            found.push_back(Reading::Counts(Counts {
                stamp,
                first: self.axis,
                axes: 1,
                counts,
                homed,
                buttons: 0,
                status,
            }));
        }
    }
}

/// What lies between two lines.
fn between(earlier: &Taken, later: &Taken) -> Between {
    let ticks = i64::from(later.ticks.wrapping_sub(earlier.ticks).cast_signed());
    // A clock that goes back has begun anew, or a digit of it came as another: the next line tells.
    if ticks < 0 {
        return Between::Anew;
    }
    Between::Later { ns: ticks * SECOND / i64::from(TICK_HZ), set: 0, expected: ticks < MOST_TICKS }
}

impl Protocol for Unit {
    fn reset(&mut self) {
        self.decoder = Decoder::new(Qsb);
        let follower = &mut self.follower;
        follower.homing.restart(0);
        (follower.last, follower.lost, follower.refused) = (None, 0, 0);
        follower.trouble.clear();
    }

    fn home_axes(&mut self, _axes: u8) -> bool {
        self.home();
        true
    }

    fn resume(&mut self) {
        self.reset();
    }

    fn climb(&mut self, met: Met<'_>) -> Rung {
        match (self.step, met) {
            (_, Met::Begin) => {
                self.step = Step::Line;
                Rung::Baud(self.baud())
            }
            (Step::Line | Step::Done, _) => {
                self.step = Step::Stop;
                // A line's end first, as a command that another host began and did not end may be the matter.
                let mut stop = vec![b'\n'];
                stop.extend(Command::Read(register::COUNT).bytes());
                Rung::Send(stop)
            }
            (Step::Stop, _) => {
                self.step = Step::Hush;
                Rung::Hush { quiet_ns: QUIET, at_most_ns: HUSHED }
            }
            (Step::Hush, Met::Noisy) => {
                let why = "goes on talking; check that it is a QSB, and its rate (arm.baud)";
                self.fall(why.into())
            }
            (Step::Hush, _) => {
                self.decoder.interrupt();
                self.tell(None)
            }
            (Step::Sent(index), _) => {
                self.step = Step::Told(index);
                Rung::Listen(ANSWER)
            }
            (Step::Told(index), Met::Heard(bytes)) => self.told(index, bytes),
            (Step::Told(None), _) => {
                let baud = self.baud();
                self.fall(format!("does not answer at {baud} bits a second; check its plug, and its rate (arm.baud)"))
            }
            (Step::Told(Some(_)), _) => self.fall("answered at first and then no more; check its plug".into()),
            (Step::Stream, _) => {
                self.step = Step::Done;
                Rung::Top { keep: false }
            }
        }
    }

    fn take(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>) {
        let follower = &mut self.follower;
        self.decoder.feed(bytes, &mut |record, _| follower.take(&record, at_ns, found));
    }

    fn patience_ns(&self) -> i64 {
        300 * MS + 6 * i64::from(self.follower.interval) * TICK
    }

    fn trouble(&self) -> &str {
        &self.follower.trouble
    }

    fn farewell(&self) -> &[u8] {
        b"R0E\n"
    }

    fn lost(&self) -> Lost {
        let losses = self.decoder.losses();
        let Follower { lost, refused, .. } = self.follower;
        Lost { readings: lost, refused: refused + losses.refusals(), skipped: losses.bytes_skipped }
    }

    fn describe(&self) -> &Description {
        &self.description
    }
}
