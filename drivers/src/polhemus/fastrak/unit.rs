//! Sets a FASTRAK up as it is found, and turns its records into readings.
//!
//! A unit keeps its settings while the host goes away and comes back: it may be found talking, in text or binary, in inches, in the midst of a record, at any of its
//! rates. So it is told to be quiet, waited for until it is, asked for its status; set up; and asked again, so that what counts is what it says and not what it was
//! told. Between settings that are the same as before nothing differs: setting up twice is harmless.

use std::borrow::Cow;
use std::collections::VecDeque;

use super::{Command, Fastrak, Layout, Mode, Record, Reply, STATIONS, Status as UnitStatus};
use crate::clock::{MS, SECOND};
use crate::connection::{Lost, Met, Protocol, Rung};
use crate::framing::Decoder;
use crate::polhemus::Settings;
use crate::reading::{Pose, Reading, Stamp, Status};
use crate::{Description, Error, Timing};

/// Rates that units were found at, the likeliest first.
const BAUDS: [u32; 5] = [115_200, 38_400, 19_200, 9_600, 57_600];
/// A unit that was told to be quiet and says nothing for so long is; two records of the slowest rate.
const QUIET: i64 = 70 * MS;
/// What a unit may take to be quiet, ns: it ends the record that it has begun, which takes 56 ms at 9600 for the longest usual one.
const HUSHED: i64 = 250 * MS;
/// What an answer may take, ns: a status takes 57 ms at 9600.
const ANSWER: i64 = 150 * MS;
/// So many rounds, at a known rate and of all rates, of which the last starts the unit anew: 13 to 18 s, longer than the 10 s that it takes to start.
const RESTARTS: [usize; 2] = [60, 16];
/// Without a record for so long the unit is silent, ns: many cycles of all stations.
const PATIENCE: i64 = 500 * MS;
/// Measurements a second, shared by the stations.
const CYCLES: f64 = 120.0;
/// From the middle of the measurement to the first byte (manual: latency without filters), ns.
const SAMPLING: i64 = 3_750_000;
/// Bits that a byte takes on the wire.
const BITS: i64 = 10;

/// Where the setting-up stands.
#[derive(Debug, Clone, PartialEq)]
enum Step {
    Rate,
    Hush,
    Hushed,
    AskStatus,
    Status,
    /// So many of the setting commands were sent.
    Configure(usize),
    /// Asked for the list of the station with this index, or at the end for the status.
    AskList(usize),
    List(usize),
    Stations,
    Verify,
    Stream,
    Fallen,
}

/// A FASTRAK on a line.
pub struct Unit {
    settings: Settings,
    /// The rate, if it is known.
    baud: Option<u32>,
    layouts: [Option<Layout>; STATIONS],
    decoder: Decoder<Fastrak>,
    step: Step,
    /// Rates tried since the last one that was answered at.
    tried: usize,
    /// The rate that was answered at last.
    found: Option<u32>,
    status: Option<UnitStatus>,
    /// What answers said that was not as asked for.
    wrong: Option<String>,
    description: Description,
    item: u64,
}

impl Unit {
    /// To be set up so. With a rate the unit is looked for at that rate only.
    ///
    /// # Errors
    /// [`Error::Misuse`] for settings that no FASTRAK has.
    pub fn new(name: &str, settings: Settings, baud: Option<u32>) -> Result<Self, Error> {
        settings.check(STATIONS as u8)?;
        let mode = if settings.binary { Mode::Binary } else { Mode::Ascii };
        let mut layouts = [None; STATIONS];
        for station in &settings.stations {
            let codes: &[u8] = if settings.stylus == Some(*station) { &[2, 11, 16, 1] } else { &[2, 11, 1] };
            let layout = Layout::new(mode, codes).map_err(|error| Error::Misuse(format!("tracker: {error}")))?;
            layouts[usize::from(*station) - 1] = Some(layout);
        }
        let rate_hz = Some(CYCLES / settings.stations.len() as f64);
        let timing = Timing { rate_hz, sampling_ns: SAMPLING, ..Timing::default() };
        let description = Description { name: format!("FASTRAK on {name}"), timing, ..Description::default() };
        Ok(Self {
            settings,
            baud,
            layouts,
            decoder: Decoder::new(Fastrak::replies()),
            step: Step::Rate,
            tried: 0,
            found: None,
            status: None,
            wrong: None,
            description,
            item: 0,
        })
    }

    fn rate(&self) -> u32 {
        self.baud.or(self.found.filter(|_| self.tried < 2)).unwrap_or(BAUDS[self.tried % BAUDS.len()])
    }

    /// Tries the next rate, or gives up for this time.
    fn next_rate(&mut self, why: &str) -> Rung {
        self.tried += 1;
        if self.tried.is_multiple_of(self.of_a_round()) {
            self.step = Step::Fallen;
            let at = match self.baud {
                Some(baud) => format!("{baud} bits a second"),
                None => BAUDS.map(|baud| baud.to_string()).join(", ") + " bits a second",
            };
            return Rung::Fall(format!(
                "{why} at {at}; check that the unit is switched on, its cable (null modem), and the rate of its switches"
            ));
        }
        self.step = Step::Rate;
        self.climb(Met::Begin)
    }

    /// Whether the unit is to be started anew in this attempt: now and then, as one that is only switched off answers sooner without.
    fn restarts(&self) -> bool {
        let rounds = RESTARTS[usize::from(self.baud.is_none())];
        self.settings.may_reset && (self.tried / self.of_a_round()) % rounds == rounds - 1
    }

    fn of_a_round(&self) -> usize {
        if self.baud.is_some() { 1 } else { BAUDS.len() }
    }

    /// What sets the unit up, in order.
    fn commands(&self) -> Vec<Command> {
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
        commands
    }

    /// Feeds what was heard to the decoder of replies; `take` says whether a reply is the one waited for.
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

    fn send(&mut self, command: Command, step: Step) -> Rung {
        self.step = step;
        Rung::Send(command.bytes())
    }

    fn ask(&mut self, command: Command, step: Step) -> Rung {
        self.decoder.reformat(Fastrak::replies());
        self.send(command, step)
    }

    /// The setting-up has failed at a rate that the unit answers at.
    fn failed(&mut self, why: String) -> Rung {
        self.step = Step::Fallen;
        Rung::Fall(why)
    }
}

impl Protocol for Unit {
    fn reset(&mut self) {
        // What was lost stays counted by who keeps the connection.
        self.decoder = Decoder::new(Fastrak::replies());
        self.step = Step::Rate;
        self.wrong = None;
    }

    fn resume(&mut self) {
        self.decoder = Decoder::new(Fastrak::new(self.layouts));
        self.item = 0;
    }

    fn climb(&mut self, met: Met<'_>) -> Rung {
        match (self.step.clone(), met) {
            (Step::Rate | Step::Fallen, _) => {
                self.step = Step::Hush;
                Rung::Baud(self.rate())
            }
            (Step::Hush, _) => {
                self.step = Step::Hushed;
                // At first alone; later with a line's end before it, as a command that others began and did not end may be the matter. A unit that was told to start
                // anew is asked as before: it answers when it is ready.
                let mut quiet = if self.tried > 0 { Command::EndLine.bytes() } else { Vec::new() };
                quiet.extend(if self.restarts() { Command::Reset.bytes() } else { Command::StopStream.bytes() });
                Rung::Send(quiet)
            }
            (Step::Hushed, Met::Done) => Rung::Hush { quiet_ns: QUIET, at_most_ns: HUSHED },
            (Step::Hushed, Met::Noisy) => self.next_rate("goes on talking"),
            (Step::Hushed, _) => self.ask(Command::Status, Step::AskStatus),
            (Step::AskStatus, _) => {
                self.step = Step::Status;
                Rung::Listen(ANSWER)
            }
            (Step::Status, Met::Heard(bytes)) => {
                let mut status = None;
                self.answered(bytes, |reply| {
                    status = reply.status().or(status);
                    status.is_some()
                });
                if status.is_none() {
                    return Rung::More;
                }
                (self.status, self.found, self.tried) = (status, Some(self.rate()), 0);
                self.step = Step::Configure(0);
                self.climb(Met::Done)
            }
            (Step::Status, _) => self.next_rate("does not answer"),
            (Step::Configure(sent), _) => {
                let commands = self.commands();
                match commands.get(sent) {
                    Some(command) => self.send(*command, Step::Configure(sent + 1)),
                    None => {
                        self.step = Step::AskList(0);
                        self.climb(Met::Done)
                    }
                }
            }
            (Step::AskList(index), _) => match self.settings.stations.get(index) {
                Some(station) => self.ask(Command::AskOutputList(*station), Step::List(index)),
                None => self.ask(Command::AskStations(Some(1)), Step::Stations),
            },
            (Step::List(_) | Step::Stations | Step::Verify, Met::Done) => Rung::Listen(ANSWER),
            (Step::List(index), Met::Heard(bytes)) => {
                let wanted = self.settings.stations.get(index).and_then(|s| self.layouts[usize::from(*s) - 1]);
                let mut is_right = false;
                let answered = self.answered(bytes, |reply| {
                    let Some(codes) = reply.output_list() else { return false };
                    is_right = wanted.is_some_and(|w| codes.eq(w.entries().iter().map(|entry| entry.code())));
                    true
                });
                match (answered, is_right) {
                    (false, _) => Rung::More,
                    (true, true) => {
                        self.step = Step::AskList(index + 1);
                        self.climb(Met::Done)
                    }
                    (true, false) => self.failed(
                        "was told what to send and says that it will send something else; switch it off and on".into(),
                    ),
                }
            }
            (Step::Stations, Met::Heard(bytes)) => {
                let wanted: [bool; STATIONS] = std::array::from_fn(|s| self.layouts[s].is_some());
                let mut stations = None;
                self.answered(bytes, |reply| {
                    stations = reply.stations().or(stations);
                    stations.is_some()
                });
                match stations {
                    None => Rung::More,
                    Some(stations) if stations == wanted => self.ask(Command::Status, Step::Verify),
                    Some(stations) => {
                        let missing: Vec<String> = (0..STATIONS)
                            .filter(|s| wanted[*s] && !stations[*s])
                            .map(|s| (s + 1).to_string())
                            .collect();
                        self.failed(match missing.is_empty() {
                            true => "keeps stations in use that were not asked for; switch it off and on".into(),
                            false => format!(
                                "does not use station {}; plug its sensor in, and check the station's switch",
                                missing.join(", ")
                            ),
                        })
                    }
                }
            }
            (Step::Verify, Met::Heard(bytes)) => {
                let mut status = None;
                self.answered(bytes, |reply| {
                    status = reply.status().or(status);
                    status.is_some()
                });
                let Some(status) = status else { return Rung::More };
                self.status = Some(status);
                let is_right = status.binary == self.settings.binary && status.centimetres && !status.continuous;
                if !is_right {
                    let said = self.wrong.clone().unwrap_or_else(|| "has not taken its settings".into());
                    return self.failed(format!("{said}; switch it off and on"));
                }
                if let Some(wrong) = self.wrong.take() {
                    return self.failed(format!("{wrong}; its firmware may be of another kind"));
                }
                self.decoder.reformat(Fastrak::new(self.layouts));
                self.send(Command::Stream, Step::Stream)
            }
            (Step::List(_) | Step::Stations | Step::Verify, _) => {
                self.failed("answered at first and then no more; check its cable".into())
            }
            (Step::Stream, _) => {
                let lengths = self.layouts.iter().flatten().map(Layout::length);
                let bytes = lengths.max().unwrap_or(0) as i64;
                self.description.timing.wire_ns = bytes * BITS * SECOND / i64::from(self.rate());
                if let Some(status) = &self.status {
                    let words = |text: &[u8]| String::from_utf8_lossy(text).trim().to_owned();
                    self.description.fields = vec![
                        ("Identity".into(), words(&status.identity)),
                        ("Firmware".into(), words(&status.version)),
                        ("Baud".into(), self.rate().to_string()),
                    ];
                }
                Rung::Top { keep: false }
            }
        }
    }

    fn take(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>) {
        let item = &mut self.item;
        self.decoder.feed(bytes, &mut |record, _| {
            let Record::Pose(pose) = record else { return };
            let (Some(position_cm), Some(quaternion_wxyz)) = (pose.position, pose.quaternion_wxyz) else { return };
            let stamp = Stamp { item: *item, host_ns: Some(at_ns), ..Stamp::default() };
            *item += 1;
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

    fn patience_ns(&self) -> i64 {
        PATIENCE
    }

    fn farewell(&self) -> &[u8] {
        b"c"
    }

    fn lost(&self) -> Lost {
        let losses = self.decoder.losses();
        // A unit without a counter does not tell what it did not send.
        Lost { readings: 0, refused: losses.refusals(), skipped: losses.bytes_skipped }
    }

    fn describe(&self) -> &Description {
        &self.description
    }
}

/// What a record's error letter says of its pose. The letter is that of the last error found and may be older than the record: what concerns the unit and not the pose
/// does not spoil it.
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
