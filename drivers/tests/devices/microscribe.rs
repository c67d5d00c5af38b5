//! MicroScribe, as it is found and as it fails.

use std::sync::{Arc, Mutex};

use drivers::arm::Settings;
use drivers::arm::microscribe::{Family, Unit};
use drivers::clock::{Clock, MS, Monotonic, SECOND};
use drivers::connection::Connection;
use drivers::health::State;
use drivers::reading::{Counts, Reading, Status};
use drivers::simulated::microscribe::{Session, Twin};
use drivers::simulated::{Faults, Joints, Pty};
use drivers::transport::{PortPath, SerialOpener};
use drivers::{Device, Next};

use crate::bench::{Rig, replays};
use crate::joints::{SOON, counts, is_true, moving, said, split};

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

/// When it was sampled, by the stamp and what the driver says of the line: 0.3 ms later than it was asked.
fn time_of(counts: &Counts, wire_ns: i64) -> i64 {
    counts.stamp.host_ns.unwrap() - wire_ns - 3 * MS / 10
}

/// Zeros of counts that begin with what the encoders show at home.
fn zeros(rig: &Rig<Twin, Unit>) -> [i64; 6] {
    rig.twin.lock().unwrap().offsets.map(|offset| -offset)
}

#[test]
fn counts_are_those_of_the_joints_when_it_was_asked() {
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
fn a_device_is_woken_however_it_was_left_and_at_whatever_rate_it_follows() {
    for fastest in [115_200, 57_600, 38_400, 19_200, 9_600] {
        for session in [Session::None, Session::Signed, Session::Begun] {
            for answers_links in [true, false] {
                let mut twin = Twin::new(moving(), Faults::default());
                (twin.fastest_baud, twin.baud, twin.session) = (fastest, fastest, session);
                twin.answers_links = answers_links;
                let mut rig = rig(twin);
                let took = rig.until(State::Running, SOON);
                assert!(took < 2 * SECOND, "{fastest} {session:?}: {} ms", took / MS);
                let found = counts(rig.readings(SECOND));
                // 14 bytes take 14.6 ms at 9600, and what asks for them 1 ms.
                let least = if fastest == 9_600 { 48 } else { 99 };
                assert!(found.len() >= least, "{fastest}: {}", found.len());
                assert!(found.iter().all(|c| c.status == Status::Ok));
            }
        }
    }
}

#[test]
fn what_is_sent_is_what_the_maker_s_library_sends() {
    let mut twin = Twin::new(moving(), Faults::default());
    twin.buttons = 0b10;
    let mut rig = rig(twin);
    rig.until(State::Running, SOON);
    let found = counts(rig.readings(15 * MS));
    assert_eq!(found[0].buttons, 0b10);
    rig.device.protocol_mut().home();
    rig.readings(15 * MS);
    rig.device.stop().unwrap();
    let obeyed = rig.twin.lock().unwrap().obeyed.clone();
    let (questions, samples) = obeyed.split_at(6);
    assert_eq!(questions, [0xca, 0xcb, 0xce, 0xcd, 0xc6, 0xc0]);
    let home = samples.iter().position(|byte| *byte == 0xc2).unwrap();
    assert!(samples[..home].iter().chain(&samples[home + 1..samples.len() - 1]).all(|byte| *byte == 0x03));
    assert_eq!(samples.last(), Some(&0xc5), "the session is ended");
    assert_eq!(rig.twin.lock().unwrap().session, Session::None);
}

#[test]
fn a_jump_demands_homing_and_homing_sets_all_counters() {
    let mut rig = usual();
    rig.until(State::Running, SOON);
    rig.twin.lock().unwrap().slip(3, 4000);
    let [before, after] = split(counts(rig.readings(SECOND)), |c| c.status != Status::Ok);
    assert!(before.len() <= 3 && after.len() > 95);
    assert!(said(&after[0]).starts_with("axis 4 of 6 jumped by 40"), "{}", said(&after[0]));
    assert!(after.iter().all(|c| c.homed == 0b11_0111 && said(c).contains("axis 4")));
    assert!(rig.device.health().why.starts_with("axis 4 of 6 jumped"), "{}", rig.device.health().why);
    rig.device.protocol_mut().home();
    let [_, after] = split(counts(rig.readings(SECOND)), |c| c.status == Status::Ok);
    let (zeros, wire) = (zeros(&rig), rig.device.describe().timing.wire_ns);
    assert!(after.len() > 95);
    for c in &after {
        assert_eq!((c.homed, &c.status), (0b11_1111, &Status::Ok));
        // The last encoder shows 16383 at home and is at 0 soon after: it is counted on.
        assert!(is_true(&moving(), c, time_of(c, wire), 0, &zeros), "{c:?} {zeros:?}");
    }
    assert_eq!((rig.device.health().why.as_str(), rig.device.health().received.refused), ("", 0));
}

#[test]
fn unplugged_is_absent_and_back_within_two_seconds_and_has_to_be_homed() {
    let mut rig = usual();
    rig.until(State::Running, SOON);
    rig.twin.lock().unwrap().unplug();
    assert!(rig.until(State::Absent, SECOND) < 20 * MS, "told at once");
    assert!(rig.readings(3 * SECOND).is_empty());
    assert!(rig.device.health().why.contains("plug it in"), "{}", rig.device.health().why);
    // It may have been switched off meanwhile, and here it was.
    let now = rig.clock.now_ns();
    rig.twin.lock().unwrap().switch_off_and_on(now);
    rig.twin.lock().unwrap().plugged = true;
    let back = rig.until(State::Running, SOON);
    assert!(back < SECOND, "{} ms", back / MS);
    assert!(counts(rig.readings(SECOND)).iter().all(|c| c.homed == 0 && said(c).contains("home it")));
    assert!(rig.device.health().why.contains("home it"), "{}", rig.device.health().why);
    rig.device.protocol_mut().home();
    rig.readings(100 * MS);
    assert_eq!(rig.device.health().why, "");
}

#[test]
fn a_device_that_hangs_is_silent_and_not_absent() {
    let mut rig = usual();
    rig.until(State::Running, SOON);
    rig.twin.lock().unwrap().hung = true;
    let noticed = rig.until(State::Silent, 2 * SECOND);
    assert!(noticed < 600 * MS, "{} ms", noticed / MS);
    assert!(rig.readings(3 * SECOND).is_empty());
    assert!(rig.device.health().why.contains("switched on"), "{}", rig.device.health().why);
    rig.twin.lock().unwrap().hung = false;
    let back = rig.until(State::Running, SOON);
    assert!(back < 2 * SECOND, "{} ms", back / MS);
    assert_eq!(rig.device.health().received.opened, 1);
}

#[test]
fn lost_bytes_cost_their_samples_and_make_no_wrong_one() {
    let mut rig = usual();
    rig.until(State::Running, SOON);
    rig.twin.lock().unwrap().set_faults(Faults { drop: 0.002, dropout: 0.01, ..Faults::default() });
    let found = counts(rig.readings(60 * SECOND));
    let (zeros, wire) = (zeros(&rig), rig.device.describe().timing.wire_ns);
    // 14 bytes a sample: one in 36 is hit.
    assert!((5500..5950).contains(&found.len()), "{}", found.len());
    for c in &found {
        // What is cut is complete when the next one's mark comes, and refused.
        assert!(is_true(&moving(), c, time_of(c, wire), 0, &zeros) && c.status == Status::Ok, "{c:?}");
    }
    let received = rig.device.health().received;
    assert!(received.skipped > 1000 && received.set_up == 1, "{received:?}");
}

#[test]
fn what_noise_makes_is_less_than_a_joint_can_move_or_refused() {
    let mut rig = usual();
    rig.until(State::Running, SOON);
    rig.twin.lock().unwrap().set_faults(Faults { noise: 0.002, ..Faults::default() });
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
fn raw_bytes_make_the_same_readings_again() {
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
fn on_a_pseudo_terminal_counts_are_exact_and_hanging_up_is_noticed() {
    let begin = Monotonic.now_ns();
    let joints: Joints = Arc::new(move |ns| [(ns - begin) / MS, 7, -9, 0, 1, 2]);
    let mut left = Twin::new(Arc::clone(&joints), Faults::default());
    (left.baud, left.home) = (115_200, [100; 6]);
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
        // What was shown at a time at which it was asked, shortly before the stamp: a busy machine asks again before it has read the answer.
        let host = c.stamp.host_ns.unwrap();
        let is_it = |at: &&i64| {
            let truth = joints(**at);
            c.as_slice() == std::array::from_fn::<i64, 6, _>(|axis| truth[axis] + offsets[axis])
        };
        let asked = sampled.iter().filter(|at| (0..2 * SECOND).contains(&(host - **at)));
        assert!(asked.rev().find(is_it).is_some(), "{c:?}");
        assert_eq!((c.homed, &c.status), (0b11_1111, &Status::Ok));
    }
    drop(pty);
    while device.health().state != State::Absent {
        assert!(Monotonic.now_ns() < end + 5 * SECOND, "{:?}", device.health());
        device.next(Monotonic.now_ns() + 50 * MS).unwrap();
    }
}

#[test]
fn settings_that_no_device_has_are_refused() {
    let refused = |settings: Settings, encoders| {
        Unit::new("x", settings, Family::MicroScribe, encoders).err().map(|e| e.to_string()).unwrap_or_default()
    };
    for encoders in [0, 3, 4, 7] {
        assert!(refused(Settings::of_14_bits(), encoders).contains("arm.encoders"));
    }
    assert!(refused(Settings { baud: Some(230_400), ..Settings::of_14_bits() }, 6).contains("arm.baud"));
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
