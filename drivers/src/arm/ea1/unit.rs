//! Sets up an EA1 arm from any state, and converts its samples to readings.
//!
//! Opening the line restarts many boards, which then send their identity. The driver waits for
//! this before it sends anything, because bytes sent to a starting board are lost or do harm. An
//! arm that still streams from an earlier session is stopped, asked for its identity, and set to
//! stream.

use std::collections::VecDeque;

use sonoweave_core::clock::{MS, SECOND};
use sonoweave_core::reading::Reading;
use sonoweave_core::{Description, Ticks, Timing};

use super::follow::Follower;
use super::{AXES, Command, Ea1, Framing, Identity, Record};
use crate::Error;
use crate::arm::Settings;
use crate::connection::{Lost, Protocol, SetupEvent, SetupStep};
use crate::framing::{Decoder, Refusal};

/// Usual serial rate, bits per second.
pub(in crate::arm) const BAUD: u32 = 115_200;
/// Time limit for the start of a board, ns.
const START: i64 = 2_500 * MS;
/// Silence after which a stopped arm counts as quiet, ns.
const QUIET: i64 = 60 * MS;
/// Time that an arm may take to become quiet, ns.
const QUIET_WITHIN: i64 = 600 * MS;
/// Time limit of an answer, ns.
const ANSWER: i64 = 300 * MS;
/// Bytes of a usual line, and of a block.
const BYTES: [i64; 2] = [45, 29];
/// Bits of a byte on the wire.
const BITS: i64 = 10;
/// Bare-number lines after which the arm counts as sending nothing else.
const BARE: usize = 3;

/// Sample format of an arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SampleFormat {
    /// EA1, samples as lines.
    #[default]
    Lines,
    /// EA1, samples as blocks.
    Blocks,
    /// Lines of three bare numbers, without checksum, number and time, from an arm without a
    /// protocol. The driver uses them, and reports all the time that they are unreliable.
    BareNumbers,
}

/// State of the set-up sequence.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    Line,
    Opened {
        knock: bool,
    },
    Wait,
    Stop,
    AwaitQuiet,
    Ask,
    Answer,
    Stream,
    Streaming,
    /// Waits for bare numbers.
    Bare,
    Done,
    Failed,
}

/// An EA1 arm on a line.
pub struct Unit {
    settings: Settings,
    format: SampleFormat,
    decoder: Decoder<Ea1>,
    step: Step,
    bare: usize,
    follower: Follower,
    sent: Vec<u8>,
    description: Description,
}

impl Unit {
    /// Creates a unit with these settings.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings that no arm has.
    pub fn new(name: &str, settings: Settings, format: SampleFormat) -> Result<Self, Error> {
        settings.check(2000)?;
        let baud = settings.baud.unwrap_or(BAUD);
        let bytes = BYTES[usize::from(format == SampleFormat::Blocks)];
        let timing = Timing {
            rate_hz: (format != SampleFormat::BareNumbers).then(|| f64::from(settings.rate_hz)),
            wire_ns: bytes * BITS * SECOND / i64::from(baud),
            ..match format {
                SampleFormat::BareNumbers => Timing::default(),
                _ => Timing { ticks: Ticks::Time, tick_hz: Some(1e6), wraps_at: Some(1 << 32), ..Timing::default() },
            }
        };
        let description = Description { name: format!("EA1 arm on {name}"), timing, ..Description::default() };
        let follower = Follower::new(&settings, format == SampleFormat::BareNumbers);
        let mut unit = Self {
            settings,
            format,
            decoder: Decoder::new(Ea1::new()),
            step: Step::Line,
            bare: 0,
            follower,
            sent: Vec::with_capacity(64),
            description,
        };
        unit.reset();
        Ok(unit)
    }

    /// Homes these axes (bit by axis): their counters are set to 0 with the next message.
    pub fn home(&mut self, axes: u8) {
        self.follower.home(axes);
    }

    /// Returns the shortest round trip of a ping, ns: an upper limit of the uncertainty of the
    /// arm's clock against the host's.
    pub fn round_trip_ns(&self) -> Option<i64> {
        self.follower.round_trip_ns()
    }

    fn baud(&self) -> u32 {
        self.settings.baud.unwrap_or(BAUD)
    }

    fn stream(&self) -> Command {
        let framing = if self.format == SampleFormat::Blocks { Framing::Blocks } else { Framing::Lines };
        Command::Stream(framing, self.settings.rate_hz)
    }

    fn send(&mut self, command: Command, step: Step) -> SetupStep {
        self.step = step;
        SetupStep::Send(command.bytes())
    }

    fn fail(&mut self, why: &str) -> SetupStep {
        self.step = Step::Failed;
        SetupStep::Fail(why.to_owned())
    }

    fn does_not_answer(&mut self) -> SetupStep {
        let baud = self.baud();
        self.fail(&format!(
            "does not answer at {baud} bits a second; check that the arm has power, that it speaks EA1, and its rate (arm.baud)"
        ))
    }

    /// Starts reading samples.
    fn listen(&mut self) {
        if self.format == SampleFormat::BareNumbers {
            self.decoder.reformat(Ea1::or_bare_numbers());
            // The next byte may be in the middle of a number.
            self.decoder.interrupt();
        } else {
            self.decoder.reformat(Ea1::new());
        }
        self.step = Step::Done;
    }

    /// Counts the records in `bytes`: bare numbers, and all others.
    fn count_records(&mut self, bytes: &[u8]) -> [usize; 2] {
        let mut counts = [0; 2];
        self.decoder.feed(bytes, &mut |record, _| counts[usize::from(!matches!(record, Record::Unreliable(_)))] += 1);
        self.bare += counts[0];
        counts
    }

    /// Takes the answer to the identity request.
    fn identify(&mut self, bytes: &[u8]) -> Option<SetupStep> {
        let before = self.decoder.losses().refused(Refusal::Header);
        let baud = self.baud().to_string();
        let mut wrong = None;
        self.decoder.feed(bytes, &mut |record, _| {
            if let Record::Identity(identity) = record {
                self.description.fields = fields(&identity, &baud);
                wrong = Some(is_another(&identity, &self.settings.counts_per_turn));
            }
        });
        match wrong {
            Some(None) => Some(self.send(self.stream(), Step::Stream)),
            Some(Some(wrong)) => Some(self.fail(&wrong)),
            None if self.decoder.losses().refused(Refusal::Header) > before => Some(
                self.fail("needs EA1 version 1 with 3 axes, but the arm has another version or number of axes; check its firmware"),
            ),
            None => None,
        }
    }

    /// Takes the answer to the stream request.
    fn begun(&mut self, bytes: &[u8]) -> SetupStep {
        let (mut samples, mut error) = (0, None);
        self.decoder.feed(bytes, &mut |record, _| match record {
            Record::Sample(_) => samples += 1,
            Record::Error(code) => error = Some(code),
            _ => {}
        });
        if samples > 0 {
            self.listen();
            return SetupStep::Finish { keep: true };
        }
        match error {
            None => SetupStep::More,
            Some(super::error::TOO_FAST) => {
                let hz = self.settings.rate_hz;
                self.fail(&format!(
                    "cannot send {hz} samples a second on this line; ask for fewer (arm.rate_hz), for blocks, or set a faster line (arm.baud)"
                ))
            }
            Some(code) => self.fail(&format!("refuses to send samples (error {code}); check its firmware")),
        }
    }
}

/// Returns the fields of an arm's identity.
fn fields(identity: &Identity<'_>, baud: &str) -> Vec<(String, String)> {
    vec![
        ("Model".into(), identity.model.into()),
        ("Serial".into(), identity.serial.into()),
        ("CountsPerTurn".into(), identity.counts_per_revolution.map(|counts| counts.to_string()).join(" ")),
        ("TickHz".into(), identity.tick_hz.to_string()),
        ("Baud".into(), baud.into()),
    ]
}

/// Returns an error text if this is not the configured arm, with advice.
fn is_another(identity: &Identity<'_>, configured: &[u32; AXES]) -> Option<String> {
    let has = identity.counts_per_revolution;
    let differs = |axis: &usize| configured[*axis] != 0 && has[*axis] != 0 && configured[*axis] != has[*axis];
    if let Some(axis) = (0..AXES).find(differs) {
        let (number, has, configured) = (axis + 1, has[axis], configured[axis]);
        return Some(format!(
            "says that axis {number} has {has} counts a turn and not {configured}: it is another arm than the one that was set up (arm.counts_per_turn)"
        ));
    }
    (identity.tick_hz == 0).then(|| "says that its clock has 0 ticks a second; EA1 needs a clock".into())
}

impl Protocol for Unit {
    fn reset(&mut self) {
        self.decoder = Decoder::new(Ea1::new());
        self.follower.restart();
    }

    fn home_axes(&mut self, axes: u8) -> bool {
        self.home(axes);
        true
    }

    fn resume(&mut self) {
        self.reset();
        self.listen();
    }

    fn next_step(&mut self, event: SetupEvent<'_>) -> SetupStep {
        match (self.step, event) {
            (_, SetupEvent::Begin) => {
                // After a failed attempt on the same line, opening did not restart the arm, and
                // its output is known.
                let knock = self.step == Step::Failed;
                if !knock || self.format == SampleFormat::BareNumbers {
                    self.bare = 0;
                }
                self.step = Step::Opened { knock };
                SetupStep::Baud(self.baud())
            }
            (Step::Opened { .. }, _) if self.format == SampleFormat::BareNumbers => {
                self.decoder.reformat(Ea1::or_bare_numbers());
                self.decoder.interrupt();
                self.step = Step::Bare;
                SetupStep::Listen(START)
            }
            (Step::Opened { knock: false }, _) => {
                self.decoder.reformat(Ea1::or_bare_numbers());
                self.step = Step::Wait;
                SetupStep::Listen(START)
            }
            (Step::Wait, SetupEvent::Received(bytes)) => match self.count_records(bytes) {
                [_, 0] => SetupStep::More,
                _ => self.next_step(SetupEvent::NoAnswer),
            },
            (Step::Opened { .. } | Step::Wait | Step::Line | Step::Failed | Step::Done, _) => {
                self.step = Step::Stop;
                // Sends a line end first, because another host may have left a command
                // unfinished.
                let mut stop = vec![b'\n'];
                stop.extend(Command::Stream(Framing::Lines, 0).bytes());
                SetupStep::Send(stop)
            }
            (Step::Stop, _) => {
                self.step = Step::AwaitQuiet;
                SetupStep::AwaitQuiet { quiet_ns: QUIET, at_most_ns: QUIET_WITHIN }
            }
            (Step::AwaitQuiet, SetupEvent::Noisy) if self.bare >= BARE => self.fail(
                "sends bare numbers without checksum, number and time, and ignores commands; give it firmware with EA1, or set arm.speech to bare numbers",
            ),
            (Step::AwaitQuiet, SetupEvent::Noisy) => {
                self.fail("does not stop sending; check that it speaks EA1, and its rate (arm.baud)")
            }
            (Step::AwaitQuiet, _) => {
                self.decoder.reformat(Ea1::new());
                self.send(Command::Identify, Step::Ask)
            }
            (Step::Ask, _) => {
                self.step = Step::Answer;
                SetupStep::Listen(ANSWER)
            }
            (Step::Answer, SetupEvent::Received(bytes)) => self.identify(bytes).unwrap_or(SetupStep::More),
            (Step::Answer, _) => self.does_not_answer(),
            (Step::Stream, _) => {
                self.step = Step::Streaming;
                SetupStep::Listen(self.patience_ns())
            }
            (Step::Streaming, SetupEvent::Received(bytes)) => self.begun(bytes),
            (Step::Streaming, _) => self.fail("sends no samples; switch it off and on"),
            (Step::Bare, SetupEvent::Received(bytes)) => match self.count_records(bytes) {
                _ if self.bare >= BARE => {
                    self.listen();
                    SetupStep::Finish { keep: false }
                }
                _ => SetupStep::More,
            },
            (Step::Bare, _) => self.fail(
                "sends no lines of three numbers; check that the arm has power, and its rate (arm.baud)",
            ),
        }
    }

    fn decode(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>) {
        let follower = &mut self.follower;
        self.decoder.feed(bytes, &mut |record, _| follower.push(&record, at_ns, found));
    }

    fn ask(&mut self, now_ns: i64) -> Option<(&[u8], i64)> {
        if self.format == SampleFormat::BareNumbers {
            return None;
        }
        self.sent.clear();
        if self.follower.has_restarted() {
            // After a restart, the arm has lost only its stream setting.
            self.stream().write(&mut self.sent);
        }
        self.follower.ask(now_ns, &mut self.sent);
        // Asks after each sample: nothing here is urgent, and a read that ends without a sample
        // is costly.
        Some((&self.sent, now_ns))
    }

    fn patience_ns(&self) -> i64 {
        (500 * MS).max(6 * SECOND / i64::from(self.settings.rate_hz))
    }

    fn trouble(&self) -> &str {
        self.follower.trouble()
    }

    fn farewell(&self) -> &[u8] {
        if self.format == SampleFormat::BareNumbers { b"" } else { b"!R0\n" }
    }

    fn lost(&self) -> Lost {
        let losses = self.decoder.losses();
        let [readings, refused] = self.follower.losses();
        Lost { readings, refused: refused + losses.refusals(), skipped: losses.bytes_skipped }
    }

    fn describe(&self) -> &Description {
        &self.description
    }
}
