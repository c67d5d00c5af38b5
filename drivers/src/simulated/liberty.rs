//! A virtual LIBERTY, PATRIOT or Latus: text or binary, inches or cm, wrong first frames, its
//! buffer on, as its last user left it.

use sonoweave_core::clock::SECOND;

use super::unit::{Model, Obeyed, Simulated, UnitAction, cosines, euler_deg, reported_cm};
use super::{Faults, Motion, Placed};
use crate::tracker::polhemus::liberty::command::{ACTIVE_STATIONS, Command, Rate, Stations};
use crate::tracker::polhemus::liberty::{Header, Layout, MOST_STATIONS, Pose, Reply, Tag};

/// Time from the middle of the measurement to the first byte, ns.
pub const SAMPLING_NS: i64 = 3_500_000;
const CM_PER_INCH: f64 = 2.54;
/// Time of a restart, ns.
const RESET: i64 = 10 * SECOND;
/// Bytes that its buffer collects before USB sends any.
const BUFFER: usize = 2300;
const STATIONS: usize = MOST_STATIONS as usize;

/// The unit on its line.
pub type Twin = Simulated<Liberty>;

/// The unit. Its fields are the state in which it was left.
#[derive(Default)]
pub struct Liberty {
    /// Model. A PATRIOT has one rate and no buffer.
    pub tag: Tag,
    /// Binary, else text.
    pub binary: bool,
    /// Positions in cm, else in inches.
    pub centimetres: bool,
    /// Frames are sent continuously.
    pub continuous: bool,
    /// Frames per second.
    pub hz: f64,
    /// Output codes of all stations.
    pub list: Vec<u8>,
    /// Stations with a connected sensor, one bit each.
    pub active: u16,
    /// Zenith of each station's hemisphere: a sensor in the other one is reported on its opposite
    /// side.
    pub hemispheres: [[f32; 3]; STATIONS],
    /// Error of each station.
    pub errors: [u8; STATIONS],
    /// Distortion level that it reports.
    pub distortion: i32,
    /// Stylus switch.
    pub switch: i32,
    /// Filters of position and attitude.
    pub filters: [[f32; 4]; 2],
    /// Frames are collected before they are sent. Only over USB.
    pub buffers: bool,
    /// Commands are echoed.
    pub echoes: bool,
    /// Frame count after it is set to 0, for testing its wrap.
    pub zero: u32,
    /// Number of wrong frames after a start: they show the sensor at a wrong position.
    pub early: u32,
    /// Number of starts that it ignores.
    pub stubborn: u32,
    /// It obeys only a restart.
    pub deaf: bool,
    frame: u32,
    since_start: u32,
}

impl Twin {
    /// Creates a LIBERTY in its factory state: 115200 bits per second, text, inches, 240 Hz, one
    /// sensor, quiet.
    pub fn new(motion: Motion, faults: Faults) -> Self {
        let unit = Liberty {
            hz: 240.0,
            list: vec![2, 4, 1],
            active: 1,
            hemispheres: [[1.0, 0.0, 0.0]; STATIONS],
            filters: [[0.2, 0.2, 0.8, 0.95]; 2],
            buffers: true,
            early: 10,
            ..Liberty::default()
        };
        Self::of(unit, motion, faults)
    }

    /// Creates a PATRIOT: 60 Hz, two stations.
    pub fn patriot(motion: Motion, faults: Faults) -> Self {
        let mut twin = Self::new(motion, faults);
        (twin.tag, twin.hz, twin.buffers) = (Tag::Patriot, 60.0, false);
        twin
    }
}

impl Liberty {
    fn reply(&self, station: u8, command: u8, error: u8, body: &[u8]) -> UnitAction {
        let mut answer = Vec::new();
        if self.binary {
            Reply { header: Header { tag: self.tag, station, command, error }, body }.write(&mut answer);
        } else {
            let error = if error == 0 { b' ' } else { b'0' + error };
            answer.extend(format!("{station:02}").bytes());
            answer.extend([command, error, b' ']);
            answer.extend(body.escape_ascii());
            answer.extend(b"\r\n");
        }
        UnitAction::Send(answer)
    }

    fn command(&mut self, command: Command) -> UnitAction {
        let is_patriot = self.tag == Tag::Patriot;
        match command {
            Command::Poll => {
                self.continuous = false;
                return UnitAction::Poll;
            }
            Command::Stream if self.stubborn > 0 => self.stubborn -= 1,
            Command::Stream => {
                (self.continuous, self.since_start) = (true, 0);
                return UnitAction::Stream(Vec::new());
            }
            Command::Binary(on) => self.binary = on,
            Command::Centimetres(on) => self.centimetres = on,
            Command::AskUnits => return self.reply(0, b'U', 0, &u32::from(self.centimetres).to_le_bytes()),
            Command::Rate(_) if is_patriot => return self.reply(0, b'R', 1, b""),
            Command::Rate(Rate::Hz60) => self.hz = 60.0,
            Command::Rate(Rate::Hz120) => self.hz = 120.0,
            Command::Rate(Rate::Hz240) => self.hz = 240.0,
            Command::OutputList(_, layout) => self.list = layout.items().iter().map(|item| item.code()).collect(),
            Command::AskOutputList(station) => {
                let codes = self.list.iter().map(|code| i32::from(*code)).chain([-1]);
                let body: Vec<u8> = codes.flat_map(i32::to_le_bytes).collect();
                return self.reply(station, b'O', 0, &body);
            }
            Command::Zero(_) => self.frame = self.zero,
            Command::Hemisphere(Stations::All, zenith) => self.hemispheres = [zenith; STATIONS],
            Command::Hemisphere(Stations::One(s), zenith) => self.hemispheres[usize::from(s) - 1] = zenith,
            Command::PositionFilter(filter) => self.filters[0] = filter,
            Command::AttitudeFilter(filter) => self.filters[1] = filter,
            Command::UsbBuffer(_) if is_patriot => return self.reply(0, b'@', 1, b""),
            Command::UsbBuffer(on) => self.buffers = on,
            Command::AskActiveStations => {
                let body = [self.active.to_le_bytes(), self.active.to_le_bytes()].concat();
                return self.reply(0, ACTIVE_STATIONS, 0, &body);
            }
            Command::Echo(on) => self.echoes = on,
            Command::Reset => {
                self.deaf = false;
                (self.binary, self.centimetres, self.continuous) = (false, false, false);
                (self.list, self.frame) = (vec![2, 4, 1], self.zero);
                return UnitAction::Rest(RESET);
            }
            Command::WhoAreYou => return self.reply(0, 0x16, 0, b"A virtual unit"),
            Command::ResetAlignment(_) | Command::ResetBoresight(_) | Command::EndLine => {}
        }
        UnitAction::Nothing
    }

    /// Returns the measurement of a station, as the unit reports it.
    fn pose(&self, station: u8, command: u8, placed: Placed) -> Pose {
        let index = usize::from(station) - 1;
        let Placed { position_cm, quaternion_wxyz: q } = placed;
        let unit = if self.centimetres { 1.0 } else { 1.0 / CM_PER_INCH };
        let mut position = reported_cm(self.hemispheres[index], position_cm).map(|x| x * unit);
        if self.since_start < self.early {
            position = position.map(|x| x + 7.5);
        }
        let single = |x: f64| x as f32;
        Pose {
            position: Some(position.map(single)),
            euler_deg: Some(euler_deg(q).map(single)),
            cosines: Some(cosines(q).map(|row| row.map(single))),
            quaternion_wxyz: Some(q.map(single)),
            timestamp_ms: Some((f64::from(self.frame) * 1000.0 / self.hz) as u32),
            frame_count: Some(self.frame),
            stylus: Some(self.switch),
            distortion: Some(self.distortion),
            external_sync: Some(0),
            ..Pose::empty(Header { tag: self.tag, station, command, error: self.errors[index] })
        }
    }
}

impl Model for Liberty {
    const SAMPLING_NS: i64 = SAMPLING_NS;

    fn continuous(&self) -> bool {
        self.continuous
    }

    fn cycles_hz(&self) -> f64 {
        self.hz
    }

    fn collects(&self) -> usize {
        if self.buffers && self.continuous { BUFFER } else { 0 }
    }

    fn obey(&mut self, input: &[u8]) -> Option<Obeyed> {
        let (read, taken) = Command::read(input)?;
        Some(match read {
            Some(command) if self.deaf && command != Command::Reset => {
                Obeyed { taken, is_command: false, action: UnitAction::Nothing }
            }
            Some(command) => Obeyed { taken, is_command: true, action: self.command(command) },
            None => Obeyed { taken, is_command: false, action: self.reply(0, input[0], 1, b"") },
        })
    }

    fn measure(&mut self, see: &dyn Fn(u8) -> Placed) -> Vec<Vec<u8>> {
        let mut records = Vec::new();
        for station in (1..=MOST_STATIONS).filter(|station| self.active >> (station - 1) & 1 != 0) {
            let Ok(layout) = Layout::new(&self.list) else { continue };
            let command = if self.continuous { b'C' } else { b'P' };
            let pose = self.pose(station, command, see(station));
            let mut record = Vec::new();
            if self.binary {
                pose.write(&layout, &mut record);
            } else {
                let error = char::from(pose.header.error.max(b' '));
                let columns = pose.position.unwrap_or_default().map(|x| format!("{x:8.3} ")).concat();
                record.extend(format!("{station:02}{error} {columns}\r\n").bytes());
            }
            records.push(record);
        }
        self.frame = self.frame.wrapping_add(1);
        self.since_start = self.since_start.saturating_add(1);
        records
    }
}
