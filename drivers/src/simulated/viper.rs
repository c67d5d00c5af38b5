//! A virtual VIPER: any units, up to sixteen sensors, answers and checksums for everything, as
//! its last user left it.

use sonoweave_core::clock::SECOND;

use super::unit::{Model, Obeyed, Simulated, UnitAction, euler_deg, reported_cm};
use super::{Faults, Motion, Placed};
use crate::framing::{Format, Parsed};
use crate::tracker::polhemus::viper::command::{Action, Reply, code};
use crate::tracker::polhemus::viper::write::FrameToWrite;
use crate::tracker::polhemus::viper::{self, MOST_SENSORS, OrientationUnit, PositionUnit, Record, Sensor};

/// Time from the middle of the measurement to the first byte, ns: not documented, so none here.
pub const SAMPLING_NS: i64 = 0;
/// Time of a restart, ns.
const RESET: i64 = 10 * SECOND;
/// Number of the unit.
const UNIT: u32 = 7;
const POSITION_UNITS: [(PositionUnit, f64); 4] = [
    (PositionUnit::Inches, 1.0 / 2.54),
    (PositionUnit::Feet, 1.0 / 30.48),
    (PositionUnit::Centimetres, 1.0),
    (PositionUnit::Metres, 0.01),
];
const ORIENTATION_UNITS: [OrientationUnit; 3] =
    [OrientationUnit::EulerDegrees, OrientationUnit::EulerRadians, OrientationUnit::Quaternion];
/// Frame rates by their number, in frames per second.
const RATES: [f64; 6] = [30.0, 60.0, 120.0, 240.0, 480.0, 960.0];

/// The unit on its line.
pub type Twin = Simulated<Viper>;

/// The unit. Its fields are the state in which it was left.
#[derive(Default)]
pub struct Viper {
    /// Numbers of the units of positions and of orientations.
    pub units: [u32; 2],
    /// Number of the rate.
    pub rate: u32,
    /// Frames are sent continuously.
    pub continuous: bool,
    /// Accelerations are sent too.
    pub accelerations: bool,
    /// Connected sensors, one bit each.
    pub sensors: u16,
    /// Zenith of the hemisphere of all sensors: a sensor in the other one is reported on its
    /// opposite side.
    pub hemisphere: [f32; 3],
    /// It follows its sensors instead.
    pub tracks: bool,
    /// Level of its filters.
    pub filter: u32,
    /// It sends nothing unless a sensor has moved.
    pub increment: bool,
    /// Orientations are relative to a stored one.
    pub boresight: bool,
    /// Offset of the tips, cm.
    pub tip_cm: f64,
    /// Result of its built-in test.
    pub test: u8,
    /// Distortion level.
    pub distortion: u8,
    /// State of the buttons.
    pub buttons: u8,
    /// Frame count after it is set to 0, for testing its wrap.
    pub zero: u32,
    /// Numbers of the commands that it refuses.
    pub refuses: Vec<u32>,
    /// It obeys only a restart.
    pub deaf: bool,
    frame: u32,
}

impl Twin {
    /// Creates a unit in its factory state: inches, degrees, 240 Hz, one sensor, quiet.
    pub fn new(motion: Motion, faults: Faults) -> Self {
        let unit = Viper { rate: 3, sensors: 1, hemisphere: [1.0, 0.0, 0.0], filter: 1, ..Viper::default() };
        Self::of(unit, motion, faults)
    }
}

/// A command as the unit reads it; [`word`](Self::word) gives the words of its payload by index.
struct CommandWords<'a> {
    command: u32,
    action: Action,
    mode: u32,
    payload: &'a [u8],
}

impl CommandWords<'_> {
    fn word(&self, index: usize) -> Option<u32> {
        self.payload.as_chunks::<4>().0.get(index).map(|word| u32::from_le_bytes(*word))
    }
}

impl Viper {
    /// Obeys a command and returns the answer; `None` if the command is wrong.
    fn command(&mut self, words: &CommandWords<'_>) -> Option<Vec<u8>> {
        let mut answer = Vec::new();
        match (words.command, words.action) {
            (code::UNITS, Action::Set) => {
                let units = [words.word(0)?, words.word(1)?];
                let known = units[0] < POSITION_UNITS.len() as u32 && units[1] < ORIENTATION_UNITS.len() as u32;
                self.units = known.then_some(units)?;
            }
            (code::UNITS, Action::Get) => answer.extend(self.units.map(u32::to_le_bytes).concat()),
            (code::FRAME_RATE, Action::Set) => self.rate = words.word(0).filter(|rate| *rate < RATES.len() as u32)?,
            (code::FRAME_RATE, Action::Get) => answer.extend(self.rate.to_le_bytes()),
            (code::HEMISPHERE, Action::Set) => {
                self.tracks = words.word(0)? & 1 != 0;
                self.hemisphere = [1, 2, 3].map(|index| words.word(index).map_or(0.0, f32::from_bits));
            }
            (code::FILTER, Action::Set) => self.filter = words.word(0)?,
            (code::TIP_OFFSET, Action::Reset) => self.tip_cm = 0.0,
            (code::INCREMENT, Action::Reset) => self.increment = false,
            (code::BORESIGHT, Action::Reset) => self.boresight = false,
            (code::STATION_MAP, Action::Get) => answer.extend((u32::from(self.sensors) | 1 << 24).to_le_bytes()),
            (code::WHO_AM_I, Action::Get) => answer.extend(b"A virtual VIPER\0"),
            (code::CONTINUOUS_PNO, Action::Set) => {
                (self.continuous, self.accelerations) = (true, words.mode == 1);
                if words.word(0)? == 0 {
                    self.frame = self.zero;
                }
            }
            (code::CONTINUOUS_PNO, Action::Reset) => self.continuous = false,
            _ => return None,
        }
        Some(answer)
    }

    fn obey_command(&mut self, command: &Reply<'_>) -> Obeyed {
        let done = |is_command, action| Obeyed { taken: 0, is_command, action };
        let Some(action) = command.action() else { return done(false, UnitAction::Nothing) };
        let mode = command.arguments[1];
        let words = CommandWords { command: command.command, action, mode, payload: command.payload };
        match (words.command, action) {
            (code::INITIALIZE, Action::Set) => {
                self.deaf = false;
                (self.units, self.continuous, self.frame) = ([0, 0], false, self.zero);
                return done(true, UnitAction::Rest(RESET));
            }
            _ if self.deaf => return done(false, UnitAction::Nothing),
            (code::SINGLE_PNO, Action::Get) => return done(true, UnitAction::Poll),
            _ => {}
        }
        let answer = if self.refuses.contains(&words.command) { None } else { self.command(&words) };
        let is_command = answer.is_some();
        let (action, payload) = match answer {
            Some(payload) => (Action::Ack, payload),
            None => {
                let mut refusal = Vec::new();
                Reply::write_nak(2, "no such command", &mut refusal);
                (Action::Nak, refusal)
            }
        };
        let mut bytes = Vec::new();
        Reply { unit: UNIT, action: action as u32, payload: &payload, ..*command }.write(&mut bytes);
        let streams = is_command && self.continuous && words.command == code::CONTINUOUS_PNO;
        done(is_command, if streams { UnitAction::Stream(bytes) } else { UnitAction::Send(bytes) })
    }

    /// Returns the measurement of the sensor with this index, as the unit reports it.
    fn sensor(&self, index: u8, placed: Placed) -> Sensor {
        let Placed { position_cm, quaternion_wxyz: q } = placed;
        let (position_unit, scale) = POSITION_UNITS[self.units[0] as usize];
        let orientation_unit = ORIENTATION_UNITS[self.units[1] as usize];
        let zenith = if self.tracks { [0.0; 3] } else { self.hemisphere };
        let q = if self.boresight { [1.0, 0.0, 0.0, 0.0] } else { q };
        let [azimuth, elevation, roll] = euler_deg(q);
        let orientation = match orientation_unit {
            OrientationUnit::Quaternion => q,
            OrientationUnit::EulerRadians => [azimuth.to_radians(), elevation.to_radians(), roll.to_radians(), 0.0],
            _ => [azimuth, elevation, roll, 0.0],
        };
        Sensor {
            sensor: index,
            is_virtual: false,
            position_unit,
            orientation_unit,
            buttons: self.buttons,
            distortion: self.distortion,
            auxiliary: 0,
            position: reported_cm(zenith, position_cm).map(|x| ((x + self.tip_cm) * scale) as f32),
            orientation: orientation.map(|x| x as f32),
            acceleration: self.accelerations.then_some([0.0; 4]),
        }
    }
}

impl Model for Viper {
    const SAMPLING_NS: i64 = SAMPLING_NS;

    fn continuous(&self) -> bool {
        self.continuous
    }

    fn cycles_hz(&self) -> f64 {
        RATES[self.rate as usize]
    }

    fn obey(&mut self, input: &[u8]) -> Option<Obeyed> {
        // The format is cloned because its records borrow from it; with checksums it has no state
        // to keep.
        match viper::Viper::new(MOST_SENSORS).parse(input) {
            Parsed::Record { length, record: Record::Reply(command) } => {
                Some(Obeyed { taken: length, ..self.obey_command(&command) })
            }
            Parsed::Record { length: taken, .. } | Parsed::Skip { bytes: taken, .. } => {
                Some(Obeyed { taken, is_command: false, action: UnitAction::Nothing })
            }
            Parsed::Short => None,
        }
    }

    fn measure(&mut self, see: &dyn Fn(u8) -> Placed) -> Vec<Vec<u8>> {
        let present = (0..MOST_SENSORS as u8).filter(|index| self.sensors >> index & 1 != 0);
        let sensors: Vec<Sensor> = present.map(|index| self.sensor(index, see(index + 1))).collect();
        let frame_count = self.frame;
        self.frame = self.frame.wrapping_add(1);
        if self.increment {
            return Vec::new();
        }
        let mut frame = Vec::new();
        let (accelerations, test) = (self.accelerations && self.continuous, self.test);
        FrameToWrite { unit: UNIT, frame_count, accelerations, test, sensors: &sensors }.write(&mut frame);
        vec![frame]
    }
}
