//! A virtual ISOTRAK II: text or packed binary, inches or cm, two stations that share a list, as
//! its last user left it.

use sonoweave_core::clock::SECOND;

use super::unit::{Model, Obeyed, Simulated, UnitAction, cosines, euler_deg, reported_cm};
use super::{Faults, Motion, Placed};
use crate::tracker::polhemus::fastrak::write::write_error;
use crate::tracker::polhemus::fastrak::{self, Command, Mode};
use crate::tracker::polhemus::isotrak::{self, CM_PER_COUNT, UNIT_PER_COUNT};

/// Time from the middle of the measurement to the first byte, ns: not documented, so none here.
pub const SAMPLING_NS: i64 = 0;
/// Cycles per second, shared by the stations in use.
const CYCLES: f64 = 60.0;
const STATIONS: usize = isotrak::STATIONS as usize;
const CM_PER_INCH: f64 = 2.54;
/// Time of a restart, ns.
const RESET: i64 = 20 * SECOND;

/// The unit on its line.
pub type Twin = Simulated<Isotrak>;

/// The unit. Its fields are the state in which it was left.
pub struct Isotrak {
    /// Text, or packed binary.
    pub mode: Mode,
    /// Positions in cm, else in inches; in text only.
    pub centimetres: bool,
    /// Records are sent continuously.
    pub continuous: bool,
    /// Output codes of both stations.
    pub list: Vec<u8>,
    /// Stations in use.
    pub stations: [bool; STATIONS],
    /// It enables no further station.
    pub stuck: bool,
    /// Zenith of each station's hemisphere: a sensor in the other one is reported on its opposite
    /// side.
    pub hemispheres: [[f32; 3]; STATIONS],
    /// Error letter, or stylus switch, of each station.
    pub errors: [u8; STATIONS],
    /// It obeys only a restart.
    pub deaf: bool,
}

impl Twin {
    /// Creates a unit in its factory state: 115200 bits per second, text, inches, one station,
    /// quiet.
    pub fn new(motion: Motion, faults: Faults) -> Self {
        let unit = Isotrak {
            mode: Mode::Ascii,
            centimetres: false,
            continuous: false,
            list: vec![2, 4, 1],
            stations: [true, false],
            stuck: false,
            hemispheres: [[1.0, 0.0, 0.0]; STATIONS],
            errors: [b' '; STATIONS],
            deaf: false,
        };
        Self::of(unit, motion, faults)
    }
}

impl Isotrak {
    fn active(&self) -> impl Iterator<Item = usize> + '_ {
        (0..STATIONS).filter(|s| self.stations[*s])
    }

    /// Returns the record of the station with this index.
    fn record(&self, index: usize, placed: Placed) -> Option<Vec<u8>> {
        let Placed { position_cm, quaternion_wxyz: q } = placed;
        let position = reported_cm(self.hemispheres[index], position_cm);
        // Two stations at most.
        let (station, error) = (index as u8 + 1, self.errors[index]);
        let mut record = Vec::new();
        match self.mode {
            Mode::Ascii => {
                let unit = if self.centimetres { 1.0 } else { 1.0 / CM_PER_INCH };
                let pose = fastrak::Pose {
                    position: Some(position.map(|x| x * unit)),
                    quaternion_wxyz: Some(q),
                    euler_deg: Some(euler_deg(q)),
                    cosines: cosines(q).map(Some),
                    ..fastrak::Pose::empty(station, error)
                };
                pose.write(&fastrak::Layout::new(Mode::Ascii, &self.list).ok()?, &mut record);
            }
            Mode::Binary => {
                // The casts saturate, as full scale does.
                let unit = |x: f64| (x / UNIT_PER_COUNT).round() as i16;
                let pose = isotrak::Pose {
                    position_counts: Some(position.map(|x| (x / CM_PER_COUNT).round() as i16)),
                    quaternion_wxyz_counts: Some(q.map(unit)),
                    euler_counts: Some(euler_deg(q).map(|x| (x / isotrak::DEGREES_PER_COUNT).round() as i16)),
                    cosine_counts: cosines(q).map(|row| Some(row.map(unit))),
                    ..isotrak::Pose::empty(station, error)
                };
                pose.write(&isotrak::Layout::new(&self.list).ok()?, &mut record);
            }
        }
        Some(record)
    }

    fn command(&mut self, command: Command) -> UnitAction {
        let station = |s: u8| usize::from(s) - 1;
        match command {
            Command::Poll => return UnitAction::Poll,
            Command::Stream => {
                self.continuous = true;
                return UnitAction::Stream(Vec::new());
            }
            Command::StopStream => self.continuous = false,
            Command::Mode(mode) => self.mode = mode,
            Command::Centimetres => self.centimetres = true,
            Command::Inches => self.centimetres = false,
            // The layout of the 16 bytes in between is unknown.
            Command::Status => return UnitAction::Send(b"21S0000  I2  4.0  0\r\n".to_vec()),
            Command::Station(s, on) if station(s) < STATIONS => self.stations[station(s)] = on && !self.stuck,
            Command::AskStations(None) => {
                let digits = self.stations.map(|on| if on { b'1' } else { b'0' });
                return UnitAction::Send([&b"2?l"[..], &digits, b"\r\n"].concat());
            }
            Command::Hemisphere(s, zenith) if station(s) < STATIONS => self.hemispheres[station(s)] = zenith,
            Command::Reset => {
                self.deaf = false;
                (self.mode, self.centimetres, self.continuous) = (Mode::Ascii, false, false);
                self.list = vec![2, 4, 1];
                return UnitAction::Rest(RESET);
            }
            _ => {}
        }
        UnitAction::Nothing
    }

    /// Sets the output list; `O` has no station here.
    fn output_list(&mut self, line: &[u8]) -> Option<UnitAction> {
        let codes = std::str::from_utf8(line).ok()?.split(',').map(|code| code.parse().ok());
        let codes: Vec<u8> = codes.collect::<Option<_>>()?;
        isotrak::Layout::new(&codes).ok()?;
        self.list = codes;
        Some(UnitAction::Nothing)
    }
}

fn refusal(code: i32) -> UnitAction {
    let mut answer = Vec::new();
    write_error(code, &mut answer);
    UnitAction::Send(answer)
}

impl Model for Isotrak {
    const SAMPLING_NS: i64 = SAMPLING_NS;

    fn continuous(&self) -> bool {
        self.continuous
    }

    fn cycles_hz(&self) -> f64 {
        // Each cycle measures one of the stations in use, in turn; here they are sent together.
        CYCLES / self.active().count().max(1) as f64
    }

    fn obey(&mut self, input: &[u8]) -> Option<Obeyed> {
        if let [b'O', rest @ ..] = input {
            let end = rest.iter().position(|byte| *byte == b'\r')?;
            let done = if self.deaf { Some(UnitAction::Nothing) } else { self.output_list(&rest[..end]) };
            let is_command = done.is_some() && !self.deaf;
            return Some(Obeyed { taken: end + 2, is_command, action: done.unwrap_or_else(|| refusal(-3)) });
        }
        let (read, taken) = Command::read(input)?;
        Some(match read {
            Ok(command) if self.deaf && command != Command::Reset => {
                Obeyed { taken, is_command: false, action: UnitAction::Nothing }
            }
            Ok(command) => Obeyed { taken, is_command: true, action: self.command(command) },
            Err(not) => Obeyed { taken, is_command: false, action: refusal(not.code()) },
        })
    }

    fn measure(&mut self, see: &dyn Fn(u8) -> Placed) -> Vec<Vec<u8>> {
        self.active().filter_map(|index| self.record(index, see(index as u8 + 1))).collect()
    }
}
