//! A virtual QSB: one encoder, registers, and lines in its reply format. Opening its line resets
//! it.

use sonoweave_core::clock::{MS, SECOND};

use super::{Faults, Joints, Machine, Wire};
use crate::arm::qsb::{Command, TICK_HZ, register};

/// Time from a reset to its banner, ns.
const START: i64 = 100 * MS;
/// Bytes of an unfinished command line that are kept.
const INPUT: usize = 64;
/// Reply format after a reset: LF and CR, without time and blanks.
const FORMAT: u32 = 0b0011;

/// The unit. Its fields are the state in which it was left.
pub struct Twin {
    joints: Joints,
    axis: usize,
    /// Its line.
    pub wire: Wire,
    /// Opening the line resets it.
    pub resets_when_opened: bool,
    /// Registers by number.
    pub registers: [u32; 0x16],
    /// It streams counts.
    pub streams: bool,
    /// The true count at which it shows 0.
    pub zero: i64,
    /// Tick of its clock at its last reset.
    pub first_tick: u32,
    /// The host's time at which its clock started, ns.
    pub born_ns: i64,
    /// Lines streamed, including those lost in transmission.
    pub streamed: u64,
    input: Vec<u8>,
    busy_ns: i64,
    banner_is_due: bool,
    /// Tick of its next streamed line, since its clock started.
    next_tick: i64,
}

impl Twin {
    /// Creates the unit of this axis, from 0, as after a reset long ago; at 230400 bits per
    /// second.
    pub fn new(joints: Joints, axis: usize, faults: Faults) -> Self {
        let mut registers = [0; 0x16];
        registers[usize::from(register::REPLY_FORMAT)] = FORMAT;
        registers[usize::from(register::VERSION)] = 12_345 << 12 | 2 << 8 | 0x23;
        Self {
            joints,
            axis,
            wire: Wire::new(230_400, faults),
            resets_when_opened: true,
            registers,
            streams: false,
            zero: 0,
            first_tick: 0,
            born_ns: 0,
            streamed: 0,
            input: Vec::new(),
            busy_ns: i64::MIN,
            banner_is_due: false,
            next_tick: 0,
        }
    }

    /// Resets it, as when DTR goes low and high: its count starts at 0 and its clock restarts.
    pub fn reset(&mut self, now_ns: i64) {
        let version = self.registers[usize::from(register::VERSION)];
        self.registers = [0; 0x16];
        self.registers[usize::from(register::REPLY_FORMAT)] = FORMAT;
        self.registers[usize::from(register::VERSION)] = version;
        self.wire.cut();
        self.input.clear();
        self.streams = false;
        self.busy_ns = now_ns + START;
        self.born_ns = self.busy_ns;
        self.banner_is_due = true;
        self.zero = (self.joints)(now_ns)[self.axis];
    }

    /// Makes its counter lose or gain steps without noticing.
    pub fn slip(&mut self, counts: i64) {
        self.zero -= counts;
    }

    fn of(&self, register: u8) -> u32 {
        self.registers.get(usize::from(register)).copied().unwrap_or(0)
    }

    fn count(&self, at_ns: i64) -> u32 {
        (((self.joints)(at_ns)[self.axis] - self.zero) as i32).cast_unsigned()
    }

    /// Returns the time of a tick of its clock, ns.
    pub fn time_of(&self, tick: i64) -> i64 {
        let second = SECOND as f64 / (1.0 + self.wire.faults().drift_ppm * 1e-6);
        self.born_ns + (tick as f64 / f64::from(TICK_HZ) * second) as i64
    }

    fn ticks(&self, at_ns: i64) -> i64 {
        let own = (at_ns - self.born_ns) as f64 * (1.0 + self.wire.faults().drift_ppm * 1e-6);
        // Adds half a microsecond, because the time of a tick is rounded to whole ns.
        ((own + 500.0) * f64::from(TICK_HZ) / SECOND as f64) as i64
    }

    /// Sends a line in its reply format.
    fn send(&mut self, letter: u8, register: u8, value: u32, line_baud: u32, at_ns: i64) {
        let format = self.of(register::REPLY_FORMAT);
        let blank = if format & 8 != 0 { " " } else { "" };
        let mut line = format!("{}{blank}{register:02X}{blank}{value:08X}{blank}", char::from(letter));
        if format & 4 != 0 {
            let ticks = self.first_tick.wrapping_add(self.ticks(at_ns) as u32);
            line += &format!("{ticks:08X}{blank}");
        }
        line.push('!');
        if format & 2 != 0 {
            line.push('\r');
        }
        if format & 1 != 0 {
            line.push('\n');
        }
        self.wire.send(line.as_bytes(), line_baud, at_ns);
    }

    fn obey(&mut self, command: Option<Command>, line_baud: u32, now_ns: i64) {
        let Some(command) = command else {
            self.wire.send(b"e!\r\n", line_baud, now_ns);
            return;
        };
        self.wire.obeyed.push(command.bytes());
        match command {
            Command::Read(register) => {
                self.streams = false;
                let value = if register == register::COUNT { self.count(now_ns) } else { self.of(register) };
                self.send(b'r', register, value, line_baud, now_ns);
            }
            Command::Write(register, value) => {
                if register == register::RESET_TIME {
                    self.born_ns = now_ns;
                } else if let Some(kept) = self.registers.get_mut(usize::from(register)) {
                    *kept = value;
                }
                self.send(b'w', register, value, line_baud, now_ns);
            }
            Command::Stream(_) => {
                self.streams = true;
                self.next_tick = self.ticks(now_ns) + 1;
            }
        }
    }
}

impl Machine for Twin {
    fn wire(&mut self) -> &mut Wire {
        &mut self.wire
    }

    fn opened(&mut self, now_ns: i64) {
        if self.resets_when_opened {
            self.reset(now_ns);
        }
    }

    fn plug_in(&mut self, now_ns: i64) {
        self.wire.plugged = true;
        self.reset(now_ns);
    }

    fn hear(&mut self, bytes: &[u8], line_baud: u32, now_ns: i64) {
        if now_ns < self.busy_ns {
            return;
        }
        self.act(line_baud, now_ns);
        if self.wire.mistakes(line_baud) {
            return;
        }
        self.input.extend_from_slice(bytes);
        while let Some((command, taken)) = Command::read(&self.input) {
            let is_empty = self.input[..taken].trim_ascii().is_empty();
            self.input.drain(..taken);
            if !is_empty {
                self.obey(command, line_baud, now_ns);
            }
        }
        if self.input.len() > INPUT {
            self.input.clear();
        }
    }

    fn awaited(&mut self, now_ns: i64) {
        if self.streams && self.time_of(self.next_tick) < now_ns - SECOND {
            // The host was not listening: the lines in between are lost.
            self.next_tick = self.ticks(now_ns) + 1;
        }
    }

    fn turn(&self) -> Option<i64> {
        match (self.wire.plugged && !self.wire.hung, self.banner_is_due) {
            (false, _) => None,
            (true, true) => Some(self.busy_ns),
            (true, false) => self.streams.then(|| self.time_of(self.next_tick)),
        }
    }

    fn act(&mut self, line_baud: u32, until_ns: i64) {
        while let Some(at) = self.turn().filter(|at| *at <= until_ns) {
            if std::mem::take(&mut self.banner_is_due) {
                self.wire.send(b"QSB-D  0E!\r\n", line_baud, at);
                continue;
            }
            self.next_tick += i64::from(self.of(register::STREAM_INTERVAL).max(1));
            self.streamed += 1;
            if self.wire.withholds() {
                continue;
            }
            let count = self.count(at);
            self.send(b's', register::COUNT, count, line_baud, at);
        }
    }
}
