use std::sync::{Arc, Mutex};

use glam::EulerRot;

use drivers::connection::{Connection, Protocol};
use drivers::simulated::{Faults, Motion, Placed};
use drivers::tracker::polhemus::{Settings, fastrak, liberty};
use drivers::transport::{MemoryOpener, Peer};
use sonoweave_core::clock::{Clock, MS, Manual, SECOND};
use sonoweave_core::{Device, Next};

use super::*;

/// Values are exact in single precision and in four digits.
fn motion() -> Motion {
    Arc::new(|station, _| {
        let q = DQuat::from_euler(EulerRot::ZYX, 0.5, -0.25, 0.125);
        Placed {
            position_cm: [12.5 * f64::from(station), -3.25, 40.0],
            quaternion_wxyz: if station == 1 { [q.w, q.x, q.y, q.z] } else { [1.0, 0.0, 0.0, 0.0] },
        }
    })
}

/// Returns the poses that the driver of a simulated unit delivers over a line.
fn taken<P: Protocol, T: Peer + 'static>(
    twin: T,
    unit: P,
    seconds: i64,
) -> (LiveIngest, Vec<(usize, PoseSample, i64)>) {
    let clock = Manual::at(SECOND);
    let opener = MemoryOpener::new(Arc::new(Mutex::new(twin)), clock.clone(), 115_200);
    let mut device = Connection::new(Box::new(opener), Arc::new(clock.clone()), unit, false);
    device.start().unwrap();
    let mut live: Option<LiveIngest> = None;
    let mut poses = Vec::new();
    while clock.now_ns() < (1 + seconds) * SECOND {
        let deadline = clock.now_ns() + 20 * MS;
        let Next::Reading(reading) = device.next(deadline).unwrap() else { continue };
        let timing = device.describe().timing;
        let live = live.get_or_insert_with(|| LiveIngest::new(Gives::Stations(vec![1, 2]), timing, 0));
        match live.take(reading) {
            Live::Pose { source, sample, .. } => poses.push((source, sample, clock.now_ns())),
            other => panic!("{other:?}"),
        }
    }
    (live.unwrap(), poses)
}

fn check(poses: &[(usize, PoseSample, i64)], cycle_hz: f64) {
    let q = DQuat::from_euler(EulerRot::ZYX, 0.5, -0.25, 0.125);
    for source in [0, 1] {
        let own: Vec<_> = poses.iter().filter(|(of, ..)| *of == source).collect();
        assert!(own.len() > 200, "{}", own.len());
        for (_, sample, _) in &own {
            let expected = DVec3::new(125.0 * (source + 1) as f64, -32.5, 400.0);
            assert!((sample.pose.position_mm - expected).length() < 1e-3, "{:?}", sample.pose);
            let rotation = if source == 0 { q } else { DQuat::IDENTITY };
            assert!(sample.pose.rotation.angle_between(rotation) < 2e-4, "{:?}", sample.pose);
            assert!((sample.pose.rotation.length() - 1.0).abs() < 1e-12 && sample.invalid.is_none());
        }
        // Simulated units measure at whole multiples of their cycle on the host's clock.
        for (_, sample, _) in own.iter().skip(150) {
            let cycles = sample.time_ns as f64 * 1e-9 * cycle_hz;
            let off_ms = (cycles - cycles.round()).abs() / cycle_hz * 1e3;
            assert!(
                off_ms < 0.02 && off_ms * 1e6 <= sample.bound_ns as f64 + 2.0,
                "{source}: {off_ms} ms, {}",
                sample.bound_ns
            );
        }
    }
}

#[test]
fn fastrak_records_are_mm_at_measurement_time() {
    let settings = Settings { stations: vec![1, 2], ..Settings::default() };
    let twin = drivers::simulated::fastrak::Twin::new(motion(), Faults::default());
    let unit = fastrak::Unit::new("a line", settings, None).unwrap();
    let (live, poses) = taken(twin, unit, 12);
    assert_eq!(live.clocks().len(), 2, "no ticks: stations count for themselves");
    check(&poses, 120.0);
}

#[test]
fn liberty_stations_share_one_clock() {
    let settings = Settings { stations: vec![1, 2], ..Settings::default() };
    let mut twin = drivers::simulated::liberty::Twin::new(motion(), Faults::default());
    twin.active = 3;
    let unit = liberty::Unit::new("a line", settings, None).unwrap();
    let (mut live, poses) = taken(twin, unit, 12);
    assert_eq!(live.clocks().len(), 1);
    check(&poses, live.timing.tick_hz.unwrap());
    assert!(
        poses.iter().all(|(_, sample, _)| !sample.flags.has(TimeFlags::REPEATED)),
        "stations of a frame are no repetitions"
    );
    let (clock, mapping) = live.take_published().unwrap();
    assert_eq!((clock, mapping.number), (0, live.clocks()[0].mapping().number));
    assert!(live.take_published().is_none());
}

fn pose(station: u8, host_ms: i64) -> Pose {
    Pose {
        stamp: Stamp { item: 3, host_ns: Some(host_ms * MS), ..Stamp::default() },
        station,
        position_cm: [1.0, 2.0, -3.0],
        quaternion_wxyz: [0.0, 0.0, 0.99, 0.0],
        buttons: 0,
        distortion: None,
        code: None,
        status: Status::Ok,
    }
}

#[test]
fn impossible_pose_refused_and_invalid_pose_marked() {
    let mut live = LiveIngest::new(Gives::Stations(vec![1]), Timing::default(), 5 * MS);
    let mut take = |change: &dyn Fn(&mut Pose)| {
        let mut changed = pose(1, 100);
        change(&mut changed);
        live.take(Reading::Pose(changed))
    };
    let Live::Pose { source: 0, sample, timed } = take(&|_| {}) else { panic!("a good pose") };
    assert_eq!(sample.pose.position_mm, DVec3::new(10.0, 20.0, -30.0));
    assert_eq!(sample.pose.rotation, DQuat::from_xyzw(0.0, 1.0, 0.0, 0.0));
    assert_eq!((sample.time_ns, timed.time_ns), (95 * MS, 95 * MS));
    let Live::Pose { sample, .. } = take(&|pose| pose.status = Status::Other("signal weak".into())) else {
        panic!("a marked pose")
    };
    assert_eq!(sample.invalid.as_deref(), Some("signal weak"));
    let mut refused = |change: &dyn Fn(&mut Pose)| match take(change) {
        Live::Refused(refusal) => refusal,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(&|pose| pose.position_cm[1] = f64::NAN).reason, Reason::PoseNotFinite);
    let long = refused(&|pose| pose.quaternion_wxyz[2] = 1.03);
    assert_eq!((long.reason, long.item), (Reason::PoseNotRigid, 3));
    assert_eq!(long.detail, "the quaternion of station 1 has the length 1.0300, not 1");
    assert_eq!(refused(&|pose| pose.stamp.host_ns = None).reason, Reason::TimeInvalid);
    assert!(matches!(take(&|pose| pose.station = 2), Live::Unused(_)));
    assert_eq!(live.refused(), 3);
    assert!(matches!(live.take(Reading::Frame(frame(0))), Live::Unused("frame")));
}

fn frame(number: u64) -> Frame {
    Frame {
        stamp: Stamp {
            item: number,
            host_ns: Some(7 * SECOND + number as i64 * 40 * MS),
            ticks: Some(number),
            ..Stamp::default()
        },
        frame_number: Some(number),
        status: Status::Ok,
        size: [2, 1],
        channels: 1,
        pixel: sonoweave_core::reading::PixelType::U8,
        orientation: "".into(),
        image_type: String::new(),
        pixels: Arc::from([1, 2].as_slice()),
        fields: Vec::new(),
    }
}

#[test]
fn frames_have_clock_time_and_damaged_ones_advance_it() {
    let timing = Timing { ticks: Ticks::Measurements, tick_hz: Some(25.0), rate_hz: Some(25.0), ..Timing::default() };
    let mut live = LiveIngest::new(Gives::Pictures, timing, 30 * MS);
    for number in 0..200 {
        let mut frame = frame(number);
        // Every fourth frame is late, every tenth damaged.
        let late = if number % 4 == 3 { 9 * MS } else { 0 };
        frame.stamp.host_ns = frame.stamp.host_ns.map(|ns| ns + late);
        if number % 10 == 5 {
            frame.status = Status::Other("ERROR".into());
            assert!(matches!(live.take(Reading::Frame(frame)), Live::Refused(_)));
            continue;
        }
        let Live::Picture { picture, timed } = live.take(Reading::Frame(frame)) else { panic!("a picture") };
        assert_eq!(picture.head.time_ns, timed.time_ns);
        assert_eq!(timed.missing, 0, "the damaged one has come");
        let truth = 7 * SECOND + number as i64 * 40 * MS - 30 * MS;
        if number > 60 {
            assert!((timed.time_ns - truth).abs() < MS / 10, "{number}: {}", timed.time_ns - truth);
        }
    }
}

#[test]
fn video_fields_have_separate_times() {
    let timing = Timing {
        ticks: Ticks::Measurements,
        tick_hz: Some(25.0),
        rate_hz: Some(50.0),
        wraps_at: Some(1 << 32),
        ..Timing::default()
    };
    let mut live = LiveIngest::new(Gives::Pictures, timing, 0);
    for number in 0..400_u64 {
        let mut field = frame(number);
        field.stamp.ticks = Some(number / 2);
        let at = 7 * SECOND + number as i64 * 20 * MS;
        field.stamp.host_ns = Some(at);
        let Live::Picture { timed, .. } = live.take(Reading::Frame(field)) else { panic!("a picture") };
        assert!((timed.time_ns - at).abs() < MS / 10, "{number}: {}", timed.time_ns - at);
    }
}

fn arm() -> Gives {
    let kinematics = |counts: &[f64]| {
        (counts[0] >= 0.0)
            .then(|| Rigid { position_mm: DVec3::new(counts[0], counts[1], counts[2]), ..Rigid::IDENTITY })
    };
    Gives::Arm { joints: 3, kinematics: Box::new(kinematics), reach: Vec::new() }
}

fn counts(first: u8, values: &[i64], host_ns: i64, ticks: u64) -> Counts {
    let mut all = [0; AXES];
    all[..values.len()].copy_from_slice(values);
    Counts {
        stamp: Stamp { host_ns: Some(host_ns), ticks: Some(ticks), ..Stamp::default() },
        first,
        axes: values.len() as u8,
        counts: all,
        homed: 7,
        buttons: 0,
        status: Status::Ok,
    }
}

#[test]
fn arm_counts_become_poses() {
    let timing = Timing { ticks: Ticks::Time, tick_hz: Some(1e6), rate_hz: Some(100.0), ..Timing::default() };
    let mut live = LiveIngest::new(arm(), timing, 0);
    let Live::Pose { source: 0, sample, .. } = live.take(Reading::Counts(counts(0, &[4, 5, 6], SECOND, 77))) else {
        panic!("a pose")
    };
    assert_eq!((sample.pose.position_mm, sample.time_ns), (DVec3::new(4.0, 5.0, 6.0), SECOND));
    let Live::Refused(refusal) = live.take(Reading::Counts(counts(0, &[-4, 5, 6], SECOND, 78))) else { panic!("none") };
    assert!(refusal.detail.contains("cannot have the counts [-4.0, 5.0, 6.0]"), "{refusal}");
}

#[test]
fn separate_axes_interpolated_to_one_time() {
    let timing = Timing { ticks: Ticks::Time, tick_hz: Some(512.0), rate_hz: Some(64.0), ..Timing::default() };
    let mut live = LiveIngest::new(arm(), timing, 0);
    // Three clocks with different start times, 0, 50 and -80 ppm off; the joints move at 1, 2
    // and 3 million counts a second.
    let mut events: Vec<(i64, u8, u64)> = Vec::new();
    for (axis, ppm) in [(0_u8, 0.0), (1, 50.0), (2, -80.0)] {
        for n in 0..1200_u64 {
            let at_s = (n as f64 / 64.0) * (1.0 + ppm * 1e-6) + 0.004 * f64::from(axis);
            events.push(((at_s * 1e9) as i64 + SECOND, axis, n * 8 + 1000 * u64::from(axis)));
        }
    }
    events.sort_unstable();
    let (mut poses, mut waits) = (0, 0);
    for (at_ns, axis, ticks) in events {
        let since_s = (at_ns - SECOND) as f64 * 1e-9;
        let count = (1e6 * f64::from(axis + 1) * since_s).round() as i64;
        match live.take(Reading::Counts(counts(axis, &[count], at_ns, ticks))) {
            Live::Waits(_) => waits += 1,
            Live::Pose { sample, .. } => {
                poses += 1;
                if at_ns > 4 * SECOND {
                    let since_s = (sample.time_ns - SECOND) as f64 * 1e-9;
                    let expected = DVec3::new(1.0, 2.0, 3.0) * since_s * 1e6;
                    let off = (sample.pose.position_mm - expected).length();
                    // The first joint moves a million counts a second: one a microsecond.
                    assert!(off < 60.0, "{off} counts");
                }
            }
            other => panic!("{other:?}"),
        }
    }
    assert!(poses > 3500 && waits > 1, "{poses} {waits}");
}

#[test]
fn named_transforms_become_poses_on_one_clock() {
    let timing = Timing { ticks: Ticks::Time, tick_hz: Some(1e6), ..Timing::default() };
    let names = ["ProbeToTracker", "ReferenceToTracker"].map(String::from).to_vec();
    let mut live = LiveIngest::new(Gives::Named(names), timing, 0);
    live.set_up(timing);
    let transform = |n: i64, from: &str, matrix: [f64; 16]| NamedTransform {
        stamp: Stamp {
            host_ns: Some(SECOND + n * 10 * MS),
            ticks: Some(1_795_339_800_000_000 + n as u64 * 10_000),
            ..Stamp::default()
        },
        from: from.into(),
        to: "Tracker".into(),
        matrix,
        status: if n == 3 { Status::Other("INVALID".into()) } else { Status::Ok },
    };
    // A quarter turn about z, with single precision rounding.
    let place = |x: f64| [1e-8, -1.0, 0.0, x, 1.0, 1e-8, 0.0, -2.0, 0.0, 0.0, 1.0, 3.0, 0.0, 0.0, 0.0, 1.0];
    for n in 0..5 {
        for (source, from) in ["Probe", "Reference"].iter().enumerate() {
            let x = 10.0 * (n as f64) + source as f64;
            let live = live.take(Reading::NamedTransform(transform(n, from, place(x))));
            let Live::Pose { source: of, sample, timed } = live else { panic!("{live:?}") };
            assert_eq!((of, sample.pose.position_mm), (source, DVec3::new(x, -2.0, 3.0)));
            assert!(sample.pose.rotation.angle_between(DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2)) < 1e-6);
            assert_eq!(sample.invalid.is_some(), n == 3);
            assert!((sample.time_ns - (SECOND + n * 10 * MS)).abs() < MS, "{sample:?}");
            assert!(!timed.flags.has(TimeFlags::REPEATED), "both have the message's time");
        }
    }
    assert_eq!(live.clocks().len(), 1);
    let other = live.take(Reading::NamedTransform(transform(6, "Stylus", place(0.0))));
    assert!(matches!(other, Live::Unused(_)), "{other:?}");
    let mut mirrored = place(0.0);
    mirrored[10] = -1.0;
    for (matrix, reason) in
        [(mirrored, Reason::PoseMirrored), ([0.0; 16], Reason::PoseNotRigid), ([f64::NAN; 16], Reason::PoseNotFinite)]
    {
        let live = live.take(Reading::NamedTransform(transform(7, "Probe", matrix)));
        let Live::Refused(refusal) = live else { panic!("{live:?}") };
        assert!(refusal.reason == reason && refusal.to_string().contains("ProbeToTracker"), "{refusal}");
    }
}
