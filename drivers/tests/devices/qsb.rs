//! Three QSBs as one arm, in their initial states and with faults.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use drivers::arm::Settings;
use drivers::arm::qsb::{Arm, Unit, register};
use drivers::connection::Protocol;
use drivers::simulated::qsb::Twin;
use drivers::simulated::{Faults, Joints, Machine, Pty};
use drivers::transport::{MemoryOpener, Opener, PortPath, SerialOpener};
use sonoweave_core::clock::{Clock, MS, Manual, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Counts, Reading, Status};
use sonoweave_core::{Device, Next};

use crate::bench::BEGIN;
use crate::joints::{SOON, counts, is_true, moving, split, text, unnumbered};

/// The arm, with the units that it consists of.
struct Trio {
    twins: [Arc<Mutex<Twin>>; 3],
    clock: Manual,
    device: Arm,
}

impl Trio {
    fn new(change: impl Fn(&mut Twin), settings: &Settings, keeps_raw: bool) -> Self {
        let clock = Manual::at(BEGIN);
        let twins = [0, 1, 2].map(|axis| {
            let mut twin = Twin::new(moving(), axis, Faults::default());
            change(&mut twin);
            Arc::new(Mutex::new(twin))
        });
        let opener = |twin: &Arc<Mutex<Twin>>| -> Box<dyn Opener> {
            Box::new(MemoryOpener::new(Arc::clone(twin), clock.clone(), 9600))
        };
        let openers = twins.each_ref().map(opener);
        let mut device = Arm::new(openers, Arc::new(clock.clone()), settings, keeps_raw).unwrap();
        device.start().unwrap();
        Self { twins, clock, device }
    }

    fn usual() -> Self {
        Self::new(|_| {}, &Settings::default(), false)
    }

    fn readings(&mut self, ns: i64) -> Vec<Reading> {
        let end = self.clock.now_ns() + ns;
        let mut readings = Vec::new();
        while self.clock.now_ns() < end {
            let deadline = (self.clock.now_ns() + 10 * MS).min(end);
            if let Next::Reading(reading) = self.device.next(deadline).unwrap() {
                readings.push(reading);
            }
            assert!(self.clock.now_ns() <= deadline, "beyond the deadline");
        }
        readings
    }

    fn until(&mut self, state: State) -> i64 {
        let begin = self.clock.now_ns();
        while self.device.health().state != state {
            let passed = self.clock.now_ns() - begin;
            assert!(passed < SOON, "not {state:?}: {:?}", self.device.health());
            self.readings(MS);
        }
        self.clock.now_ns() - begin
    }

    fn homed(mut self) -> Self {
        self.until(State::Running);
        self.device.home(7);
        self.readings(100 * MS);
        assert_eq!(self.device.health().why, "");
        self
    }

    fn twin(&self, axis: usize) -> std::sync::MutexGuard<'_, Twin> {
        self.twins[axis].lock().unwrap()
    }

    /// Returns the time of a count by its unit's clock, exact to the rounding of a tick.
    fn time_of(&self, counts: &Counts) -> i64 {
        let twin = self.twin(counts.first.into());
        let tick = (counts.stamp.ticks.unwrap() as u32).wrapping_sub(twin.first_tick);
        twin.time_of(tick.into())
    }
}

#[test]
fn counts_match_joints_at_unit_ticks() {
    let mut trio = Trio::usual();
    let took = trio.until(State::Running);
    assert!(took < SECOND, "{} ms", took / MS);
    let not_homed = counts(trio.readings(100 * MS));
    assert!(not_homed.iter().all(|c| c.homed == 0
        && text(c) == format!("axis {} is not homed: move the arm to its home position and home it", c.first + 1)));
    let mut trio = trio.homed();
    let first: Vec<Counts> = counts(trio.readings(50 * MS));
    // The driver chose the zero when homing; all later counts share it.
    let zeros = [0, 1, 2].map(|axis| {
        let c = first.iter().find(|c| usize::from(c.first) == axis).unwrap();
        moving()(trio.time_of(c))[axis] - c.counts[0]
    });
    let found = counts(trio.readings(5 * SECOND));
    let timing = trio.device.describe().timing;
    assert_eq!((timing.tick_hz, timing.wraps_at, timing.rate_hz), (Some(512.0), Some(1 << 32), Some(102.4)));
    assert!(found.windows(2).all(|two| two[1].stamp.item == two[0].stamp.item + 1));
    for axis in 0..3_u8 {
        let own: Vec<&Counts> = found.iter().filter(|c| c.first == axis).collect();
        assert!((510..=514).contains(&own.len()), "{}", own.len());
        for c in &own {
            assert_eq!((c.axes, c.homed, &c.status), (1, 1 << axis, &Status::Ok));
            let time = trio.time_of(c);
            assert!(is_true(&moving(), c, time - 2000, 4000, &zeros[usize::from(axis)..]), "{c:?}");
            // The record's bytes, and polling of the two other lines.
            let late = c.stamp.host_ns.unwrap() - time - timing.wire_ns;
            assert!((-2000..MS).contains(&late), "{late}");
        }
    }
    let received = trio.device.health().received;
    assert_eq!((received.set_up, received.lost, received.refused), (3, 0, 0));
    let fields = &trio.device.describe().fields;
    assert!(fields.contains(&("Axis2Serial".into(), "12345".into())), "{fields:?}");
}

#[test]
fn unit_in_any_initial_state_is_set_up() {
    for left in 0..8 {
        let change = |twin: &mut Twin| {
            twin.resets_when_opened = left & 1 != 0;
            twin.streams = left & 2 != 0;
            twin.registers[usize::from(register::REPLY_FORMAT)] = if left & 4 != 0 { 0xf } else { 1 };
            twin.registers[usize::from(register::COUNT_MODE)] = 1;
            twin.registers[usize::from(register::STREAM_THRESHOLD)] = 100;
        };
        let mut trio = Trio::new(change, &Settings { rate_hz: 512, ..Settings::default() }, false);
        let took = trio.until(State::Running);
        assert!(took < SECOND, "{left}: {} ms", took / MS);
        assert!(counts(trio.readings(SECOND)).len() >= 3 * 511, "{left}");
        assert_eq!(trio.twin(0).registers[usize::from(register::COUNT_MODE)], 3);
        assert_eq!(trio.twin(0).registers[usize::from(register::STREAM_THRESHOLD)], 0);
    }
}

#[test]
fn sent_commands_set_registers() {
    let mut trio = Trio::new(|twin| twin.resets_when_opened = false, &Settings::default(), false);
    trio.until(State::Running);
    trio.device.stop().unwrap();
    for axis in 0..3 {
        let obeyed: Vec<String> =
            trio.twin(axis).wire.obeyed.iter().map(|b| String::from_utf8(b.clone()).unwrap()).collect();
        let expected = ["R0E\n", "R14\n", "W15F\n", "W000\n", "W033\n", "W0B0\n", "W0C5\n", "W0D1\n", "S0E\n", "R0E\n"];
        assert_eq!(obeyed, expected);
    }
    assert_eq!(trio.device.health().state, State::Stopped);
}

#[test]
fn absent_or_hung_unit_is_named_and_delays_no_other() {
    let mut trio = Trio::usual().homed();
    trio.twin(1).unplug();
    trio.until(State::Absent);
    assert!(trio.device.health().why.starts_with("axis 2 of 3: ") && trio.device.health().why.contains("unplugged"));
    let found = counts(trio.readings(5 * SECOND));
    assert!(found.iter().all(|c| c.first != 1 && c.status == Status::Ok));
    assert!((1020..=1028).contains(&found.len()), "{}", found.len());
    assert!(trio.device.health().why.contains("plug it in"), "{}", trio.device.health().why);
    trio.twin(1).wire.plugged = true;
    let back = trio.until(State::Running);
    assert!(back < SECOND, "{} ms", back / MS);
    let found = counts(trio.readings(SECOND));
    assert!(found.iter().all(|c| (c.first == 1) == (c.homed == 0)), "what was away has to be homed");
    assert!(trio.device.health().why.starts_with("axis 2 of 3: axis 2 is not homed"), "{}", trio.device.health().why);
    let mut trio = trio.homed();
    trio.twin(2).wire.hung = true;
    let noticed = trio.until(State::Silent);
    assert!(noticed < SECOND / 2, "{} ms", noticed / MS);
    assert!(trio.device.health().why.starts_with("axis 3 of 3: "), "{}", trio.device.health().why);
    let found = counts(trio.readings(5 * SECOND));
    assert!(found.iter().all(|c| c.first != 2) && found.len() > 1010);
    assert!(trio.device.health().why.contains("does not answer"), "{}", trio.device.health().why);
    trio.twin(2).wire.hung = false;
    let back = trio.until(State::Running);
    assert!(back < SECOND, "{} ms", back / MS);
}

#[test]
fn reset_and_jump_require_homing() {
    let mut trio = Trio::usual().homed();
    let now = trio.clock.now_ns();
    trio.twin(0).reset(now);
    let [_, after] = split(counts(trio.readings(2 * SECOND)), |c| c.first == 0 && c.homed == 0);
    assert!(after.len() > 100 && after.iter().all(|c| c.first != 0 || text(c).contains("axis 1")));
    assert!(trio.device.health().why.contains("axis 1 of 3 was reset"), "{}", trio.device.health().why);
    let mut trio = trio.homed();
    trio.twin(2).slip(-70_000);
    let [_, after] = split(counts(trio.readings(SECOND)), |c| c.status != Status::Ok);
    assert!(text(&after[0]).starts_with("axis 3 of 3 jumped by -"), "{}", text(&after[0]));
    assert!(after.iter().all(|c| (c.first == 2) == (c.homed == 0)));
    assert!(trio.device.health().why.contains("jumped by -"), "{}", trio.device.health().why);
    trio.homed();
}

#[test]
fn counts_and_ticks_survive_wrap() {
    let mut trio = Trio::new(|twin| twin.resets_when_opened = false, &Settings::default(), false);
    trio.until(State::Running);
    let ahead = moving()(trio.clock.now_ns())[0];
    trio.twin(0).zero = ahead - i64::from(i32::MAX) + 500;
    let ticks = ((trio.clock.now_ns() - trio.twin(0).born_ns) as f64 / SECOND as f64 * 512.0) as u32;
    trio.twin(0).first_tick = u32::MAX - ticks - 600;
    trio.readings(200 * MS);
    let mut trio = trio.homed();
    let found = counts(trio.readings(3 * SECOND));
    let own: Vec<&Counts> = found.iter().filter(|c| c.first == 0).collect();
    assert!(own.iter().all(|c| c.status == Status::Ok) && own.len() > 300);
    assert!(own.windows(2).any(|two| two[1].stamp.ticks < two[0].stamp.ticks), "the clock wraps");
    for two in own.windows(2) {
        let ticks = [0, 1].map(|n| two[n].stamp.ticks.unwrap() as u32);
        assert_eq!(ticks[1].wrapping_sub(ticks[0]), 5);
        // 10 counts per ms, 5/512 s.
        assert!((two[1].counts[0] - two[0].counts[0] - 97).abs() <= 1, "{two:?}");
    }
}

#[test]
fn lost_bytes_lose_lines_without_wrong_ones() {
    let mut trio = Trio::usual().homed();
    let first = counts(trio.readings(50 * MS));
    let zero = first.iter().find(|c| c.first == 0).map(|c| moving()(trio.time_of(c))[0] - c.counts[0]).unwrap();
    let before = trio.device.health().received;
    let begin = trio.twin(0).streamed;
    trio.twin(0).wire.set_faults(Faults { drop: 0.002, dropout: 0.01, ..Faults::default() });
    let found = counts(trio.readings(30 * SECOND));
    let (streamed, received) = (trio.twin(0).streamed - begin, trio.device.health().received);
    let own: Vec<&Counts> = found.iter().filter(|c| c.first == 0).collect();
    for c in &own {
        assert!(is_true(&moving(), c, trio.time_of(c) - 2000, 4000, &[zero]) && c.status == Status::Ok, "{c:?}");
    }
    let lost = received.lost - before.lost;
    assert!((lost + own.len() as u64).abs_diff(streamed) <= 2 && lost > 50, "{lost} {} {streamed}", own.len());
}

#[test]
fn noise_errors_stay_below_jump_limit() {
    let settings = Settings { fastest: 20_000, ..Settings::default() };
    let mut trio = Trio::new(|_| {}, &settings, false).homed();
    let first = counts(trio.readings(50 * MS));
    let zero = first.iter().find(|c| c.first == 0).map(|c| moving()(trio.time_of(c))[0] - c.counts[0]).unwrap();
    trio.twin(0).wire.set_faults(Faults { noise: 0.003, ..Faults::default() });
    let found = counts(trio.readings(30 * SECOND));
    let own: Vec<&Counts> = found.iter().filter(|c| c.first == 0).collect();
    assert!(own.len() > 2500, "{}", own.len());
    for c in own {
        // Without a checksum, a low digit of count or time may be wrong: by at most the
        // possible movement until the next line.
        let truth = moving()(c.stamp.host_ns.unwrap())[0] - zero;
        assert!((c.counts[0] - truth).abs() < 1500, "{c:?} {truth}");
    }
}

#[test]
fn raw_bytes_replay_same_readings() {
    let mut trio = Trio::new(|_| {}, &Settings::default(), true);
    let readings = trio.readings(5 * SECOND);
    let mut units = [0, 1, 2].map(|axis| Unit::new("a recording", Settings::default(), axis, 3).unwrap());
    let (mut again, mut live) = (VecDeque::new(), Vec::new());
    units.iter_mut().for_each(Unit::resume);
    for reading in &readings {
        match reading {
            Reading::Raw(raw) => {
                units[usize::from(raw.line)].decode(&raw.bytes, raw.stamp.host_ns.unwrap(), &mut again)
            }
            // The caller of the protocol numbers the readings.
            Reading::Counts(counts) => live.push(unnumbered(counts)),
            other => panic!("{other:?}"),
        }
    }
    assert!(live.len() > 1200 && again.len() == live.len(), "{} {}", live.len(), again.len());
    for (again, live) in again.iter().zip(live) {
        assert!(matches!(again, Reading::Counts(counts) if *counts == live), "{again:?} {live:?}");
    }
}

#[test]
fn pseudo_terminal_counts_are_exact_until_hangup() {
    let begin = Monotonic.now_ns();
    let joints: Joints = Arc::new(move |ns| {
        let ms = (ns - begin) / MS;
        [ms, -2 * ms, 5, 0, 0, 0]
    });
    let twins = [0, 1, 2].map(|axis| Arc::new(Mutex::new(Twin::new(Arc::clone(&joints), axis, Faults::default()))));
    let mut ptys: Vec<Pty> = twins.iter().map(|twin| Pty::run(Arc::clone(twin)).unwrap()).collect();
    let openers = [0, 1, 2].map(|axis: usize| -> Box<dyn Opener> {
        let port = PortPath { path: ptys[axis].path().into(), baud: 9600 };
        Box::new(SerialOpener::new(port, Arc::new(Monotonic)))
    });
    let mut device = Arm::new(openers, Arc::new(Monotonic), &Settings::default(), false).unwrap();
    device.start().unwrap();
    let end = Monotonic.now_ns() + 20 * SECOND;
    let mut found = [0; 3];
    while found.iter().any(|found| *found < 50) {
        assert!(Monotonic.now_ns() < end, "{:?}", device.health());
        if let Next::Reading(Reading::Counts(c)) = device.next(Monotonic.now_ns() + 50 * MS).unwrap() {
            let axis = usize::from(c.first);
            found[axis] += 1;
            let twin = twins[axis].lock().unwrap();
            let time = twin.time_of(i64::try_from(c.stamp.ticks.unwrap()).unwrap());
            drop(twin);
            assert!(is_true(&joints, &c, time - 2000, 4000, &[0]), "{c:?}");
        }
    }
    ptys.remove(1);
    while device.health().state != State::Absent {
        assert!(Monotonic.now_ns() < end + 5 * SECOND, "{:?}", device.health());
        device.next(Monotonic.now_ns() + 50 * MS).unwrap();
    }
    assert!(device.health().why.starts_with("axis 2 of 3"), "{}", device.health().why);
}
