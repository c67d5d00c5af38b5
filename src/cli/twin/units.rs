//! The units that can be simulated, and their initial states.

use std::sync::{Arc, Mutex};

use clap::ValueEnum;

use drivers::arm::ea1::Framing;
use drivers::arm::qsb::register;
use drivers::simulated::{
    self, Faults, Joints, Machine, Motion, Simulated, ea1, fastrak, isotrak, liberty, microscribe, qsb, viper,
};
use drivers::tracker::polhemus::fastrak::Mode;

use crate::cli::Failure;

/// Codes of output lists: position, quaternion, and a list that another host may have set
/// instead.
const POSE: [u8; 2] = [2, 11];
const LIBERTY_POSE: [u8; 2] = [2, 7];
const OTHER: [u8; 3] = [2, 4, 1];
/// Possible remainder of a text record on a line.
const REST: &[u8] = b"2.34  -5.67   8.90\r\n";
/// Possible remainder of an arm's sample on a line.
const REST_OF_SAMPLE: &[u8] = b"00,1024,-300,65536,07*1E\r\n";

/// Unit to simulate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Unit {
    /// Polhemus ISOTRAK: one sensor
    Isotrak,
    /// Polhemus ISOTRAK II: two sensors
    Isotrak2,
    /// Polhemus FASTRAK: four sensors
    Fastrak,
    /// Polhemus LIBERTY: sixteen sensors
    Liberty,
    /// Polhemus PATRIOT: two sensors
    Patriot,
    /// Polhemus VIPER: sixteen sensors
    Viper,
    /// An arm with protocol EA1 (docs/ea1.md)
    Ea1,
    /// An arm of three US Digital QSBs, a terminal each
    Qsb,
    /// An arm on a MicroScribe's electronics
    Microscribe,
}

/// Initial state of a unit.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Found {
    /// Factory state, silent; an arm at home
    #[default]
    Quiet,
    /// Streaming, as another host left it
    Streaming,
    /// Streaming, in a mode and with contents that our drivers do not use
    WrongMode,
    /// Streaming, in inches
    Inches,
    /// Streaming, and the line begins in the middle of a record
    MidRecord,
    /// Streaming, and ignoring all commands but a restart
    Deaf,
    /// An arm that was never homed
    Unhomed,
}

/// Returns a value's name on the command line.
pub(super) fn name(value: impl ValueEnum) -> String {
    value.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned())
}

/// A terminal's name, and the twin on it.
pub(super) struct Port {
    pub(super) name: String,
    pub(super) machine: Arc<Mutex<dyn Machine>>,
}

/// State in which the unit was left.
pub(super) struct Left {
    pub(super) found: Found,
    /// Sensors in use.
    pub(super) stations: u8,
    /// Readings a second.
    pub(super) rate_hz: Option<u32>,
    pub(super) faults: Faults,
    pub(super) now_ns: i64,
}

impl Unit {
    /// Whether it is an arm.
    pub(super) fn is_arm(self) -> bool {
        matches!(self, Self::Ea1 | Self::Qsb | Self::Microscribe)
    }

    /// Returns the largest number of sensors.
    pub(super) fn most_stations(self) -> u8 {
        match self {
            Self::Isotrak | Self::Ea1 | Self::Qsb | Self::Microscribe => 1,
            Self::Isotrak2 | Self::Patriot => 2,
            Self::Fastrak => 4,
            Self::Liberty | Self::Viper => 16,
        }
    }

    /// Returns the possible initial states.
    pub(super) fn states(self) -> &'static [Found] {
        use Found::{Deaf, Inches, MidRecord, Quiet, Streaming, Unhomed, WrongMode};
        match self {
            Self::Ea1 => &[Quiet, Streaming, WrongMode, MidRecord, Unhomed],
            Self::Qsb => &[Quiet, Streaming, WrongMode],
            Self::Microscribe => &[Quiet, Streaming],
            _ => &[Quiet, Streaming, WrongMode, Inches, MidRecord, Deaf],
        }
    }

    /// Returns the possible initial rates, Hz; none if it has one only, or is polled for each
    /// reading.
    pub(super) fn rates(self) -> &'static [u32] {
        match self {
            Self::Liberty => &[60, 120, 240],
            Self::Viper => &[30, 60, 120, 240, 480, 960],
            Self::Ea1 => &[10, 25, 50, 100, 200],
            Self::Qsb => &[16, 32, 64, 128, 256],
            _ => &[],
        }
    }

    /// Creates the tracker in this state.
    pub(super) fn tracker(self, motion: Motion, left: &Left) -> Result<Vec<Port>, Failure> {
        let Left { found, stations, rate_hz, faults, now_ns } = *left;
        let talks = found != Found::Quiet;
        let text = matches!(found, Found::WrongMode | Found::Deaf);
        let centimetres = talks && found != Found::Inches;
        let mode = if talks && !text { Mode::Binary } else { Mode::Ascii };
        let list = |pose: [u8; 2]| if talks && !text { pose.to_vec() } else { OTHER.to_vec() };
        let plugged = ((1_u32 << stations) - 1) as u16;
        let deaf = found == Found::Deaf;
        fn port<M: simulated::Model + 'static>(unit: Unit, found: Found, mut twin: Simulated<M>, now_ns: i64) -> Port {
            if found == Found::MidRecord {
                twin.wire.send(REST, 0, now_ns);
            }
            Port { name: name(unit), machine: Arc::new(Mutex::new(twin)) }
        }
        Ok(vec![match self {
            Self::Isotrak | Self::Isotrak2 => {
                let mut twin = isotrak::Twin::new(motion, faults);
                (twin.mode, twin.centimetres, twin.continuous, twin.deaf) = (mode, centimetres, talks, deaf);
                twin.list = list(POSE);
                (twin.stations, twin.stuck) = ([true, stations > 1], self == Self::Isotrak);
                port(self, found, twin, now_ns)
            }
            Self::Fastrak => {
                let mut twin = fastrak::Twin::new(motion, faults);
                (twin.mode, twin.centimetres, twin.continuous, twin.deaf) = (mode, centimetres, talks, deaf);
                twin.lists = std::array::from_fn(|_| list(POSE));
                twin.stations = std::array::from_fn(|station| station < usize::from(stations));
                port(self, found, twin, now_ns)
            }
            Self::Liberty | Self::Patriot => {
                let new = if self == Self::Liberty { liberty::Twin::new } else { liberty::Twin::patriot };
                let mut twin = new(motion, faults);
                (twin.binary, twin.centimetres, twin.continuous, twin.deaf) =
                    (mode == Mode::Binary, centimetres, talks, deaf);
                (twin.list, twin.active) = (list(LIBERTY_POSE), plugged);
                twin.hz = rate_hz.map_or(twin.hz, f64::from);
                port(self, found, twin, now_ns)
            }
            Self::Viper => {
                let mut twin = viper::Twin::new(motion, faults);
                // Centimetres and quaternions; or degrees, and accelerations that our drivers do
                // not use.
                twin.units = [if centimetres { 2 } else { 0 }, if talks && !text { 2 } else { 0 }];
                (twin.continuous, twin.accelerations, twin.deaf) = (talks, text, deaf);
                twin.sensors = plugged;
                if let Some(at) = rate_hz.and_then(|hz| self.rates().iter().position(|rate| *rate == hz)) {
                    twin.rate = at as u32;
                }
                port(self, found, twin, now_ns)
            }
            Self::Ea1 | Self::Qsb | Self::Microscribe => {
                return Err(Failure::new("an arm is no tracker; choose a tracker"));
            }
        }])
    }

    /// Creates the arm in this state.
    pub(super) fn arm(self, joints: &Joints, counts_per_turn: u32, left: &Left) -> Result<Vec<Port>, Failure> {
        let Left { found, rate_hz, faults, now_ns, .. } = *left;
        let talks = !matches!(found, Found::Quiet | Found::Unhomed);
        let one = |machine: Arc<Mutex<dyn Machine>>| vec![Port { name: name(self), machine }];
        Ok(match self {
            Self::Ea1 => {
                let mut twin = ea1::Twin::new(Arc::clone(joints), faults);
                twin.counts_per_turn = [counts_per_turn; 3];
                twin.set_clock(now_ns, 0);
                twin.rate_hz = if talks { rate_hz.unwrap_or(100) } else { 0 };
                twin.homed = if found == Found::Unhomed { 0 } else { 7 };
                twin.framing = if found == Found::WrongMode { Framing::Blocks } else { Framing::Lines };
                if found == Found::MidRecord {
                    twin.wire.send(REST_OF_SAMPLE, 0, now_ns);
                }
                one(Arc::new(Mutex::new(twin)))
            }
            Self::Qsb => {
                let axis = |axis: usize| {
                    let mut twin = qsb::Twin::new(Arc::clone(joints), axis, faults);
                    twin.born_ns = now_ns;
                    twin.streams = talks;
                    twin.registers[usize::from(register::STREAM_INTERVAL)] = 512 / rate_hz.unwrap_or(128);
                    if found == Found::WrongMode {
                        twin.registers[usize::from(register::REPLY_FORMAT)] = 1;
                        twin.registers[usize::from(register::STREAM_THRESHOLD)] = 100;
                        twin.registers[usize::from(register::COUNT_MODE)] = 1;
                    }
                    Port { name: format!("{} axis {}", name(self), axis + 1), machine: Arc::new(Mutex::new(twin)) }
                };
                [0, 1, 2].map(axis).into()
            }
            Self::Microscribe => {
                let mut twin = microscribe::Twin::new(Arc::clone(joints), faults);
                if talks {
                    (twin.session, twin.wire.baud) = (microscribe::Session::Begun, 115_200);
                }
                one(Arc::new(Mutex::new(twin)))
            }
            _ => return Err(Failure::new("a tracker is no arm; choose an arm")),
        })
    }
}
