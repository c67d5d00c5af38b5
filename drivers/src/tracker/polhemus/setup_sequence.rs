//! Set-up sequence of all these units, from any state; each model adds its own unit protocol.
//!
//! A unit keeps its settings while the host goes away and comes back. It may be streaming, in
//! another mode, in inches, in the middle of a record, or at any of its rates. The driver tells
//! it to stop, waits until it is quiet and asks for its identity. It then sets the unit up and
//! reads the settings back, because only the unit's own answer counts. Finally it starts the
//! stream, again if no record comes. Repeating the set-up with the same settings is harmless.

use std::collections::VecDeque;

use sonoweave_core::Description;
use sonoweave_core::clock::{MS, SECOND};
use sonoweave_core::reading::Reading;

use crate::connection::{Lost, Protocol, SetupEvent, SetupStep};

/// Silence after which a stopped unit counts as quiet, ns: two records of the slowest rate.
const QUIET: i64 = 70 * MS;
/// Time that a unit may take to become quiet, ns. It finishes its record, which takes 56 ms at
/// 9600 bits per second for the longest usual one.
const QUIET_WITHIN: i64 = 250 * MS;
/// Time limit of the first answer, ns: a status takes 57 ms at 9600 bits per second.
const PROBED: i64 = 150 * MS;
/// Time limit of later answers, ns: two text records and a status take 135 ms at 9600 bits per
/// second.
const ANSWER: i64 = 400 * MS;
/// Time limit of the first record after the stream starts, ns. A text record takes 56 ms at 9600
/// bits per second, and follows a cycle of all stations.
const FIRST: i64 = 150 * MS;
/// Attempts to start the stream before set-up fails.
const STARTS: usize = 3;
/// Time without a record after which the unit counts as silent, ns: many cycles of all stations.
const PATIENCE: i64 = 500 * MS;
/// Bits of a byte on a serial line.
const BITS: i64 = 10;

/// Physical connection of a unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Line {
    /// A serial line at this rate, bits per second; `None` searches the usual rates.
    Serial(Option<u32>),
    /// USB, which has no rate.
    Usb,
}

impl From<Option<u32>> for Line {
    fn from(baud: Option<u32>) -> Self {
        Self::Serial(baud)
    }
}

/// Returns the transmission time of `bytes` at a rate, ns; 0 without a rate.
pub(super) fn wire_ns(bytes: usize, baud: Option<u32>) -> i64 {
    baud.map_or(0, |baud| bytes as i64 * BITS * SECOND / i64::from(baud))
}

/// Returns the highest of these record rates (descending, records per second) that does not
/// exceed `at_most_hz` and fits the line. The line must have 5 % to spare for `bytes` per record.
/// Falls back to the lowest rate.
pub(super) fn fastest<R: Copy>(
    rates: &[(R, f64)],
    at_most_hz: f64,
    bytes: usize,
    baud: Option<u32>,
) -> Option<(R, f64)> {
    let fits = |hz: f64| baud.is_none_or(|baud| hz * (bytes as i64 * BITS) as f64 <= 0.95 * f64::from(baud));
    rates.iter().find(|(_, hz)| *hz <= at_most_hz && fits(*hz)).or(rates.last()).copied()
}

/// One set-up step.
#[derive(Debug, Clone, PartialEq)]
pub enum ScriptStep<Q> {
    /// Bytes to send, without an answer.
    Send(Vec<u8>),
    /// Bytes to send, with the question that they ask.
    Ask(Vec<u8>, Q),
}

/// State of a question.
#[derive(Debug, Clone, PartialEq)]
pub enum QuestionState {
    /// No answer yet.
    Nothing,
    /// The answer is as expected.
    Good,
    /// The answer is wrong: why the unit cannot be used, and what to do.
    Bad(String),
}

/// Unit protocol: the commands and answers of one model.
pub trait UnitProtocol: Send {
    /// Questions to the unit.
    type Question: Copy + Send;
    /// Serial rates of such units, the likeliest first.
    const BAUDS: &'static [u32];
    /// Number of rounds whose last one restarts the unit: with a single rate (or none), and with
    /// all rates. The rounds must take longer than the unit's start. `None` if the unit cannot be
    /// restarted.
    const RESTARTS: Option<[usize; 2]>;
    /// Further checks when a serial unit does not answer, as the end of a sentence.
    const SERIAL_ADVICE: &'static str;

    /// Clears all state.
    fn forget(&mut self);
    /// Returns the bytes that stop the stream or restart the unit; `again` marks a retry.
    fn quieten(&self, again: bool, restart: bool) -> Vec<u8>;
    /// Prepares for a question: later bytes answer it, earlier bytes do not.
    fn listen(&mut self);
    /// Returns the first question, which the unit answers in every state.
    fn probe(&self) -> (Vec<u8>, Self::Question);
    /// Returns the commands that set the unit up and read the settings back. `baud` is the rate
    /// of the first answer, `None` for USB.
    fn script(&mut self, baud: Option<u32>) -> Vec<ScriptStep<Self::Question>>;
    /// Takes bytes while a question is open.
    fn judge_answer(&mut self, bytes: &[u8], question: Self::Question) -> QuestionState;
    /// Returns the bytes that start the stream, after set-up.
    fn stream(&mut self, baud: Option<u32>) -> Vec<u8>;
    /// Prepares to replay recorded bytes, which the unit sent after set-up with these settings.
    fn replay(&mut self);
    /// See [`Protocol::decode`].
    fn decode(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>);
    /// See [`Protocol::farewell`].
    fn farewell(&self) -> &[u8];
    /// See [`Protocol::lost`].
    fn lost(&self) -> Lost;
    /// See [`Protocol::describe`].
    fn describe(&self) -> &Description;
}

/// State of the set-up sequence.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    /// The rate is set next, and the unit is stopped.
    Rate,
    Quieten,
    Quietened,
    /// A question was sent; the first is the probe.
    Sent,
    /// The driver waits for an answer.
    Answer,
    /// The next command of the script follows.
    Script,
    /// The stream was started this many times.
    Start(usize),
    /// The driver waits for the first record.
    First(usize),
}

/// A unit on a line.
pub struct Tracker<U: UnitProtocol> {
    unit: U,
    line: Line,
    may_reset: bool,
    step: Step,
    /// The open question.
    question: Option<U::Question>,
    /// Whether the unit has answered in this attempt.
    is_there: bool,
    /// Remaining set-up commands.
    script: VecDeque<ScriptStep<U::Question>>,
    /// Rates tried since the last answer.
    tried: usize,
    /// Rate of the last answer.
    found: Option<u32>,
}

impl<U: UnitProtocol> Tracker<U> {
    /// Creates a unit of this model.
    pub(super) fn of(unit: U, line: Line, may_reset: bool) -> Self {
        Self {
            unit,
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

    /// Returns the rate of this attempt.
    fn baud(&self) -> Option<u32> {
        match self.line {
            Line::Usb => None,
            Line::Serial(Some(baud)) => Some(baud),
            Line::Serial(None) => {
                Some(self.found.filter(|_| self.tried < 2).unwrap_or(U::BAUDS[self.tried % U::BAUDS.len()]))
            }
        }
    }

    fn of_a_round(&self) -> usize {
        if self.line == Line::Serial(None) { U::BAUDS.len() } else { 1 }
    }

    /// Returns whether this attempt restarts the unit. Most attempts do not, because a unit that
    /// was only switched off answers sooner without a restart.
    fn restarts(&self) -> bool {
        let Some(rounds) = U::RESTARTS.filter(|_| self.may_reset) else { return false };
        let rounds = rounds[usize::from(self.line == Line::Serial(None))];
        (self.tried / self.of_a_round()) % rounds == rounds - 1
    }

    /// Tries the next rate, or ends this attempt.
    fn next_rate(&mut self, why: &str) -> SetupStep {
        self.tried += 1;
        if !self.tried.is_multiple_of(self.of_a_round()) {
            self.step = Step::Rate;
            return self.next_step(SetupEvent::Begin);
        }
        let at = match self.line {
            Line::Usb => String::new(),
            Line::Serial(Some(baud)) => format!(" at {baud} bits a second"),
            Line::Serial(None) => {
                let bauds: Vec<String> = U::BAUDS.iter().map(|baud| baud.to_string()).collect();
                format!(" at {} bits a second", bauds.join(", "))
            }
        };
        let cable = match self.line {
            Line::Usb => String::new(),
            Line::Serial(_) => format!(" (null modem), and the rate of its switches{}", U::SERIAL_ADVICE),
        };
        self.fail(format!("{why}{at}; check that the unit is switched on, and its cable{cable}"))
    }

    fn fail(&mut self, why: String) -> SetupStep {
        self.step = Step::Rate;
        SetupStep::Fail(why)
    }

    fn ask(&mut self, bytes: Vec<u8>, question: U::Question) -> SetupStep {
        self.unit.listen();
        (self.step, self.question) = (Step::Sent, Some(question));
        SetupStep::Send(bytes)
    }

    /// Sends the next command of the script; starts the stream at its end.
    fn go_on(&mut self) -> SetupStep {
        match self.script.pop_front() {
            Some(ScriptStep::Send(bytes)) => {
                self.step = Step::Script;
                SetupStep::Send(bytes)
            }
            Some(ScriptStep::Ask(bytes, question)) => self.ask(bytes, question),
            None => self.start(1),
        }
    }

    fn start(&mut self, times: usize) -> SetupStep {
        self.step = Step::Start(times);
        SetupStep::Send(self.unit.stream(self.baud()))
    }

    fn judge_answer(&mut self, bytes: &[u8]) -> SetupStep {
        let Some(question) = self.question else { return SetupStep::More };
        match self.unit.judge_answer(bytes, question) {
            QuestionState::Nothing => SetupStep::More,
            QuestionState::Bad(why) => self.fail(why),
            QuestionState::Good => {
                if !self.is_there {
                    (self.is_there, self.found, self.tried) = (true, self.baud(), 0);
                    self.script = self.unit.script(self.baud()).into();
                }
                self.go_on()
            }
        }
    }
}

impl<U: UnitProtocol> Protocol for Tracker<U> {
    fn reset(&mut self) {
        self.unit.forget();
        (self.step, self.question, self.is_there) = (Step::Rate, None, false);
    }

    fn resume(&mut self) {
        self.unit.replay();
    }

    fn next_step(&mut self, event: SetupEvent<'_>) -> SetupStep {
        match (self.step, event) {
            (Step::Rate, _) => {
                self.is_there = false;
                self.step = Step::Quieten;
                match self.baud() {
                    Some(baud) => SetupStep::Baud(baud),
                    None => self.next_step(SetupEvent::Done),
                }
            }
            (Step::Quieten, _) => {
                self.step = Step::Quietened;
                // A restarted unit is probed as usual: it answers when it is ready.
                SetupStep::Send(self.unit.quieten(self.tried > 0, self.restarts()))
            }
            (Step::Quietened, SetupEvent::Done) => SetupStep::AwaitQuiet { quiet_ns: QUIET, at_most_ns: QUIET_WITHIN },
            (Step::Quietened, SetupEvent::Noisy) => self.next_rate("does not stop sending"),
            (Step::Quietened, _) => {
                let (bytes, question) = self.unit.probe();
                self.ask(bytes, question)
            }
            (Step::Sent, _) => {
                self.step = Step::Answer;
                SetupStep::Listen(if self.is_there { ANSWER } else { PROBED })
            }
            (Step::Answer, SetupEvent::Received(bytes)) => self.judge_answer(bytes),
            (Step::Answer, _) if !self.is_there => self.next_rate("does not answer"),
            (Step::Answer, _) => self.fail("stopped answering; check its cable".into()),
            (Step::Script, _) => self.go_on(),
            (Step::Start(times), _) => {
                self.step = Step::First(times);
                SetupStep::Listen(FIRST)
            }
            (Step::First(_), SetupEvent::Received(_)) => SetupStep::Finish { keep: true },
            (Step::First(times), _) if times < STARTS => self.start(times + 1),
            (Step::First(_), _) => self.fail(
                "was set up but sends no records; check that its transmitter and its sensors are plugged in, and switch it off and on".into(),
            ),
        }
    }

    fn decode(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>) {
        self.unit.decode(bytes, at_ns, found);
    }

    fn patience_ns(&self) -> i64 {
        PATIENCE
    }

    fn farewell(&self) -> &[u8] {
        self.unit.farewell()
    }

    fn lost(&self) -> Lost {
        self.unit.lost()
    }

    fn describe(&self) -> &Description {
        self.unit.describe()
    }
}
