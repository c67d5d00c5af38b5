mod flat;

use glam::DVec3;

use sonoweave_core::frames::{Probe, Tracker};

use super::*;
use crate::phantom::{Geometry, Wire};
use crate::probe::dots::Dot;
use crate::probe::recording::Dots;
use crate::probe::track::Poses;
use crate::tests::noise::Noise;
use crate::tests::wire_scans::{Imperfect, SIZE_PX, Scan};

const GOOD: Imperfect = Imperfect { position_mm: 0.1, turn_deg: 0.05, dot_px: 0.5, lag_s: 0.0 };

/// Returns the observations of a scan, as if its images of dots had been read.
fn observed(scan: &Scan, layout: &Layout) -> Vec<Observation> {
    let mut matcher = Matcher::new();
    let poses = scan.track.poses();
    let observation = |sighting: &Sighting| {
        let dots: Vec<Dot> =
            sighting.marks.iter().map(|mark| Dot { at_px: mark.at_px, contrast: 100.0, area_px: 50 }).collect();
        let reading = matcher.read(&dots, SIZE_PX, layout);
        Observation {
            frame: sighting.frame,
            time_s: sighting.time_s,
            seen: Dots { dots, reading },
            poses: Some(poses[sighting.frame]),
        }
    };
    scan.sightings.iter().map(observation).collect()
}

fn recording(observations: &[Observation]) -> Recording<'_> {
    Recording { observations, track: None, size_px: SIZE_PX, timed: true }
}

fn registration(scan: &Scan) -> Registration {
    Registration::new(scan.reference_from_phantom, Some(0.05)).unwrap()
}

fn refused(layout: &Layout, registration: &Registration, observations: &[Observation]) -> ProbeError {
    match calibrate(layout, registration, recording(observations), None) {
        Err(CalibrationError::Probe(error)) => error,
        other => panic!("{other:?}"),
    }
}

/// Returns the refusal for good observations after a change.
fn refusal(change: impl Fn(&mut Vec<Observation>)) -> ProbeError {
    let scan = Scan::new(40, GOOD, &mut Noise::new(31));
    let mut observations = observed(&scan, &scan.layout);
    change(&mut observations);
    refused(&scan.layout, &registration(&scan), &observations)
}

fn read_again(observations: &mut [Observation], layout: &Layout) {
    let mut matcher = Matcher::new();
    for observation in observations {
        observation.seen.reading = matcher.read(&observation.seen.dots, SIZE_PX, layout);
    }
}

#[test]
fn scan_is_validated_on_last_third_and_on_another() {
    let mut noise = Noise::new(30);
    let scan = Scan::new(90, GOOD, &mut noise);
    let observations = observed(&scan, &scan.layout);
    let split = calibrate(&scan.layout, &registration(&scan), recording(&observations), None).unwrap();
    assert!(split.split && split.used() >= 85, "{}", split.used());
    let other = Scan::new(45, GOOD, &mut noise);
    let second = observed(&other, &other.layout);
    let held =
        calibrate(&scan.layout, &registration(&scan), recording(&observations), Some(recording(&second))).unwrap();
    assert!(!held.split && held.refined.plane == split.refined.plane);
    for found in [&split, &held] {
        let [middle, wires] = found.validation.as_ref().unwrap();
        // Limits follow from the sensors' noise at levers of some 90 mm, and from the dots'
        // noise enlarged along the wire.
        assert!(middle.mean < 0.5 && wires.mean < 0.25 && wires.mean < middle.mean, "{middle:?} {wires:?}");
        assert!(middle.mean > 0.05 && middle.max < 3.0 && (middle.rms - middle.mean.hypot(middle.sd)).abs() < 1e-9);
    }
    let picture = held.pictures.iter().find(|picture| picture.outcome == Outcome::Used).unwrap();
    assert!(
        picture.dots.iter().all(|dot| dot.used && dot.off_mm < 1.0 && dot.seen_px.distance(dot.expected_px) < 15.0)
    );
    let predicted = held.predicted_mm(3);
    assert!(predicted[1][1] < predicted[0][0] && predicted[1][1] > 0.0, "{predicted:?}");
}

#[test]
fn images_without_wires_are_refused() {
    let none =
        refusal(|all| all.iter_mut().for_each(|o| o.seen = Dots { dots: o.seen.dots[..3].to_vec(), reading: None }));
    assert!(matches!(none, ProbeError::NoWires { pictures: 40, dots: 3, .. }), "{none}");
}

#[test]
fn dots_of_another_phantom_are_refused() {
    let scan = Scan::new(40, GOOD, &mut Noise::new(32));
    // The same number of N's, with the outer wires elsewhere.
    let wire = |wire: &Wire, shift: f64| {
        let ends_mm = wire.ends_mm.map(|end| DVec3::new(end.x + shift, end.y, 1.7 * end.z));
        Wire { ends_mm, ..wire.clone() }
    };
    let geometry = scan.layout.geometry();
    let shifts = [0.0, 0.0, 0.0, 6.0, 6.0, -3.0, -8.0, 0.0, 0.0];
    let wires: Vec<Wire> = geometry.wires().iter().zip(shifts).map(|(w, shift)| wire(w, shift)).collect();
    let patterns = geometry.patterns().map(|pattern| wires[pattern].to_vec()).collect();
    let other = Layout::new(Geometry::new("another", patterns, Vec::new()).unwrap()).unwrap();
    let observations = observed(&scan, &other);
    let refused = refused(&other, &registration(&scan), &observations);
    assert!(matches!(&refused, ProbeError::OtherPhantom { phantom, .. } if phantom == "another"), "{refused}");
}

#[test]
fn mirrored_images_are_refused() {
    let scan = Scan::new(40, GOOD, &mut Noise::new(31));
    let mirrored = refusal(|all| {
        let flip = |dot: &mut Dot| dot.at_px.x = 819.0 - dot.at_px.x;
        all.iter_mut().for_each(|o| o.seen.dots.iter_mut().for_each(flip));
        read_again(all, &scan.layout);
    });
    assert!(matches!(mirrored, ProbeError::Mirrored { .. }), "{mirrored}");
}

#[test]
fn invalid_poses_few_images_and_one_pose_are_refused() {
    let invalid = refusal(|all| all.iter_mut().for_each(|o| o.poses = None));
    assert_eq!(invalid, ProbeError::NoPoses { pictures: 40 });
    let few = refusal(|all| all.truncate(3));
    assert_eq!(few, ProbeError::TooFew { pictures: 3 });
    let scan = Scan::new(40, GOOD, &mut Noise::new(31));
    let still = refusal(|all| {
        let (dots, poses) = (all[5].seen.dots.clone(), all[5].poses);
        for observation in all.iter_mut() {
            observation.seen.dots.clone_from(&dots);
            observation.poses = poses.map(|poses| Poses { time_s: observation.time_s, ..poses });
        }
        read_again(all, &scan.layout);
    });
    assert!(matches!(still, ProbeError::Still { .. }), "{still}");
}

#[test]
fn images_without_poses_are_left_out_and_counted() {
    let scan = Scan::new(60, GOOD, &mut Noise::new(33));
    let mut observations = observed(&scan, &scan.layout);
    observations.iter_mut().step_by(10).for_each(|o| o.poses = None);
    let found = calibrate(&scan.layout, &registration(&scan), recording(&observations), None).unwrap();
    let count = |outcome: Outcome| found.pictures.iter().filter(|picture| picture.outcome == outcome).count();
    assert_eq!((count(Outcome::NoPose), found.pictures.len()), (6, 60));
    assert!(found.used() >= 50);
}

#[test]
fn tracker_samples_give_lag() {
    let scan = Scan::new(90, GOOD, &mut Noise::new(34));
    let observations = observed(&scan, &scan.layout);
    let own = calibrate(&scan.layout, &registration(&scan), recording(&observations), None).unwrap();
    let late = scan.track.poses().iter().map(|poses| Poses { time_s: poses.time_s + 0.0437, ..*poses });
    let late = Track::new(late.collect());
    let recording = Recording { track: Some(&late), ..recording(&observations) };
    let found = calibrate(&scan.layout, &registration(&scan), recording, None).unwrap();
    let later = found.refined.lag_s - own.refined.lag_s;
    assert!((later - 0.0437).abs() < 1e-4 && own.refined.lag_sd_s < 0.01, "{later} {}", own.refined.lag_sd_s);
}

#[test]
fn other_units_than_mm_are_named() {
    for (factor, units) in [(10.0, Units::Centimetres), (25.4, Units::Inches)] {
        let scaled = |mut affine: DAffine3| {
            affine.translation /= factor;
            affine
        };
        let poses = refusal(|all| {
            for poses in all.iter_mut().filter_map(|o| o.poses.as_mut()) {
                let probe = scaled(poses.tracker_from_probe.affine());
                poses.tracker_from_probe = Transform::<Tracker, Probe>::from_affine(probe);
                poses.tracker_from_reference =
                    poses.tracker_from_reference.map(|t| Transform::from_affine(scaled(t.affine())));
            }
        });
        assert_eq!(poses, ProbeError::PoseUnits { units });
        // The phantom's file in other units, unless its size is refused at once.
        let scan = Scan::new(40, GOOD, &mut Noise::new(31));
        let geometry = scan.layout.geometry();
        let wire = |wire: &Wire| Wire { ends_mm: wire.ends_mm.map(|end| end / factor), ..wire.clone() };
        let patterns = geometry.patterns().map(|p| geometry.wires()[p].iter().map(wire).collect()).collect();
        let mut landmarks = geometry.landmarks().to_vec();
        landmarks.iter_mut().for_each(|landmark| landmark.position_mm /= factor);
        let Ok(small) = Geometry::new("", patterns, landmarks) else {
            assert!(factor > 20.0);
            continue;
        };
        let small = Layout::new(small).unwrap();
        let observations = observed(&scan, &small);
        let file = refused(&small, &registration(&scan), &observations);
        assert_eq!(file, ProbeError::PhantomUnits { units });
    }
    let scan = Scan::new(40, GOOD, &mut Noise::new(31));
    let mut affine = scan.reference_from_phantom.affine();
    affine.translation /= 10.0;
    let short = Registration::new(Transform::from_affine(affine), None).unwrap();
    let observations = observed(&scan, &scan.layout);
    let refused = refused(&scan.layout, &short, &observations);
    // A shift of the phantom equals a shift of the image unless the probe turns, so the cause
    // is not always determined.
    let in_cm = ProbeError::RegistrationUnits { units: Units::Centimetres };
    assert!(refused == in_cm || matches!(refused, ProbeError::Contradictory { .. }), "{refused}");
}

#[test]
fn dots_taken_for_another_layer_are_read_again() {
    let scan = Scan::new(60, GOOD, &mut Noise::new(37));
    let well = observed(&scan, &scan.layout);
    let mut badly = well.clone();
    // Every third image, all by the same layer: they agree with each other.
    for observation in badly.iter_mut().step_by(3) {
        let Some(reading) = &mut observation.seen.reading else { continue };
        reading.best.marks.retain(|mark| mark.wire < 6);
        reading.best.marks.iter_mut().for_each(|mark| mark.wire += 3);
    }
    let read = |observations: &[Observation]| {
        calibrate(&scan.layout, &registration(&scan), recording(observations), Some(recording(observations))).unwrap()
    };
    let (well, badly) = (read(&well), read(&badly));
    assert!(badly.used() + 1 >= well.used(), "{} {}", badly.used(), well.used());
    for px in crate::tests::wire_scans::places() {
        let [one, other] = [&well, &badly].map(|found| found.refined.plane.point(px));
        assert!(one.distance(other) < 0.02, "{one} {other}");
    }
    let [one, other] = [&well, &badly].map(|found| found.validation.as_ref().unwrap()[0].mean);
    assert!((one - other).abs() < 0.02, "{one} {other}");
}
