//! Set-up commands of a FASTRAK, and the conversion of its records to readings.

use std::borrow::Cow;
use std::collections::VecDeque;

use sonoweave_core::reading::{Pose, Reading, Stamp, Status};
use sonoweave_core::{Description, Timing};

use super::{Command, Fastrak, Layout, Mode, Record, Reply, STATIONS, Status as UnitStatus};
use crate::Error;
use crate::connection::Lost;
use crate::framing::Decoder;
use crate::tracker::polhemus::Settings;
use crate::tracker::polhemus::setup_sequence::{Line, QuestionState, ScriptStep, Tracker, UnitProtocol, wire_ns};

/// Measurements per second, shared by the stations.
const CYCLES: f64 = 120.0;
/// Time from the middle of the measurement to the first byte, ns (manual: latency without
/// filters).
const SAMPLING: i64 = 3_750_000;

/// A FASTRAK on a line.
pub type Unit = Tracker<FastrakProtocol>;

/// The unit protocol of a FASTRAK.
pub struct FastrakProtocol {
    settings: Settings,
    layouts: [Option<Layout>; STATIONS],
    decoder: Decoder<Fastrak>,
    status: Option<UnitStatus>,
    /// Refused setting, with the error code.
    wrong: Option<String>,
    description: Description,
}

/// Questions to the unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Question {
    /// The unit's status and identity.
    Status,
    /// The output list of this station.
    List(u8),
    /// Which stations are in use.
    Stations,
    /// Whether the unit has taken its settings.
    Verify,
}

impl Unit {
    /// Creates a unit with these settings. If `line` gives a rate, the driver tries only that
    /// rate.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings that no FASTRAK has.
    pub fn new(name: &str, settings: Settings, line: impl Into<Line>) -> Result<Self, Error> {
        settings.check(STATIONS as u8)?;
        let mode = if settings.binary { Mode::Binary } else { Mode::Ascii };
        let mut layouts = [None; STATIONS];
        for station in &settings.stations {
            let codes: &[u8] = if settings.stylus == Some(*station) { &[2, 11, 16, 1] } else { &[2, 11, 1] };
            let layout = Layout::new(mode, codes)?;
            layouts[usize::from(*station) - 1] = Some(layout);
        }
        let rate_hz = Some(CYCLES / settings.stations.len() as f64);
        let timing = Timing { rate_hz, sampling_ns: SAMPLING, ..Timing::default() };
        let description = Description { name: format!("FASTRAK on {name}"), timing, ..Description::default() };
        let may_reset = settings.may_reset;
        let unit = FastrakProtocol {
            settings,
            layouts,
            decoder: Decoder::new(Fastrak::replies()),
            status: None,
            wrong: None,
            description,
        };
        Ok(Self::of(unit, line.into(), may_reset))
    }
}

impl FastrakProtocol {
    /// Feeds received bytes to the decoder of replies. `take` returns whether a reply is the
    /// expected one.
    fn answered(&mut self, bytes: &[u8], mut take: impl FnMut(&Reply<'_>) -> bool) -> bool {
        let mut answered = false;
        let mut error = None;
        self.decoder.feed(bytes, &mut |record, _| {
            if let Record::Reply(reply) = record {
                answered |= take(&reply);
                if let Some(code) = reply.error_code() {
                    error = Some(code);
                }
            }
        });
        if let Some(code) = error {
            self.wrong = Some(format!("refused a setting with error {code}"));
        }
        answered
    }

    fn read_status(&mut self, bytes: &[u8]) -> Option<UnitStatus> {
        let mut status = None;
        self.answered(bytes, |reply| {
            status = reply.status().or(status);
            status.is_some()
        });
        self.status = status.or(self.status);
        status
    }
}

impl UnitProtocol for FastrakProtocol {
    type Question = Question;
    const BAUDS: &'static [u32] = &[115_200, 38_400, 19_200, 9_600, 57_600];
    // 13 to 18 s, longer than the unit's start, which takes 10 s.
    const RESTARTS: Option<[usize; 2]> = Some([60, 16]);
    const SERIAL_ADVICE: &'static str = "";

    fn forget(&mut self) {
        // The connection keeps the total of losses.
        self.decoder = Decoder::new(Fastrak::replies());
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
        self.decoder.reformat(Fastrak::replies());
    }

    fn probe(&self) -> (Vec<u8>, Question) {
        (Command::Status.bytes(), Question::Status)
    }

    fn script(&mut self, _baud: Option<u32>) -> Vec<ScriptStep<Question>> {
        let mode = if self.settings.binary { Mode::Binary } else { Mode::Ascii };
        let mut commands = vec![Command::Mode(mode), Command::Centimetres];
        for station in 1..=STATIONS as u8 {
            commands.push(Command::Station(station, self.settings.stations.contains(&station)));
        }
        for station in &self.settings.stations {
            let s = *station;
            if let Some(layout) = self.layouts[usize::from(s) - 1] {
                commands.push(Command::OutputList(Some(s), layout));
            }
            commands.push(Command::ResetAlignment(s));
            commands.push(Command::ResetBoresight(s));
            commands.push(Command::Increment(s, 0.0));
            commands.push(Command::Hemisphere(s, self.settings.hemisphere));
        }
        commands.push(Command::PositionFilter(super::command::NO_FILTER));
        commands.push(Command::AttitudeFilter(super::command::NO_FILTER));
        let mut script: Vec<ScriptStep<Question>> =
            commands.iter().map(|command| ScriptStep::Send(command.bytes())).collect();
        for s in &self.settings.stations {
            script.push(ScriptStep::Ask(Command::AskOutputList(*s).bytes(), Question::List(*s)));
        }
        script.push(ScriptStep::Ask(Command::AskStations(Some(1)).bytes(), Question::Stations));
        script.push(ScriptStep::Ask(Command::Status.bytes(), Question::Verify));
        script
    }

    fn judge_answer(&mut self, bytes: &[u8], question: Question) -> QuestionState {
        match question {
            Question::Status => self.read_status(bytes).map_or(QuestionState::Nothing, |_| QuestionState::Good),
            Question::List(station) => {
                let expected = self.layouts[usize::from(station) - 1];
                let mut is_right = false;
                let answered = self.answered(bytes, |reply| {
                    let Some(codes) = reply.output_list() else { return false };
                    is_right = expected.is_some_and(|w| codes.eq(w.entries().iter().map(|entry| entry.code())));
                    true
                });
                match (answered, is_right) {
                    (false, _) => QuestionState::Nothing,
                    (true, true) => QuestionState::Good,
                    (true, false) => QuestionState::Bad(
                        "was told what to send and says that it will send something else; switch it off and on".into(),
                    ),
                }
            }
            Question::Stations => {
                let expected: [bool; STATIONS] = std::array::from_fn(|s| self.layouts[s].is_some());
                let mut stations = None;
                self.answered(bytes, |reply| {
                    stations = reply.stations().or(stations);
                    stations.is_some()
                });
                stations.map_or(QuestionState::Nothing, |stations| judge_stations(&expected, &stations))
            }
            Question::Verify => {
                let Some(status) = self.read_status(bytes) else { return QuestionState::Nothing };
                let is_right = status.binary == self.settings.binary && status.centimetres && !status.continuous;
                match self.wrong.take() {
                    None if is_right => QuestionState::Good,
                    Some(wrong) if is_right => {
                        QuestionState::Bad(format!("{wrong}; its firmware may be of another kind"))
                    }
                    reason => {
                        let reason = reason.unwrap_or_else(|| "has not taken its settings".into());
                        QuestionState::Bad(format!("{reason}; switch it off and on"))
                    }
                }
            }
        }
    }

    fn stream(&mut self, baud: Option<u32>) -> Vec<u8> {
        self.replay();
        let longest = self.layouts.iter().flatten().map(Layout::length).max().unwrap_or(0);
        self.description.timing.wire_ns = wire_ns(longest, baud);
        if let Some(status) = &self.status {
            let words = |text: &[u8]| String::from_utf8_lossy(text).trim().to_owned();
            self.description.fields =
                vec![("Identity".into(), words(&status.identity)), ("Firmware".into(), words(&status.version))];
            self.description.fields.extend(baud.map(|baud| ("Baud".into(), baud.to_string())));
        }
        Command::Stream.bytes()
    }

    fn replay(&mut self) {
        self.decoder.reformat(Fastrak::new(self.layouts));
    }

    fn decode(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>) {
        self.decoder.feed(bytes, &mut |record, _| {
            let Record::Pose(pose) = record else { return };
            let (Some(position_cm), Some(quaternion_wxyz)) = (pose.position, pose.quaternion_wxyz) else { return };
            let stamp = Stamp { host_ns: Some(at_ns), ..Stamp::default() };
            found.push_back(Reading::Pose(Pose {
                stamp,
                station: pose.station,
                position_cm,
                quaternion_wxyz,
                buttons: u8::from(pose.stylus.is_some_and(|switch| switch[1] == b'1')),
                distortion: None,
                code: (pose.error != b' ').then_some(pose.error),
                status: status_of(pose.error),
            }));
        });
    }

    fn farewell(&self) -> &[u8] {
        b"c"
    }

    fn lost(&self) -> Lost {
        let losses = self.decoder.losses();
        // Without a frame count, unsent records cannot be counted.
        Lost { readings: 0, refused: losses.refusals(), skipped: losses.bytes_skipped }
    }

    fn describe(&self) -> &Description {
        &self.description
    }
}

/// Compares the stations that the unit reports in use with the requested ones.
pub(in crate::tracker::polhemus) fn judge_stations(expected: &[bool], used: &[bool]) -> QuestionState {
    if expected == used {
        return QuestionState::Good;
    }
    let missing = expected.iter().zip(used).enumerate().filter(|(_, (expected, used))| **expected && !**used);
    let missing: Vec<String> = missing.map(|(index, _)| (index + 1).to_string()).collect();
    QuestionState::Bad(match missing.is_empty() {
        true => "keeps stations in use that were not asked for; switch it off and on".into(),
        false => {
            format!("does not use station {}; plug its sensor in, and check the station's switch", missing.join(", "))
        }
    })
}

/// Returns the status of a pose from its record's error letter. The letter is that of the last
/// error found and may be older than the record. Errors of the unit alone therefore do not
/// invalidate the pose.
pub fn status_of(letter: u8) -> Status {
    let why = match letter {
        b'j' => "sensor saturated: too near the transmitter",
        b'k' => "signal too low: too far from the transmitter, or a cable",
        b'l' => "an element of the sensor or the transmitter gives nothing",
        b's' => "sensor out of its range",
        b'v' => "no synchronisation",
        b'x' => "outside the box of movement that was set",
        b'y' => "outside the angles that were set",
        b'A'..=b'F' => "signal weak",
        _ => return Status::Ok,
    };
    Status::Other(Cow::Borrowed(why))
}
