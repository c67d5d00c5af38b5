//! MicroScribe, in its initial states and with faults.

use std::sync::{Arc, Mutex};

use drivers::arm::Settings;
use drivers::arm::microscribe::{Family, Unit};
use drivers::connection::Connection;
use drivers::simulated::microscribe::{Session, Twin};
use drivers::simulated::{Faults, Joints, Machine, Pty};
use drivers::transport::{PortPath, SerialOpener};
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Counts, Reading, Status};
use sonoweave_core::{Device, Next};

use crate::bench::{Rig, refused_setting, replays};
use crate::joints::{SOON, counts, is_true, moving, split, text};

fn unit() -> Unit {
    Unit::new("a line", Settings::of_14_bits(), Family::MicroScribe, 6).unwrap()
}

fn rig(twin: Twin) -> Rig<Twin, Unit> {
    let mut rig = Rig::new(twin, unit(), false);
    rig.device.start().unwrap();
    rig
}

fn usual() -> Rig<Twin, Unit> {
    rig(Twin::new(moving(), Faults::default()))
}

/// Returns the sampling time, from the stamp and the driver's wire time: the device samples 0.3
/// ms after the request.
fn time_of(counts: &Counts, wire_ns: i64) -> i64 {
    counts.stamp.host_ns.unwrap() - wire_ns - 3 * MS / 10
}

/// Returns the zeros of counts that start at the encoders' values at home.
fn zeros(rig: &Rig<Twin, Unit>) -> [i64; 6] {
    rig.twin.lock().unwrap().offsets.map(|offset| -offset)
}

#[test]
fn counts_match_joints_at_request_time() {
    let mut rig = usual();
    let took = rig.until(State::Running, SOON);
    assert!(took < SECOND, "{} ms", took / MS);
    let found = counts(rig.readings(5 * SECOND));
    let timing = rig.device.describe().timing;
    assert_eq!((timing.rate_hz, timing.tick_hz, timing.wire_ns), (Some(100.0), None, 14 * 10 * SECOND / 115_200));
    assert!((499..=501).contains(&found.len()), "{}", found.len());
    let zeros = zeros(&rig);
    let sampled = rig.twin.lock().unwrap().sampled.clone();
    assert!(found.iter().any(|c| c.counts[0] > 0x3fff), "the first encoder wraps");
    for (n, c) in found.iter().enumerate() {
        assert_eq!((c.first, c.axes, c.homed, c.buttons, &c.status), (0, 6, 0b11_1111, 0, &Status::Ok));
        assert_eq!(c.stamp.item, found[0].stamp.item + n as u64);
        let time = time_of(c, timing.wire_ns);
        assert!(sampled.binary_search(&time).is_ok(), "the very time at which it was sampled");
        assert!(is_true(&moving(), c, time, 0, &zeros), "{c:?}");
    }
    assert_eq!(rig.device.health().why, "");
    let fields = &rig.device.describe().fields;
    for (name, value) in [
        ("Product", "MSCR"),
        ("Baud", "115200"),
        ("Serial", "M1234"),
        ("CountsPerTurn", "16384 16384 8192 8192 8192 4096"),
        ("LinkLengthsMils", "3000 4000 5000 6000 7000 8000"),
    ] {
        assert!(fields.contains(&(name.into(), value.into())), "{name}: {fields:?}");
    }
}

#[test]
fn device_in_any_state_and_rate_is_woken() {
    for fastest in [115_200, 57_600, 38_400, 19_200, 9_600] {
        for session in [Session::None, Session::Signed, Session::Begun] {
            for answers_links in [true, false] {
                let mut twin = Twin::new(moving(), Faults::default());
                (twin.fastest_baud, twin.wire.baud, twin.session) = (fastest, fastest, session);
                twin.answers_links = answers_links;
                let mut rig = rig(twin);
                let took = rig.until(State::Running, SOON);
                assert!(took < 2 * SECOND, "{fastest} {session:?}: {} ms", took / MS);
                let found = counts(rig.readings(SECOND));
                // 14 bytes take 14.6 ms at 9600 baud, and their request 1 ms.
                let least = if fastest == 9_600 { 48 } else { 99 };
                assert!(found.len() >= least, "{fastest}: {}", found.len());
                assert!(found.iter().all(|c| c.status == Status::Ok));
            }
        }
    }
}

#[test]
fn sent_commands_match_manufacturer_library() {
    let mut twin = Twin::new(moving(), Faults::default());
    twin.buttons = 0b10;
    let mut rig = rig(twin);
    rig.until(State::Running, SOON);
    let found = counts(rig.readings(15 * MS));
    assert_eq!(found[0].buttons, 0b10);
    rig.device.protocol_mut().home();
    rig.readings(15 * MS);
    rig.device.stop().unwrap();
    let obeyed = rig.twin.lock().unwrap().wire.obeyed.concat();
    let (questions, samples) = obeyed.split_at(6);
    assert_eq!(questions, [0xca, 0xcb, 0xce, 0xcd, 0xc6, 0xc0]);
    let home = samples.iter().position(|byte| *byte == 0xc2).unwrap();
    assert!(samples[..home].iter().chain(&samples[home + 1..samples.len() - 1]).all(|byte| *byte == 0x03));
    assert_eq!(samples.last(), Some(&0xc5), "the session is ended");
    assert_eq!(rig.twin.lock().unwrap().session, Session::None);
}

#[test]
fn jump_requires_homing_which_sets_all_counters() {
    let mut rig = usual();
    rig.until(State::Running, SOON);
    rig.twin.lock().unwrap().slip(3, 4000);
    let [before, after] = split(counts(rig.readings(SECOND)), |c| c.status != Status::Ok);
    assert!(before.len() <= 3 && after.len() > 95);
    assert!(text(&after[0]).starts_with("axis 4 of 6 jumped by 40"), "{}", text(&after[0]));
    assert!(after.iter().all(|c| c.homed == 0b11_0111 && text(c).contains("axis 4")));
    assert!(rig.device.health().why.starts_with("axis 4 of 6 jumped"), "{}", rig.device.health().why);
    rig.device.protocol_mut().home();
    let [_, after] = split(counts(rig.readings(SECOND)), |c| c.status == Status::Ok);
    let (zeros, wire) = (zeros(&rig), rig.device.describe().timing.wire_ns);
    assert!(after.len() > 95);
    for c in &after {
        assert_eq!((c.homed, &c.status), (0b11_1111, &Status::Ok));
        // The last encoder reads 16383 at home and 0 soon after: the count continues across the
        // wrap.
        assert!(is_true(&moving(), c, time_of(c, wire), 0, &zeros), "{c:?} {zeros:?}");
    }
    assert_eq!((rig.device.health().why.as_str(), rig.device.health().received.refused), ("", 0));
}

#[test]
fn unplugged_device_is_absent_then_requires_homing() {
    let mut rig = usual();
    rig.until(State::Running, SOON);
    rig.twin.lock().unwrap().unplug();
    assert!(rig.until(State::Absent, SECOND) < 20 * MS, "told at once");
    assert!(rig.readings(3 * SECOND).is_empty());
    assert!(rig.device.health().why.contains("plug it in"), "{}", rig.device.health().why);
    // The device may have been switched off meanwhile; in this test it was.
    let now = rig.clock.now_ns();
    rig.twin.lock().unwrap().switch_off_and_on(now);
    rig.twin.lock().unwrap().wire.plugged = true;
    let back = rig.until(State::Running, SOON);
    assert!(back < SECOND, "{} ms", back / MS);
    assert!(counts(rig.readings(SECOND)).iter().all(|c| c.homed == 0 && text(c).contains("home it")));
    assert!(rig.device.health().why.contains("home it"), "{}", rig.device.health().why);
    rig.device.protocol_mut().home();
    rig.readings(100 * MS);
    assert_eq!(rig.device.health().why, "");
}

#[test]
fn hung_device_is_silent_not_absent() {
    let mut rig = usual();
    rig.until(State::Running, SOON);
    rig.twin.lock().unwrap().wire.hung = true;
    let noticed = rig.until(State::Silent, 2 * SECOND);
    assert!(noticed < 600 * MS, "{} ms", noticed / MS);
    assert!(rig.readings(3 * SECOND).is_empty());
    assert!(rig.device.health().why.contains("switched on"), "{}", rig.device.health().why);
    rig.twin.lock().unwrap().wire.hung = false;
    let back = rig.until(State::Running, SOON);
    assert!(back < 2 * SECOND, "{} ms", back / MS);
    assert_eq!(rig.device.health().received.opened, 1);
}

#[test]
fn lost_bytes_lose_samples_without_wrong_ones() {
    let mut rig = usual();
    rig.until(State::Running, SOON);
    rig.twin.lock().unwrap().wire.set_faults(Faults { drop: 0.002, dropout: 0.01, ..Faults::default() });
    let found = counts(rig.readings(60 * SECOND));
    let (zeros, wire) = (zeros(&rig), rig.device.describe().timing.wire_ns);
    // 14 bytes per sample: one in 36 is hit.
    assert!((5500..5950).contains(&found.len()), "{}", found.len());
    for c in &found {
        // The next sample's mark ends a cut sample, which is refused.
        assert!(is_true(&moving(), c, time_of(c, wire), 0, &zeros) && c.status == Status::Ok, "{c:?}");
    }
    let received = rig.device.health().received;
    assert!(received.skipped > 1000 && received.set_up == 1, "{received:?}");
}

#[test]
fn noise_errors_stay_below_jump_limit() {
    let mut rig = usual();
    rig.until(State::Running, SOON);
    rig.twin.lock().unwrap().wire.set_faults(Faults { noise: 0.002, ..Faults::default() });
    let found = counts(rig.readings(60 * SECOND));
    let zeros = zeros(&rig);
    assert!(found.len() > 5000, "{}", found.len());
    for c in &found {
        let truth = moving()(c.stamp.host_ns.unwrap());
        let off = (0..6).map(|axis| (c.counts[axis] + -truth[axis] + zeros[axis]).abs()).max().unwrap();
        assert!(off < 2000, "{off}: {c:?}");
    }
}

#[test]
fn raw_bytes_replay_same_readings() {
    let faults = Faults { drop: 0.001, ..Faults::default() };
    let mut rig = Rig::new(Twin::new(moving(), faults), unit(), true);
    rig.device.start().unwrap();
    let mut readings = rig.readings(4 * SECOND);
    rig.twin.lock().unwrap().slip(2, 3000);
    readings.extend(rig.readings(2 * SECOND));
    rig.device.protocol_mut().home();
    readings.extend(rig.readings(4 * SECOND));
    let found = counts(readings.clone());
    assert!(found.iter().any(|c| c.homed != 0b11_1111) && found.last().unwrap().homed == 0b11_1111);
    let found = replays(&readings, unit);
    assert!(found > 900, "{found}");
}

#[test]
fn pseudo_terminal_counts_are_exact_until_hangup() {
    let begin = Monotonic.now_ns();
    let joints: Joints = Arc::new(move |ns| [(ns - begin) / MS, 7, -9, 0, 1, 2]);
    let mut left = Twin::new(Arc::clone(&joints), Faults::default());
    (left.wire.baud, left.home) = (115_200, [100; 6]);
    left.switch_off_and_on(begin);
    let twin = Arc::new(Mutex::new(left));
    let pty = Pty::run(Arc::clone(&twin)).unwrap();
    let opener = SerialOpener::new(PortPath { path: pty.path().into(), baud: 9600 }, Arc::new(Monotonic));
    let mut device = Connection::new(Box::new(opener), Arc::new(Monotonic), unit(), false);
    device.start().unwrap();
    let end = Monotonic.now_ns() + 20 * SECOND;
    let mut found = Vec::new();
    while found.len() < 100 {
        assert!(Monotonic.now_ns() < end, "{:?}", device.health());
        match device.next(Monotonic.now_ns() + 50 * MS).unwrap() {
            Next::Reading(Reading::Counts(counts)) => found.push(counts),
            Next::Reading(other) => panic!("{other:?}"),
            Next::Pending => {}
            Next::End => panic!("the end"),
        }
    }
    let offsets = twin.lock().unwrap().offsets;
    let sampled = twin.lock().unwrap().sampled.clone();
    for c in &found {
        // The counts of a request shortly before the stamp: a busy machine sends the next
        // request before it has read the answer.
        let host = c.stamp.host_ns.unwrap();
        let is_it = |at: &&i64| {
            let truth = joints(**at);
            c.as_slice() == std::array::from_fn::<i64, 6, _>(|axis| truth[axis] + offsets[axis])
        };
        let requested = sampled.iter().filter(|at| (0..2 * SECOND).contains(&(host - **at)));
        assert!(requested.rev().find(is_it).is_some(), "{c:?}");
        assert_eq!((c.homed, &c.status), (0b11_1111, &Status::Ok));
    }
    drop(pty);
    while device.health().state != State::Absent {
        assert!(Monotonic.now_ns() < end + 5 * SECOND, "{:?}", device.health());
        device.next(Monotonic.now_ns() + 50 * MS).unwrap();
    }
}

#[test]
fn impossible_settings_are_refused() {
    let refused = |settings, encoders| refused_setting(Unit::new("x", settings, Family::MicroScribe, encoders).err());
    for encoders in [0, 3, 4, 7] {
        assert_eq!(refused(Settings::of_14_bits(), encoders), "encoders");
    }
    assert_eq!(refused(Settings { baud: Some(230_400), ..Settings::of_14_bits() }, 6), "baud");
    let mut twin = Twin::new(moving(), Faults::default());
    twin.maxima[1] = 4095;
    let settings = Settings { counts_per_turn: [16_384, 16_384, 0], ..Settings::of_14_bits() };
    let mut rig = Rig::new(twin, Unit::new("x", settings, Family::MicroScribe, 6).unwrap(), false);
    rig.device.start().unwrap();
    assert!(rig.readings(2 * SECOND).is_empty());
    assert!(
        rig.device.health().why.contains("axis 2 has 4096 counts a turn and not 16384"),
        "{}",
        rig.device.health().why
    );
}
