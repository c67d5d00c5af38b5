//! Wakes a MicroScribe, asks for its identity, and then polls one sample after another.
//!
//! A device listens at any rate. It detects the rate from the first bytes of a session: the byte
//! that ends a session and its signature, which the host sends until the device echoes them. It
//! counts from the position of its arm at power-on, which must be the home position, as its
//! manual demands. After a loss of connection the device may have been switched off, so its arm
//! must be homed again. Homing sets all counters at once to their values at home
//! ([`Command::Home`]). The device confirms this among its samples, so a recording's bytes give
//! the same readings.
//!
//! Samples have no checksum, and only their first byte is marked. A valid sample with counts that
//! the arm cannot have reached is refused; smaller corruption is not noticed.

use std::collections::VecDeque;

use sonoweave_core::clock::{MS, SECOND};
use sonoweave_core::reading::{AXES, Counts, Reading, Stamp};
use sonoweave_core::{Description, Timing};

use super::{Answers, Awaited, BEGIN, Command, Family, Links, Question, Request, SIGNATURE, Sample, Samples, WAKE};
use crate::Error;
use crate::arm::Settings;
use crate::arm::homing::{Between, Homing, Passed};
use crate::connection::{Lost, Protocol, SetupEvent, SetupStep};
use crate::framing::Decoder;

/// Serial rates of such devices, the likeliest first, bits per second.
pub(in crate::arm) const BAUDS: [u32; 5] = [115_200, 57_600, 38_400, 19_200, 9_600];
/// Wake-up calls at one rate before the next is tried.
const CALLS: u8 = 4;
/// Waiting time for the signature, in addition to its time on the wire, ns.
const PAUSE: i64 = 15 * MS;
/// After the session starts, late signatures are dropped until the line is silent for this long,
/// ns.
const QUIET: i64 = 30 * MS;
/// Time limit for dropping them, ns.
const QUIET_WITHIN: i64 = 300 * MS;
/// An answer may take this many characters' time (the manufacturer's figure), but at least
/// [`ANSWER`] ns.
const CHARACTERS: i64 = 84;
const ANSWER: i64 = 100 * MS;
/// Time without a sample after which the device counts as silent, ns.
const PATIENCE: i64 = 500 * MS;
/// Bits of a byte on the wire.
const BITS: i64 = 10;
/// Bits of an encoder.
const ENCODER: u32 = 14;
/// Byte that confirms setting the counters.
const HOMED: u8 = 0xc2;
/// Bit of the first byte of a sample, which no other byte has.
const MARK: u8 = 0x80;

/// Questions in order; a device need not answer the last ones.
const QUESTIONS: [Question; 6] = [
    Question::Model,
    Question::Serial,
    Question::Version,
    Question::ParameterFormat,
    Question::Maxima,
    Question::Parameters,
];

/// State of the set-up sequence.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    Rate,
    Call,
    Called,
    AwaitQuiet,
    Quietened,
    Begun,
    Ask(usize),
    Answer(usize),
    Done,
    Failed,
}

/// A reading before it is accepted or refused.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Taken {
    at_ns: i64,
    buttons: u8,
    /// Number of times that the counters were set before this reading.
    homed: u32,
}

/// State of a device that sends samples.
#[derive(Debug)]
struct Follower {
    encoders: u8,
    homing: Homing<Taken>,
    /// Number of times that the counters were set.
    homed: u32,
    refused: u64,
    trouble: String,
}

/// A MicroScribe on a line.
pub struct Unit {
    settings: Settings,
    request: Request,
    decoder: Decoder<Samples>,
    answers: Decoder<Answers>,
    step: Step,
    /// Rates tried since the last answer.
    tried: usize,
    calls: u8,
    /// Rate of the last answer.
    found: Option<u32>,
    /// Whether the device was set up once.
    was_there: bool,
    to_home: bool,
    /// Whether the last byte may have confirmed setting the counters.
    maybe_homed: bool,
    sent: Vec<u8>,
    due_ns: i64,
    follower: Follower,
    description: Description,
}

impl Unit {
    /// Creates a unit with `encoders` encoders (MicroScribe 5 or 6, box 2, 4 or 6). If a rate is
    /// set (`arm.baud`), the driver tries only that rate.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings that no device has.
    pub fn new(name: &str, settings: Settings, family: Family, encoders: u8) -> Result<Self, Error> {
        settings.check(500)?;
        let request = Request::new(family, encoders.into(), false).filter(|_| usize::from(encoders) <= AXES);
        let Some(request) = request else {
            let problem =
                format!("{encoders} is not possible; give 5 or 6 for a MicroScribe, 2, 4 or 6 for an Immersion box");
            return Err(Error::setting("arm", "encoders", problem));
        };
        if let Some(baud) = settings.baud.filter(|baud| !BAUDS.contains(baud)) {
            return Err(Error::setting(
                "arm",
                "baud",
                format!("a MicroScribe does not have the rate {baud}; it has {BAUDS:?}"),
            ));
        }
        // The host receives data in packets, so its times are coarse.
        let grace_ns = 2 * SECOND / i64::from(settings.rate_hz) + 10 * MS;
        let homing = Homing::new(0, encoders, encoders, ENCODER, settings.fastest, grace_ns);
        let follower = Follower { encoders, homing, homed: 0, refused: 0, trouble: String::new() };
        let timing = Timing { rate_hz: Some(f64::from(settings.rate_hz)), ..Timing::default() };
        let description = Description { name: format!("MicroScribe on {name}"), timing, ..Description::default() };
        Ok(Self {
            settings,
            request,
            decoder: Decoder::new(Samples::new(request)),
            answers: Decoder::new(Answers::to(Awaited::Signature)),
            step: Step::Rate,
            tried: 0,
            calls: 0,
            found: None,
            was_there: false,
            to_home: false,
            maybe_homed: false,
            sent: Vec::with_capacity(2),
            due_ns: i64::MIN,
            follower,
            description,
        })
    }

    /// Homes the arm, which must be in its home position; sets all counters, whichever axes are
    /// requested.
    pub fn home(&mut self) {
        self.to_home = true;
    }

    fn rate(&self) -> u32 {
        self.settings.baud.or(self.found.filter(|_| self.tried < 2)).unwrap_or(BAUDS[self.tried % BAUDS.len()])
    }

    /// Returns the transmission time of `bytes` bytes, ns.
    fn wire(&self, bytes: i64) -> i64 {
        bytes * BITS * SECOND / i64::from(self.rate())
    }

    /// Returns the time between two requests, ns; a request must not precede the answer to the
    /// last.
    fn period(&self) -> i64 {
        let least = self.wire(self.request.length() as i64 + 1) * 5 / 4;
        least.max(SECOND / i64::from(self.settings.rate_hz))
    }

    fn answer(&self) -> i64 {
        self.wire(CHARACTERS).max(ANSWER)
    }

    fn next_rate(&mut self) -> SetupStep {
        self.calls = 0;
        self.tried += 1;
        let round = if self.settings.baud.is_some() { 1 } else { BAUDS.len() };
        if !self.tried.is_multiple_of(round) {
            self.step = Step::Rate;
            return SetupStep::Baud(self.rate());
        }
        self.fail("does not answer at any rate; check that it is switched on, and its cable".into())
    }

    fn fail(&mut self, why: String) -> SetupStep {
        self.step = Step::Failed;
        SetupStep::Fail(why)
    }

    /// Returns the awaited answer once it is complete.
    fn answered(&mut self, bytes: &[u8]) -> Option<Vec<u8>> {
        let mut answer = None;
        self.answers.feed(bytes, &mut |record, _| {
            answer.get_or_insert_with(|| record.to_vec());
        });
        answer
    }

    fn await_answer(&mut self, awaited: Awaited) {
        self.answers.reformat(Answers::to(awaited));
    }

    /// Asks the next question, or ends the set-up.
    fn question(&mut self, index: usize) -> SetupStep {
        let Some(question) = QUESTIONS.get(index) else {
            self.begin_samples();
            return SetupStep::Finish { keep: false };
        };
        self.await_answer(Awaited::Answer(*question));
        self.step = Step::Ask(index);
        SetupStep::Send(vec![question.byte()])
    }

    fn begin_samples(&mut self) {
        self.decoder.reformat(Samples::new(self.request));
        self.description.timing.wire_ns = self.wire(self.request.length() as i64);
        self.step = Step::Done;
        // At power-on the arm was at home, as the manual demands; after a reconnection that is
        // unknown.
        let homed = if self.was_there { 0 } else { self.follower.homing.all() };
        self.follower.homing.restart(homed);
        self.was_there = true;
    }

    /// Stores an answer in the description; returns an error text if the device is the wrong one.
    fn keep(&mut self, question: Question, answer: &[u8]) -> Option<String> {
        let join = |values: &[i16]| values.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ");
        let fields = &mut self.description.fields;
        let mut add = |name: &str, value: String| fields.push((name.into(), value));
        let text = || String::from_utf8_lossy(answer).into_owned();
        match question {
            Question::Model => add("Model", text()),
            Question::Serial => add("Serial", text()),
            Question::Version => add("Firmware", text()),
            Question::ParameterFormat => add("ParameterFormat", text()),
            Question::Parameters => {
                if let Some(links) = Links::read(answer) {
                    add("LinkTwists32768thsOfPi", join(&links.alpha_counts));
                    add("LinkLengthsMils", join(&links.a_mils));
                    add("LinkOffsetsMils", join(&links.d_mils));
                }
            }
            Question::Maxima => {
                // Buttons, timer (2), eight analogue inputs and their common maximum, then the
                // encoders, high byte first.
                let (maxima, _) = answer.get(12..)?.as_chunks::<2>();
                let turns: Vec<u32> =
                    maxima.iter().map(|maximum| u32::from(u16::from_be_bytes(*maximum)) + 1).collect();
                add("CountsPerTurn", turns.iter().map(ToString::to_string).collect::<Vec<_>>().join(" "));
                let configured = self.settings.counts_per_turn;
                let differs = |(axis, has): &(usize, &u32)| configured.get(*axis).is_some_and(|w| *w != 0 && w != *has);
                if let Some((axis, has)) = turns.iter().enumerate().find(differs) {
                    let (number, configured) = (axis + 1, configured[axis]);
                    return Some(format!(
                        "says that axis {number} has {has} counts a turn and not {configured}: it is another arm than the one that was set up (arm.counts_per_turn)"
                    ));
                }
            }
            _ => {}
        }
        None
    }
}

impl Follower {
    fn push(&mut self, sample: &Sample, at_ns: i64, found: &mut VecDeque<Reading>) {
        let mut shown = [0; AXES];
        shown.iter_mut().zip(sample.encoders()).for_each(|(shown, count)| *shown = i64::from(*count));
        let all = self.homing.all();
        let taken = Taken { at_ns, buttons: sample.buttons, homed: self.homed };
        let passed = self.homing.push(taken, shown, |earlier, later| Between::Later {
            ns: (later.at_ns - earlier.at_ns).max(0),
            set: if later.homed == earlier.homed { 0 } else { all },
            expected: true,
        });
        self.pass(passed, found);
    }

    fn pass(&mut self, passed: Passed<Taken>, found: &mut VecDeque<Reading>) {
        self.refused += passed.refused;
        let jumped = passed.held.is_some();
        for (Taken { at_ns, buttons, .. }, counts) in [passed.held, passed.this].into_iter().flatten() {
            let homed = self.homing.homed();
            let status = self.homing.status_after(jumped, homed, 0);
            let trouble = self.homing.trouble(&status);
            if self.trouble != trouble {
                trouble.clone_into(&mut self.trouble);
            }
            let stamp = Stamp { host_ns: Some(at_ns), ..Stamp::default() };
            let axes = self.encoders;
            found.push_back(Reading::Counts(Counts { stamp, first: 0, axes, counts, homed, buttons, status }));
        }
    }
}

impl Protocol for Unit {
    fn reset(&mut self) {
        self.decoder = Decoder::new(Samples::new(self.request));
        self.follower.refused = 0;
        self.follower.trouble.clear();
        (self.calls, self.due_ns, self.to_home, self.maybe_homed) = (0, i64::MIN, false, false);
        self.description.fields.clear();
    }

    fn home_axes(&mut self, _axes: u8) -> bool {
        self.home();
        true
    }

    fn resume(&mut self) {
        self.reset();
        self.was_there = false;
        self.begin_samples();
    }

    fn next_step(&mut self, event: SetupEvent<'_>) -> SetupStep {
        match (self.step, event) {
            (_, SetupEvent::Begin) => {
                self.step = Step::Rate;
                SetupStep::Baud(self.rate())
            }
            (Step::Rate | Step::Done | Step::Failed, _) => {
                self.calls += 1;
                self.await_answer(Awaited::Signature);
                self.step = Step::Call;
                let mut call = vec![WAKE];
                call.extend(SIGNATURE);
                SetupStep::Send(call)
            }
            (Step::Call, _) => {
                self.step = Step::Called;
                SetupStep::Listen(PAUSE + self.wire(2 * SIGNATURE.len() as i64 + 1))
            }
            (Step::Called, SetupEvent::Received(bytes)) => match self.answered(bytes) {
                None => SetupStep::More,
                Some(_) => {
                    (self.found, self.tried) = (Some(self.rate()), 0);
                    self.step = Step::AwaitQuiet;
                    self.next_step(SetupEvent::Done)
                }
            },
            (Step::Called, _) if self.calls < CALLS => {
                self.step = Step::Rate;
                self.next_step(SetupEvent::Done)
            }
            (Step::Called, _) => self.next_rate(),
            (Step::AwaitQuiet, _) => {
                self.step = Step::Quietened;
                SetupStep::AwaitQuiet { quiet_ns: QUIET, at_most_ns: QUIET_WITHIN }
            }
            (Step::Quietened, SetupEvent::Quiet) => {
                self.await_answer(Awaited::ProductName);
                self.step = Step::Begun;
                SetupStep::Send(BEGIN.to_vec())
            }
            (Step::Quietened, _) => self.fail("does not stop sending; switch it off and on".into()),
            (Step::Begun, SetupEvent::Done) => SetupStep::Listen(self.answer()),
            (Step::Begun, SetupEvent::Received(bytes)) => match self.answered(bytes) {
                None => SetupStep::More,
                Some(name) => {
                    let name = String::from_utf8_lossy(&name).into_owned();
                    let baud = self.rate().to_string();
                    self.description.fields = vec![("Product".into(), name), ("Baud".into(), baud)];
                    self.question(0)
                }
            },
            (Step::Begun, _) => self.fail("answers and does not begin; switch it off and on".into()),
            (Step::Ask(index), _) => {
                self.step = Step::Answer(index);
                SetupStep::Listen(self.answer())
            }
            (Step::Answer(index), SetupEvent::Received(bytes)) => match self.answered(bytes) {
                None => SetupStep::More,
                Some(answer) => match self.keep(QUESTIONS[index], &answer) {
                    None => self.question(index + 1),
                    Some(wrong) => self.fail(wrong),
                },
            },
            // A device does not answer unknown questions; its samples decide.
            (Step::Answer(index), _) => self.question(index + 1),
        }
    }

    fn decode(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>) {
        let mark = self.request.byte() | MARK;
        let follower = &mut self.follower;
        for part in bytes.split_inclusive(|byte| *byte == HOMED) {
            // The confirmation of setting the counters stands between two samples; elsewhere this
            // byte is noise.
            if std::mem::take(&mut self.maybe_homed) {
                if part[0] == mark {
                    follower.homed = follower.homed.wrapping_add(1);
                    follower.homing.trust(follower.homing.all());
                    follower.homing.settle();
                } else {
                    self.decoder.feed(&[HOMED], &mut |_, _| {});
                }
            }
            let before = part.strip_suffix(&[HOMED]);
            self.decoder.feed(before.unwrap_or(part), &mut |sample, _| follower.push(&sample, at_ns, found));
            if before.is_some() {
                self.maybe_homed = self.decoder.pending() == 0;
                if !self.maybe_homed {
                    self.decoder.feed(&[HOMED], &mut |_, _| {});
                }
            }
        }
    }

    fn ask(&mut self, now_ns: i64) -> Option<(&[u8], i64)> {
        self.sent.clear();
        if std::mem::take(&mut self.to_home) {
            self.sent.extend(Command::Home.bytes());
            // The confirmation comes before the answer to the next request.
            return Some((&self.sent, now_ns + self.wire(2) + PAUSE));
        }
        self.sent.push(self.request.byte());
        let period = self.period();
        // Keeps an even pace, without a burst after a pause.
        self.due_ns = if self.due_ns + period > now_ns { self.due_ns + period } else { now_ns + period };
        Some((&self.sent, self.due_ns))
    }

    fn patience_ns(&self) -> i64 {
        PATIENCE.max(6 * self.period())
    }

    fn trouble(&self) -> &str {
        &self.follower.trouble
    }

    fn farewell(&self) -> &[u8] {
        &[WAKE]
    }

    fn lost(&self) -> Lost {
        let losses = self.decoder.losses();
        // Samples have no number, so lost ones cannot be counted.
        Lost { readings: 0, refused: self.follower.refused + losses.refusals(), skipped: losses.bytes_skipped }
    }

    fn describe(&self) -> &Description {
        &self.description
    }
}
