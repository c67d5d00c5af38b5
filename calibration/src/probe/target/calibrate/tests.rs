use glam::DVec3;

use super::*;
use crate::error::{Axis, ProbeError};
use crate::probe::track::Poses;
use crate::tests::draws::draws;
use crate::tests::noise::Noise;
use crate::tests::target_scans::{GOOD, Imperfect, Motion, Scan};
use crate::tests::wire_scans::places;

const TIP: Target = Target::Tip { place_mm: DVec3::new(2.0, -5.0, 140.0), error_mm: 0.2 };
const USUAL: Imperfect =
    Imperfect { position_mm: 0.1, turn_deg: 0.05, seen_px: 1.0, across_mm: 0.0, lag_s: 0.1, wrong: 0.25 };

fn apart(found: &Calibration, scan: &Scan) -> f64 {
    let off = |px| found.refined.plane.point(px).distance(scan.plane.point(px));
    places().map(off).into_iter().fold(0.0, f64::max)
}

fn refused(target: Target, tilt: [f64; 3], change: impl Fn(&mut Observation<Seen>)) -> ProbeError {
    let motion = Motion { tilt: DVec3::from_array(tilt), ..GOOD };
    let mut scan = Scan::new(target, 60, motion, USUAL, &mut Noise::new(30));
    scan.observations.iter_mut().for_each(change);
    refusal(target, &scan)
}

fn refusal(target: Target, scan: &Scan) -> ProbeError {
    match calibrate(target, scan.recording(true), None) {
        Err(CalibrationError::Probe(error)) => error,
        other => panic!("{other:?}"),
    }
}

#[test]
fn scan_is_calibrated_from_images_and_poses_alone() {
    for (target, most) in [(Target::Point, 0.4), (TIP, 0.4), (Target::Plane, 1.5)] {
        for seed in 0..draws(6) {
            let mut noise = Noise::new(30 + seed);
            let scan = Scan::new(target, 150, GOOD, USUAL, &mut noise);
            let second = Scan::new(target, 60, GOOD, USUAL, &mut noise);
            let split = calibrate(target, scan.recording(true), None).unwrap();
            assert!(apart(&split, &scan) < most, "{target:?} {seed}: {}", apart(&split, &scan));
            assert!((split.refined.lag_s - 0.1).abs() < 0.004, "{target:?} {seed}: {}", split.refined.lag_s);
            let held = calibrate(target, scan.recording(true), Some(second.recording(true))).unwrap();
            assert!(split.split && !held.split && held.refined.plane == split.refined.plane);
            for errors in [&split.errors, split.validation.as_ref().unwrap(), held.validation.as_ref().unwrap()] {
                assert!(errors.mean > 0.02 && errors.mean < 0.5, "{target:?} {seed}: {errors:?}");
            }
            // A quarter of the images show other objects; those of a point also show the point.
            let expected = if target == Target::Plane { 100..125 } else { 140..150 };
            assert!(expected.contains(&split.used()), "{target:?} {seed}: {}", split.used());
            assert_eq!(split.pictures.len(), 150);
        }
    }
}

#[test]
fn same_scan_gives_same_bits() {
    for target in [Target::Point, Target::Plane] {
        let scan = Scan::new(target, 50, GOOD, USUAL, &mut Noise::new(7));
        let one = || calibrate(target, scan.recording(true), None).unwrap().refined.plane;
        assert_eq!(one(), one());
    }
}

#[test]
fn insufficient_motion_is_refused_with_missing_axes() {
    let missing = |target: Target, tilt: [f64; 3]| match refused(target, tilt, |_| {}) {
        ProbeError::NoTurn { axes, .. } => axes,
        other => panic!("{target:?} {tilt:?}: {other}"),
    };
    let [u, v, normal] = [Axis::U, Axis::V, Axis::Normal];
    assert_eq!(missing(Target::Point, [0.0; 3]), [u, v, normal]);
    assert_eq!(missing(Target::Point, [0.5, 0.0, 0.0]), [v, normal]);
    assert_eq!(missing(Target::Point, [0.0, 0.0, 0.5]), [u, v]);
    assert_eq!(missing(Target::Plane, [0.0; 3]), [u, normal]);
    assert_eq!(missing(Target::Plane, [0.5, 0.0, 0.0]), [normal]);
    assert_eq!(missing(Target::Plane, [0.0, 0.0, 0.5]), [u]);
    let refusal = refused(Target::Plane, [0.0, 0.0, 0.5], |_| {}).to_string();
    assert!(
        refusal.contains("hardly turned about u ") && refusal.ends_with("; tilt the probe fore and aft"),
        "{refusal}"
    );
    // A tip's position is known, so no rotation is needed.
    let motion = Motion { tilt: DVec3::ZERO, ..GOOD };
    let scan = Scan::new(TIP, 60, motion, USUAL, &mut Noise::new(30));
    assert!(apart(&calibrate(TIP, scan.recording(true), None).unwrap(), &scan) < 0.8);
}

#[test]
fn insufficient_recordings_are_refused_with_advice() {
    for target in [Target::Point, TIP, Target::Plane] {
        let after = |change: &dyn Fn(&mut Observation<Seen>)| refused(target, [0.5; 3], change);
        assert_eq!(after(&|o| o.poses = None), ProbeError::NoPoses { pictures: 60 });
        let unseen = after(&|o| {
            if o.frame % 8 > 0 {
                o.seen = Seen::Nothing;
            }
        });
        assert!(matches!(unseen, ProbeError::Unseen { seen: 8, pictures: 60, least: 10, .. }), "{unseen}");
        let still = Scan::new(target, 60, GOOD, USUAL, &mut Noise::new(30));
        let one = still.observations[0].poses;
        let held = after(&|o| o.poses = one.map(|poses| Poses { time_s: o.time_s, ..poses }));
        assert!(matches!(held, ProbeError::Still { .. }), "{held}");
    }
    let in_one_place = Motion { part: 0.01, ..GOOD };
    for target in [Target::Point, TIP] {
        let scan = Scan::new(target, 60, in_one_place, Imperfect { wrong: 0.0, ..USUAL }, &mut Noise::new(30));
        let error = refusal(target, &scan);
        assert!(matches!(error, ProbeError::OnePlace { line: false, .. }), "{error}");
    }
    // Metres are recognised by the pixel size; a point gives no other evidence.
    let refusal = refused(Target::Point, [0.5; 3], |o| {
        o.poses = o.poses.map(|poses| Track::new(vec![poses]).scaled(0.001).poses()[0]);
    });
    assert!(matches!(refusal, ProbeError::PixelSize { units: Some(_), .. }), "{refusal}");
}
