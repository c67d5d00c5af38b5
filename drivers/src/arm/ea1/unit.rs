//! Sets an EA1 arm up as it is found, and turns its samples into readings.
//!
//! Opening its line starts many a board anew, which then says who it is: that is waited for before anything is sent, as what a board is sent while it starts is lost
//! or worse. An arm that goes on talking from before is told to be quiet, asked who it is, and told how to talk.

use std::collections::VecDeque;

use super::follow::Follower;
use super::{AXES, Command, Ea1, Framing, Identity, Record};
use crate::arm::Settings;
use crate::clock::{MS, SECOND};
use crate::connection::{Lost, Met, Protocol, Rung};
use crate::framing::{Decoder, Refusal};
use crate::reading::Reading;
use crate::{Description, Error, Ticks, Timing};

/// Bits a second that are usual.
pub(in crate::arm) const BAUD: u32 = 115_200;
/// So long may a board take to start, ns.
const START: i64 = 2_500 * MS;
/// An arm that was told to be quiet and says nothing for so long is.
const QUIET: i64 = 60 * MS;
/// What it may take to be quiet, ns.
const HUSHED: i64 = 600 * MS;
/// What an answer may take, ns.
const ANSWER: i64 = 300 * MS;
/// Bytes of a usual line, and of a block.
const BYTES: [i64; 2] = [45, 29];
/// Bits that a byte takes on the wire.
const BITS: i64 = 10;
/// Bare numbers that make an arm that sends nothing else.
const BARE: usize = 3;

/// What an arm is to speak.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Speech {
    /// EA1, samples as lines.
    #[default]
    Lines,
    /// EA1, samples as blocks.
    Blocks,
    /// Lines of three bare numbers, by an arm that knows nothing else: without checksum, number and time. They are used, and as long as they are it is said that nothing vouches for them.
    BareNumbers,
}

/// Where the setting-up stands.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    Line,
    Opened {
        knock: bool,
    },
    Wait,
    Stop,
    Hush,
    Ask,
    Asked,
    Stream,
    Streaming,
    /// Sends bare numbers, or not.
    Bare,
    Done,
    Fallen,
}

/// An EA1 arm on a line.
pub struct Unit {
    settings: Settings,
    speech: Speech,
    decoder: Decoder<Ea1>,
    step: Step,
    bare: usize,
    follower: Follower,
    sent: Vec<u8>,
    description: Description,
}

impl Unit {
    /// To be set up so.
    ///
    /// # Errors
    /// [`Error::Misuse`] for settings that no arm has.
    pub fn new(name: &str, settings: Settings, speech: Speech) -> Result<Self, Error> {
        settings.check(2000)?;
        let baud = settings.baud.unwrap_or(BAUD);
        let bytes = BYTES[usize::from(speech == Speech::Blocks)];
        let timing = Timing {
            rate_hz: (speech != Speech::BareNumbers).then(|| f64::from(settings.rate_hz)),
            wire_ns: bytes * BITS * SECOND / i64::from(baud),
            ..match speech {
                Speech::BareNumbers => Timing::default(),
                _ => Timing { ticks: Ticks::Time, tick_hz: Some(1e6), wraps_at: Some(1 << 32), ..Timing::default() },
            }
        };
        let description = Description { name: format!("EA1 arm on {name}"), timing, ..Description::default() };
        let follower = Follower::new(&settings, speech == Speech::BareNumbers);
        let mut unit = Self {
            settings,
            speech,
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

    /// These axes (bit by axis) are at home now: their counters become 0, at the next turn of the line.
    pub fn home(&mut self, axes: u8) {
        self.follower.home(axes);
    }

    /// The shortest time that a ping and its answer took, ns: what the arm's clock is uncertain by at most, against the host's.
    pub fn round_trip_ns(&self) -> Option<i64> {
        self.follower.round_trip_ns()
    }

    fn baud(&self) -> u32 {
        self.settings.baud.unwrap_or(BAUD)
    }

    fn stream(&self) -> Command {
        let framing = if self.speech == Speech::Blocks { Framing::Blocks } else { Framing::Lines };
        Command::Stream(framing, self.settings.rate_hz)
    }

    fn send(&mut self, command: Command, step: Step) -> Rung {
        self.step = step;
        Rung::Send(command.bytes())
    }

    fn fall(&mut self, why: &str) -> Rung {
        self.step = Step::Fallen;
        Rung::Fall(why.to_owned())
    }

    fn does_not_answer(&mut self) -> Rung {
        let baud = self.baud();
        self.fall(&format!(
            "does not answer at {baud} bits a second; check that the arm has power, that it speaks EA1, and its rate (arm.baud)"
        ))
    }

    /// From here on, samples are what is listened for.
    fn listen(&mut self) {
        if self.speech == Speech::BareNumbers {
            self.decoder.reformat(Ea1::or_bare_numbers());
            // The next byte may be in the midst of a number.
            self.decoder.interrupt();
        } else {
            self.decoder.reformat(Ea1::new());
        }
        self.step = Step::Done;
    }

    /// Counts the records in what was heard: bare numbers, and all others.
    fn heard(&mut self, bytes: &[u8]) -> [usize; 2] {
        let mut heard = [0; 2];
        self.decoder.feed(bytes, &mut |record, _| heard[usize::from(!matches!(record, Record::Unreliable(_)))] += 1);
        self.bare += heard[0];
        heard
    }

    /// The answer to who the arm is.
    fn identify(&mut self, bytes: &[u8]) -> Option<Rung> {
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
            Some(Some(wrong)) => Some(self.fall(&wrong)),
            None if self.decoder.losses().refused(Refusal::Header) > before => Some(
                self.fall("speaks another version of EA1, or has not three axes; what is wanted is version 1 with 3"),
            ),
            None => None,
        }
    }

    /// What comes of being told to send samples.
    fn begun(&mut self, bytes: &[u8]) -> Rung {
        let (mut samples, mut error) = (0, None);
        self.decoder.feed(bytes, &mut |record, _| match record {
            Record::Sample(_) => samples += 1,
            Record::Error(code) => error = Some(code),
            _ => {}
        });
        if samples > 0 {
            self.listen();
            return Rung::Top { keep: true };
        }
        match error {
            None => Rung::More,
            Some(super::error::TOO_FAST) => {
                let hz = self.settings.rate_hz;
                self.fall(&format!(
                    "cannot send {hz} samples a second on this line; ask for fewer (arm.rate_hz), for blocks, or set a faster line (arm.baud)"
                ))
            }
            Some(code) => {
                self.fall(&format!("refuses to send samples, with error {code}; its firmware may not know them"))
            }
        }
    }
}

/// What an arm says of itself.
fn fields(identity: &Identity<'_>, baud: &str) -> Vec<(String, String)> {
    vec![
        ("Model".into(), identity.model.into()),
        ("Serial".into(), identity.serial.into()),
        ("CountsPerTurn".into(), identity.counts_per_revolution.map(|counts| counts.to_string()).join(" ")),
        ("TickHz".into(), identity.tick_hz.to_string()),
        ("Baud".into(), baud.into()),
    ]
}

/// Whether it is another arm than the one that is wanted, and what to do.
fn is_another(identity: &Identity<'_>, wanted: &[u32; AXES]) -> Option<String> {
    let has = identity.counts_per_revolution;
    let differs = |axis: &usize| wanted[*axis] != 0 && has[*axis] != 0 && wanted[*axis] != has[*axis];
    if let Some(axis) = (0..AXES).find(differs) {
        let (number, has, wanted) = (axis + 1, has[axis], wanted[axis]);
        return Some(format!(
            "says that axis {number} has {has} counts a turn and not {wanted}: it is another arm than the one that was set up (arm.counts_per_turn)"
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

    fn climb(&mut self, met: Met<'_>) -> Rung {
        match (self.step, met) {
            (_, Met::Begin) => {
                // One that has just been tried on this line was not started anew by its opening; what it sent is known.
                let knock = self.step == Step::Fallen;
                if !knock || self.speech == Speech::BareNumbers {
                    self.bare = 0;
                }
                self.step = Step::Opened { knock };
                Rung::Baud(self.baud())
            }
            (Step::Opened { .. }, _) if self.speech == Speech::BareNumbers => {
                self.decoder.reformat(Ea1::or_bare_numbers());
                self.decoder.interrupt();
                self.step = Step::Bare;
                Rung::Listen(START)
            }
            (Step::Opened { knock: false }, _) => {
                self.decoder.reformat(Ea1::or_bare_numbers());
                self.step = Step::Wait;
                Rung::Listen(START)
            }
            (Step::Wait, Met::Heard(bytes)) => match self.heard(bytes) {
                [_, 0] => Rung::More,
                _ => self.climb(Met::Deaf),
            },
            (Step::Opened { .. } | Step::Wait | Step::Line | Step::Fallen | Step::Done, _) => {
                self.step = Step::Stop;
                // A line's end before it, as a command that another host began and did not end may be the matter.
                let mut stop = vec![b'\n'];
                stop.extend(Command::Stream(Framing::Lines, 0).bytes());
                Rung::Send(stop)
            }
            (Step::Stop, _) => {
                self.step = Step::Hush;
                Rung::Hush { quiet_ns: QUIET, at_most_ns: HUSHED }
            }
            (Step::Hush, Met::Noisy) if self.bare >= BARE => self.fall(
                "sends bare numbers, without checksum, number and time, and does not obey; teach it EA1, or set arm.speech to bare numbers to use it all the same",
            ),
            (Step::Hush, Met::Noisy) => {
                self.fall("goes on talking; check that it speaks EA1, and its rate (arm.baud)")
            }
            (Step::Hush, _) => {
                self.decoder.reformat(Ea1::new());
                self.send(Command::Identify, Step::Ask)
            }
            (Step::Ask, _) => {
                self.step = Step::Asked;
                Rung::Listen(ANSWER)
            }
            (Step::Asked, Met::Heard(bytes)) => self.identify(bytes).unwrap_or(Rung::More),
            (Step::Asked, _) => self.does_not_answer(),
            (Step::Stream, _) => {
                self.step = Step::Streaming;
                Rung::Listen(self.patience_ns())
            }
            (Step::Streaming, Met::Heard(bytes)) => self.begun(bytes),
            (Step::Streaming, _) => self.fall("was told to send samples and sends none; switch it off and on"),
            (Step::Bare, Met::Heard(bytes)) => match self.heard(bytes) {
                _ if self.bare >= BARE => {
                    self.listen();
                    Rung::Top { keep: false }
                }
                _ => Rung::More,
            },
            (Step::Bare, _) => self.fall(
                "sends no lines of three numbers; check that the arm has power, and its rate (arm.baud)",
            ),
        }
    }

    fn take(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>) {
        let follower = &mut self.follower;
        self.decoder.feed(bytes, &mut |record, _| follower.take(&record, at_ns, found));
    }

    fn ask(&mut self, now_ns: i64) -> Option<(&[u8], i64)> {
        if self.speech == Speech::BareNumbers {
            return None;
        }
        self.sent.clear();
        if self.follower.has_restarted() {
            // All that it forgot and has to be told is how to send.
            self.stream().write(&mut self.sent);
        }
        self.follower.ask(now_ns, &mut self.sent);
        // After each sample: nothing that is to be sent is in a hurry, and a read that ends without one costs.
        Some((&self.sent, now_ns))
    }

    fn patience_ns(&self) -> i64 {
        (500 * MS).max(6 * SECOND / i64::from(self.settings.rate_hz))
    }

    fn trouble(&self) -> &str {
        self.follower.trouble()
    }

    fn farewell(&self) -> &[u8] {
        if self.speech == Speech::BareNumbers { b"" } else { b"!R0\n" }
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
