//! Set-up commands of ISOTRAK and ISOTRAK II, and the conversion of their records to readings.
//!
//! The layout of the status is not verified, so the driver does not read it. Instead it asks for
//! one record of each station before it starts the stream; these records show that the unit has
//! taken its settings. No record shows whether text is in centimetres; binary has a fixed unit.

use std::collections::VecDeque;

use sonoweave_core::reading::{Pose, Reading, Stamp, Status};
use sonoweave_core::{Description, Timing};

use super::{CM_PER_COUNT, Isotrak, Layout, PRESSED, RELEASED, Record, STATIONS, UNIT_PER_COUNT};
use crate::Error;
use crate::connection::Lost;
use crate::framing::Decoder;
use crate::tracker::polhemus::Settings;
use crate::tracker::polhemus::fastrak::command::NO_FILTER;
use crate::tracker::polhemus::fastrak::{self, Command, Fastrak, Mode, Reply, judge_stations, status_of};
use crate::tracker::polhemus::setup_sequence::{Line, QuestionState, ScriptStep, Tracker, UnitProtocol, wire_ns};

/// Measurements per second, shared by the stations. Not confirmed by the unit's manual.
const CYCLES: f64 = 60.0;

/// An ISOTRAK or ISOTRAK II on a line.
pub type Unit = Tracker<IsotrakProtocol>;

/// The unit protocol of ISOTRAK and ISOTRAK II.
pub struct IsotrakProtocol {
    settings: Settings,
    /// Output list of all stations, in text.
    text: fastrak::Layout,
    /// The same output list, in binary.
    packed: Layout,
    replies: Decoder<Fastrak>,
    records: Records,
    /// Refused setting, with the error code.
    wrong: Option<String>,
    /// Stations whose record has arrived.
    seen: [bool; STATIONS as usize],
    description: Description,
}

/// Reads records in text or binary.
#[allow(clippy::large_enum_variant, reason = "there is one a unit")]
enum Records {
    Text(Box<Decoder<Fastrak>>),
    Packed(Decoder<Isotrak>),
}

/// A record, from text or binary.
struct Measured {
    station: u8,
    error: u8,
    position_cm: [f64; 3],
    quaternion_wxyz: [f64; 4],
}

/// Questions to the unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Question {
    /// Whether the unit is there.
    Status,
    /// Which stations are in use.
    Stations,
    /// One record of each station.
    Records,
}

impl Unit {
    /// Creates a unit with these settings. If `line` gives a rate, the driver tries only that
    /// rate.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings that no ISOTRAK has.
    pub fn new(name: &str, settings: Settings, line: impl Into<Line>) -> Result<Self, Error> {
        settings.check(STATIONS)?;
        // Binary needs no line end, because the beginning of a record is marked.
        let codes: &[u8] = if settings.binary { &[2, 11] } else { &[2, 11, 1] };
        let text = fastrak::Layout::new(Mode::Ascii, codes)?;
        let packed = Layout::new(codes)?;
        let rate_hz = Some(CYCLES / settings.stations.len() as f64);
        // The latency from measurement to the first byte is not documented.
        let timing = Timing { rate_hz, ..Timing::default() };
        let description = Description { name: format!("ISOTRAK on {name}"), timing, ..Description::default() };
        let may_reset = settings.may_reset;
        let records = match settings.binary {
            true => Records::Packed(Decoder::new(Isotrak::new(STATIONS, packed))),
            false => Records::Text(Box::new(Decoder::new(Fastrak::uniform(usize::from(STATIONS), text)))),
        };
        let unit = IsotrakProtocol {
            settings,
            text,
            packed,
            replies: Decoder::new(Fastrak::replies()),
            records,
            wrong: None,
            seen: [false; STATIONS as usize],
            description,
        };
        Ok(Self::of(unit, line.into(), may_reset))
    }
}

impl Records {
    /// Passes the records in `bytes` to `found`.
    fn feed(&mut self, bytes: &[u8], found: &mut impl FnMut(Measured)) {
        match self {
            Self::Text(decoder) => decoder.feed(bytes, &mut |record, _| {
                let fastrak::Record::Pose(pose) = record else { return };
                if let (Some(position_cm), Some(quaternion_wxyz)) = (pose.position, pose.quaternion_wxyz) {
                    found(Measured { station: pose.station, error: pose.error, position_cm, quaternion_wxyz });
                }
            }),
            Self::Packed(decoder) => decoder.feed(bytes, &mut |record, _| {
                let Record::Pose(pose) = record else { return };
                if let (Some(position), Some(quaternion)) = (pose.position_counts, pose.quaternion_wxyz_counts) {
                    found(Measured {
                        station: pose.station,
                        error: pose.error,
                        position_cm: position.map(|count| f64::from(count) * CM_PER_COUNT),
                        quaternion_wxyz: quaternion.map(|count| f64::from(count) * UNIT_PER_COUNT),
                    });
                }
            }),
        }
    }

    fn interrupt(&mut self) {
        match self {
            Self::Text(decoder) => decoder.interrupt(),
            Self::Packed(decoder) => decoder.interrupt(),
        }
    }
}

impl IsotrakProtocol {
    fn is_used(&self, station: u8) -> bool {
        self.settings.stations.contains(&station)
    }

    /// Feeds received bytes to the decoder of replies. `take` returns whether a reply is the
    /// expected one.
    fn answered(&mut self, bytes: &[u8], mut take: impl FnMut(&Reply<'_>) -> bool) -> bool {
        let mut answered = false;
        let wrong = &mut self.wrong;
        self.replies.feed(bytes, &mut |record, _| {
            let fastrak::Record::Reply(reply) = record else { return };
            match reply.error_code() {
                Some(code) => *wrong = Some(format!("refused a setting with error {code}")),
                None => answered |= take(&reply),
            }
        });
        answered
    }
}

impl UnitProtocol for IsotrakProtocol {
    type Question = Question;
    const BAUDS: &'static [u32] = &[115_200, 19_200, 9_600, 38_400, 57_600];
    // 22 to 32 s, longer than the unit's start, which takes 20 s.
    const RESTARTS: Option<[usize; 2]> = Some([100, 20]);
    const SERIAL_ADVICE: &'static str = "";

    fn forget(&mut self) {
        // The connection keeps the total of losses.
        self.replies = Decoder::new(Fastrak::replies());
        self.records = match self.records {
            Records::Text(_) => {
                Records::Text(Box::new(Decoder::new(Fastrak::uniform(usize::from(STATIONS), self.text))))
            }
            Records::Packed(_) => Records::Packed(Decoder::new(Isotrak::new(STATIONS, self.packed))),
        };
        self.wrong = None;
    }

    fn quieten(&self, again: bool, restart: bool) -> Vec<u8> {
        // The retry sends a line end first, because another host may have left a command
        // unfinished.
        let mut quiet = if again { Command::EndLine.bytes() } else { Vec::new() };
        quiet.extend(if restart { Command::Reset.bytes() } else { Command::StopStream.bytes() });
        quiet
    }

    fn listen(&mut self) {
        self.replies.interrupt();
        self.records.interrupt();
        self.seen = [false; STATIONS as usize];
    }

    fn probe(&self) -> (Vec<u8>, Question) {
        (Command::Status.bytes(), Question::Status)
    }

    fn script(&mut self, _baud: Option<u32>) -> Vec<ScriptStep<Question>> {
        self.wrong = None;
        let mode = if self.settings.binary { Mode::Binary } else { Mode::Ascii };
        let mut commands = vec![Command::Mode(mode), Command::Centimetres];
        commands.extend((1..=STATIONS).map(|station| Command::Station(station, self.is_used(station))));
        commands.push(Command::OutputList(None, self.text));
        for &station in &self.settings.stations {
            commands.extend([
                Command::ResetAlignment(station),
                Command::ResetBoresight(station),
                Command::Increment(station, 0.0),
                Command::Hemisphere(station, self.settings.hemisphere),
            ]);
        }
        commands.extend([Command::PositionFilter(NO_FILTER), Command::AttitudeFilter(NO_FILTER)]);
        let mut script: Vec<ScriptStep<Question>> =
            commands.iter().map(|command| ScriptStep::Send(command.bytes())).collect();
        script.push(ScriptStep::Ask(Command::AskStations(None).bytes(), Question::Stations));
        // The decoder accepts a text record when something follows it: here, the status.
        let poll = [Command::Poll.bytes(), Command::Status.bytes()].concat();
        script.push(ScriptStep::Ask(poll, Question::Records));
        script
    }

    fn judge_answer(&mut self, bytes: &[u8], question: Question) -> QuestionState {
        match question {
            Question::Status => match self.answered(bytes, |_| true) {
                true => QuestionState::Good,
                false => QuestionState::Nothing,
            },
            Question::Stations => {
                let mut used = None;
                self.answered(bytes, |reply| {
                    used = reply.stations().or(used);
                    used.is_some()
                });
                let expected = std::array::from_fn::<_, { STATIONS as usize }, _>(|s| self.is_used(s as u8 + 1));
                match (used, self.wrong.take()) {
                    (None, wrong) => {
                        self.wrong = wrong;
                        QuestionState::Nothing
                    }
                    (Some(_), Some(wrong)) => {
                        QuestionState::Bad(format!("{wrong}; its firmware may be of another kind"))
                    }
                    (Some(used), None) => judge_stations(&expected, &used[..usize::from(STATIONS)]),
                }
            }
            Question::Records => {
                let seen = &mut self.seen;
                self.records.feed(bytes, &mut |record| seen[usize::from(record.station) - 1] = true);
                match self.settings.stations.iter().all(|station| self.seen[usize::from(*station) - 1]) {
                    true => QuestionState::Good,
                    false => QuestionState::Nothing,
                }
            }
        }
    }

    fn stream(&mut self, baud: Option<u32>) -> Vec<u8> {
        self.replay();
        let bytes = if self.settings.binary { self.packed.length() } else { self.text.length() };
        self.description.timing.wire_ns = wire_ns(bytes, baud);
        self.description.fields = baud.map(|baud| ("Baud".into(), baud.to_string())).into_iter().collect();
        Command::Stream.bytes()
    }

    fn replay(&mut self) {
        self.records.interrupt();
    }

    fn decode(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>) {
        let Self { settings, records, .. } = self;
        records.feed(bytes, &mut |record| {
            if !settings.stations.contains(&record.station) {
                return;
            }
            let stamp = Stamp { host_ns: Some(at_ns), ..Stamp::default() };
            // The stylus switch takes the place of the error letter.
            let is_switch = matches!(record.error, PRESSED | RELEASED);
            found.push_back(Reading::Pose(Pose {
                stamp,
                station: record.station,
                position_cm: record.position_cm,
                quaternion_wxyz: record.quaternion_wxyz,
                buttons: u8::from(record.error == PRESSED),
                distortion: None,
                code: (record.error != b' ' && !is_switch).then_some(record.error),
                status: if is_switch { Status::Ok } else { status_of(record.error) },
            }));
        });
    }

    fn farewell(&self) -> &[u8] {
        b"c"
    }

    fn lost(&self) -> Lost {
        let records = match &self.records {
            Records::Text(decoder) => decoder.losses(),
            Records::Packed(decoder) => decoder.losses(),
        };
        let replies = self.replies.losses();
        // Without a frame count, unsent records cannot be counted.
        Lost {
            readings: 0,
            refused: records.refusals() + replies.refusals(),
            skipped: records.bytes_skipped + replies.bytes_skipped,
        }
    }

    fn describe(&self) -> &Description {
        &self.description
    }
}
