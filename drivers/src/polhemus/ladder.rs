//! How any of these units is set up as it is found: what is common to all of them, so that each model only says what it is told and how it answers.
//!
//! A unit keeps its settings while the host goes away and comes back: it may be found talking, in another mode, in inches, in the midst of a record, at any of its rates.
//! So it is told to be quiet, waited for until it is, asked who it is; set up; and asked again, so that what counts is what it says and not what it was told. Then it is
//! told to stream, again if nothing comes. Between settings that are the same as before nothing differs: setting up twice is harmless.

use std::collections::VecDeque;

use crate::Description;
use crate::clock::{MS, SECOND};
use crate::connection::{Lost, Met, Protocol, Rung};
use crate::reading::Reading;

/// A unit that was told to be quiet and says nothing for so long is; two records of the slowest rate.
const QUIET: i64 = 70 * MS;
/// What a unit may take to be quiet, ns: it ends the record that it has begun, which takes 56 ms at 9600 for the longest usual one.
const HUSHED: i64 = 250 * MS;
/// What the first answer may take, ns: a status takes 57 ms at 9600.
const PROBED: i64 = 150 * MS;
/// What a later one may take, ns: two records of text and a status take 135 ms at 9600.
const ANSWER: i64 = 400 * MS;
/// What the first record may take after the unit was told to stream, ns: one in text takes 56 ms at 9600, and follows a cycle of all stations.
const FIRST: i64 = 150 * MS;
/// Times that a unit is told to stream before it counts as not doing so.
const STARTS: usize = 3;
/// Without a record for so long the unit is silent, ns: many cycles of all stations.
const PATIENCE: i64 = 500 * MS;
/// Bits that a byte takes on a serial line.
const BITS: i64 = 10;

/// What a unit is connected by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Line {
    /// A serial line at this rate, bits a second; `None` for whichever of the usual ones the unit answers at.
    Serial(Option<u32>),
    /// USB, which has no rate.
    Usb,
}

impl From<Option<u32>> for Line {
    fn from(baud: Option<u32>) -> Self {
        Self::Serial(baud)
    }
}

/// Time that so many bytes take at a rate, ns; none where there is no rate.
pub(super) fn wire_ns(bytes: usize, baud: Option<u32>) -> i64 {
    baud.map_or(0, |baud| bytes as i64 * BITS * SECOND / i64::from(baud))
}

/// The highest of these record rates (descending, records a second) that is no higher than wanted and at which so many bytes a time pass a line with 5 in 100 to
/// spare; the lowest where none is.
pub(super) fn fastest<R: Copy>(
    rates: &[(R, f64)],
    at_most_hz: f64,
    bytes: usize,
    baud: Option<u32>,
) -> Option<(R, f64)> {
    let fits = |hz: f64| baud.is_none_or(|baud| hz * (bytes as i64 * BITS) as f64 <= 0.95 * f64::from(baud));
    rates.iter().find(|(_, hz)| *hz <= at_most_hz && fits(*hz)).or(rates.last()).copied()
}

/// One step of the setting-up.
#[derive(Debug, Clone, PartialEq)]
pub enum Say<Q> {
    /// To be sent; nothing is answered.
    Tell(Vec<u8>),
    /// To be sent and answered.
    Ask(Vec<u8>, Q),
}

/// What became of a question.
#[derive(Debug, Clone, PartialEq)]
pub enum Heard {
    /// No answer yet.
    Nothing,
    /// Answered as it should be.
    Good,
    /// Answered otherwise: why the unit cannot be used, and what to do.
    Bad(String),
}

/// What a unit of one model is told, and how it answers.
pub trait Dialect: Send {
    /// What can be asked.
    type Question: Copy + Send;
    /// Rates that units were found at, the likeliest first.
    const BAUDS: &'static [u32];
    /// So many rounds, at a known rate (or none) and of all rates, of which the last starts the unit anew: longer than what it takes to start. `None` where it cannot be told.
    const RESTARTS: Option<[usize; 2]>;
    /// What else to check where it does not answer on a serial line, as the end of a sentence.
    const SERIAL_ADVICE: &'static str;

    /// Everything begins anew.
    fn forget(&mut self);
    /// Tells it to be quiet, `again` when that has failed once; or to start anew.
    fn quieten(&self, again: bool, restart: bool) -> Vec<u8>;
    /// What comes next answers a question that is about to be asked; what came before does not.
    fn listen(&mut self);
    /// The first question, which it answers however it was left.
    fn probe(&self) -> (Vec<u8>, Self::Question);
    /// What sets it up and asks it whether it is, once it has answered at this rate (`None` by USB).
    fn script(&mut self, baud: Option<u32>) -> Vec<Say<Self::Question>>;
    /// Takes bytes while a question is open.
    fn hear(&mut self, bytes: &[u8], question: Self::Question) -> Heard;
    /// It is set up: what starts the stream.
    fn stream(&mut self, baud: Option<u32>) -> Vec<u8>;
    /// Ready to take the bytes that a unit of these settings sent after it was set up, as a recording has them.
    fn replay(&mut self);
    /// See [`Protocol::take`].
    fn take(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>);
    /// See [`Protocol::farewell`].
    fn farewell(&self) -> &[u8];
    /// See [`Protocol::lost`].
    fn lost(&self) -> Lost;
    /// See [`Protocol::describe`].
    fn describe(&self) -> &Description;
}

/// Where the setting-up stands.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    /// The rate is to be set, and the unit to be quietened.
    Rate,
    Hush,
    Hushed,
    /// The question was sent; the first is the probe.
    Asked,
    /// It is waited for an answer.
    Answer,
    /// What comes next in the script.
    Script,
    /// Told to stream so many times.
    Start(usize),
    /// It is waited for the first record.
    First(usize),
}

/// A unit on a line.
pub struct Tracker<D: Dialect> {
    dialect: D,
    line: Line,
    may_reset: bool,
    step: Step,
    /// The question that is open.
    question: Option<D::Question>,
    /// Whether the unit has answered in this attempt.
    is_there: bool,
    /// What is still to be said.
    script: VecDeque<Say<D::Question>>,
    /// Rates tried since the last one that was answered at.
    tried: usize,
    /// The rate that was answered at last.
    found: Option<u32>,
}

impl<D: Dialect> Tracker<D> {
    /// A unit of this model.
    pub(super) fn of(dialect: D, line: Line, may_reset: bool) -> Self {
        Self {
            dialect,
            line,
            may_reset,
            step: Step::Rate,
            question: None,
            is_there: false,
            script: VecDeque::new(),
            tried: 0,
            found: None,
        }
    }

    /// The rate that is tried now.
    fn baud(&self) -> Option<u32> {
        match self.line {
            Line::Usb => None,
            Line::Serial(Some(baud)) => Some(baud),
            Line::Serial(None) => {
                Some(self.found.filter(|_| self.tried < 2).unwrap_or(D::BAUDS[self.tried % D::BAUDS.len()]))
            }
        }
    }

    fn of_a_round(&self) -> usize {
        if self.line == Line::Serial(None) { D::BAUDS.len() } else { 1 }
    }

    /// Whether the unit is to be started anew in this attempt: now and then, as one that is only switched off answers sooner without.
    fn restarts(&self) -> bool {
        let Some(rounds) = D::RESTARTS.filter(|_| self.may_reset) else { return false };
        let rounds = rounds[usize::from(self.line == Line::Serial(None))];
        (self.tried / self.of_a_round()) % rounds == rounds - 1
    }

    /// Tries the next rate, or gives up for this time.
    fn next_rate(&mut self, why: &str) -> Rung {
        self.tried += 1;
        if !self.tried.is_multiple_of(self.of_a_round()) {
            self.step = Step::Rate;
            return self.climb(Met::Begin);
        }
        let at = match self.line {
            Line::Usb => String::new(),
            Line::Serial(Some(baud)) => format!(" at {baud} bits a second"),
            Line::Serial(None) => {
                let bauds: Vec<String> = D::BAUDS.iter().map(|baud| baud.to_string()).collect();
                format!(" at {} bits a second", bauds.join(", "))
            }
        };
        let cable = match self.line {
            Line::Usb => String::new(),
            Line::Serial(_) => format!(" (null modem), and the rate of its switches{}", D::SERIAL_ADVICE),
        };
        self.fall(format!("{why}{at}; check that the unit is switched on, and its cable{cable}"))
    }

    fn fall(&mut self, why: String) -> Rung {
        self.step = Step::Rate;
        Rung::Fall(why)
    }

    fn ask(&mut self, bytes: Vec<u8>, question: D::Question) -> Rung {
        self.dialect.listen();
        (self.step, self.question) = (Step::Asked, Some(question));
        Rung::Send(bytes)
    }

    /// The next of the script, and at its end the stream.
    fn go_on(&mut self) -> Rung {
        match self.script.pop_front() {
            Some(Say::Tell(bytes)) => {
                self.step = Step::Script;
                Rung::Send(bytes)
            }
            Some(Say::Ask(bytes, question)) => self.ask(bytes, question),
            None => self.start(1),
        }
    }

    fn start(&mut self, times: usize) -> Rung {
        self.step = Step::Start(times);
        Rung::Send(self.dialect.stream(self.baud()))
    }

    fn hear(&mut self, bytes: &[u8]) -> Rung {
        let Some(question) = self.question else { return Rung::More };
        match self.dialect.hear(bytes, question) {
            Heard::Nothing => Rung::More,
            Heard::Bad(why) => self.fall(why),
            Heard::Good => {
                if !self.is_there {
                    (self.is_there, self.found, self.tried) = (true, self.baud(), 0);
                    self.script = self.dialect.script(self.baud()).into();
                }
                self.go_on()
            }
        }
    }
}

impl<D: Dialect> Protocol for Tracker<D> {
    fn reset(&mut self) {
        self.dialect.forget();
        (self.step, self.question, self.is_there) = (Step::Rate, None, false);
    }

    fn resume(&mut self) {
        self.dialect.replay();
    }

    fn climb(&mut self, met: Met<'_>) -> Rung {
        match (self.step, met) {
            (Step::Rate, _) => {
                self.is_there = false;
                self.step = Step::Hush;
                match self.baud() {
                    Some(baud) => Rung::Baud(baud),
                    None => self.climb(Met::Done),
                }
            }
            (Step::Hush, _) => {
                self.step = Step::Hushed;
                // A unit that was told to start anew is asked as before: it answers when it is ready.
                Rung::Send(self.dialect.quieten(self.tried > 0, self.restarts()))
            }
            (Step::Hushed, Met::Done) => Rung::Hush { quiet_ns: QUIET, at_most_ns: HUSHED },
            (Step::Hushed, Met::Noisy) => self.next_rate("goes on talking"),
            (Step::Hushed, _) => {
                let (bytes, question) = self.dialect.probe();
                self.ask(bytes, question)
            }
            (Step::Asked, _) => {
                self.step = Step::Answer;
                Rung::Listen(if self.is_there { ANSWER } else { PROBED })
            }
            (Step::Answer, Met::Heard(bytes)) => self.hear(bytes),
            (Step::Answer, _) if !self.is_there => self.next_rate("does not answer"),
            (Step::Answer, _) => self.fall("answered at first and then no more; check its cable".into()),
            (Step::Script, _) => self.go_on(),
            (Step::Start(times), _) => {
                self.step = Step::First(times);
                Rung::Listen(FIRST)
            }
            (Step::First(_), Met::Heard(_)) => Rung::Top { keep: true },
            (Step::First(times), _) if times < STARTS => self.start(times + 1),
            (Step::First(_), _) => self.fall(
                "was set up and sends no record; check that its transmitter and its sensors are plugged in, and switch it off and on".into(),
            ),
        }
    }

    fn take(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>) {
        self.dialect.take(bytes, at_ns, found);
    }

    fn patience_ns(&self) -> i64 {
        PATIENCE
    }

    fn farewell(&self) -> &[u8] {
        self.dialect.farewell()
    }

    fn lost(&self) -> Lost {
        self.dialect.lost()
    }

    fn describe(&self) -> &Description {
        self.dialect.describe()
    }
}
