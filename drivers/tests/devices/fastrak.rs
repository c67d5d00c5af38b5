//! FASTRAK, in its initial states and with faults.

use drivers::simulated::Faults;
use drivers::simulated::fastrak::{SAMPLING_NS, Twin};
use drivers::tracker::polhemus::Settings;
use drivers::tracker::polhemus::fastrak::{Mode, Unit};
use sonoweave_core::Device;
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::Status;

use crate::bench::{BEGIN, Rig, on_a_terminal, refused_setting, replays, ticking, time_of};

fn twin() -> Twin {
    Twin::new(ticking(), Faults::default())
}

fn rig(twin: Twin, settings: Settings) -> Rig<Twin, Unit> {
    let mut rig = Rig::new(twin, Unit::new("a line", settings, None).unwrap(), false);
    rig.device.start().unwrap();
    rig
}

#[test]
fn poses_match_sensor_at_stamp_times() {
    let mut rig = rig(twin(), Settings { stations: vec![1, 2], ..Settings::default() });
    rig.until(State::Running, 2 * SECOND);
    let poses = rig.poses(2 * SECOND);
    let timing = rig.device.describe().timing;
    assert_eq!(timing.rate_hz, Some(60.0));
    assert_eq!((timing.sampling_ns, timing.wire_ns), (SAMPLING_NS, 33 * 10 * SECOND / 115_200));
    assert_eq!(poses.len(), 240, "60 of each station a second");
    for (n, pose) in poses.iter().enumerate() {
        assert_eq!(pose.station as usize, 1 + n % 2, "in order");
        assert_eq!(pose.stamp.item, poses[0].stamp.item + n as u64);
        assert_eq!(pose.position_cm[1..], [f64::from(pose.station), -30.25]);
        assert_eq!(pose.quaternion_wxyz, [0.5, -0.5, 0.5, -0.5]);
        // The second station's record waits for the first one's.
        let wire = timing.wire_ns * i64::from(pose.station);
        let measured = pose.stamp.host_ns.unwrap() - timing.sampling_ns - wire;
        assert!((0..MS / 8).contains(&(measured - time_of(pose))), "{} {}", measured, time_of(pose));
        assert_eq!((&pose.status, pose.code, pose.buttons), (&Status::Ok, None, 0));
    }
    let received = rig.device.health().received;
    assert_eq!((received.opened, received.set_up, received.refused, received.lost), (1, 1, 0, 0));
}

#[test]
fn text_poses_match_column_precision() {
    let mut rig = rig(twin(), Settings { binary: false, ..Settings::default() });
    rig.until(State::Running, 2 * SECOND);
    for pose in rig.poses(SECOND) {
        let host = pose.stamp.host_ns.unwrap();
        let reported = ((pose.position_cm[0] - 1.0) * 4096.0 * (MS / 8) as f64) as i64 + BEGIN;
        let wire = rig.device.describe().timing.wire_ns;
        // Half of the last digit is 0.005 cm: 2.56 ms here.
        assert!((host - SAMPLING_NS - wire - reported).abs() < 2_560_000 + MS / 8);
        assert_eq!(pose.quaternion_wxyz, [0.5, -0.5, 0.5, -0.5]);
    }
}

#[test]
fn unit_in_any_initial_state_is_set_up() {
    let mut slowest = 0;
    for baud in [115_200, 57_600, 38_400, 19_200, 9_600] {
        for left in 0..16 {
            let mut twin = twin();
            twin.wire.baud = baud;
            twin.continuous = left & 1 != 0;
            twin.mode = if left & 2 != 0 { Mode::Binary } else { Mode::Ascii };
            twin.stations = [left & 4 != 0, true, false, left & 4 != 0];
            twin.hemispheres = [[0.0, 0.0, -1.0]; 4];
            if left & 8 != 0 {
                twin.lists = std::array::from_fn(|_| vec![2, 5, 6, 7]);
                twin.wire.send(b"3.95-0.9713-0.0093 01   28.", 0, BEGIN);
                twin.written_by_another(b"O1,2,");
            }
            let mut rig = rig(twin, Settings::default());
            let took = rig.until(State::Running, 4 * SECOND);
            slowest = slowest.max(took);
            let poses = rig.poses(SECOND / 2);
            // Number of cycles of 1/120 s that the record takes on the wire, rounded up.
            let cycles = (33 * 10 * 120 / u64::from(baud)) as usize + 1;
            assert!(poses.len() >= 60 / (cycles + 1), "{baud} {left}: {}", poses.len());
            assert!(
                poses.iter().all(|pose| pose.station == 1 && pose.position_cm[1..] == [1.0, -30.25]),
                "{baud} {left}"
            );
            let twin = rig.twin.lock().unwrap();
            assert!(twin.centimetres && twin.mode == Mode::Binary && twin.stations == [true, false, false, false]);
            assert_eq!(twin.hemispheres[0], [1.0, 0.0, 0.0]);
        }
    }
    assert!(slowest < 2 * SECOND, "{} ms", slowest / MS);
}

#[test]
fn sent_commands_match_manual() {
    let mut rig = rig(twin(), Settings { hemisphere: [0.0, 0.0, 1.0], ..Settings::default() });
    rig.until(State::Running, 2 * SECOND);
    rig.device.stop().unwrap();
    let expected = [
        "c",
        "S",
        "f",
        "u",
        "l1,1\r",
        "l2,0\r",
        "l3,0\r",
        "l4,0\r",
        "O1,2,11,1\r",
        "R1\r",
        "b1\r",
        "I1,0\r",
        "H1,0,0,1\r",
        "x0,1,0,0\r",
        "v0,1,0,0\r",
        "O1\r",
        "l1\r",
        "S",
        "C",
        "c",
    ];
    assert_eq!(rig.reported(), expected);
    assert_eq!(rig.device.health().state, State::Stopped);
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
    stubborn.readings(40 * SECOND);
    assert_eq!(stubborn.device.health().state, State::Silent);
    assert!(stubborn.device.health().why.contains("does not stop sending"), "{}", stubborn.device.health().why);
    assert!(stubborn.twin.lock().unwrap().deaf);
    let mut left = twin();
    (left.deaf, left.continuous) = (true, true);
    let mut rig = rig(left, Settings::default());
    let took = rig.until(State::Running, 60 * SECOND);
    // Sixteen rounds, ten seconds for the restart, and one round at most.
    assert!((25 * SECOND..32 * SECOND).contains(&took), "{} s", took / SECOND);
    assert_eq!(rig.times_sent(b"\x19"), 1, "it is not told again while it starts");
}

#[test]
fn lost_bytes_lose_records_without_wrong_ones() {
    let mut rig = rig(twin(), Settings::default());
    rig.until(State::Running, 2 * SECOND);
    rig.twin.lock().unwrap().wire.set_faults(Faults { drop: 0.002, dropout: 0.01, ..Faults::default() });
    let poses = rig.poses(60 * SECOND);
    assert!(poses.iter().all(|pose| pose.position_cm[1..] == [1.0, -30.25]), "each is right or not there");
    assert!(poses.windows(2).all(|two| time_of(&two[0]) < time_of(&two[1])));
    let received = rig.device.health().received;
    // 33 bytes per record: one in sixteen is hit, and loses itself and at most the next.
    assert!((5800..7000).contains(&poses.len()), "{} of 7200", poses.len());
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
    assert!(poses.len() > 110 && poses[2..].iter().all(|pose| pose.position_cm[1..] == [1.0, -30.25]));
}

#[test]
fn error_letters_qualify_poses() {
    let mut twin = twin();
    twin.errors = [b'k', b'a', b' ', b' '];
    let mut rig = rig(twin, Settings { stations: vec![1, 2], ..Settings::default() });
    rig.until(State::Running, 2 * SECOND);
    let poses = rig.poses(SECOND / 4);
    let [weak, old] = [1, 2].map(|station| poses.iter().find(|pose| pose.station == station).unwrap());
    assert!(matches!(&weak.status, Status::Other(why) if why.contains("signal")) && weak.code == Some(b'k'));
    // A limit of the unit's own calibration does not concern a pose.
    assert!(old.status == Status::Ok && old.code == Some(b'a'));
}

#[test]
fn raw_bytes_replay_same_readings() {
    let faults = Faults { drop: 0.001, packet_ns: 16 * MS, ..Faults::default() };
    let protocol = Unit::new("a line", Settings::default(), None).unwrap();
    let mut rig = Rig::new(Twin::new(ticking(), faults), protocol, true);
    rig.device.start().unwrap();
    let readings = rig.readings(20 * SECOND);
    let poses = replays(&readings, || Unit::new("a recording", Settings::default(), None).unwrap());
    assert!(poses > 1500, "{poses}");
}

#[test]
fn pseudo_terminal_poses_are_exact_until_hangup() {
    let begin = Monotonic.now_ns();
    let motion = std::sync::Arc::new(move |station: u8, ns: i64| {
        let mut placed = ticking()(station, BEGIN + ns - begin);
        placed.position_cm[2] = 2.0;
        placed
    });
    let mut left = Twin::new(motion, Faults::default());
    left.continuous = true;
    let unit = Unit::new("a terminal", Settings::default(), None).unwrap();
    for pose in on_a_terminal(left, unit, 100) {
        assert_eq!(pose.position_cm[1..], [1.0, 2.0]);
        // The pose's time is in the past, but recent even on a busy machine.
        let reported = time_of(&pose) - BEGIN + begin;
        let age = pose.stamp.host_ns.unwrap() - reported;
        assert!((SAMPLING_NS..2 * SECOND).contains(&age), "{age}");
    }
}

#[test]
fn impossible_settings_are_refused() {
    let refused = |settings: Settings| refused_setting(Unit::new("x", settings, None).err());
    for stations in [vec![], vec![0], vec![5], vec![2, 1], vec![1, 1]] {
        assert_eq!(refused(Settings { stations, ..Settings::default() }), "stations");
    }
    assert_eq!(refused(Settings { hemisphere: [f32::NAN, 0.0, 0.0], ..Settings::default() }), "hemisphere");
    assert_eq!(refused(Settings { stylus: Some(2), ..Settings::default() }), "stylus");
}
