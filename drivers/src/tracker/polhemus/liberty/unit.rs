//! Set-up commands of LIBERTY, PATRIOT and Latus, and the conversion of their frames to readings.
//!
//! The driver selects binary before the first question, because only binary answers identify the
//! model. It sets the highest frame rate that is requested and that the line carries. It drops
//! the first frames after the start, because other programs found them wrong.

use std::borrow::Cow;
use std::collections::VecDeque;

use sonoweave_core::reading::{Pose, Reading, Stamp, Status};
use sonoweave_core::{Description, Ticks, Timing};

use super::command::{Command, Counter as Zeroed, Rate, Stations};
use super::{Header, Layout, Liberty, MOST_STATIONS, Record, Reply, Tag};
use crate::Error;
use crate::connection::Lost;
use crate::framing::Decoder;
use crate::tracker::polhemus::Settings;
use crate::tracker::polhemus::counter::{Counted, Counter};
use crate::tracker::polhemus::setup_sequence::{
    Line, QuestionState, ScriptStep, Tracker, UnitProtocol, fastest, wire_ns,
};

/// Time from the middle of the measurement to the first byte, ns (manual: latency without
/// filters).
const SAMPLING: i64 = 3_500_000;
/// Frames of each station that are dropped after the start.
const EARLY: u32 = 10;
/// Frame rates that a LIBERTY offers, in frames per second.
const RATES: [(Rate, f64); 3] = [(Rate::Hz240, 240.0), (Rate::Hz120, 120.0), (Rate::Hz60, 60.0)];
/// Frame rate of a PATRIOT, which has only one, in frames per second.
const PATRIOT_HZ: f64 = 60.0;
/// Parameters that switch a filter off.
const NO_FILTER: [f32; 4] = [0.0, 1.0, 0.0, 0.0];

/// A LIBERTY, PATRIOT or Latus on a line.
pub type Unit = Tracker<LibertyProtocol>;

/// The unit protocol of LIBERTY, PATRIOT and Latus.
pub struct LibertyProtocol {
    name: String,
    settings: Settings,
    layout: Layout,
    is_usb: bool,
    decoder: Decoder<Liberty>,
    /// Model, as the unit reports it.
    tag: Tag,
    /// Stations that the unit reports as active, one bit each.
    active: u16,
    /// Frames per second.
    hz: f64,
    counters: [Counter; MOST_STATIONS as usize],
    lost: u64,
    /// Records with an implausible frame count.
    doubtful: u64,
    /// First setting that the unit refused, with the reason.
    wrong: Option<String>,
    description: Description,
}

/// Questions to the unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Question {
    /// Which stations are there; the answer also identifies the model.
    Who,
    /// Whether positions are in cm.
    Units,
    /// The output list of this station.
    List(u8),
    /// Which stations are in use, and whether the unit refused a setting.
    Verify,
}

impl Unit {
    /// Creates a unit with these settings. If `line` gives a rate, the driver tries only that
    /// rate.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings that no such unit has.
    pub fn new(name: &str, settings: Settings, line: impl Into<Line>) -> Result<Self, Error> {
        settings.check(MOST_STATIONS)?;
        if !settings.binary {
            let problem = "the text of LIBERTY and PATRIOT has no separate columns; set it to true";
            return Err(Error::setting("tracker", "binary", problem));
        }
        // Frame count, switch, distortion, position, and last the quaternion. Its length shows
        // whether a byte before it was lost.
        let codes: &[u8] = if settings.stylus.is_some() { &[9, 10, 11, 2, 7] } else { &[9, 11, 2, 7] };
        let layout = Layout::new(codes)?;
        let line = line.into();
        let timing =
            Timing { ticks: Ticks::Measurements, wraps_at: Some(1 << 32), sampling_ns: SAMPLING, ..Timing::default() };
        let description = Description { name: format!("LIBERTY on {name}"), timing, ..Description::default() };
        let may_reset = settings.may_reset;
        let mut unit = LibertyProtocol {
            name: name.to_owned(),
            settings,
            layout,
            is_usb: line == Line::Usb,
            decoder: Decoder::new(Liberty::replies()),
            tag: Tag::Liberty,
            active: 1,
            hz: RATES[0].1,
            counters: Default::default(),
            lost: 0,
            doubtful: 0,
            wrong: None,
            description,
        };
        unit.set_rate(RATES[0].1);
        Ok(Self::of(unit, line, may_reset))
    }
}

impl LibertyProtocol {
    fn set_rate(&mut self, hz: f64) {
        self.hz = hz;
        (self.description.timing.tick_hz, self.description.timing.rate_hz) = (Some(hz), Some(hz));
    }

    /// Feeds received bytes to the decoder of replies. `take` returns whether a reply is the
    /// expected one.
    fn answered(&mut self, bytes: &[u8], mut take: impl FnMut(&Reply<'_>) -> bool) -> bool {
        let mut answered = false;
        let (tag, wrong) = (&mut self.tag, &mut self.wrong);
        self.decoder.feed(bytes, &mut |record, _| {
            let Record::Reply(reply) = record else { return };
            *tag = reply.header.tag;
            if reply.header.is_well() {
                answered |= take(&reply);
            } else if reply.header.command != b'@' {
                // Some units have no buffer to switch off, and refuse `@B`.
                let Header { command, error, .. } = reply.header;
                *wrong = Some(format!("refused a setting ({}) with error {error}", command.escape_ascii()));
            }
        });
        answered
    }

    fn hear_stations(&mut self, bytes: &[u8]) -> Option<u16> {
        let mut active = None;
        self.answered(bytes, |reply| {
            active = reply.station_map().map(|[_, active]| active).or(active);
            active.is_some()
        });
        active
    }

    fn judge_stations(&self, active: u16) -> QuestionState {
        let absent = self.settings.stations.iter().filter(|station| active >> (*station - 1) & 1 == 0);
        let absent: Vec<String> = absent.map(|station| station.to_string()).collect();
        if absent.is_empty() {
            return QuestionState::Good;
        }
        QuestionState::Bad(format!("does not use station {}; plug its sensor in, and wait a second", absent.join(", ")))
    }
}

impl UnitProtocol for LibertyProtocol {
    type Question = Question;
    const BAUDS: &'static [u32] = &[115_200, 38_400, 19_200, 9_600, 57_600];
    // 13 to 18 s, longer than the unit's start, which takes 10 s.
    const RESTARTS: Option<[usize; 2]> = Some([60, 16]);
    const SERIAL_ADVICE: &'static str =
        "; a unit that was used by USB does not listen to its serial line until it was switched off and on";

    fn forget(&mut self) {
        // The connection keeps the total of losses.
        self.decoder = Decoder::new(Liberty::replies());
        (self.wrong, self.lost, self.doubtful) = (None, 0, 0);
        self.counters = Default::default();
    }

    fn quieten(&self, again: bool, restart: bool) -> Vec<u8> {
        // The retry sends a line end first, because another host may have left a command
        // unfinished.
        let mut quiet = if again { Command::EndLine.bytes() } else { Vec::new() };
        quiet.extend(if restart { Command::Reset.bytes() } else { Command::Poll.bytes() });
        quiet
    }

    fn listen(&mut self) {
        self.decoder.reformat(Liberty::replies());
    }

    fn probe(&self) -> (Vec<u8>, Question) {
        ([Command::Binary(true).bytes(), Command::AskActiveStations.bytes()].concat(), Question::Who)
    }

    fn script(&mut self, baud: Option<u32>) -> Vec<ScriptStep<Question>> {
        self.wrong = None;
        // All active stations send frames, unwanted ones too.
        let bytes = self.layout.length() * self.active.count_ones().max(1) as usize;
        let rate = match self.tag {
            Tag::Patriot => None,
            Tag::Liberty | Tag::Latus => fastest(&RATES, self.settings.rate_hz, bytes, baud),
        };
        self.set_rate(rate.map_or(PATRIOT_HZ, |(_, hz)| hz));
        let all = Stations::All;
        let mut commands = vec![Command::Echo(false)];
        commands.extend(self.is_usb.then_some(Command::UsbBuffer(false)));
        commands.push(Command::Centimetres(true));
        commands.extend(rate.map(|(rate, _)| Command::Rate(rate)));
        commands.extend([
            Command::OutputList(all, self.layout),
            Command::ResetAlignment(all),
            Command::ResetBoresight(all),
            Command::Hemisphere(all, self.settings.hemisphere),
            Command::PositionFilter(NO_FILTER),
            Command::AttitudeFilter(NO_FILTER),
        ]);
        let mut script: Vec<ScriptStep<Question>> =
            commands.iter().map(|command| ScriptStep::Send(command.bytes())).collect();
        script.push(ScriptStep::Ask(Command::AskUnits.bytes(), Question::Units));
        for station in &self.settings.stations {
            script.push(ScriptStep::Ask(Command::AskOutputList(*station).bytes(), Question::List(*station)));
        }
        script.push(ScriptStep::Ask(Command::AskActiveStations.bytes(), Question::Verify));
        script
    }

    fn judge_answer(&mut self, bytes: &[u8], question: Question) -> QuestionState {
        match question {
            Question::Who => match self.hear_stations(bytes) {
                None => QuestionState::Nothing,
                Some(active) => {
                    self.active = active;
                    QuestionState::Good
                }
            },
            Question::Units => {
                let mut centimetres = None;
                self.answered(bytes, |reply| {
                    centimetres = reply.centimetres().or(centimetres);
                    centimetres.is_some()
                });
                match centimetres {
                    None => QuestionState::Nothing,
                    Some(true) => QuestionState::Good,
                    Some(false) => QuestionState::Bad("keeps sending inches; switch it off and on".into()),
                }
            }
            Question::List(_) => {
                let layout = self.layout;
                let mut is_right = true;
                let answered = self.answered(bytes, |reply| {
                    // An answer of another form is not judged; the length of the frames will show
                    // a wrong list.
                    is_right =
                        reply.output_list().is_none_or(|codes| codes.eq(layout.items().iter().map(|item| item.code())));
                    reply.header.command == b'O'
                });
                match (answered, is_right) {
                    (false, _) => QuestionState::Nothing,
                    (true, true) => QuestionState::Good,
                    (true, false) => QuestionState::Bad(
                        "was told what to send and says that it will send something else; switch it off and on".into(),
                    ),
                }
            }
            Question::Verify => {
                let Some(active) = self.hear_stations(bytes) else { return QuestionState::Nothing };
                match self.wrong.take() {
                    Some(wrong) => QuestionState::Bad(format!("{wrong}; its firmware may be of another kind")),
                    None => self.judge_stations(active),
                }
            }
        }
    }

    fn stream(&mut self, baud: Option<u32>) -> Vec<u8> {
        self.replay();
        let model = match self.tag {
            Tag::Liberty => "LIBERTY",
            Tag::Patriot => "PATRIOT",
            Tag::Latus => "Latus",
        };
        self.description.name = format!("{model} on {}", self.name);
        self.description.timing.wire_ns = wire_ns(self.layout.length(), baud);
        self.description.fields = baud.map(|baud| ("Baud".into(), baud.to_string())).into_iter().collect();
        [Command::Zero(Zeroed::Both).bytes(), Command::Stream.bytes()].concat()
    }

    fn replay(&mut self) {
        self.decoder.reformat(Liberty::new(MOST_STATIONS, self.layout));
        self.counters = Default::default();
    }

    fn decode(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>) {
        let Self { decoder, settings, counters, hz, lost, doubtful, .. } = self;
        decoder.feed(bytes, &mut |record, _| {
            let Record::Pose(pose) = record else { return };
            let (Some(position), Some(quaternion)) = (pose.position, pose.quaternion_wxyz) else { return };
            let Some(count) = pose.frame_count else { return };
            let station = pose.header.station;
            if !settings.stations.contains(&station) {
                return;
            }
            let counter = &mut counters[usize::from(station) - 1];
            let counted = counter.count(count, at_ns, *hz);
            if counted == Counted::Doubtful {
                *doubtful += 1;
                return;
            }
            if counter.since_first() < EARLY {
                return;
            }
            if let Counted::Next(missing) = counted {
                *lost += u64::from(missing);
            }
            let stamp = Stamp { host_ns: Some(at_ns), ticks: Some(u64::from(count)), ..Stamp::default() };
            let (position_cm, quaternion_wxyz) = (position.map(f64::from), quaternion.map(f64::from));
            found.push_back(Reading::Pose(Pose {
                stamp,
                station,
                position_cm,
                quaternion_wxyz,
                buttons: u8::from(settings.stylus == Some(station) && pose.stylus.is_some_and(|switch| switch != 0)),
                distortion: pose.distortion,
                code: (!pose.header.is_well()).then_some(pose.header.error),
                status: status_of(pose.header.error, &position_cm, &quaternion_wxyz),
            }));
        });
    }

    fn farewell(&self) -> &[u8] {
        b"P"
    }

    fn lost(&self) -> Lost {
        let losses = self.decoder.losses();
        Lost { readings: self.lost, refused: losses.refusals() + self.doubtful, skipped: losses.bytes_skipped }
    }

    fn describe(&self) -> &Description {
        &self.description
    }
}

/// Returns the status of a pose from its frame's error. Errors of commands and of the built-in
/// test alone do not invalidate the pose, but its numbers are checked.
pub fn status_of(error: u8, position_cm: &[f64; 3], quaternion_wxyz: &[f64; 4]) -> Status {
    let why = match error {
        b'a'..=b'g' => "a coil of the transmitter fails",
        b'A'..=b'G' => "a coil of the transmitter fails, and the built-in test found errors",
        b'u' => "outside the box that the unit's distortion map covers",
        _ if !crate::tracker::polhemus::is_pose(position_cm, quaternion_wxyz) => "impossible numbers for a pose",
        _ => return Status::Ok,
    };
    Status::Other(Cow::Borrowed(why))
}
