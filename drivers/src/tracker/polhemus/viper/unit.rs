//! Set-up commands of a VIPER, and the conversion of its frames to readings.
//!
//! The unit answers every command. Each frame states the units of its numbers, so the driver can
//! refuse frames in other units.

use std::borrow::Cow;
use std::collections::VecDeque;

use sonoweave_core::reading::{Pose, Reading, Stamp, Status};
use sonoweave_core::{Description, Ticks, Timing};

use super::command::{ALL, Action, Command, FilterLevel, Rate, Reply, code};
use super::frame::{FRAME_HEADER, HEADER, SENSOR, TRAILER};
use super::{MOST_SENSORS, OrientationUnit, PositionUnit, Record, Viper};
use crate::Error;
use crate::connection::Lost;
use crate::framing::Decoder;
use crate::tracker::polhemus::Settings;
use crate::tracker::polhemus::counter::{Counted, Counter};
use crate::tracker::polhemus::setup_sequence::{
    Line, QuestionState, ScriptStep, Tracker, UnitProtocol, fastest, wire_ns,
};

/// Frame rates; some units offer those above 240 Hz as an option, others refuse them.
const RATES: [(Rate, f64); 6] = [
    (Rate::Hz960, 960.0),
    (Rate::Hz480, 480.0),
    (Rate::Hz240, 240.0),
    (Rate::Hz120, 120.0),
    (Rate::Hz60, 60.0),
    (Rate::Hz30, 30.0),
];
/// Default rate.
const USUAL: (Rate, f64) = (Rate::Hz240, 240.0);

/// A VIPER on a line.
pub type Unit = Tracker<ViperProtocol>;

/// The unit protocol of a VIPER.
pub struct ViperProtocol {
    settings: Settings,
    decoder: Decoder<Viper>,
    /// Unit number, as the unit reports it.
    unit: u32,
    /// Connected sensors, as the unit reports them, one bit each.
    sensors: u16,
    /// Frame rate that the driver sets.
    rate: (Rate, f64),
    counter: Counter,
    /// Bytes that stop the stream.
    farewell: Vec<u8>,
    lost: u64,
    /// Frames with an implausible number or other units.
    doubtful: u64,
    description: Description,
}

/// Questions to the unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Question {
    /// Which sensors are connected.
    Sensors,
    /// Whether the unit obeyed the setting command with this number.
    Set(u32),
    /// Whether the unit reset the value of this command, which it may not support.
    Forget(u32),
    /// Which units its numbers have.
    Units,
    /// Which frame rate it uses.
    Rate,
    /// Whether the requested sensors are connected.
    Verify,
}

impl Question {
    fn command(self) -> u32 {
        match self {
            Self::Sensors | Self::Verify => code::STATION_MAP,
            Self::Set(command) | Self::Forget(command) => command,
            Self::Units => code::UNITS,
            Self::Rate => code::FRAME_RATE,
        }
    }
}

impl Unit {
    /// Creates a unit with these settings. If `line` gives a rate, the driver tries only that
    /// rate.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings that no VIPER has.
    pub fn new(name: &str, settings: Settings, line: impl Into<Line>) -> Result<Self, Error> {
        settings.check(MOST_SENSORS as u8)?;
        if !settings.binary {
            return Err(Error::setting("tracker", "binary", "VIPER has no text; set it to true"));
        }
        // The latency from measurement to the first byte is not documented.
        let timing = Timing { ticks: Ticks::Measurements, wraps_at: Some(1 << 32), ..Timing::default() };
        let description = Description { name: format!("VIPER on {name}"), timing, ..Description::default() };
        let may_reset = settings.may_reset;
        let mut unit = ViperProtocol {
            settings,
            decoder: Decoder::new(Viper::new(MOST_SENSORS)),
            unit: 0,
            sensors: 1,
            rate: USUAL,
            counter: Counter::default(),
            farewell: Command::StopStream.bytes(),
            lost: 0,
            doubtful: 0,
            description,
        };
        unit.set_rate(USUAL);
        Ok(Self::of(unit, line.into(), may_reset))
    }
}

impl ViperProtocol {
    fn set_rate(&mut self, rate: (Rate, f64)) {
        self.rate = rate;
        (self.description.timing.tick_hz, self.description.timing.rate_hz) = (Some(rate.1), Some(rate.1));
    }

    /// Returns the bytes of a frame of all connected sensors, unwanted ones included.
    fn frame_bytes(&self) -> usize {
        HEADER + FRAME_HEADER + SENSOR * self.sensors.count_ones().max(1) as usize + TRAILER
    }

    /// Compares the reported settings with the requested ones.
    fn judge(&mut self, reply: &[u32], question: Question) -> QuestionState {
        // A missing word reads as 0.
        let first = reply.first().copied().unwrap_or_default();
        match question {
            Question::Sensors => {
                self.sensors = (first & 0xffff) as u16;
                QuestionState::Good
            }
            Question::Verify => {
                let absent = self.settings.stations.iter().filter(|station| first >> (*station - 1) & 1 == 0);
                let absent: Vec<String> = absent.map(|station| station.to_string()).collect();
                if absent.is_empty() {
                    return QuestionState::Good;
                }
                QuestionState::Bad(format!("has no sensor at station {}; plug it in", absent.join(", ")))
            }
            Question::Units if *reply != [PositionUnit::Centimetres as u32, OrientationUnit::Quaternion as u32] => {
                QuestionState::Bad(
                    "keeps sending other units than centimetres and quaternions; switch it off and on".into(),
                )
            }
            Question::Rate if first != self.rate.0 as u32 => {
                QuestionState::Bad(format!("does not accept {} frames a second; switch it off and on", self.rate.1))
            }
            Question::Units | Question::Rate | Question::Set(_) | Question::Forget(_) => QuestionState::Good,
        }
    }

    fn judge_reply(&mut self, reply: &Reply<'_>, question: Question) -> QuestionState {
        self.unit = reply.unit;
        match reply.action() {
            Some(Action::Ack | Action::NakWarning) => {
                let (words, _) = reply.payload.as_chunks::<4>();
                let mut numbers = [0; 2];
                numbers.iter_mut().zip(words).for_each(|(number, word)| *number = u32::from_le_bytes(*word));
                self.judge(&numbers[..words.len().min(2)], question)
            }
            Some(Action::Nak) if matches!(question, Question::Forget(_)) => QuestionState::Good,
            Some(Action::Nak) => {
                let reason = reply.nak().map(|nak| String::from_utf8_lossy(nak.text).trim().to_owned());
                QuestionState::Bad(format!(
                    "refused command {}: {}; its firmware may be of another kind",
                    reply.command,
                    reason.filter(|reason| !reason.is_empty()).unwrap_or_else(|| "without a reason".into())
                ))
            }
            _ => QuestionState::Nothing,
        }
    }
}

impl UnitProtocol for ViperProtocol {
    type Question = Question;
    const BAUDS: &'static [u32] = &[115_200, 921_600, 460_800, 230_400, 38_400];
    // 13 to 18 s. Not verified: that it takes 10 s to start, like its predecessors.
    const RESTARTS: Option<[usize; 2]> = Some([60, 16]);
    const SERIAL_ADVICE: &'static str = "; the line is RS-422, not RS-232";

    fn forget(&mut self) {
        // The connection keeps the total of losses.
        self.decoder = Decoder::new(Viper::new(MOST_SENSORS));
        (self.counter, self.lost, self.doubtful) = (Counter::default(), 0, 0);
    }

    fn quieten(&self, again: bool, restart: bool) -> Vec<u8> {
        let quiet = if restart { Command::Initialize } else { Command::StopStream }.bytes();
        // The retry sends it twice: the unit may read the first as the rest of a command that
        // another host left unfinished.
        if again && !restart { [quiet.clone(), quiet].concat() } else { quiet }
    }

    fn listen(&mut self) {
        self.decoder.interrupt();
    }

    fn probe(&self) -> (Vec<u8>, Question) {
        (Command::AskStationMap.bytes(), Question::Sensors)
    }

    fn script(&mut self, baud: Option<u32>) -> Vec<ScriptStep<Question>> {
        self.set_rate(fastest(&RATES, self.settings.rate_hz, self.frame_bytes(), baud).unwrap_or(USUAL));
        let zenith = self.settings.hemisphere;
        let hemisphere = Command::Hemisphere { sensor: ALL, track: zenith == [0.0; 3], zenith };
        let filter = Command::Filter { sensor: ALL, level: FilterLevel::None };
        [
            (Command::Units(PositionUnit::Centimetres, OrientationUnit::Quaternion), Question::Set(code::UNITS)),
            (Command::FrameRate(self.rate.0), Question::Set(code::FRAME_RATE)),
            (Command::Default(code::TIP_OFFSET), Question::Forget(code::TIP_OFFSET)),
            (Command::Default(code::INCREMENT), Question::Forget(code::INCREMENT)),
            (Command::Default(code::BORESIGHT), Question::Forget(code::BORESIGHT)),
            (hemisphere, Question::Set(code::HEMISPHERE)),
            (filter, Question::Set(code::FILTER)),
            (Command::AskUnits, Question::Units),
            (Command::AskFrameRate, Question::Rate),
            (Command::AskStationMap, Question::Verify),
        ]
        .map(|(command, question)| ScriptStep::Ask(command.bytes(), question))
        .into()
    }

    fn judge_answer(&mut self, bytes: &[u8], question: Question) -> QuestionState {
        // The closure below borrows `self` while the decoder runs, so the decoder is taken out.
        let mut decoder = std::mem::replace(&mut self.decoder, Decoder::new(Viper::new(0)));
        let mut state = QuestionState::Nothing;
        decoder.feed(bytes, &mut |record, _| {
            if let Record::Reply(reply) = record
                && reply.command == question.command()
                && state == QuestionState::Nothing
            {
                state = self.judge_reply(&reply, question);
            }
        });
        self.decoder = decoder;
        state
    }

    fn stream(&mut self, baud: Option<u32>) -> Vec<u8> {
        self.replay();
        self.description.timing.wire_ns = wire_ns(self.frame_bytes(), baud);
        self.description.fields = vec![("Unit".into(), self.unit.to_string())];
        self.description.fields.extend(baud.map(|baud| ("Baud".into(), baud.to_string())));
        Command::Stream { accelerations: false, restart_count: true }.bytes()
    }

    fn replay(&mut self) {
        self.decoder.interrupt();
        self.counter = Counter::default();
    }

    fn decode(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>) {
        let Self { decoder, settings, counter, rate, lost, doubtful, .. } = self;
        decoder.feed(bytes, &mut |record, _| {
            let Record::Frame(frame) = record else { return };
            let counted = counter.count(frame.frame_count, at_ns, rate.1);
            if counted == Counted::Doubtful {
                *doubtful += 1;
                return;
            }
            let mut stations = 0;
            for sensor in frame.sensors().filter(|sensor| !sensor.is_virtual) {
                let station = sensor.sensor + 1;
                if !settings.stations.contains(&station) {
                    continue;
                }
                stations += 1;
                let units = (sensor.position_unit, sensor.orientation_unit);
                if frame.accelerations || units != (PositionUnit::Centimetres, OrientationUnit::Quaternion) {
                    *doubtful += 1;
                    continue;
                }
                let ticks = Some(u64::from(frame.frame_count));
                let stamp = Stamp { host_ns: Some(at_ns), ticks, ..Stamp::default() };
                let position_cm = sensor.position.map(f64::from);
                let quaternion_wxyz = sensor.orientation.map(f64::from);
                let status = match crate::tracker::polhemus::is_pose(&position_cm, &quaternion_wxyz) {
                    true => Status::Ok,
                    false => Status::Other(Cow::Borrowed("impossible numbers for a pose")),
                };
                found.push_back(Reading::Pose(Pose {
                    stamp,
                    station,
                    position_cm,
                    quaternion_wxyz,
                    buttons: sensor.buttons,
                    distortion: Some(i32::from(sensor.distortion)),
                    // The code concerns the unit, not the pose.
                    code: (frame.test != 0).then_some(frame.test),
                    status,
                }));
            }
            if let Counted::Next(missing) = counted {
                // Each missing frame contained these stations too.
                *lost += u64::from(missing) * stations;
            }
        });
    }

    fn farewell(&self) -> &[u8] {
        &self.farewell
    }

    fn lost(&self) -> Lost {
        let losses = self.decoder.losses();
        Lost { readings: self.lost, refused: losses.refusals() + self.doubtful, skipped: losses.bytes_skipped }
    }

    fn describe(&self) -> &Description {
        &self.description
    }
}
