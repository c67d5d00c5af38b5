//! A QSB: one encoder, registers, and lines as its reply format says. Opening its line resets it.

use super::{Faults, Joints, Wire};
use crate::arm::qsb::{Command, TICK_HZ, register};
use crate::clock::{MS, SECOND};
use crate::transport::{LineError, Peer};

/// From a reset to its banner, ns.
const START: i64 = 100 * MS;
/// Bytes of commands that are kept while their line is not ended.
const INPUT: usize = 64;
/// Reply format after a reset: LF and CR, without time and blanks.
const FORMAT: u32 = 0b0011;

/// The unit. Its fields are how it was left.
pub struct Twin {
    joints: Joints,
    axis: usize,
    wire: Wire,
    /// Bits a second.
    pub baud: u32,
    /// Opening the line resets it.
    pub resets_when_opened: bool,
    /// Registers by number.
    pub registers: [u32; 0x16],
    /// It streams counts.
    pub streams: bool,
    /// The true count at which it shows 0.
    pub zero: i64,
    /// What its clock shows at the time of its last reset.
    pub first_tick: u32,
    /// The host's time of its clock's beginning.
    pub born_ns: i64,
    /// Lines streamed, those lost on the way included.
    pub streamed: u64,
    /// What it has done so far: commands obeyed, by their bytes.
    pub obeyed: Vec<Vec<u8>>,
    /// Plugged in.
    pub plugged: bool,
    /// It stays silent though it is there.
    pub hung: bool,
    input: Vec<u8>,
    busy_ns: i64,
    says_banner: bool,
    /// Ticks since its clock's beginning at which it streams next.
    next_tick: i64,
}

impl Twin {
    /// Of this axis, from 0, as after a reset long ago; at 230400 bits a second.
    pub fn new(joints: Joints, axis: usize, faults: Faults) -> Self {
        let mut registers = [0; 0x16];
        registers[usize::from(register::REPLY_FORMAT)] = FORMAT;
        registers[usize::from(register::VERSION)] = 12_345 << 12 | 2 << 8 | 0x23;
        Self {
            joints,
            axis,
            wire: Wire::new(faults),
            baud: 230_400,
            resets_when_opened: true,
            registers,
            streams: false,
            zero: 0,
            first_tick: 0,
            born_ns: 0,
            streamed: 0,
            obeyed: Vec::new(),
            plugged: true,
            hung: false,
            input: Vec::new(),
            busy_ns: i64::MIN,
            says_banner: false,
            next_tick: 0,
        }
    }

    /// Its wire, for what became of the bytes on it.
    pub(super) fn wire(&self) -> &Wire {
        &self.wire
    }

    /// Other faults from now on.
    pub fn set_faults(&mut self, faults: Faults) {
        self.wire.set_faults(faults);
    }

    /// Pulled out.
    pub fn unplug(&mut self) {
        self.plugged = false;
        self.wire.cut();
    }

    /// Its count begins at 0 and its clock anew, as when DTR goes low and high.
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
        self.says_banner = true;
        self.zero = (self.joints)(now_ns)[self.axis];
    }

    /// Its counter loses steps, or gains some, without noticing.
    pub fn slip(&mut self, counts: i64) {
        self.zero -= counts;
    }

    fn of(&self, register: u8) -> u32 {
        self.registers.get(usize::from(register)).copied().unwrap_or(0)
    }

    fn count(&self, at_ns: i64) -> u32 {
        (((self.joints)(at_ns)[self.axis] - self.zero) as i32).cast_unsigned()
    }

    /// When its clock has gone so many ticks.
    pub fn time_of(&self, tick: i64) -> i64 {
        let second = SECOND as f64 / (1.0 + self.wire.faults().drift_ppm * 1e-6);
        self.born_ns + (tick as f64 / f64::from(TICK_HZ) * second) as i64
    }

    fn ticks(&self, at_ns: i64) -> i64 {
        let own = (at_ns - self.born_ns) as f64 * (1.0 + self.wire.faults().drift_ppm * 1e-6);
        // Half a microsecond, as the time of a tick is rounded to whole ns.
        ((own + 500.0) * f64::from(TICK_HZ) / SECOND as f64) as i64
    }

    /// A line as its reply format says.
    fn say(&mut self, letter: u8, register: u8, value: u32, line_baud: u32, at_ns: i64) {
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
        let garbled = line_baud != 0 && line_baud != self.baud;
        self.wire.send(line.as_bytes(), self.baud, garbled, at_ns);
    }

    fn turn(&self) -> Option<i64> {
        match (self.plugged && !self.hung, self.says_banner) {
            (false, _) => None,
            (true, true) => Some(self.busy_ns),
            (true, false) => self.streams.then(|| self.time_of(self.next_tick)),
        }
    }

    fn go_on(&mut self, line_baud: u32, until_ns: i64) {
        while let Some(at) = self.turn().filter(|at| *at <= until_ns) {
            if std::mem::take(&mut self.says_banner) {
                self.wire.send(b"QSB-D  0E!\r\n", self.baud, line_baud != 0 && line_baud != self.baud, at);
                continue;
            }
            self.next_tick += i64::from(self.of(register::STREAM_INTERVAL).max(1));
            self.streamed += 1;
            if self.wire.withholds() {
                continue;
            }
            let count = self.count(at);
            self.say(b's', register::COUNT, count, line_baud, at);
        }
    }

    fn obey(&mut self, command: Option<Command>, line_baud: u32, now_ns: i64) {
        let Some(command) = command else {
            self.wire.send(b"e!\r\n", self.baud, line_baud != 0 && line_baud != self.baud, now_ns);
            return;
        };
        self.obeyed.push(command.bytes());
        match command {
            Command::Read(register) => {
                self.streams = false;
                let value = if register == register::COUNT { self.count(now_ns) } else { self.of(register) };
                self.say(b'r', register, value, line_baud, now_ns);
            }
            Command::Write(register, value) => {
                if register == register::RESET_TIME {
                    self.born_ns = now_ns;
                } else if let Some(kept) = self.registers.get_mut(usize::from(register)) {
                    *kept = value;
                }
                self.say(b'w', register, value, line_baud, now_ns);
            }
            Command::Stream(_) => {
                self.streams = true;
                self.next_tick = self.ticks(now_ns) + 1;
            }
        }
    }
}

impl Peer for Twin {
    fn open(&mut self, now_ns: i64) -> Result<(), LineError> {
        if !self.plugged {
            return Err(LineError::Absent("no such file".into()));
        }
        if self.resets_when_opened {
            self.reset(now_ns);
        }
        Ok(())
    }

    fn written(&mut self, bytes: &[u8], baud: u32, now_ns: i64) {
        if !self.plugged || self.hung || now_ns < self.busy_ns {
            return;
        }
        self.go_on(baud, now_ns);
        if baud != 0 && baud != self.baud {
            return;
        }
        self.input.extend_from_slice(bytes);
        while let Some((command, taken)) = Command::read(&self.input) {
            let is_empty = self.input[..taken].trim_ascii().is_empty();
            self.input.drain(..taken);
            if !is_empty {
                self.obey(command, baud, now_ns);
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
        if self.streams && self.time_of(self.next_tick) < now_ns - SECOND {
            // It was not listened to: what it sent is gone.
            self.next_tick = self.ticks(now_ns) + 1;
        }
        loop {
            // As far as the first byte that the host waits for, and no farther: what it will say then may change everything after it.
            match self.wire.due() {
                Some(at) if at <= until_ns => return Ok(self.wire.take(at.max(now_ns))),
                _ => {}
            }
            match self.turn() {
                Some(at) if at <= until_ns => self.go_on(baud, at),
                _ => return Ok(None),
            }
        }
    }

    fn due(&self, _now_ns: i64) -> Option<i64> {
        [self.wire.due(), self.turn()].into_iter().flatten().min()
    }
}
