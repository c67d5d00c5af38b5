//! VIPER, in its initial states and with faults, over serial and USB.

use std::sync::Arc;

use drivers::simulated::viper::Twin;
use drivers::simulated::{Faults, Placed};
use drivers::tracker::polhemus::viper::Unit;
use drivers::tracker::polhemus::viper::command::code;
use drivers::tracker::polhemus::{Line, Settings};
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Pose, Status};
use sonoweave_core::{Device, Ticks};

use crate::bench::{BEGIN, Rig, on_a_terminal, refused_setting, replays, ticking, time_of};

const BAUDS: [u32; 5] = [115_200, 921_600, 460_800, 230_400, 38_400];

fn twin() -> Twin {
    Twin::new(ticking(), Faults::default())
}

fn usb(mut twin: Twin) -> Twin {
    twin.wire.usb = true;
    twin
}

fn rig(twin: Twin, settings: Settings) -> Rig<Twin, Unit> {
    let line = if twin.wire.usb { Line::Usb } else { Line::Serial(None) };
    let mut rig = Rig::new(twin, Unit::new("a line", settings, line).unwrap(), false);
    rig.device.start().unwrap();
    rig
}

fn two() -> Settings {
    Settings { stations: vec![1, 3], ..Settings::default() }
}

/// Checks every delivered pose; missing poses are allowed.
fn assert_right(poses: &[Pose], what: &str) {
    for pose in poses {
        assert_eq!(pose.position_cm[1..], [f64::from(pose.station), -30.25], "{what}: {pose:?}");
        assert_eq!(pose.quaternion_wxyz, [0.5, -0.5, 0.5, -0.5], "{what}");
        assert!(time_of(pose) >= BEGIN && time_of(pose) < pose.stamp.host_ns.unwrap(), "{what}");
    }
}

#[test]
fn poses_match_sensors_at_stamp_and_tick_times() {
    for (baud, sensors, rate_hz, hz) in [
        (Some(115_200), 0b1, 240.0, 120.0),
        (Some(115_200), 0b111, 960.0, 60.0),
        (Some(921_600), 0b101, 240.0, 240.0),
        (None, 0b111, 240.0, 240.0),
        (None, 0b101, 960.0, 960.0),
        (None, 0b1, 959.0, 480.0),
        (None, 0b1, 10.0, 30.0),
    ] {
        let mut left = twin();
        (left.sensors, left.wire.usb, left.distortion, left.buttons) = (sensors, baud.is_none(), 9, 2);
        left.wire.baud = baud.unwrap_or(115_200);
        let required = if sensors == 1 { Settings::default() } else { two() };
        let required = Settings { rate_hz, ..required };
        let stations = required.stations.clone();
        let mut rig = rig(left, required);
        rig.until(State::Running, 2 * SECOND);
        let mut poses = rig.poses(2 * SECOND);
        // The state running may have come with a pose of any station.
        poses.drain(..poses.iter().position(|pose| pose.station == 1).unwrap());
        let timing = rig.device.describe().timing;
        assert_eq!((timing.rate_hz, timing.tick_hz), (Some(hz), Some(hz)));
        assert_eq!((timing.ticks, timing.wraps_at), (Ticks::Measurements, Some(1 << 32)));
        let bytes = 28 + 32 * i64::from(sensors.count_ones());
        assert_eq!(timing.wire_ns, baud.map_or(0, |baud| bytes * 10 * SECOND / i64::from(baud)));
        assert!(poses.len().abs_diff(2 * hz as usize * stations.len()) <= stations.len(), "{}", poses.len());
        assert_right(&poses, "all");
        let (first_tick, first_time) = (poses[0].stamp.ticks.unwrap(), time_of(&poses[0]));
        assert!(first_tick < 3, "counted from the start: {first_tick}");
        for (n, pose) in poses.iter().enumerate() {
            assert_eq!(pose.station, stations[n % stations.len()], "in order");
            assert_eq!(pose.stamp.item, poses[0].stamp.item + n as u64);
            let measured = pose.stamp.host_ns.unwrap() - timing.sampling_ns - timing.wire_ns;
            assert!((0..MS / 8 + 3000).contains(&(measured - time_of(pose))), "{measured} {}", time_of(pose));
            let ticks = pose.stamp.ticks.unwrap();
            assert_eq!(ticks, first_tick + (n / stations.len()) as u64, "all sensors of a frame at once");
            let by_ticks = first_time + ((ticks - first_tick) as f64 / hz * SECOND as f64) as i64;
            assert!((by_ticks - time_of(pose)).abs() <= MS / 8 + 1, "{by_ticks} {}", time_of(pose));
            assert_eq!((&pose.status, pose.code, pose.buttons, pose.distortion), (&Status::Ok, None, 2, Some(9)));
        }
        let received = rig.device.health().received;
        assert_eq!((received.opened, received.set_up, received.refused, received.lost), (1, 1, 0, 0));
    }
}

#[test]
fn unit_in_any_initial_state_is_set_up() {
    let mut slowest = 0;
    for baud in BAUDS.map(Some).into_iter().chain([None]) {
        for left in 0..32 {
            let mut twin = twin();
            (twin.wire.baud, twin.wire.usb) = (baud.unwrap_or(115_200), baud.is_none());
            twin.continuous = left & 1 != 0;
            (twin.units, twin.accelerations) = if left & 2 != 0 { ([3, 1], true) } else { ([0, 0], false) };
            (twin.sensors, twin.rate) = if left & 4 != 0 { (0b1011, 5) } else { (1, 0) };
            (twin.hemisphere, twin.filter) = ([0.0, 0.0, -1.0], 3);
            (twin.boresight, twin.tip_cm, twin.tracks) = (true, 11.0, true);
            twin.increment = left & 8 != 0;
            if left & 16 != 0 {
                twin.wire.send(b"\x00\x00VPRC\x00\x01\x00\x00VPRP\x34\x00", 0, BEGIN);
                twin.written_by_another(b"VPRC\x20\x00\x00\x00\xff\xff\xff\xff");
            }
            let mut rig = rig(twin, Settings::default());
            slowest = slowest.max(rig.until(State::Running, 4 * SECOND));
            let poses = rig.poses(SECOND / 2);
            let hz = rig.device.describe().timing.rate_hz.unwrap();
            assert!(poses.len() >= (0.5 * hz) as usize - 1, "{baud:?} {left}: {} at {hz}", poses.len());
            assert!(poses.iter().all(|pose| pose.station == 1));
            assert_right(&poses, &format!("{baud:?} {left}"));
            let twin = rig.twin.lock().unwrap();
            assert_eq!((twin.units, twin.hemisphere, twin.tracks), ([2, 2], [1.0, 0.0, 0.0], false));
            assert!(!twin.increment && !twin.boresight && twin.tip_cm == 0.0 && twin.filter == 0);
        }
    }
    assert!(slowest < 2 * SECOND, "{} ms", slowest / MS);
}

/// Returns a command from the words of its body, with preamble and checksum.
fn framed(command: u32, action: u32, arguments: [u32; 2], payload: &[u32]) -> Vec<u8> {
    let words = [&[u32::MAX, command, action, arguments[0], arguments[1]], payload].concat();
    let mut bytes = b"VPRC".to_vec();
    bytes.extend((4 * words.len() as u32 + 4).to_le_bytes());
    bytes.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    // CRC-16/ARC, bit by bit.
    let crc = bytes.iter().fold(0_u16, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xA001 } else { crc >> 1 })
    });
    bytes.extend(u32::from(crc).to_le_bytes());
    bytes
}

#[test]
fn sent_commands_match_manufacturer_header() {
    let mut rig = rig(usb(twin()), Settings { hemisphere: [0.0, 0.0, 1.0], ..Settings::default() });
    rig.until(State::Running, 2 * SECOND);
    rig.device.stop().unwrap();
    let every = [u32::MAX, 0];
    let one = 1.0_f32.to_bits();
    let expected = [
        framed(19, 2, [0, 0], &[]),
        framed(10, 1, [0, 0], &[]),
        framed(7, 0, [0, 0], &[2, 2]),
        framed(6, 0, [0, 0], &[3]),
        framed(2, 2, every, &[]),
        framed(3, 2, every, &[]),
        framed(4, 2, every, &[]),
        framed(0, 0, every, &[0, 0, 0, one]),
        framed(1, 0, every, &[0; 5]),
        framed(7, 1, [0, 0], &[]),
        framed(6, 1, [0, 0], &[]),
        framed(10, 1, [0, 0], &[]),
        framed(19, 0, [0, 0], &[0]),
        framed(19, 2, [0, 0], &[]),
    ];
    assert_eq!(rig.twin.lock().unwrap().wire.obeyed, expected);
    // Two checksums equal those of the decoder tests' vectors.
    assert_eq!(expected[2][36..], [0x7f, 0xbf, 0, 0]);
    assert_eq!(expected[12][32..], [0x94, 0xcb, 0, 0]);
    assert_eq!(rig.device.health().state, State::Stopped);
}

#[test]
fn relevant_refusal_is_reported_in_unit_words() {
    let mut left = twin();
    left.refuses = vec![code::INCREMENT, code::BORESIGHT, code::TIP_OFFSET];
    let mut lenient = rig(left, Settings::default());
    lenient.until(State::Running, 2 * SECOND);
    for refused in [code::UNITS, code::FRAME_RATE, code::HEMISPHERE, code::FILTER] {
        let mut left = twin();
        left.refuses = vec![refused];
        let mut rig = rig(left, Settings::default());
        rig.readings(3 * SECOND);
        let health = rig.device.health();
        let expected = format!("refused command {refused}: no such command");
        assert!(health.state == State::Silent && health.why.contains(&expected), "{health:?}");
        rig.twin.lock().unwrap().refuses.clear();
        assert!(rig.until(State::Running, 2 * SECOND) < SECOND);
    }
}

#[test]
fn a_station_without_a_sensor_is_named() {
    let mut rig = rig(twin(), two());
    rig.readings(3 * SECOND);
    assert_eq!(rig.device.health().state, State::Silent);
    assert!(rig.device.health().why.contains("station 3; plug it in"), "{}", rig.device.health().why);
    rig.twin.lock().unwrap().sensors = 0b101;
    assert!(rig.until(State::Running, 2 * SECOND) < 2 * SECOND);
}

#[test]
fn frame_count_wrap_loses_nothing() {
    let mut left = usb(twin());
    left.zero = u32::MAX - 100;
    let mut rig = rig(left, Settings::default());
    rig.until(State::Running, 2 * SECOND);
    let poses = rig.poses(SECOND);
    assert!(poses.len().abs_diff(240) <= 1, "{}", poses.len());
    let ticks: Vec<u64> = poses.iter().map(|pose| pose.stamp.ticks.unwrap()).collect();
    assert!(ticks[0] > 1 << 31 && *ticks.last().unwrap() < 1 << 31, "{} to {:?}", ticks[0], ticks.last());
    assert!(ticks.windows(2).all(|two| (two[0] + 1) % (1 << 32) == two[1]));
    assert_eq!(rig.device.health().received.lost, 0);
}

#[test]
fn hemisphere_setting_selects_sensor_side() {
    let behind: drivers::simulated::Motion =
        Arc::new(|_, _| Placed { position_cm: [-20.0, 3.0, 5.0], quaternion_wxyz: [1.0, 0.0, 0.0, 0.0] });
    for (hemisphere, expected) in
        [([1.0, 0.0, 0.0], [20.0, -3.0, -5.0]), ([-1.0, 0.0, 0.0], [-20.0, 3.0, 5.0]), ([0.0; 3], [-20.0, 3.0, 5.0])]
    {
        let left = Twin::new(Arc::clone(&behind), Faults::default());
        let mut rig = rig(left, Settings { hemisphere, ..Settings::default() });
        rig.until(State::Running, 2 * SECOND);
        assert!(rig.poses(SECOND / 4).iter().all(|pose| pose.position_cm == expected), "{hemisphere:?}");
    }
}

#[test]
fn unplugged_unit_is_absent_and_returns_in_two_seconds() {
    for left in [twin(), usb(twin())] {
        rig(left, Settings::default()).assert_survives_unplugging();
    }
}

#[test]
fn hung_unit_is_silent_and_returns_in_two_seconds() {
    for left in [twin(), usb(twin())] {
        rig(left, Settings::default()).assert_survives_hanging();
    }
}

#[test]
fn unresponsive_unit_is_reset() {
    for on_usb in [false, true] {
        let mut left = twin();
        (left.deaf, left.continuous, left.wire.usb) = (true, true, on_usb);
        let mut stubborn = rig(left, Settings { may_reset: false, ..Settings::default() });
        stubborn.readings(40 * SECOND);
        assert_eq!(stubborn.device.health().state, State::Silent);
        let mut left = twin();
        (left.deaf, left.continuous, left.wire.usb) = (true, true, on_usb);
        let mut rig = rig(left, Settings::default());
        let took = rig.until(State::Running, 60 * SECOND);
        assert!((20 * SECOND..34 * SECOND).contains(&took), "{} s", took / SECOND);
        assert_eq!(rig.times_sent(&framed(21, 0, [0, 0], &[])), 1, "it is not told again while it starts");
    }
}

#[test]
fn lost_and_damaged_bytes_are_counted_by_frame_count() {
    for (sensors, settings) in [(1, Settings::default()), (0b111, two())] {
        let stations = settings.stations.len() as u64;
        let mut left = usb(twin());
        left.sensors = sensors;
        let mut rig = rig(left, settings);
        rig.until(State::Running, 2 * SECOND);
        rig.readings(SECOND);
        let before = {
            let mut twin = rig.twin.lock().unwrap();
            twin.wire.set_faults(Faults { drop: 0.001, noise: 0.001, dropout: 0.01, ..Faults::default() });
            twin.harmed
        };
        let poses = rig.poses(60 * SECOND);
        rig.twin.lock().unwrap().wire.set_faults(Faults::default());
        assert!(rig.poses(SECOND).len() > 235);
        assert_right(&poses, "lossy");
        let twin = rig.twin.lock().unwrap();
        let received = rig.device.health().received;
        let harmed = twin.harmed - before;
        assert!(harmed > 1000, "{harmed}");
        assert_eq!(received.lost, harmed * stations, "of {} frames", twin.measured);
        assert!(received.refused > 300 && received.set_up == 1, "{received:?}");
    }
}

#[test]
fn noise_gives_no_wrong_pose() {
    let mut rig = rig(twin(), Settings::default());
    rig.until(State::Running, 2 * SECOND);
    rig.twin.lock().unwrap().wire.set_faults(Faults { noise: 0.3, ..Faults::default() });
    assert!(rig.poses(5 * SECOND).iter().all(|pose| pose.position_cm[1..] == [1.0, -30.25]), "none is wrong");
    rig.twin.lock().unwrap().wire.set_faults(Faults::default());
    assert!(rig.until(State::Running, 3 * SECOND) <= 2 * SECOND);
    let poses = rig.poses(SECOND);
    assert!(poses.len() > 115, "{}", poses.len());
    assert_right(&poses, "after noise");
}

#[test]
fn built_in_test_code_and_impossible_values_are_reported() {
    let mut left = twin();
    left.test = 5;
    let mut found = rig(left, Settings::default());
    found.until(State::Running, 2 * SECOND);
    assert!(found.poses(SECOND / 4).iter().all(|pose| pose.code == Some(5) && pose.status == Status::Ok));
    for (x, w) in [(f64::NAN, 1.0), (1e9, 1.0), (10.0, 0.5), (10.0, f64::NAN)] {
        let lost: drivers::simulated::Motion =
            Arc::new(move |_, _| Placed { position_cm: [x, 0.0, 0.0], quaternion_wxyz: [w, 0.0, 0.0, 0.0] });
        let mut rig = rig(Twin::new(lost, Faults::default()), Settings::default());
        rig.until(State::Running, 2 * SECOND);
        let poses = rig.poses(SECOND / 4);
        assert!(poses.len() > 20 && poses.iter().all(|pose| pose.status != Status::Ok), "{x} {w}");
    }
}

#[test]
fn raw_bytes_replay_same_readings() {
    let faults = Faults { drop: 0.001, packet_ns: 16 * MS, ..Faults::default() };
    let mut left = Twin::new(ticking(), faults);
    left.sensors = 0b111;
    let mut rig = Rig::new(left, Unit::new("a line", two(), None).unwrap(), true);
    rig.device.start().unwrap();
    let readings = rig.readings(20 * SECOND);
    let poses = replays(&readings, || Unit::new("a recording", two(), None).unwrap());
    assert!(poses > 1500, "{poses}");
}

#[test]
fn pseudo_terminal_poses_are_exact_until_hangup() {
    let begin = Monotonic.now_ns();
    let motion = Arc::new(move |station: u8, ns: i64| ticking()(station, BEGIN + ns - begin));
    let mut left = Twin::new(motion, Faults::default());
    left.continuous = true;
    let unit = Unit::new("a terminal", Settings::default(), None).unwrap();
    for pose in on_a_terminal(left, unit, 100) {
        assert_eq!(pose.position_cm[1..], [1.0, -30.25]);
        // The pose's time is in the past, but recent even on a busy machine.
        let age = pose.stamp.host_ns.unwrap() - (time_of(&pose) - BEGIN + begin);
        assert!((0..2 * SECOND).contains(&age), "{age}");
    }
}

#[test]
fn impossible_settings_are_refused() {
    let refused = |settings: Settings| refused_setting(Unit::new("x", settings, None).err());
    for stations in [vec![], vec![0], vec![17], vec![2, 1], vec![1, 1]] {
        assert_eq!(refused(Settings { stations, ..Settings::default() }), "stations");
    }
    assert_eq!(refused(Settings { binary: false, ..Settings::default() }), "binary");
}
