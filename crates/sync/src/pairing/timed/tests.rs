use std::borrow::Cow;

use glam::DQuat;

use sonoweave_core::named::StaticTransform;

use super::*;

const MS: i64 = 1_000_000;

fn calibration() -> StaticTransform {
    let rows = [0.1, 0.0, 0.0, -3.0, 0.0, 0.2, 0.0, 10.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    StaticTransform::new("Image", "Probe", &rows).unwrap()
}

fn options() -> TimedOptions {
    let sources = vec![Source::new("Probe", "Tracker"), Source::new("Reference", "Tracker")];
    TimedOptions {
        pairing: PairingOptions { statics: vec![calibration()], ..PairingOptions::default() },
        sources,
        most_waiting: 3,
        ..TimedOptions::default()
    }
}

/// The probe moves and turns; the patient moves the other way.
fn rigid(source: usize, at_ns: i64) -> Rigid {
    let s = at_ns as f64 * 1e-9;
    let (speed, turn) = if source == 0 { (50.0, 0.5) } else { (-4.0, 0.0) };
    Rigid {
        rotation: DQuat::from_rotation_y(turn * s),
        position_mm: DVec3::new(speed * s, 100.0, 20.0 * speed * s * s),
    }
}

fn sample(source: usize, ms: i64) -> PoseSample {
    let pose = rigid(source, ms * MS);
    PoseSample { time_ns: ms * MS, bound_ns: 0, flags: TimeFlags::NONE, pose, invalid: None }
}

fn frame(ms: i64) -> FrameTime {
    FrameTime { time_ns: ms * MS, bound_ns: 0, flags: TimeFlags::NONE, size: [640, 480] }
}

/// Ground truth.
fn world_from_image(at_ns: i64) -> DAffine3 {
    rigid(1, at_ns).inverse().affine() * rigid(0, at_ns).affine() * calibration().affine
}

#[test]
fn frame_waits_for_poses_on_both_sides_then_true_pose() {
    let mut stage = TimedPairing::new(options()).unwrap();
    assert_eq!(stage.route().describe(), "Image → Probe → Tracker → Reference");
    for ms in [0, 10, 20] {
        stage.pose(0, sample(0, ms));
        stage.pose(1, sample(1, ms));
    }
    assert!(stage.frame(frame(25), 26 * MS, "a").is_none());
    assert!(stage.next(27 * MS).is_none(), "nothing lies after it");
    stage.pose(0, sample(0, 30));
    assert!(stage.next(31 * MS).is_none(), "the other station has not come");
    assert_eq!((stage.waiting(), stage.deadline_ns()), (1, Some(526 * MS)));
    stage.pose(1, sample(1, 30));
    let answered = stage.next(32 * MS).unwrap();
    assert_eq!((answered.payload, answered.waited_ns, answered.crowded), ("a", 6 * MS, false));
    let placed = answered.answer.unwrap();
    assert_eq!(placed.how, How::Interpolated { gap_ns: 10 * MS });
    let truth = world_from_image(25 * MS);
    for corner in [[0.0, 0.0], [639.0, 0.0], [0.0, 479.0], [639.0, 479.0]] {
        let corner = DVec3::new(corner[0], corner[1], 0.0);
        let off = (placed.world_from_image.point(corner) - truth.transform_point3(corner)).length();
        assert!(off <= placed.error_mm && off > 0.0, "{off} {}", placed.error_mm);
    }
    assert!(placed.error_mm < 0.6, "{}", placed.error_mm);
    assert!(stage.frame(frame(20), 33 * MS, "b").is_none());
    let exact = stage.next(33 * MS).unwrap().answer.unwrap();
    assert_eq!(exact.how, How::Exact);
    assert!(exact.world_from_image.affine().abs_diff_eq(world_from_image(20 * MS), 1e-9));
}

#[test]
fn clock_and_tracker_errors_are_in_error_bound() {
    let with = |bound_ns: i64, noise_mm: f64, noise_rad: f64| {
        let mut options = options();
        options.sources[0].noise_mm = noise_mm;
        options.sources[0].noise_rad = noise_rad;
        let mut stage = TimedPairing::new(options).unwrap();
        for ms in [0, 10, 20, 30] {
            stage.pose(0, PoseSample { bound_ns, ..sample(0, ms) });
            stage.pose(1, PoseSample { bound_ns, ..sample(1, ms) });
        }
        stage.frame(FrameTime { bound_ns, ..frame(15) }, 0, ());
        stage.next(0).unwrap().answer.unwrap().error_mm
    };
    let plain = with(0, 0.0, 0.0);
    // Two clocks are off by 2 ms in sum, at some 50 mm/s and 4 mm/s.
    assert!((with(MS, 0.0, 0.0) - plain - 0.13).abs() < 0.05, "{}", with(MS, 0.0, 0.0) - plain);
    assert!((with(0, 0.5, 0.0) - plain - 0.5).abs() < 1e-9);
    // The corner is some 120 mm from the sensor.
    assert!((with(0, 0.0, 0.01) - plain - 1.2).abs() < 0.1, "{}", with(0, 0.0, 0.01) - plain);
}

#[test]
fn frame_without_pose_gets_source_and_reason() {
    let answer = |prepare: &dyn Fn(&mut TimedPairing<()>), frame: FrameTime| {
        let mut stage = TimedPairing::new(options()).unwrap();
        for ms in [100, 110, 120] {
            stage.pose(0, sample(0, ms));
        }
        prepare(&mut stage);
        stage.frame(frame, 130 * MS, ());
        let at_once = stage.next(130 * MS);
        let answered = match at_once {
            Some(answered) => answered,
            None => {
                assert!(stage.next(629 * MS).is_none());
                stage.next(630 * MS).expect("it has waited long enough")
            }
        };
        (answered.waited_ns / MS, answered.answer.unwrap_err().to_string())
    };
    let both = |stage: &mut TimedPairing<()>| [100, 110, 120].iter().for_each(|ms| stage.pose(1, sample(1, *ms)));
    assert_eq!(answer(&|_| {}, frame(115)), (500, "ReferenceToTracker: nothing was received".into()));
    assert_eq!(
        answer(&both, frame(125)),
        (500, "ProbeToTracker: no pose came after the time: the last is 5.0 ms before it".into())
    );
    // A reason that cannot change is given at once.
    assert_eq!(
        answer(&both, frame(95)),
        (0, "ProbeToTracker: the time is 5.0 ms before the first pose that is kept".into())
    );
    let gap = |stage: &mut TimedPairing<()>| [0, 300].iter().for_each(|ms| stage.pose(1, sample(1, *ms)));
    assert_eq!(answer(&gap, frame(115)), (0, "ReferenceToTracker: the poses about the time lie 300.0 ms apart".into()));
    let invalid = |stage: &mut TimedPairing<()>| {
        both(stage);
        stage.pose(1, PoseSample { invalid: Some(Cow::Borrowed("signal weak")), ..sample(1, 120) });
    };
    assert_eq!(
        answer(&invalid, frame(115)),
        (0, "ReferenceToTracker: a pose about the time is not valid: signal weak".into())
    );
    let lost = |stage: &mut TimedPairing<()>| {
        both(stage);
        stage.pose(0, PoseSample { flags: TimeFlags::LOST, ..sample(0, 120) });
    };
    assert_eq!(answer(&lost, frame(115)), (0, "ProbeToTracker: the clock of the poses about the time was lost".into()));
    let (waited, why) = answer(&both, FrameTime { flags: TimeFlags::LOST, ..frame(115) });
    assert!(waited == 0 && why.contains("clock of the pictures"), "{why}");
}

#[test]
fn queue_is_bounded_and_ordered() {
    let mut stage = TimedPairing::new(options()).unwrap();
    for n in 0..3 {
        assert!(stage.frame(frame(n), 0, n).is_none());
    }
    let first = stage.frame(frame(3), MS, 3).unwrap();
    assert!(first.crowded && first.payload == 0 && first.answer.is_err());
    let mut rest = Vec::new();
    while let Some(answered) = stage.finish(2 * MS) {
        rest.push(answered.payload);
    }
    assert_eq!(rest, [1, 2, 3]);
    stage.pose(7, sample(0, 1));
    assert!(stage.history(7).is_none() && stage.history(0).unwrap().is_empty());
}

#[test]
fn world_is_reference_if_present_and_no_path_reported() {
    let mut options = options();
    options.sources.pop();
    let stage = TimedPairing::<()>::new(options.clone()).unwrap();
    assert_eq!(stage.route().world(), "Tracker");
    options.pairing.statics.clear();
    let error = TimedPairing::<()>::new(options).unwrap_err().to_string();
    assert!(error.contains("no way from Image to Tracker"), "{error}");
}
