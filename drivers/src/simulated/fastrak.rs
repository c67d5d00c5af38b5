//! A FASTRAK: text or binary, inches or cm, up to four stations, as it was left by whoever had it before.

use super::{Faults, Motion, Placed, Wire};
use crate::clock::SECOND;
use crate::polhemus::fastrak::write::{write_error, write_output_list, write_stations};
use crate::polhemus::fastrak::{Command, Layout, Mode, Pose, STATIONS, Status};
use crate::transport::{LineError, Peer};

/// From the middle of the measurement to the first byte, ns.
pub const SAMPLING_NS: i64 = 3_750_000;
/// Cycles a second, shared by the stations in use.
const CYCLES: i64 = 120;
/// Bytes of commands that are kept while their line is not ended.
const INPUT: usize = 512;
const CM_PER_INCH: f64 = 2.54;
/// What starting anew takes, ns.
const RESET: i64 = 10 * SECOND;

/// The unit. Its fields are how it was left.
pub struct Twin {
    motion: Motion,
    wire: Wire,
    /// The rate of its switches, bits a second.
    pub baud: u32,
    /// Text or binary.
    pub mode: Mode,
    /// Positions in cm, else in inches.
    pub centimetres: bool,
    /// Records without being asked.
    pub continuous: bool,
    /// Output codes of each station.
    pub lists: [Vec<u8>; STATIONS],
    /// Stations in use.
    pub stations: [bool; STATIONS],
    /// Zenith of each station's hemisphere: a sensor in the other one is reported on its opposite side.
    pub hemispheres: [[f32; 3]; STATIONS],
    /// Error letter of each station.
    pub errors: [u8; STATIONS],
    /// What it has done so far: commands obeyed, by their bytes.
    pub obeyed: Vec<Vec<u8>>,
    /// Switched on and plugged in.
    pub plugged: bool,
    /// It obeys nothing but being started anew.
    pub deaf: bool,
    /// It stays silent though it is there: as a unit that hangs.
    pub hung: bool,
    input: Vec<u8>,
    /// It does nothing before this time.
    busy_ns: i64,
    /// The measurement that is next, by number since 0 ns of the host's clock.
    cycle: Option<i64>,
    /// Measurements taken.
    pub measured: u64,
}

impl Twin {
    /// As it comes from the factory: 115200 bits a second, text, inches, one station, quiet.
    pub fn new(motion: Motion, faults: Faults) -> Self {
        Self {
            motion,
            wire: Wire::new(faults),
            baud: 115_200,
            mode: Mode::Ascii,
            centimetres: false,
            continuous: false,
            lists: std::array::from_fn(|_| vec![2, 4, 1]),
            stations: [true, false, false, false],
            hemispheres: [[1.0, 0.0, 0.0]; STATIONS],
            errors: [b' '; STATIONS],
            obeyed: Vec::new(),
            plugged: true,
            deaf: false,
            hung: false,
            input: Vec::new(),
            busy_ns: i64::MIN,
            cycle: None,
            measured: 0,
        }
    }

    /// Other faults from now on.
    pub fn set_faults(&mut self, faults: Faults) {
        self.wire.set_faults(faults);
    }

    /// Pulled out: what was on its way is lost, what was set is kept.
    pub fn unplug(&mut self) {
        self.plugged = false;
        self.wire.cut();
        self.input.clear();
        self.cycle = None;
    }

    /// Bytes on the line before anything else: the rest of a record that was cut.
    pub fn leave_on_the_line(&mut self, bytes: &[u8], now_ns: i64) {
        self.wire.send(bytes, self.baud, false, now_ns);
    }

    /// The beginning of a command that another host sent and did not end.
    pub fn written_by_another(&mut self, bytes: &[u8]) {
        self.input.extend_from_slice(bytes);
    }

    fn active(&self) -> impl Iterator<Item = usize> + '_ {
        (0..STATIONS).filter(|s| self.stations[*s])
    }

    /// What a station measures at a time, as it says it.
    pub fn pose(&self, station: usize, at_ns: i64) -> Pose {
        // Four stations at most.
        let number = station as u8 + 1;
        let Placed { position_cm, quaternion_wxyz: q } = (self.motion)(number, at_ns);
        let zenith = self.hemispheres[station].map(f64::from);
        let along: f64 = (0..3).map(|a| zenith[a] * position_cm[a]).sum();
        // The field looks the same on the opposite side: only the hemisphere tells the two apart.
        let mirrored = zenith != [0.0; 3] && along < 0.0;
        let unit = if self.centimetres { 1.0 } else { 1.0 / CM_PER_INCH };
        let position = position_cm.map(|x| if mirrored { -x * unit } else { x * unit });
        let mut pose = Pose::empty(number, self.errors[station]);
        (pose.position, pose.quaternion_wxyz) = (Some(position), Some(q));
        pose.euler_deg = Some(euler_deg(q));
        pose.cosines = cosines(q).map(Some);
        pose.stylus = Some(*b" 0");
        pose
    }

    fn layout(&self, station: usize) -> Option<Layout> {
        Layout::new(self.mode, &self.lists[station]).ok()
    }

    fn say(&mut self, bytes: &[u8], line_baud: u32, now_ns: i64) {
        let garbled = line_baud != 0 && line_baud != self.baud;
        self.wire.send(bytes, self.baud, garbled, now_ns);
    }

    /// One record of each station in use, measured at that time.
    fn measure(&mut self, line_baud: u32, at_ns: i64) {
        let mut record = Vec::new();
        let active: Vec<usize> = self.active().collect();
        for station in active {
            let Some(layout) = self.layout(station) else { continue };
            self.measured += 1;
            if self.wire.chance(self.wire.faults().dropout) {
                continue;
            }
            record.clear();
            self.pose(station, at_ns).write(&layout, &mut record);
            self.say(&record, line_baud, at_ns + SAMPLING_NS);
        }
    }

    /// Time of a measurement by its number: all stations in use are measured in turn, each cycle one, and sent together here.
    fn time_of(&self, cycle: i64) -> i64 {
        let stations = self.active().count().max(1) as i64;
        // Its own second, in host nanoseconds.
        let second = SECOND as f64 / (1.0 + self.wire.faults().drift_ppm * 1e-6);
        (cycle as f64 * stations as f64 / CYCLES as f64 * second) as i64
    }

    /// Measures what is due until a time.
    fn go_on(&mut self, line_baud: u32, until_ns: i64) {
        if !self.continuous || !self.plugged || self.hung {
            self.cycle = None;
            return;
        }
        while let Some(cycle) = self.cycle
            && self.time_of(cycle) + SAMPLING_NS <= until_ns
        {
            let at = self.time_of(cycle);
            // A record that takes longer on the wire than its cycle is not sent.
            if at >= self.busy_ns && self.wire.is_idle(at + SAMPLING_NS) {
                self.measure(line_baud, at);
            }
            self.cycle = Some(cycle + 1);
        }
    }

    fn begin_cycles(&mut self, now_ns: i64) {
        let mut cycle = (now_ns as f64 / SECOND as f64 * CYCLES as f64 / self.active().count().max(1) as f64) as i64;
        while self.time_of(cycle) < now_ns {
            cycle += 1;
        }
        self.cycle = Some(cycle);
    }

    fn obey(&mut self, command: Command, line_baud: u32, now_ns: i64) {
        self.obeyed.push(command.bytes());
        let mut answer = Vec::new();
        let station = |s: u8| usize::from(s) - 1;
        match command {
            Command::Poll => self.measure(line_baud, now_ns),
            Command::Stream => {
                self.continuous = true;
                self.begin_cycles(now_ns);
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
                self.busy_ns = now_ns + RESET;
                self.deaf = false;
                (self.mode, self.centimetres, self.continuous) = (Mode::Ascii, false, false);
                self.lists = std::array::from_fn(|_| vec![2, 4, 1]);
            }
            _ => {}
        }
        if !answer.is_empty() {
            self.say(&answer, line_baud, now_ns);
        }
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

impl Peer for Twin {
    fn open(&mut self, _now_ns: i64) -> Result<(), LineError> {
        if self.plugged { Ok(()) } else { Err(LineError::Absent("no such file".into())) }
    }

    fn written(&mut self, bytes: &[u8], baud: u32, now_ns: i64) {
        if !self.plugged || self.hung || now_ns < self.busy_ns {
            return;
        }
        self.go_on(baud, now_ns);
        if baud != 0 && baud != self.baud {
            // What it reads at another rate makes no sense to it.
            return;
        }
        self.input.extend_from_slice(bytes);
        while let Some((read, taken)) = Command::read(&self.input) {
            self.input.drain(..taken);
            match read {
                Ok(command) if self.deaf && command != Command::Reset => {}
                Ok(command) => self.obey(command, baud, now_ns),
                Err(not) => {
                    let mut answer = Vec::new();
                    write_error(not.code(), &mut answer);
                    self.say(&answer, baud, now_ns);
                }
            }
        }
        if self.input.len() > INPUT {
            self.input.clear();
        }
    }

    fn next(&mut self, baud: u32, now_ns: i64, until_ns: i64) -> Result<Option<(i64, Vec<u8>)>, LineError> {
        if !self.plugged {
            return Err(LineError::Gone("unplugged".into()));
        }
        if self.continuous && self.cycle.is_none() {
            self.begin_cycles(now_ns);
        }
        loop {
            // As far as the first byte that the host waits for, and no farther: what it will say then may change everything after it.
            match self.wire.due() {
                Some(at) if at <= until_ns => return Ok(self.wire.take(at.max(now_ns))),
                _ => {}
            }
            match self.cycle.map(|cycle| self.time_of(cycle) + SAMPLING_NS) {
                Some(at) if at <= until_ns && !self.hung => self.go_on(baud, at),
                _ => return Ok(None),
            }
        }
    }

    fn due(&self, _now_ns: i64) -> Option<i64> {
        let measured = self.cycle.filter(|_| self.continuous && !self.hung).map(|c| self.time_of(c) + SAMPLING_NS);
        [self.wire.due(), measured].into_iter().flatten().min()
    }
}

/// Rows of the direction cosine matrix of a unit quaternion w, x, y, z.
pub fn cosines([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
}

/// Azimuth, elevation, roll in degrees: R = Rz(azimuth) · Ry(elevation) · Rx(roll).
pub fn euler_deg(q: [f64; 4]) -> [f64; 3] {
    let [[xx, ..], [yx, ..], [zx, zy, zz]] = cosines(q);
    [yx.atan2(xx), (-zx.clamp(-1.0, 1.0)).asin(), zy.atan2(zz)].map(f64::to_degrees)
}
