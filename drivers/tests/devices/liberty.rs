//! LIBERTY and PATRIOT, in their initial states and with faults, over serial and USB.

use std::sync::Arc;

use drivers::simulated::Faults;
use drivers::simulated::liberty::{SAMPLING_NS, Twin};
use drivers::tracker::polhemus::liberty::{Tag, Unit};
use drivers::tracker::polhemus::{Line, Settings};
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Pose, Status};
use sonoweave_core::{Device, Ticks};

use crate::bench::{BEGIN, Rig, on_a_terminal, refused_setting, replays, ticking, time_of};

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
    Settings { stations: vec![1, 2], ..Settings::default() }
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
fn poses_match_sensor_at_stamp_and_tick_times() {
    for (on_usb, active, rate_hz, hz) in
        [(false, 1, 240.0, 240.0), (false, 3, 240.0, 120.0), (true, 3, 1000.0, 240.0), (true, 1, 100.0, 60.0)]
    {
        let mut left = twin();
        (left.active, left.wire.usb, left.distortion) = (active, on_usb, 1);
        let stations: Vec<u8> = (1..=active.count_ones() as u8).collect();
        let mut rig = rig(left, Settings { stations: stations.clone(), rate_hz, ..Settings::default() });
        rig.until(State::Running, 2 * SECOND);
        let mut poses = rig.poses(2 * SECOND);
        // The state running may have come with a pose of any station.
        poses.drain(..poses.iter().position(|pose| pose.station == 1).unwrap());
        let timing = rig.device.describe().timing;
        assert_eq!((timing.rate_hz, timing.tick_hz), (Some(hz), Some(hz)));
        assert_eq!((timing.ticks, timing.wraps_at), (Ticks::Measurements, Some(1 << 32)));
        assert_eq!(timing.sampling_ns, SAMPLING_NS);
        assert_eq!(timing.wire_ns, if on_usb { 0 } else { 44 * 10 * SECOND / 115_200 });
        assert!(poses.len().abs_diff(2 * hz as usize * stations.len()) <= stations.len(), "{}", poses.len());
        assert_right(&poses, "all");
        let (first_tick, first_time) = (poses[0].stamp.ticks.unwrap(), time_of(&poses[0]));
        assert!((10..20).contains(&first_tick), "counted from the start, the first ten left out: {first_tick}");
        for (n, pose) in poses.iter().enumerate() {
            assert_eq!(pose.station, stations[n % stations.len()], "in order");
            assert_eq!(pose.stamp.item, poses[0].stamp.item + n as u64);
            // The second station's record waits for the first one's; over USB each takes a
            // microsecond.
            let wire = timing.wire_ns * i64::from(pose.station);
            let measured = pose.stamp.host_ns.unwrap() - timing.sampling_ns - wire;
            assert!((0..MS / 8 + 2000).contains(&(measured - time_of(pose))), "{measured} {}", time_of(pose));
            let ticks = pose.stamp.ticks.unwrap();
            assert_eq!(ticks, first_tick + (n / stations.len()) as u64, "all stations of a frame at once");
            let by_ticks = first_time + ((ticks - first_tick) as f64 / hz * SECOND as f64) as i64;
            assert!((by_ticks - time_of(pose)).abs() <= MS / 8 + 1, "{by_ticks} {}", time_of(pose));
            assert_eq!((&pose.status, pose.code, pose.buttons, pose.distortion), (&Status::Ok, None, 0, Some(1)));
        }
        let received = rig.device.health().received;
        assert_eq!((received.opened, received.set_up, received.refused, received.lost), (1, 1, 0, 0));
    }
}

#[test]
fn unit_in_any_initial_state_is_set_up() {
    let mut slowest = 0;
    for (baud, on_usb) in
        [(115_200, false), (57_600, false), (38_400, false), (19_200, false), (9_600, false), (115_200, true)]
    {
        for left in 0..32 {
            let mut twin = twin();
            (twin.wire.baud, twin.wire.usb) = (baud, on_usb);
            twin.continuous = left & 1 != 0;
            twin.binary = left & 2 != 0;
            twin.buffers = on_usb && left & 4 != 0;
            twin.hemispheres = [[0.0, 0.0, -1.0]; 16];
            if left & 8 != 0 {
                (twin.active, twin.hz, twin.echoes) = (0b111, 60.0, true);
                twin.list = vec![8, 9, 2, 4, 6, 1];
                twin.wire.send(b"01\x00\x00LY\x01C\x00\x00\x24\x00\x40", 0, BEGIN);
                twin.written_by_another(b"O1,2,");
            }
            twin.stubborn = u32::from(left & 16 != 0) * 2;
            let mut rig = rig(twin, Settings::default());
            slowest = slowest.max(rig.until(State::Running, 4 * SECOND));
            let poses = rig.poses(SECOND / 2);
            let hz = rig.device.describe().timing.rate_hz.unwrap();
            // Number of cycles that the stations' records take on the wire, rounded up.
            let bytes = 44 * if left & 8 != 0 { 3 } else { 1 };
            let cycles = if on_usb { 1.0 } else { (f64::from(bytes * 10) / f64::from(baud) * hz).ceil() };
            let least = (0.5 * hz / cycles) as usize - 1;
            assert!(poses.len() >= least, "{baud} {left}: {} of {least}", poses.len());
            assert!(poses.iter().all(|pose| pose.station == 1));
            assert_right(&poses, &format!("{baud} {left}"));
            let twin = rig.twin.lock().unwrap();
            assert!(twin.binary && twin.centimetres && !(on_usb && twin.buffers) && !twin.echoes);
            assert_eq!((twin.hemispheres[0], twin.filters), ([1.0, 0.0, 0.0], [[0.0, 1.0, 0.0, 0.0]; 2]));
            assert_eq!(twin.list, [9, 11, 2, 7]);
        }
    }
    assert!(slowest < 2 * SECOND, "{} ms", slowest / MS);
}

#[test]
fn sent_commands_match_manual() {
    let mut by_usb = rig(usb(twin()), Settings { hemisphere: [0.0, 0.0, 1.0], ..two() });
    by_usb.twin.lock().unwrap().active = 3;
    by_usb.until(State::Running, 2 * SECOND);
    by_usb.device.stop().unwrap();
    let begin = ["P", "F1\r", "\x150\r", "\x050\r"];
    let settings = ["O*,9,11,2,7\r", "\x12*\r", "\x02*\r", "H*,0,0,1\r", "X0,1,0,0\r", "Y0,1,0,0\r", "U\r"];
    let end = ["\x150\r", "Q0\r", "C\r", "P"];
    let expected = [&begin[..], &["@B0\r", "U1\r", "R4\r"], &settings, &["O1\r", "O2\r"], &end].concat();
    assert_eq!(by_usb.reported(), expected);
    assert_eq!(by_usb.device.health().state, State::Stopped);

    let mut serial = rig(twin(), Settings { stylus: Some(1), hemisphere: [0.0, 0.0, 1.0], ..Settings::default() });
    serial.until(State::Running, 2 * SECOND);
    serial.device.stop().unwrap();
    let settings = [&["O*,9,10,11,2,7\r"], &settings[1..]].concat();
    // 48 bytes, 240 times a second, would fill the line.
    let expected = [&begin[..], &["U1\r", "R3\r"], &settings, &["O1\r"], &end].concat();
    assert_eq!(serial.reported(), expected);

    let mut patriot = rig(usb(Twin::patriot(ticking(), Faults::default())), Settings::default());
    patriot.until(State::Running, 2 * SECOND);
    assert!(patriot.reported().iter().all(|command| !command.starts_with('R')), "it has one rate");
    assert_eq!(patriot.device.describe().timing.rate_hz, Some(60.0));
    assert!(patriot.device.describe().name.starts_with("PATRIOT"), "{}", patriot.device.describe().name);
    let poses = patriot.poses(SECOND);
    assert!(poses.len().abs_diff(60) <= 1, "{}", poses.len());
    assert_right(&poses, "PATRIOT");
}

#[test]
fn buffered_frames_do_not_delay_poses() {
    let mut left = usb(twin());
    (left.binary, left.continuous) = (true, true);
    assert!(left.buffers);
    let mut rig = rig(left, Settings::default());
    rig.until(State::Running, 2 * SECOND);
    for pose in rig.poses(SECOND) {
        assert!(pose.stamp.host_ns.unwrap() - time_of(&pose) < 4 * MS);
    }
}

#[test]
fn wrong_first_frames_are_dropped() {
    let mut left = twin();
    left.stubborn = 1;
    let mut rig = rig(left, Settings::default());
    let poses = rig.poses(2 * SECOND);
    assert_right(&poses, "from the first");
    assert_eq!(poses[0].stamp.ticks, Some(10));
}

#[test]
fn frame_count_wrap_loses_nothing() {
    let mut left = twin();
    // Counts after the wrap look like a new start.
    left.zero = u32::MAX - 100;
    let mut rig = rig(left, Settings::default());
    rig.until(State::Running, 2 * SECOND);
    let poses = rig.poses(SECOND);
    assert!(poses.len().abs_diff(240) <= 1, "{}", poses.len());
    assert_right(&poses, "wrapped");
    let ticks: Vec<u64> = poses.iter().map(|pose| pose.stamp.ticks.unwrap()).collect();
    assert!(ticks[0] > 1 << 31 && *ticks.last().unwrap() < 1 << 31, "{} to {:?}", ticks[0], ticks.last());
    assert!(ticks.windows(2).all(|two| (two[0] + 1) % (1 << 32) == two[1]));
    assert_eq!(rig.device.health().received.lost, 0);
}

#[test]
fn hemisphere_setting_selects_sensor_side() {
    let behind: drivers::simulated::Motion = Arc::new(|_, _| drivers::simulated::Placed {
        position_cm: [-20.0, 3.0, 5.0],
        quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
    });
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
        (left.deaf, left.continuous, left.wire.usb, left.buffers) = (true, true, on_usb, false);
        let mut stubborn = rig(left, Settings { may_reset: false, ..Settings::default() });
        stubborn.readings(40 * SECOND);
        assert_eq!(stubborn.device.health().state, State::Silent);
        let why = &stubborn.device.health().why;
        assert!(why.contains("does not stop sending") && (on_usb || why.contains("used by USB")), "{why}");
        let mut left = twin();
        (left.deaf, left.continuous, left.wire.usb, left.buffers) = (true, true, on_usb, false);
        let mut rig = rig(left, Settings::default());
        let took = rig.until(State::Running, 60 * SECOND);
        assert!((20 * SECOND..32 * SECOND).contains(&took), "{} s", took / SECOND);
        assert_eq!(rig.times_sent(b"\x19\r"), 1, "it is not told twice");
    }
}

#[test]
fn lost_bytes_are_counted_by_frame_count() {
    for active in [1, 3] {
        let mut left = twin();
        left.active = active;
        let mut rig = rig(left, if active == 3 { two() } else { Settings::default() });
        rig.until(State::Running, 2 * SECOND);
        rig.readings(SECOND);
        let (measured, harmed) = {
            let mut twin = rig.twin.lock().unwrap();
            twin.wire.set_faults(Faults { drop: 0.002, dropout: 0.01, ..Faults::default() });
            (twin.measured, twin.harmed)
        };
        let poses = rig.poses(60 * SECOND);
        rig.twin.lock().unwrap().wire.set_faults(Faults::default());
        let after = rig.poses(SECOND);
        assert_right(&poses, "lossy");
        assert!(after.len() > 235);
        for station in 1..=active.count_ones() as u8 {
            let of: Vec<&Pose> = poses.iter().filter(|pose| pose.station == station).collect();
            assert!(of.windows(2).all(|two| time_of(two[0]) < time_of(two[1])));
        }
        let twin = rig.twin.lock().unwrap();
        let received = rig.device.health().received;
        let harmed = twin.harmed - harmed;
        assert!(harmed > 1000, "{harmed}");
        assert_eq!(received.lost, harmed, "of {}", twin.measured - measured);
        assert!(received.refused > 300 && received.set_up == 1, "{received:?}");
        drop(twin);
        // After a new set-up the counter restarts, but earlier losses stay counted.
        rig.assert_survives_hanging();
        let again = rig.device.health().received;
        assert_eq!((again.lost, again.set_up), (received.lost, 2));
        assert!(again.refused >= received.refused && again.skipped >= received.skipped, "{again:?}");
    }
}

#[test]
fn host_that_pauses_reading_loses_nothing() {
    let mut left = usb(twin());
    left.wire.set_faults(Faults { drift_ppm: 300.0, latency_ns: 2 * MS, jitter_ns: 3 * MS, ..Faults::default() });
    let mut rig = rig(left, Settings::default());
    rig.until(State::Running, 2 * SECOND);
    rig.readings(SECOND);
    rig.clock.pass(10 * SECOND);
    let poses = rig.poses(SECOND);
    assert!(poses.len().abs_diff(11 * 240) <= 2, "{}", poses.len());
    assert!(poses.windows(2).all(|two| two[0].stamp.ticks.unwrap() + 1 == two[1].stamp.ticks.unwrap()));
    let received = rig.device.health().received;
    assert_eq!((received.lost, received.refused, received.set_up), (0, 0, 1));
}

#[test]
fn noise_recovers_within_two_seconds() {
    let mut rig = rig(twin(), Settings::default());
    rig.until(State::Running, 2 * SECOND);
    rig.twin.lock().unwrap().wire.set_faults(Faults { noise: 0.3, ..Faults::default() });
    rig.readings(5 * SECOND);
    rig.twin.lock().unwrap().wire.set_faults(Faults::default());
    assert!(rig.until(State::Running, 3 * SECOND) <= 2 * SECOND);
    rig.readings(300 * MS);
    let poses = rig.poses(SECOND);
    assert!(poses.len() > 235, "{}", poses.len());
    assert_right(&poses, "after noise");
}

#[test]
fn errors_qualify_poses() {
    for (error, spoils) in [(b'u', true), (b'a', true), (b'C', true), (b'I', false), (b' ', false), (0x12, false)] {
        let mut left = twin();
        (left.active, left.errors[0]) = (3, error);
        let mut rig = rig(left, two());
        rig.until(State::Running, 2 * SECOND);
        let poses = rig.poses(SECOND / 4);
        let [first, second] = [1, 2].map(|station| poses.iter().find(|pose| pose.station == station).unwrap());
        assert_eq!(matches!(first.status, Status::Other(_)), spoils, "{error}: {:?}", first.status);
        assert_eq!(first.code, (error != b' ').then_some(error));
        assert_eq!((&second.status, second.code), (&Status::Ok, None));
    }
    // After an error that does not concern the pose, its values are still checked.
    let lost: drivers::simulated::Motion =
        Arc::new(|_, _| drivers::simulated::Placed { position_cm: [10.0, 0.0, 0.0], quaternion_wxyz: [0.0; 4] });
    let mut left = Twin::new(lost, Faults::default());
    left.errors[0] = b'I';
    let mut rig = rig(left, Settings::default());
    rig.until(State::Running, 2 * SECOND);
    assert!(rig.poses(SECOND / 4).iter().all(|pose| pose.status != Status::Ok));
}

#[test]
fn a_stylus_has_a_button() {
    let mut left = twin();
    left.switch = 1;
    left.active = 3;
    let mut rig = rig(left, Settings { stylus: Some(2), ..two() });
    rig.until(State::Running, 2 * SECOND);
    assert!(rig.poses(SECOND / 4).iter().all(|pose| pose.buttons == u8::from(pose.station == 2)));
}

#[test]
fn a_station_without_a_sensor_is_named() {
    let mut rig = rig(twin(), two());
    rig.readings(3 * SECOND);
    assert_eq!(rig.device.health().state, State::Silent);
    assert!(rig.device.health().why.contains("station 2; plug its sensor in"), "{}", rig.device.health().why);
    rig.twin.lock().unwrap().active = 3;
    assert!(rig.until(State::Running, 2 * SECOND) < 2 * SECOND);
}

#[test]
fn raw_bytes_replay_same_readings() {
    let faults = Faults { drop: 0.001, packet_ns: 16 * MS, ..Faults::default() };
    let mut left = Twin::new(ticking(), faults);
    left.active = 3;
    left.tag = Tag::Latus;
    let mut rig = Rig::new(left, Unit::new("a line", two(), None).unwrap(), true);
    rig.device.start().unwrap();
    let readings = rig.readings(20 * SECOND);
    let poses = replays(&readings, || Unit::new("a recording", two(), None).unwrap());
    assert!(poses > 3500, "{poses}");
}

#[test]
fn pseudo_terminal_poses_are_exact_until_hangup() {
    let begin = Monotonic.now_ns();
    let motion = Arc::new(move |station: u8, ns: i64| ticking()(station, BEGIN + ns - begin));
    let mut left = Twin::new(motion, Faults::default());
    left.continuous = true;
    let unit = Unit::new("a terminal", Settings::default(), None).unwrap();
    for pose in on_a_terminal(left, unit, 200) {
        assert_eq!(pose.position_cm[1..], [1.0, -30.25]);
        // The pose's time is in the past, but recent even on a busy machine.
        let age = pose.stamp.host_ns.unwrap() - (time_of(&pose) - BEGIN + begin);
        assert!((SAMPLING_NS..2 * SECOND).contains(&age), "{age}");
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
