//! A virtual FASTRAK: text or binary, inches or cm, up to four stations, as its last user left
//! it.

use sonoweave_core::clock::SECOND;

use super::unit::{Model, Obeyed, Simulated, UnitAction, cosines, euler_deg, reported_cm};
use super::{Faults, Motion, Placed};
use crate::tracker::polhemus::fastrak::write::{write_error, write_output_list, write_stations};
use crate::tracker::polhemus::fastrak::{Command, Layout, Mode, Pose, STATIONS, Status};

/// Time from the middle of the measurement to the first byte, ns.
pub const SAMPLING_NS: i64 = 3_750_000;
/// Cycles per second, shared by the stations in use.
const CYCLES: f64 = 120.0;
const CM_PER_INCH: f64 = 2.54;
/// Time of a restart, ns.
const RESET: i64 = 10 * SECOND;

/// The unit on its line.
pub type Twin = Simulated<Fastrak>;

/// The unit. Its fields are the state in which it was left.
pub struct Fastrak {
    /// Text or binary.
    pub mode: Mode,
    /// Positions in cm, else in inches.
    pub centimetres: bool,
    /// Records are sent continuously.
    pub continuous: bool,
    /// Output codes of each station.
    pub lists: [Vec<u8>; STATIONS],
    /// Stations in use.
    pub stations: [bool; STATIONS],
    /// Zenith of each station's hemisphere: a sensor in the other one is reported on its opposite
    /// side.
    pub hemispheres: [[f32; 3]; STATIONS],
    /// Error letter of each station.
    pub errors: [u8; STATIONS],
    /// It obeys only a restart.
    pub deaf: bool,
}

impl Twin {
    /// Creates a unit in its factory state: 115200 bits per second, text, inches, one station,
    /// quiet.
    pub fn new(motion: Motion, faults: Faults) -> Self {
        let unit = Fastrak {
            mode: Mode::Ascii,
            centimetres: false,
            continuous: false,
            lists: std::array::from_fn(|_| vec![2, 4, 1]),
            stations: [true, false, false, false],
            hemispheres: [[1.0, 0.0, 0.0]; STATIONS],
            errors: [b' '; STATIONS],
            deaf: false,
        };
        Self::of(unit, motion, faults)
    }
}

impl Fastrak {
    fn active(&self) -> impl Iterator<Item = usize> + '_ {
        (0..STATIONS).filter(|s| self.stations[*s])
    }

    /// Returns the measurement of the station with this index, as the unit reports it.
    fn pose(&self, station: usize, placed: Placed) -> Pose {
        let Placed { position_cm, quaternion_wxyz: q } = placed;
        let unit = if self.centimetres { 1.0 } else { 1.0 / CM_PER_INCH };
        // Four stations at most.
        let mut pose = Pose::empty(station as u8 + 1, self.errors[station]);
        pose.position = Some(reported_cm(self.hemispheres[station], position_cm).map(|x| x * unit));
        pose.quaternion_wxyz = Some(q);
        pose.euler_deg = Some(euler_deg(q));
        pose.cosines = cosines(q).map(Some);
        pose.stylus = Some(*b" 0");
        pose
    }

    fn layout(&self, station: usize) -> Option<Layout> {
        Layout::new(self.mode, &self.lists[station]).ok()
    }

    fn command(&mut self, command: Command) -> UnitAction {
        let mut answer = Vec::new();
        let station = |s: u8| usize::from(s) - 1;
        match command {
            Command::Poll => return UnitAction::Poll,
            Command::Stream => {
                self.continuous = true;
                return UnitAction::Stream(answer);
            }
            Command::StopStream => self.continuous = false,
            Command::Mode(mode) => self.mode = mode,
            Command::Centimetres => self.centimetres = true,
            Command::Inches => self.centimetres = false,
            Command::Status => self.status().write(&mut answer),
            Command::OutputList(of, layout) => {
                let codes: Vec<u8> = layout.entries().iter().map(|entry| entry.code()).collect();
                match of {
                    Some(s) => self.lists[station(s)] = codes,
                    None => self.lists = std::array::from_fn(|_| codes.clone()),
                }
            }
            Command::AskOutputList(s) => {
                if let Some(layout) = self.layout(station(s)) {
                    write_output_list(s, &layout, &mut answer);
                }
            }
            Command::Station(s, on) => self.stations[station(s)] = on,
            Command::AskStations(_) => write_stations(1, self.stations, &mut answer),
            Command::Hemisphere(s, zenith) => self.hemispheres[station(s)] = zenith,
            Command::Reset => {
                self.deaf = false;
                (self.mode, self.centimetres, self.continuous) = (Mode::Ascii, false, false);
                self.lists = std::array::from_fn(|_| vec![2, 4, 1]);
                return UnitAction::Rest(RESET);
            }
            _ => {}
        }
        if answer.is_empty() { UnitAction::Nothing } else { UnitAction::Send(answer) }
    }

    fn status(&self) -> Status {
        Status {
            station: b'1',
            binary: self.mode == Mode::Binary,
            centimetres: self.centimetres,
            compensated: false,
            continuous: self.continuous,
            configured: false,
            test: *b"   ",
            model: *b"  F3 1",
            version: *b" 3.11 ",
            identity: *b"A virtual FASTRAK               ",
        }
    }
}

impl Model for Fastrak {
    const SAMPLING_NS: i64 = SAMPLING_NS;

    fn continuous(&self) -> bool {
        self.continuous
    }

    fn cycles_hz(&self) -> f64 {
        // Each cycle measures one of the stations in use, in turn; here they are sent together.
        CYCLES / self.active().count().max(1) as f64
    }

    fn obey(&mut self, input: &[u8]) -> Option<Obeyed> {
        let (read, taken) = Command::read(input)?;
        Some(match read {
            Ok(command) if self.deaf && command != Command::Reset => {
                Obeyed { taken, is_command: false, action: UnitAction::Nothing }
            }
            Ok(command) => Obeyed { taken, is_command: true, action: self.command(command) },
            Err(not) => {
                let mut answer = Vec::new();
                write_error(not.code(), &mut answer);
                Obeyed { taken, is_command: false, action: UnitAction::Send(answer) }
            }
        })
    }

    fn measure(&mut self, see: &dyn Fn(u8) -> Placed) -> Vec<Vec<u8>> {
        let mut records = Vec::new();
        for station in self.active() {
            let Some(layout) = self.layout(station) else { continue };
            let mut record = Vec::new();
            self.pose(station, see(station as u8 + 1)).write(&layout, &mut record);
            records.push(record);
        }
        records
    }
}
