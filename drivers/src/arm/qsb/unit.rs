//! Sets up a QSB from any state, and converts its lines to readings of one axis.
//!
//! A QSB stores no position: opening its line resets it (DTR), and its count starts at 0 wherever
//! the joint is. After each set-up its axis is therefore not homed until the user homes it. The
//! host then records the count, because no command is known to set it. A recording's bytes do not
//! show when that was.
//!
//! Lines have no checksum. A valid line with a count that the joint cannot have reached is
//! refused. A corrupted digit that gives a plausible count is not noticed.

use std::collections::VecDeque;

use sonoweave_core::clock::{MS, SECOND};
use sonoweave_core::reading::{AXES, Counts, Reading, Stamp};
use sonoweave_core::{Description, Ticks, Timing};

use super::{Cause, Command, Qsb, Record, TICK_HZ, Value, register};
use crate::Error;
use crate::arm::Settings;
use crate::arm::homing::{Between, HOME_IT, Homing, Passed};
use crate::connection::{Lost, Protocol, SetupEvent, SetupStep};
use crate::framing::Decoder;

/// Usual serial rate, bits per second.
pub(in crate::arm) const BAUD: u32 = 230_400;
/// Silence after which a stopped unit counts as quiet, ns.
const QUIET: i64 = 40 * MS;
/// Time that a unit may take to become quiet, ns.
const QUIET_WITHIN: i64 = 250 * MS;
/// Time limit of an answer, ns.
const ANSWER: i64 = 150 * MS;
/// Maximum ticks between two readings of one unit; the clock never goes back.
const MOST_TICKS: i64 = 5 * TICK_HZ as i64;
/// One tick, ns: the elapsed time may exceed the ticks by this.
const TICK: i64 = SECOND / TICK_HZ as i64;
/// Bytes of a line.
const BYTES: i64 = 26;
/// Bits of a byte on the wire.
const BITS: i64 = 10;

/// State of the set-up sequence.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    Line,
    Stop,
    AwaitQuiet,
    /// The version was requested, or the setting with this index was written.
    Sent(Option<usize>),
    Answer(Option<usize>),
    Stream,
    Done,
}

/// A reading before it is accepted or refused.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Taken {
    ticks: u32,
    at_ns: i64,
}

/// State of a unit that sends counts.
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
    /// Creates the unit of axis `axis`, from 0, of an arm with `of` axes.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings that no QSB has.
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

    /// Homes the joint: its count is 0 in the next reading.
    pub fn home(&mut self) {
        self.follower.homing.home(1);
    }

    fn baud(&self) -> u32 {
        self.settings.baud.unwrap_or(BAUD)
    }

    /// Returns the set-up commands, in order.
    fn commands(&self) -> [(u8, u32); 6] {
        [
            (register::REPLY_FORMAT, 0xf),
            (register::MODE, 0),
            // All four edges of a line count.
            (register::COUNT_MODE, 3),
            // Unchanged counts are sent too, so that a static joint does not look silent.
            (register::STREAM_THRESHOLD, 0),
            (register::STREAM_INTERVAL, self.follower.interval),
            (register::RESET_TIME, 1),
        ]
    }

    /// Asks for the version, or writes a register.
    fn send_command(&mut self, index: Option<usize>) -> SetupStep {
        let command = match index {
            None => Command::Read(register::VERSION),
            Some(index) => match self.commands().get(index) {
                Some((register, value)) => Command::Write(*register, *value),
                None => {
                    self.step = Step::Stream;
                    return SetupStep::Send(Command::Stream(register::COUNT).bytes());
                }
            },
        };
        self.step = Step::Sent(index);
        SetupStep::Send(command.bytes())
    }

    /// Takes the answer to [`send_command`](Self::send_command).
    fn read_answer(&mut self, index: Option<usize>, bytes: &[u8]) -> SetupStep {
        let (register, expected) = match index {
            None => (register::VERSION, None),
            // The value of the clock's register after its reset is not documented.
            Some(index) => match self.commands()[index] {
                (register::RESET_TIME, _) => (register::RESET_TIME, None),
                (register, value) => (register, Some(value)),
            },
        };
        let cause = if index.is_none() { Cause::Read } else { Cause::Written };
        let (mut answer, mut refused) = (None, false);
        self.decoder.feed(bytes, &mut |record, _| match record {
            Record::Value(value) if value.cause == cause && value.register == register => answer = Some(value.value),
            Record::Error(_) => refused = true,
            _ => {}
        });
        match answer {
            None if refused => {
                self.fail(format!("refuses register {register:02X}; its firmware may be of another kind"))
            }
            None => SetupStep::More,
            Some(value) if expected.is_some_and(|expected| expected != value) => self.fail(format!(
                "was told {expected:?} for register {register:02X} and keeps {value}; switch it off and on"
            )),
            Some(value) => {
                if index.is_none() {
                    // Serial number from bit 12, type of unit from bit 8, firmware below.
                    self.description.fields = vec![
                        ("Serial".into(), (value >> 12).to_string()),
                        ("Type".into(), (value >> 8 & 0xf).to_string()),
                        ("Firmware".into(), (value & 0xff).to_string()),
                        ("Baud".into(), self.baud().to_string()),
                    ];
                }
                self.send_command(Some(index.map_or(0, |index| index + 1)))
            }
        }
    }

    fn fail(&mut self, why: String) -> SetupStep {
        self.step = Step::Line;
        SetupStep::Fail(why)
    }
}

impl Follower {
    fn push(&mut self, record: &Record<'_>, at_ns: i64, found: &mut VecDeque<Reading>) {
        match *record {
            Record::Value(value) => self.count(value, at_ns, found),
            Record::Banner => {
                // A reset also ends the stream: the unit stays silent until it is set up again.
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
        let passed = self.homing.push(Taken { ticks, at_ns }, shown, between);
        self.pass(passed, found);
    }

    fn pass(&mut self, passed: Passed<Taken>, found: &mut VecDeque<Reading>) {
        self.refused += passed.refused;
        let jumped = passed.held.is_some();
        for (Taken { ticks, at_ns }, counts) in [passed.held, passed.this].into_iter().flatten() {
            if let Some(last) = self.last.replace(ticks) {
                // Lines come every `interval` ticks; missing lines were lost in transmission.
                let intervals = (ticks.wrapping_sub(last) + self.interval / 2) / self.interval;
                self.lost += u64::from(intervals.saturating_sub(1));
            }
            let homed = self.homing.homed();
            let status = self.homing.status_after(jumped, homed, 0);
            let trouble = self.homing.trouble(&status);
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

/// Returns the relation of two consecutive lines.
fn between(earlier: &Taken, later: &Taken) -> Between {
    let ticks = i64::from(later.ticks.wrapping_sub(earlier.ticks).cast_signed());
    // Either the clock restarted or one of its digits was corrupted: the next line decides.
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

    fn next_step(&mut self, event: SetupEvent<'_>) -> SetupStep {
        match (self.step, event) {
            (_, SetupEvent::Begin) => {
                self.step = Step::Line;
                SetupStep::Baud(self.baud())
            }
            (Step::Line | Step::Done, _) => {
                self.step = Step::Stop;
                // Sends a line end first, because another host may have left a command
                // unfinished.
                let mut stop = vec![b'\n'];
                stop.extend(Command::Read(register::COUNT).bytes());
                SetupStep::Send(stop)
            }
            (Step::Stop, _) => {
                self.step = Step::AwaitQuiet;
                SetupStep::AwaitQuiet { quiet_ns: QUIET, at_most_ns: QUIET_WITHIN }
            }
            (Step::AwaitQuiet, SetupEvent::Noisy) => {
                let why = "does not stop sending; check that it is a QSB, and its rate (arm.baud)";
                self.fail(why.into())
            }
            (Step::AwaitQuiet, _) => {
                self.decoder.interrupt();
                self.send_command(None)
            }
            (Step::Sent(index), _) => {
                self.step = Step::Answer(index);
                SetupStep::Listen(ANSWER)
            }
            (Step::Answer(index), SetupEvent::Received(bytes)) => self.read_answer(index, bytes),
            (Step::Answer(None), _) => {
                let baud = self.baud();
                self.fail(format!("does not answer at {baud} bits a second; check its plug, and its rate (arm.baud)"))
            }
            (Step::Answer(Some(_)), _) => self.fail("answered at first and then no more; check its plug".into()),
            (Step::Stream, _) => {
                self.step = Step::Done;
                SetupStep::Finish { keep: false }
            }
        }
    }

    fn decode(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>) {
        let follower = &mut self.follower;
        self.decoder.feed(bytes, &mut |record, _| follower.push(&record, at_ns, found));
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
