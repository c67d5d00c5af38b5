use std::borrow::Cow;

use glam::{DQuat, DVec3};

use sonoweave_core::named::StaticTransform;

use super::*;
use crate::smoothing::NotSmoothed;

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

/// Settings with smoothing over 100 ms on both sides, 30 ms ahead.
fn smoothed_options() -> TimedOptions {
    let mut options = options();
    for source in &mut options.sources {
        source.smoothing = Some(Smoothing { half_width_ns: 100 * MS, ahead_ns: 30 * MS });
    }
    options
}

#[test]
fn frame_waits_for_poses_ahead_then_smoothed_pose() {
    let mut stage = TimedPairing::new(smoothed_options()).unwrap();
    let add = |stage: &mut TimedPairing<_>, ms: i64| {
        let mut probe = sample(0, ms);
        // Multiples of the golden ratio have no order.
        let noise = |n: i64| ((ms * n) as f64 * 0.618_033_988_75).fract() - 0.5;
        probe.pose.position_mm += DVec3::new(noise(7), noise(11), noise(16));
        stage.pose(0, probe);
        stage.pose(1, sample(1, ms));
    };
    (0..=320).step_by(10).for_each(|ms| add(&mut stage, ms));
    assert!(stage.frame(frame(295), 321 * MS, "a").is_none());
    assert!(stage.next(330 * MS).is_none(), "320 ms are there, and 325 are wanted");
    assert_eq!(stage.deadline_ns(), Some(851 * MS), "30 ms more than without smoothing");
    add(&mut stage, 330);
    let placed = stage.next(331 * MS).unwrap().answer.unwrap();
    let effect = placed.smoothing.unwrap();
    assert_eq!(effect.not_smoothed, None);
    let truth = world_from_image(295 * MS);
    let [smoothed, between] = [placed.world_from_image, effect.unsmoothed]
        .map(|pose| (pose.point(DVec3::ZERO) - truth.transform_point3(DVec3::ZERO)).length());
    assert!(smoothed < 0.5 * between && between > 0.2, "{smoothed} {between}");
    assert!((effect.moved_mm - between).abs() < 1.1 * smoothed, "{effect:?}");
    assert!(smoothed < 2.0 * effect.error_mm && effect.error_mm < 0.4, "{smoothed} {effect:?}");
    // Later poses change nothing.
    let again = stage.place(&frame(295)).unwrap();
    add(&mut stage, 340);
    assert_eq!(stage.place(&frame(295)).unwrap(), again);
    assert_eq!(placed, again);
}

#[test]
fn frame_without_enough_poses_is_interpolated_with_reason() {
    let mut stage = TimedPairing::new(smoothed_options()).unwrap();
    let mut plain = TimedPairing::<()>::new(options()).unwrap();
    for ms in (0..=60).step_by(10) {
        for source in [0, 1] {
            stage.pose(source, sample(source, ms));
            plain.pose(source, sample(source, ms));
        }
    }
    assert!(stage.frame(frame(25), 26 * MS, ()).is_none());
    let placed = stage.next(61 * MS).unwrap().answer.unwrap();
    let effect = placed.smoothing.unwrap();
    assert_eq!(effect.not_smoothed, Some(NotSmoothed::FewSamples { samples: 6 }));
    let expected = plain.place(&frame(25)).unwrap();
    assert_eq!((placed.world_from_image, effect.unsmoothed), (expected.world_from_image, expected.world_from_image));
    assert_eq!((effect.moved_mm, expected.smoothing), (0.0, None));
    // If the tracker falls silent, the wait ends.
    assert!(stage.frame(frame(55), 62 * MS, ()).is_none() && stage.next(591 * MS).is_none());
    assert!(stage.next(592 * MS).unwrap().answer.is_ok());
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
