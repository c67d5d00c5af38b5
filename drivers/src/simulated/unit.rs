//! Common parts of virtual trackers: a line with or without a rate, commands obeyed one by one,
//! measurements at times of their own clock.

use std::ops::{Deref, DerefMut};

use sonoweave_core::clock::SECOND;

use super::{Faults, Machine, Motion, Placed, Wire};

/// Bytes of an unfinished command that are kept.
const INPUT: usize = 512;

/// Behaviour of one model.
pub trait Model: Send {
    /// Time from the middle of the measurement to the first byte, ns.
    const SAMPLING_NS: i64;

    /// Returns whether records are sent continuously.
    fn continuous(&self) -> bool;

    /// Returns the measurements of all stations per second.
    fn cycles_hz(&self) -> f64;

    /// Reads the first command of the input, obeys it, and returns the result. Returns `None`
    /// while the command is unfinished.
    fn obey(&mut self, input: &[u8]) -> Option<Obeyed>;

    /// Measures all stations and returns one record each, or one for all. `see` gives the pose of
    /// a station's sensor.
    fn measure(&mut self, see: &dyn Fn(u8) -> Placed) -> Vec<Vec<u8>>;

    /// Returns the bytes of records that are collected before USB sends any; 0 for none.
    fn collects(&self) -> usize {
        0
    }
}

/// Result of reading the input.
pub struct Obeyed {
    /// Bytes read.
    pub taken: usize,
    /// Whether it was a command that the model obeyed.
    pub is_command: bool,
    /// Effect beyond the model's own settings.
    pub action: UnitAction,
}

/// Effect of a command.
pub enum UnitAction {
    /// Nothing visible.
    Nothing,
    /// Sends an answer.
    Send(Vec<u8>),
    /// Sends a record of each station.
    Poll,
    /// Sends an answer and starts a stream.
    Stream(Vec<u8>),
    /// Neither sends nor receives for this time, ns.
    Rest(i64),
}

/// A virtual tracker. It dereferences to its model, whose fields are the state in which it was
/// left.
pub struct Simulated<M> {
    model: M,
    motion: Motion,
    /// Its line.
    pub wire: Wire,
    /// Records measured for the host.
    pub measured: u64,
    /// Measured records that were not sent, or will not arrive intact.
    pub harmed: u64,
    input: Vec<u8>,
    collected: Vec<u8>,
    /// It does nothing before this time, ns.
    busy_ns: i64,
    /// Number of the next measurement since 0 ns of the host's clock.
    cycle: Option<i64>,
}

impl<M: Model> Simulated<M> {
    /// Creates a model at 115200 bits per second.
    pub(super) fn of(model: M, motion: Motion, faults: Faults) -> Self {
        Self {
            model,
            motion,
            wire: Wire::new(115_200, faults),
            measured: 0,
            harmed: 0,
            input: Vec::new(),
            collected: Vec::new(),
            busy_ns: i64::MIN,
            cycle: None,
        }
    }

    /// Adds the beginning of a command that another host left unfinished.
    pub fn written_by_another(&mut self, bytes: &[u8]) {
        self.input.extend_from_slice(bytes);
    }

    /// Measures records at this time. A record that takes longer on the wire than its cycle is
    /// not sent.
    fn measure(&mut self, line_baud: u32, at_ns: i64) {
        let motion = &self.motion;
        let records = self.model.measure(&|station| motion(station, at_ns));
        let sent_ns = at_ns + M::SAMPLING_NS;
        let collects = if self.wire.usb { self.model.collects() } else { 0 };
        let can_be_sent = at_ns >= self.busy_ns && self.wire.is_idle(sent_ns);
        for record in records {
            self.measured += 1;
            if !can_be_sent || self.wire.withholds() {
                self.harmed += 1;
                continue;
            }
            let whole = if collects > 0 {
                self.collected.extend(record);
                true
            } else {
                self.wire.send(&record, line_baud, sent_ns)
            };
            self.harmed += u64::from(!whole);
        }
        if collects > 0 && self.collected.len() >= collects {
            let collected = std::mem::take(&mut self.collected);
            self.wire.send(&collected, line_baud, sent_ns);
        }
    }

    /// Returns the time of a measurement by its number: all stations are measured together here.
    fn time_of(&self, cycle: i64) -> i64 {
        // The unit's own second, in host nanoseconds.
        let second = SECOND as f64 / (1.0 + self.wire.faults().drift_ppm * 1e-6);
        (cycle as f64 / self.model.cycles_hz() * second) as i64
    }

    fn begin_cycles(&mut self, now_ns: i64) {
        let mut cycle = (now_ns as f64 / SECOND as f64 * self.model.cycles_hz()) as i64;
        while self.time_of(cycle) < now_ns {
            cycle += 1;
        }
        self.cycle = Some(cycle);
    }
}

impl<M: Model> Machine for Simulated<M> {
    fn wire(&mut self) -> &mut Wire {
        &mut self.wire
    }

    /// Unplugs it: data in transit are lost, settings are kept.
    fn unplug(&mut self) {
        self.wire.plugged = false;
        self.wire.cut();
        self.input.clear();
        self.collected.clear();
        self.cycle = None;
    }

    fn hear(&mut self, bytes: &[u8], line_baud: u32, now_ns: i64) {
        if now_ns < self.busy_ns {
            return;
        }
        self.act(line_baud, now_ns);
        if self.wire.mistakes(line_baud) {
            // Bytes at another rate are unreadable.
            return;
        }
        self.input.extend_from_slice(bytes);
        while !self.input.is_empty()
            && let Some(Obeyed { taken, is_command, action }) = self.model.obey(&self.input)
        {
            let command: Vec<u8> = self.input.drain(..taken).collect();
            if is_command {
                self.wire.obeyed.push(command);
            }
            if self.model.collects() == 0 {
                self.collected.clear();
            }
            match action {
                UnitAction::Nothing => {}
                UnitAction::Send(answer) => {
                    self.wire.send(&answer, line_baud, now_ns);
                }
                UnitAction::Poll => self.measure(line_baud, now_ns),
                UnitAction::Stream(answer) => {
                    self.wire.send(&answer, line_baud, now_ns);
                    self.begin_cycles(now_ns);
                }
                UnitAction::Rest(ns) => self.busy_ns = now_ns + ns,
            }
        }
        if self.input.len() > INPUT {
            self.input.clear();
        }
    }

    fn awaited(&mut self, now_ns: i64) {
        if self.model.continuous() && self.cycle.is_none() {
            self.begin_cycles(now_ns);
        }
    }

    fn turn(&self) -> Option<i64> {
        self.cycle.filter(|_| !self.wire.hung).map(|cycle| self.time_of(cycle) + M::SAMPLING_NS)
    }

    /// Makes the measurements that are due until a time.
    fn act(&mut self, line_baud: u32, until_ns: i64) {
        if !self.model.continuous() || !self.wire.plugged || self.wire.hung {
            self.cycle = None;
            return;
        }
        while let Some(cycle) = self.cycle
            && self.time_of(cycle) + M::SAMPLING_NS <= until_ns
        {
            self.measure(line_baud, self.time_of(cycle));
            self.cycle = Some(cycle + 1);
        }
    }
}

impl<M> Deref for Simulated<M> {
    type Target = M;

    fn deref(&self) -> &M {
        &self.model
    }
}

impl<M> DerefMut for Simulated<M> {
    fn deref_mut(&mut self) -> &mut M {
        &mut self.model
    }
}

/// Returns the reported position for a zenith. The field is the same on the opposite side, and
/// only the hemisphere distinguishes the two. All zeros follow the sensor.
pub(super) fn reported_cm(zenith: [f32; 3], position_cm: [f64; 3]) -> [f64; 3] {
    let along: f64 = zenith.iter().zip(position_cm).map(|(z, x)| f64::from(*z) * x).sum();
    if along < 0.0 { position_cm.map(|x| -x) } else { position_cm }
}

/// Returns the rows of the direction cosine matrix of a unit quaternion w, x, y, z.
pub fn cosines([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
}

/// Returns azimuth, elevation, roll in degrees: R = Rz(azimuth) · Ry(elevation) · Rx(roll).
pub fn euler_deg(q: [f64; 4]) -> [f64; 3] {
    let [[xx, ..], [yx, ..], [zx, zy, zz]] = cosines(q);
    [yx.atan2(xx), (-zx.clamp(-1.0, 1.0)).asin(), zy.atan2(zz)].map(f64::to_degrees)
}
