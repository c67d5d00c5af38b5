//! Corrections of simulated sweeps by hand, and scans that are not to be corrected.

mod closed;
mod sweep;

use std::time::Instant;

use glam::DAffine3;

use super::*;
use crate::tests::noise::Noise as Random;
use sweep::{Scene, Sweep};

fn noise(mm_and_deg: f64) -> TrackerNoise {
    TrackerNoise { position_mm: mm_and_deg, rotation_deg: mm_and_deg }
}

/// Errors of the points of all images, root mean square, mm: in all, and within the planes.
fn errors(sweep: &Sweep, found: Option<&Jitter>) -> [f64; 2] {
    let (mut all, mut within, mut count) = (0.0, 0.0, 0.0);
    for (slice, (truth, measured)) in sweep.truth.iter().zip(&sweep.measured).enumerate() {
        let corrected = found.map_or(*measured, |found| found.corrected(slice, *measured));
        let normal = truth.matrix3.z_axis.normalize();
        for p in State::points(&sweep.slices) {
            let off = corrected.transform_point3(p) - truth.transform_point3(p);
            all += off.length_squared();
            within += off.length_squared() - off.dot(normal).powi(2);
            count += 1.0;
        }
    }
    [all, within].map(|sum: f64| (sum / count).sqrt())
}

/// Prints a result, and returns it with the errors before and after.
fn found(name: &str, sweep: &Sweep, given: f64) -> (Jitter, [[f64; 2]; 2]) {
    let begin = Instant::now();
    let found = sweep.slices.found_jitter(noise(given)).unwrap();
    let ms = begin.elapsed().as_millis();
    let [before, after] = [None, Some(&found)].map(|found| errors(sweep, found));
    println!(
        "{name}: in all {:.3} -> {:.3} mm, within planes {:.3} -> {:.3} mm; fall {:.1} %, correlation {:.2}, chi2 {:.2}, \
        largest {:.2} mm, rms {:.3} mm, unpredicted {:.1} %, {} of {} corrected, {ms} ms; {:?}",
        before[0],
        after[0],
        before[1],
        after[1],
        100.0 * found.fall(),
        found.correlation,
        found.chi2,
        found.largest_mm,
        found.rms_mm,
        100.0 * found.unpredicted,
        found.corrected,
        found.slices,
        found.unfit(),
    );
    (found, [before, after])
}

#[test]
fn pose_of_a_slice_is_that_of_its_sample() {
    let sweep = Sweep::of(&Scene::default(), 0.3, 1);
    for (slice, measured) in sweep.measured.iter().enumerate() {
        let placed = sweep.slices.placed(slice, 0.0).unwrap();
        assert!(placed.abs_diff_eq(*measured, 1e-9), "{slice}");
    }
}

#[test]
fn white_noise_is_reduced_within_planes() {
    for seed in 1..4 {
        let (jitter, [before, after]) = found("0.3 mm, 0.3°", &Sweep::of(&Scene::default(), 0.3, seed), 0.3);
        assert!(jitter.unfit().is_none(), "{:?}", jitter.unfit());
        // Errors across the planes remain.
        assert!(before[1] > 0.6 && after[1] < 0.5 * before[1] && after[0] < 0.8 * before[0]);
        let (jitter, [before, after]) = found("0.1 mm, 0.1°", &Sweep::of(&Scene::default(), 0.1, seed), 0.1);
        assert!(jitter.unfit().is_none(), "{:?}", jitter.unfit());
        assert!(before[1] > 0.2 && after[1] < 0.55 * before[1] && after[0] < 0.8 * before[0]);
    }
}

#[test]
fn exact_poses_are_refused() {
    for (seed, given) in [(1, 0.3), (2, 0.3), (3, 0.3), (1, 0.1), (2, 0.1), (3, 0.03)] {
        for noise in [1.2, 6.0] {
            let (jitter, [_, after]) =
                found("exact", &Sweep::of(&Scene { noise, ..Scene::default() }, 0.0, seed), given);
            assert!(jitter.fall() < 0.02 && after[0] < 0.05, "{} {after:?}", jitter.fall());
            assert!(matches!(jitter.unfit(), Some(JitterError::NoBetter { .. })), "{:?}", jitter.unfit());
        }
    }
}

/// Poses smoothed over time have errors that many neighbours share.
#[test]
fn smoothed_poses_are_refused_or_improved() {
    for seed in 1..4 {
        for given in [0.3, 0.1] {
            let sweep = Sweep::of(&Scene { is_smooth: true, ..Scene::default() }, 0.3, seed);
            let (jitter, [before, after]) = found("smoothed", &sweep, given);
            assert!(after[0] < before[0] && after[1] < before[1]);
            assert!(given < 0.3 || jitter.unfit().is_some());
        }
    }
}

#[test]
fn images_of_noise_are_refused() {
    for pose in [0.0, 0.3] {
        let sweep = Sweep::of(&Scene { is_body: false, speckle: 25.0, ..Scene::default() }, pose, 1);
        let (jitter, _) = found("speckle of each image's own", &sweep, 0.3);
        assert!(jitter.correlation.abs() < 0.1 && jitter.fall() < 0.02);
        let refused = sweep.slices.jitter(noise(0.3)).unwrap_err();
        assert!(matches!(refused, CalibrationError::Jitter(JitterError::Unrelated { .. })), "{refused}");
        // Shapes of the body below it.
        let sweep = Sweep::of(&Scene { speckle: 15.0, ..Scene::default() }, pose, 1);
        let (jitter, _) = found("the same over a body", &sweep, 0.3);
        assert!(matches!(jitter.unfit(), Some(JitterError::NoBetter { .. })), "{:?}", jitter.unfit());
    }
}

#[test]
fn uniform_images_are_refused() {
    let mut sweep = Sweep::of(&Scene { is_body: false, noise: 0.0, ..Scene::default() }, 0.3, 1);
    let (jitter, _) = found("uniform", &sweep, 0.3);
    assert!(jitter.largest_mm < 1e-9);
    let refused = jitter.unfit();
    assert!(matches!(refused, Some(JitterError::Flat { flat: 120, slices: 120 })), "{refused:?}");
    sweep.slices.pixels.iter_mut().for_each(|(_, pixels)| pixels.fill(0));
    let refused = sweep.slices.jitter(noise(0.3)).unwrap_err();
    assert!(matches!(refused, CalibrationError::Jitter(JitterError::Flat { .. })), "{refused}");
}

#[test]
fn few_slices_or_no_noise_are_refused() {
    let sweep = Sweep::of(&Scene { slices: LEAST_SLICES - 1, ..Scene::default() }, 0.3, 1);
    let refused = sweep.slices.jitter(noise(0.3)).unwrap_err();
    assert_eq!(refused, JitterError::FewSlices { slices: LEAST_SLICES - 1, least: LEAST_SLICES }.into());
    for of in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        for given in [TrackerNoise { position_mm: of, ..noise(0.3) }, TrackerNoise { rotation_deg: of, ..noise(0.3) }] {
            let refused = sweep.slices.jitter(given).unwrap_err();
            assert!(matches!(refused, CalibrationError::Jitter(JitterError::Noise { .. })), "{refused}");
        }
    }
}

#[test]
fn resting_probe_is_refused() {
    let sweep = Sweep::of(&Scene { speed_mm_s: 0.0, wander: 0.0, ..Scene::default() }, 0.0, 1);
    let refused = sweep.slices.jitter(noise(0.001)).unwrap_err();
    assert!(matches!(refused, CalibrationError::Jitter(JitterError::Unpredicted { .. })), "{refused}");
}

/// Noise that is far larger than stated is no noise of this tracker.
#[test]
fn displacements_beyond_the_noise_are_refused() {
    let (jitter, _) = found("noise of 0.3, stated as 0.1", &Sweep::of(&Scene::default(), 0.3, 1), 0.1);
    assert!(matches!(jitter.unfit(), Some(JitterError::Unlikely { .. })), "{:?}", jitter.unfit());
}

#[test]
fn large_displacement_is_refused() {
    let mut sweep = Sweep::of(&Scene::default(), 0.3, 1);
    // The image of one slice is displaced by 10 pixels of 0.5 mm.
    let pixels = &mut sweep.slices.pixels[60].1;
    pixels.copy_within(10.., 0);
    let (jitter, _) = found("one image displaced", &sweep, 2.0);
    assert!(matches!(jitter.unfit(), Some(JitterError::Large { .. })), "{:?}", jitter.unfit());
    assert!(jitter.numbers(60).unwrap()[0] > 2.0, "{:?}", jitter.numbers(60));
}

/// Pushes the slices in another order.
#[test]
fn order_of_slices_does_not_count() {
    let sweep = Sweep::of(&Scene { slices: 60, ..Scene::default() }, 0.3, 1);
    let mut other = sweep.slices.clone();
    let order: Vec<usize> = (0..60).map(|k| k * 23 % 60).collect();
    other.pixels = order.iter().map(|slice| sweep.slices.pixels[*slice].clone()).collect();
    let [a, b] = [&sweep.slices, &other].map(|slices| slices.found_jitter(noise(0.3)).unwrap());
    assert!(a.numbers(30).is_some_and(|numbers| numbers[0] != 0.0));
    order.iter().enumerate().for_each(|(new, old)| assert_eq!(a.numbers(*old), b.numbers(new), "{old}"));
    assert_eq!((a.differences, a.correlation), (b.differences, b.correlation));
    assert_eq!((a.chi2, a.rms_mm, a.largest_mm, a.unpredicted), (b.chi2, b.rms_mm, b.largest_mm, b.unpredicted));
}

#[test]
fn frame_of_the_room_does_not_matter() {
    let sweep = Sweep::of(&Scene { slices: 60, ..Scene::default() }, 0.3, 2);
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.7, -2.0, 1.1);
    let room = DAffine3::from_rotation_translation(turn, glam::DVec3::new(300.0, -500.0, 90.0));
    let moved = sweep.moved(room);
    let [a, b] = [&sweep.slices, &moved].map(|slices| slices.found_jitter(noise(0.3)).unwrap());
    for slice in 0..60 {
        let [a, b] = [&a, &b].map(|found| found.numbers(slice).unwrap_or_default());
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6), "{slice}: {a:?} {b:?}");
    }
}

#[test]
fn long_scan_is_corrected_as_a_short_one() {
    let shown = Scene { slices: 600, speed_mm_s: 3.0, ..Scene::default() };
    let (jitter, [before, after]) = found("600 slices, gaps of 0.1 mm", &Sweep::of(&shown, 0.3, 1), 0.3);
    assert!(jitter.unfit().is_none() && after[1] < 0.5 * before[1], "{:?}", jitter.unfit());
}

#[test]
fn covariance_is_that_of_the_sensors_noise() {
    let sweep = Sweep::of(&Scene { slices: 20, ..Scene::default() }, 0.0, 1);
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.7, 1.1);
    let probe_from_picture = DAffine3::from_rotation_translation(turn, glam::DVec3::new(60.0, 110.0, -40.0));
    let mut state = State::of(&sweep.slices);
    state.probe_from_picture = probe_from_picture;
    let prior = Prior::of(&state, noise(0.3));
    let covariance = prior.inverse.try_inverse().unwrap();
    let mut random = Random::new(4);
    let (mut sum, mut across) = (nalgebra::Matrix3::<f64>::zeros(), 0.0);
    const DRAWS: u32 = 20_000;
    for _ in 0..DRAWS {
        // The twist about the image's middle by a small displacement of the sensor.
        let sensor = DAffine3::from_rotation_translation(random.turn(0.3_f64.to_radians()), random.vector(0.3));
        let picture = state.probe_from_picture.inverse() * sensor * state.probe_from_picture;
        let turn = glam::DQuat::from_mat3(&picture.matrix3).to_scaled_axis();
        let within = nalgebra::Vector3::new(picture.translation.x, picture.translation.y, turn.z);
        sum += within * within.transpose();
        across += picture.translation.z.powi(2);
    }
    let drawn = sum / f64::from(DRAWS);
    assert!(((across / f64::from(DRAWS)).sqrt() / prior.across_mm - 1.0).abs() < 0.02, "{}", prior.across_mm);
    for (i, j) in (0..9).map(|k| (k / 3, k % 3)) {
        let unit = (covariance[(i, i)] * covariance[(j, j)]).sqrt();
        assert!((drawn[(i, j)] - covariance[(i, j)]).abs() < 0.04 * unit, "{i}, {j}: {drawn} {}", covariance);
    }
}
