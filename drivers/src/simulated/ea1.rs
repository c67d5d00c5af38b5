//! A virtual EA1 arm: a microcontroller that restarts when its line is opened, counts from the
//! present position of its joints, and samples by a timer.

use sonoweave_core::clock::{MS, SECOND};

use super::{Faults, Joints, Machine, Wire};
use crate::arm::ea1::{AXES, Command, Framing, Identity, Record, Sample, error, flag};

/// Time from power-on to the identity, ns: the boot loader first waits for a new program.
pub const START: i64 = 1_600 * MS;
/// Bytes of an unfinished command line that are kept.
const INPUT: usize = 64;

/// The arm. Its fields are the state in which it was left.
pub struct Twin {
    joints: Joints,
    /// Its line.
    pub wire: Wire,
    /// Opening the line restarts it, as with most boards.
    pub starts_when_opened: bool,
    /// Samples per second; 0 for none.
    pub rate_hz: u32,
    /// Samples as lines or as blocks.
    pub framing: Framing,
    /// It sends only bare numbers.
    pub bare: bool,
    /// Counts per revolution that it reports.
    pub counts_per_turn: [u32; AXES],
    /// Bit by axis: homed since its start.
    pub homed: u16,
    /// Bit by axis: steps were lost.
    pub faults: u16,
    /// Pressed buttons.
    pub buttons: u8,
    /// Index mark of each joint, in counts from home.
    pub marks: [Option<i64>; AXES],
    /// The true counts at which its counters show 0.
    pub zeros: [i64; AXES],
    /// Number of the last sample.
    pub seq: u32,
    /// Samples taken.
    pub sampled: u64,
    /// Number of further pings whose answers are lost.
    pub mute_pings: u32,
    input: Vec<u8>,
    /// It does nothing before this time, ns.
    busy_ns: i64,
    identity_is_due: bool,
    /// The host's time at which its clock showed 0, ns.
    born_ns: i64,
    next_ns: i64,
    before: [i64; AXES],
    overrun: bool,
}

impl Twin {
    /// Creates an arm that has long been on: quiet, not homed, counting from home, at 115200 bits
    /// per second.
    pub fn new(joints: Joints, faults: Faults) -> Self {
        Self {
            joints,
            wire: Wire::new(115_200, faults),
            starts_when_opened: true,
            rate_hz: 0,
            framing: Framing::Lines,
            bare: false,
            counts_per_turn: [40_000, 20_000, 0],
            homed: 0,
            faults: 0,
            buttons: 0,
            marks: [None; AXES],
            zeros: [0; AXES],
            seq: 0,
            sampled: 0,
            mute_pings: 0,
            input: Vec::new(),
            busy_ns: i64::MIN,
            identity_is_due: false,
            born_ns: 0,
            next_ns: i64::MIN,
            before: [0; AXES],
            overrun: false,
        }
    }

    /// Restarts it, as by its reset button.
    pub fn restart(&mut self, now_ns: i64) {
        self.wire.cut();
        self.input.clear();
        (self.homed, self.faults, self.seq, self.overrun) = (0, 0, 0, false);
        self.rate_hz = 0;
        self.busy_ns = now_ns + START;
        self.born_ns = self.busy_ns;
        self.identity_is_due = true;
        self.zeros = self.true_counts(now_ns);
        self.before = self.zeros;
    }

    /// Makes a counter lose or gain steps without noticing.
    pub fn slip(&mut self, axis: usize, counts: i64) {
        self.zeros[axis] -= counts;
    }

    /// Sets its clock to `us` µs at `now_ns`.
    pub fn set_clock(&mut self, now_ns: i64, us: u32) {
        self.born_ns = now_ns - i64::from(us) * 1000;
    }

    fn true_counts(&self, at_ns: i64) -> [i64; AXES] {
        let [a, b, c, ..] = (self.joints)(at_ns);
        [a, b, c]
    }

    /// Returns the time of its clock, µs.
    pub fn us(&self, now_ns: i64) -> u32 {
        let passed = (now_ns - self.born_ns) as f64 * (1.0 + self.wire.faults().drift_ppm * 1e-6);
        (passed as i64 / 1000) as u32
    }

    fn send(&mut self, record: &Record<'_>, line_baud: u32, now_ns: i64) {
        let mut bytes = Vec::new();
        record.write(&mut bytes);
        self.wire.send(&bytes, line_baud, now_ns);
    }

    fn period(&self) -> i64 {
        let own_second = SECOND as f64 / (1.0 + self.wire.faults().drift_ppm * 1e-6);
        (own_second / f64::from(self.rate_hz.max(1))) as i64
    }

    fn latch(&mut self, at_ns: i64) -> Sample {
        let counts = self.true_counts(at_ns);
        for (axis, mark) in self.marks.into_iter().enumerate() {
            if let Some(mark) = mark
                && self.homed & 1 << axis == 0
                && (self.before[axis] < mark) != (counts[axis] < mark)
            {
                self.zeros[axis] = mark;
                self.homed |= 1 << axis;
            }
        }
        self.before = counts;
        self.seq = self.seq.wrapping_add(1);
        self.sampled += 1;
        let shown = std::array::from_fn(|axis| (counts[axis] - self.zeros[axis]) as i32);
        let pressed = if self.buttons != 0 { flag::BUTTON } else { 0 };
        let overrun = if std::mem::take(&mut self.overrun) { flag::OVERRUN } else { 0 };
        let flags = self.homed | self.faults << AXES | pressed | overrun;
        let buttons = if self.framing == Framing::Lines { u8::from(self.buttons != 0) } else { self.buttons };
        Sample { seq: self.seq, t_us: self.us(at_ns), counts: shown, flags, buttons, framing: self.framing }
    }

    fn sample(&mut self, line_baud: u32, at_ns: i64) {
        // At most one sample waits for the line.
        if !self.wire.is_idle(at_ns + self.period()) {
            self.latch(at_ns);
            self.overrun = true;
            return;
        }
        let sample = self.latch(at_ns);
        if self.wire.withholds() {
            return;
        }
        let record = if self.bare { Record::Unreliable(sample.counts) } else { Record::Sample(sample) };
        self.send(&record, line_baud, at_ns);
    }

    fn identity(&mut self, line_baud: u32, now_ns: i64) {
        let identity = Identity {
            model: "Virtual arm",
            serial: "1",
            counts_per_revolution: self.counts_per_turn,
            tick_hz: 1_000_000,
            rate_hz: self.rate_hz,
        };
        self.send(&Record::Identity(identity), line_baud, now_ns);
    }

    fn obey(&mut self, command: Result<Command, u32>, line_baud: u32, now_ns: i64) {
        if let Ok(command) = &command {
            self.wire.obeyed.push(command.bytes());
        }
        match command {
            Ok(Command::Identify) => self.identity(line_baud, now_ns),
            Ok(Command::Poll) => {
                let sample = Sample { framing: Framing::Lines, ..self.latch(now_ns) };
                self.send(&Record::Sample(sample), line_baud, now_ns);
            }
            Ok(Command::Zero(axes)) => {
                let counts = self.true_counts(now_ns);
                for axis in (0..AXES).filter(|axis| axes & 1 << axis != 0) {
                    self.zeros[axis] = counts[axis];
                }
                self.homed |= u16::from(axes);
                self.faults &= !u16::from(axes);
                self.next_ns = now_ns + self.period();
            }
            Ok(Command::Time(token)) => {
                if self.mute_pings > 0 {
                    self.mute_pings -= 1;
                    return;
                }
                let t_us = self.us(now_ns);
                self.send(&Record::Time { token, t_us }, line_baud, now_ns);
            }
            Ok(Command::Stream(framing, hz)) => {
                let bytes = if framing == Framing::Lines { 45 } else { 29 };
                if i64::from(hz) * bytes * 10 > i64::from(self.wire.baud) {
                    return self.send(&Record::Error(error::TOO_FAST), line_baud, now_ns);
                }
                (self.framing, self.rate_hz) = (framing, hz);
                self.next_ns = now_ns + self.period();
            }
            Err(code) => self.send(&Record::Error(code), line_baud, now_ns),
        }
    }
}

impl Machine for Twin {
    fn wire(&mut self) -> &mut Wire {
        &mut self.wire
    }

    fn opened(&mut self, now_ns: i64) {
        if self.starts_when_opened && !self.bare {
            self.restart(now_ns);
        }
    }

    fn plug_in(&mut self, now_ns: i64) {
        self.wire.plugged = true;
        self.restart(now_ns);
    }

    fn hear(&mut self, bytes: &[u8], line_baud: u32, now_ns: i64) {
        if now_ns < self.busy_ns {
            return;
        }
        self.act(line_baud, now_ns);
        if self.bare || self.wire.mistakes(line_baud) {
            return;
        }
        self.input.extend_from_slice(bytes);
        while let Some((command, taken)) = Command::read(&self.input) {
            self.input.drain(..taken);
            self.obey(command, line_baud, now_ns);
        }
        if self.input.len() > INPUT {
            self.input.clear();
        }
    }

    fn awaited(&mut self, now_ns: i64) {
        if self.next_ns < now_ns - SECOND {
            // The host was not listening: the samples in between are lost.
            self.next_ns = now_ns;
        }
    }

    fn turn(&self) -> Option<i64> {
        match (self.wire.plugged && !self.wire.hung, self.identity_is_due) {
            (false, _) => None,
            (true, true) => Some(self.busy_ns),
            (true, false) => (self.rate_hz != 0).then_some(self.next_ns.max(self.busy_ns)),
        }
    }

    fn act(&mut self, line_baud: u32, until_ns: i64) {
        while let Some(at) = self.turn().filter(|at| *at <= until_ns) {
            if std::mem::take(&mut self.identity_is_due) {
                if !self.bare {
                    self.identity(line_baud, at);
                }
                continue;
            }
            self.next_ns = at + self.period();
            self.sample(line_baud, at);
        }
    }
}
