//! ISOTRAK II, in its initial states and with faults, in text and binary.

use std::sync::Arc;

use drivers::simulated::isotrak::Twin;
use drivers::simulated::{Faults, Motion, Placed};
use drivers::tracker::polhemus::Settings;
use drivers::tracker::polhemus::fastrak::Mode;
use drivers::tracker::polhemus::isotrak::{CM_PER_COUNT, Unit};
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Pose, Status};
use sonoweave_core::{Device, Ticks};

use crate::bench::{BEGIN, Rig, on_a_terminal, refused_setting, replays};

/// Eighths of a ms along x before y increases.
const FULL: i64 = 30_000;

/// Returns a path whose position gives the time exactly in the wire's counts: an eighth of a ms
/// each, x before y. z gives the station.
fn counting(begin: i64) -> Motion {
    Arc::new(move |station, ns| {
        let eighths = (ns - begin) / (MS / 8);
        let counts = [(eighths % FULL) as f64, (eighths / FULL) as f64, -100.0 * f64::from(station)];
        Placed { position_cm: counts.map(|count| count * CM_PER_COUNT), quaternion_wxyz: [0.5, -0.5, 0.5, -0.5] }
    })
}

fn counts(pose: &Pose) -> [i64; 3] {
    pose.position_cm.map(|x| (x / CM_PER_COUNT).round() as i64)
}

/// Returns the time encoded in a position, ns, at most an eighth of a ms too early.
fn time_of(pose: &Pose) -> i64 {
    let [x, y, _] = counts(pose);
    (x + FULL * y) * (MS / 8) + BEGIN
}

fn twin() -> Twin {
    Twin::new(counting(BEGIN), Faults::default())
}

fn rig(twin: Twin, settings: Settings) -> Rig<Twin, Unit> {
    let mut rig = Rig::new(twin, Unit::new("a line", settings, None).unwrap(), false);
    rig.device.start().unwrap();
    rig
}

fn two() -> Settings {
    Settings { stations: vec![1, 2], ..Settings::default() }
}

fn is_right(pose: &Pose) -> bool {
    let turned = pose.quaternion_wxyz.iter().zip([0.5, -0.5, 0.5, -0.5]).all(|(q, r)| (q - r).abs() <= 0.51 / 32_767.0);
    turned && counts(pose)[2] == -100 * i64::from(pose.station) && time_of(pose) < pose.stamp.host_ns.unwrap()
}

#[test]
fn poses_match_sensor_at_stamp_times() {
    let mut rig = rig(twin(), two());
    rig.until(State::Running, 2 * SECOND);
    let mut poses = rig.poses(2 * SECOND);
    poses.drain(..poses.iter().position(|pose| pose.station == 1).unwrap());
    let timing = rig.device.describe().timing;
    assert_eq!((timing.rate_hz, timing.ticks, timing.tick_hz), (Some(30.0), Ticks::None, None));
    assert_eq!((timing.sampling_ns, timing.wire_ns), (0, 20 * 10 * SECOND / 115_200));
    assert!(poses.len().abs_diff(120) <= 2, "{}: 30 of each station a second", poses.len());
    for (n, pose) in poses.iter().enumerate() {
        assert_eq!(usize::from(pose.station), 1 + n % 2, "in order");
        assert_eq!(pose.stamp.item, poses[0].stamp.item + n as u64);
        assert!(is_right(pose), "{pose:?}");
        // Exactly the value of the counts, without the rounding before.
        assert_eq!(pose.position_cm, counts(pose).map(|count| count as f64 * CM_PER_COUNT));
        let measured = pose.stamp.host_ns.unwrap() - timing.wire_ns * i64::from(pose.station);
        assert!((0..MS / 8).contains(&(measured - time_of(pose))), "{measured} {}", time_of(pose));
        assert_eq!((&pose.status, pose.code, pose.buttons, pose.stamp.ticks), (&Status::Ok, None, 0, None));
    }
    let received = rig.device.health().received;
    assert_eq!((received.opened, received.set_up, received.lost), (1, 1, 0));
}

#[test]
fn text_poses_match_column_precision() {
    let mut rig = rig(twin(), Settings { binary: false, ..two() });
    rig.until(State::Running, 2 * SECOND);
    let wire = rig.device.describe().timing.wire_ns;
    assert_eq!(wire, 54 * 10 * SECOND / 115_200);
    let poses = rig.poses(SECOND);
    assert!(poses.len() >= 58, "{}", poses.len());
    for pose in poses {
        assert_eq!(pose.quaternion_wxyz, [0.5, -0.5, 0.5, -0.5]);
        // Half of the last digit is 0.005 cm: a little more than one count.
        let measured = (pose.stamp.host_ns.unwrap() - wire * i64::from(pose.station) - BEGIN) / (MS / 8);
        assert!((pose.position_cm[0] / CM_PER_COUNT - (measured % FULL) as f64).abs() < 2.0, "{pose:?}");
    }
}

#[test]
fn unit_in_any_initial_state_is_set_up() {
    let mut slowest = 0;
    for baud in [115_200, 19_200, 9_600, 38_400, 57_600] {
        for left in 0..32 {
            let mut twin = twin();
            twin.wire.baud = baud;
            twin.continuous = left & 1 != 0;
            twin.mode = if left & 2 != 0 { Mode::Binary } else { Mode::Ascii };
            twin.stations = [left & 4 != 0, true];
            twin.hemispheres = [[0.0, 0.0, 1.0]; 2];
            if left & 8 != 0 {
                twin.list = vec![2, 5, 6, 7];
                twin.wire.send(b"3.95-0.9713-0.0093 01   28.", 0, BEGIN);
                twin.written_by_another(b"O1,2,");
            }
            let binary = left & 16 == 0;
            let mut rig = rig(twin, Settings { binary, ..Settings::default() });
            slowest = slowest.max(rig.until(State::Running, 4 * SECOND));
            let poses = rig.poses(SECOND / 2);
            // Number of cycles of 1/60 s that the record takes on the wire, rounded up.
            let cycles = (if binary { 20 } else { 54 } * 10 * 60 / u64::from(baud)) as usize + 1;
            assert!(poses.len() >= 30 / cycles - 1, "{baud} {left}: {}", poses.len());
            for pose in &poses {
                assert_eq!(pose.station, 1, "{baud} {left}");
                assert!(if binary { is_right(pose) } else { (pose.position_cm[2] + 0.51).abs() < 0.01 }, "{pose:?}");
            }
            let twin = rig.twin.lock().unwrap();
            assert!(twin.centimetres && (twin.mode == Mode::Binary) == binary && twin.stations == [true, false]);
            assert_eq!(twin.hemispheres[0], [1.0, 0.0, 0.0]);
        }
    }
    assert!(slowest < 2 * SECOND, "{} ms", slowest / MS);
}

#[test]
fn sent_commands_match_other_programs() {
    for (binary, mode, list) in [(true, "f", "O2,11\r"), (false, "F", "O2,11,1\r")] {
        let mut rig = rig(twin(), Settings { hemisphere: [1.0, 0.0, 0.5], binary, ..Settings::default() });
        rig.until(State::Running, 2 * SECOND);
        rig.device.stop().unwrap();
        let expected = [
            "c",
            "S",
            mode,
            "u",
            "l1,1\r",
            "l2,0\r",
            list,
            "R1\r",
            "b1\r",
            "I1,0\r",
            "H1,1,0,0.5\r",
            "x0,1,0,0\r",
            "v0,1,0,0\r",
            "l\r",
            "P",
            "S",
            "C",
            "c",
        ];
        assert_eq!(rig.reported(), expected);
        assert_eq!(rig.device.health().state, State::Stopped);
    }
}

#[test]
fn hemisphere_setting_selects_sensor_side() {
    let behind: Motion = Arc::new(|_, _| Placed {
        position_cm: [-2000.0, 300.0, 500.0].map(|count| count * CM_PER_COUNT),
        quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
    });
    for (hemisphere, expected) in
        [([1.0, 0.0, 0.0], [2000, -300, -500]), ([-1.0, 0.0, 0.0], [-2000, 300, 500]), ([0.0; 3], [-2000, 300, 500])]
    {
        let left = Twin::new(Arc::clone(&behind), Faults::default());
        let mut rig = rig(left, Settings { hemisphere, ..Settings::default() });
        rig.until(State::Running, 2 * SECOND);
        let poses = rig.poses(SECOND / 4);
        assert!(poses.len() > 10 && poses.iter().all(|pose| counts(pose) == expected), "{hemisphere:?}");
    }
}

#[test]
fn unused_station_is_named() {
    let mut left = twin();
    left.stuck = true;
    let mut rig = rig(left, two());
    rig.readings(3 * SECOND);
    assert_eq!(rig.device.health().state, State::Silent);
    assert!(rig.device.health().why.contains("does not use station 1, 2"), "{}", rig.device.health().why);
    rig.twin.lock().unwrap().stuck = false;
    assert!(rig.until(State::Running, 2 * SECOND) < 2 * SECOND);
}

#[test]
fn unplugged_unit_is_absent_and_returns_in_two_seconds() {
    rig(twin(), Settings::default()).assert_survives_unplugging();
}

#[test]
fn hung_unit_is_silent_and_returns_in_two_seconds() {
    rig(twin(), Settings::default()).assert_survives_hanging();
}

#[test]
fn unresponsive_unit_is_reset() {
    let mut left = twin();
    (left.deaf, left.continuous) = (true, true);
    let mut stubborn = rig(left, Settings { may_reset: false, ..Settings::default() });
    stubborn.readings(60 * SECOND);
    assert_eq!(stubborn.device.health().state, State::Silent);
    let mut left = twin();
    (left.deaf, left.continuous) = (true, true);
    let mut rig = rig(left, Settings::default());
    let took = rig.until(State::Running, 90 * SECOND);
    // Twenty rounds, twenty seconds for the restart, and one round at most.
    assert!((40 * SECOND..48 * SECOND).contains(&took), "{} s", took / SECOND);
    assert_eq!(rig.times_sent(b"\x19"), 1, "it is not told twice");
}

#[test]
fn lost_bytes_lose_records_without_wrong_ones() {
    let mut rig = rig(twin(), Settings::default());
    rig.until(State::Running, 2 * SECOND);
    let before = {
        let mut twin = rig.twin.lock().unwrap();
        twin.wire.set_faults(Faults { drop: 0.003, dropout: 0.01, ..Faults::default() });
        (twin.measured, twin.harmed)
    };
    let poses = rig.poses(120 * SECOND);
    assert!(poses.iter().all(is_right), "each is right or not there");
    assert!(poses.windows(2).all(|two| time_of(&two[0]) < time_of(&two[1])));
    let twin = rig.twin.lock().unwrap();
    let whole = (twin.measured - before.0 - (twin.harmed - before.1)) as usize;
    let received = rig.device.health().received;
    assert!(twin.harmed - before.1 > 400, "{}", twin.harmed);
    // Bit 7 marks each beginning: a cut record loses only itself.
    assert!(poses.len().abs_diff(whole) <= 1, "{} of {whole}", poses.len());
    assert!(received.skipped > 5000 && received.refused > 300 && received.set_up == 1, "{received:?}");
}

#[test]
fn noise_recovers_within_two_seconds() {
    let mut rig = rig(twin(), Settings::default());
    rig.until(State::Running, 2 * SECOND);
    rig.twin.lock().unwrap().wire.set_faults(Faults { noise: 0.3, ..Faults::default() });
    rig.readings(5 * SECOND);
    rig.twin.lock().unwrap().wire.set_faults(Faults::default());
    assert!(rig.until(State::Running, 3 * SECOND) <= 2 * SECOND);
    let poses = rig.poses(SECOND);
    assert!(poses.len() > 55 && poses[2..].iter().all(is_right), "{}", poses.len());
}

#[test]
fn letters_qualify_poses_and_switches_are_buttons() {
    for (letter, buttons, code, spoils) in [
        (b' ', 0, None, false),
        (b'@', 1, None, false),
        (b'*', 0, None, false),
        (b'k', 0, Some(b'k'), true),
        (b'a', 0, Some(b'a'), false),
    ] {
        for binary in [true, false] {
            let mut left = twin();
            left.errors[0] = letter;
            let mut rig = rig(left, Settings { binary, ..Settings::default() });
            rig.until(State::Running, 2 * SECOND);
            let poses = rig.poses(SECOND / 4);
            assert!(poses.len() > 10);
            for pose in poses {
                assert_eq!((pose.buttons, pose.code), (buttons, code), "{letter}");
                assert_eq!(matches!(pose.status, Status::Other(_)), spoils, "{letter}: {:?}", pose.status);
            }
        }
    }
}

#[test]
fn raw_bytes_replay_same_readings() {
    for binary in [true, false] {
        let settings = Settings { binary, ..two() };
        let faults = Faults { drop: 0.001, packet_ns: 16 * MS, ..Faults::default() };
        let protocol = Unit::new("a line", settings.clone(), None).unwrap();
        let mut rig = Rig::new(Twin::new(counting(BEGIN), faults), protocol, true);
        rig.device.start().unwrap();
        let readings = rig.readings(20 * SECOND);
        let poses = replays(&readings, || Unit::new("a recording", settings.clone(), None).unwrap());
        assert!(poses > 900, "{poses}");
    }
}

#[test]
fn pseudo_terminal_poses_are_exact_until_hangup() {
    let begin = Monotonic.now_ns();
    let mut left = Twin::new(counting(begin), Faults::default());
    left.continuous = true;
    let unit = Unit::new("a terminal", Settings::default(), None).unwrap();
    for pose in on_a_terminal(left, unit, 60) {
        assert_eq!(counts(&pose)[2], -100);
        // The pose's time is in the past, but recent even on a busy machine.
        let age = pose.stamp.host_ns.unwrap() - (time_of(&pose) - BEGIN + begin);
        assert!((0..2 * SECOND).contains(&age), "{age}");
    }
}

#[test]
fn impossible_settings_are_refused() {
    let refused = |settings: Settings| refused_setting(Unit::new("x", settings, None).err());
    for stations in [vec![], vec![0], vec![3], vec![2, 1], vec![1, 1]] {
        assert_eq!(refused(Settings { stations, ..Settings::default() }), "stations");
    }
}
