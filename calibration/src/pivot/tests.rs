//! Pivot calibration of simulated styli with known tips.

#![allow(clippy::print_stdout, reason = "figures, for who asks with --nocapture")]

use glam::{DAffine3, DQuat};

use sonoweave_core::frames::Reference;

use super::*;
use crate::least_squares::tests::jacobian::check_jacobian;
use crate::tests::draws::draws;
use crate::tests::noise::{Noise, mahalanobis};

const TIP: DVec3 = DVec3::new(108.565, 7.774, 2.539);
const PIVOT: DVec3 = DVec3::new(-310.0, 42.0, 95.0);

type Pose = Transform<Reference, Stylus>;

/// Simulated tracker errors.
#[derive(Clone, Copy)]
struct Errors {
    mm: f64,
    deg: f64,
    /// Every n-th pose is displaced; 0 for none.
    jump_every: usize,
}

const NONE: Errors = Errors { mm: 0.0, deg: 0.0, jump_every: 0 };

/// Returns the sensor's orientation with the shaft upright; no axis of its frame is an axis of
/// the world.
fn upright() -> DQuat {
    DQuat::from_scaled_axis(DVec3::new(0.4, -1.1, 0.3))
}

/// Returns a pose with this rotation whose tip is at the pivot.
fn resting(rotation: DQuat) -> DAffine3 {
    DAffine3::from_rotation_translation(rotation, PIVOT - rotation * TIP)
}

/// Simulates a stylus tilted by up to 40° to all sides and rolled by up to 60°.
fn swung(count: usize, errors: Errors, seed: u64) -> Vec<Pose> {
    let mut random = Noise::new(seed);
    let pose = |index: usize| {
        let (towards, tilt) = (random.between(0.0, std::f64::consts::TAU), random.between(0.0, 40_f64.to_radians()));
        let axis = DVec3::new(towards.cos(), towards.sin(), 0.0);
        let roll = DQuat::from_axis_angle(TIP.normalize(), random.between(-1.0, 1.0));
        let mut pose = resting(DQuat::from_axis_angle(axis, tilt) * upright() * roll);
        if errors.jump_every > 0 && index.is_multiple_of(errors.jump_every) {
            pose.translation += random.rotation() * DVec3::X * random.between(15.0, 80.0);
        }
        let noise = (random.vector(errors.mm), random.turn(errors.deg.to_radians()));
        pose.translation += noise.0;
        pose.matrix3 *= DMat3::from_quat(noise.1);
        Pose::from_affine(pose)
    };
    (0..count).map(pose).collect()
}

fn found(poses: &[Pose]) -> Pivot {
    calibrate(poses, &Settings::default()).expect("a tip")
}

fn refused(poses: &[Pose]) -> PivotError {
    match calibrate(poses, &Settings::default()) {
        Err(CalibrationError::Pivot(error)) => error,
        other => panic!("{other:?}"),
    }
}

#[test]
fn exact_poses_give_exact_tip_despite_jumps() {
    for jump_every in [0, 10, 4] {
        let pivot = found(&swung(120, Errors { jump_every, ..NONE }, 1));
        assert!((pivot.tip_mm - TIP).length() < 1e-9, "{}", pivot.tip_mm - TIP);
        assert!((pivot.pivot_mm - PIVOT).length() < 1e-9);
        assert_eq!(pivot.outliers.len(), 120_usize.checked_div(jump_every).unwrap_or(0));
        assert!(pivot.residual_mm.max < 1e-9 && pivot.residual_mm.count == 120 - pivot.outliers.len());
    }
}

#[test]
fn derivatives_match_finite_differences() {
    let poses: Vec<_> = swung(20, Errors { mm: 0.5, deg: 0.3, ..NONE }, 1)
        .iter()
        .map(|p| (p.affine().matrix3, p.affine().translation))
        .collect();
    let mut parameters = Parameters::new();
    let (tip, pivot) = (parameters.point("tip", 100.0, TIP), parameters.point("pivot", 100.0, PIVOT));
    let shaft = DMat3::from_quat(upright());
    let whitening = Whitening::sds([0.2, 0.7, 0.7]);
    let problem = Problem { poses: &poses, parameters, tip, pivot, shaft, whitening };
    let check = check_jacobian(&problem.parameters, &problem.parameters.start(), |s, b| problem.put(s, b));
    assert!(check.largest < 1e-7, "{check:?}");
}

/// Over many seeds, eᵀΣ⁻¹e of the tip averages three: with any kind of noise, and with a tenth
/// of the poses displaced.
#[test]
fn tip_covariance_matches_errors() {
    for (name, errors, rms_mm) in [
        ("0.05 mm, 0.05°", Errors { mm: 0.05, deg: 0.05, ..NONE }, 0.03),
        ("0.3 mm, 0.2°", Errors { mm: 0.3, deg: 0.2, ..NONE }, 0.14),
        ("0.3 mm", Errors { mm: 0.3, ..NONE }, 0.14),
        ("0.3 mm, 0.2°, jumps", Errors { mm: 0.3, deg: 0.2, jump_every: 10 }, 0.14),
    ] {
        let seeds = draws(450);
        let (mut sum, mut squares, mut bias) = (0.0, 0.0, DVec3::ZERO);
        for seed in 0..seeds {
            let pivot = found(&swung(200, errors, 10_000 + seed));
            let error = pivot.tip_mm - TIP;
            sum += mahalanobis(error.to_array(), &pivot.tip_covariance_mm2);
            squares += error.length_squared();
            bias += error;
        }
        let (mean, rms) = (sum / seeds as f64, (squares / seeds as f64).sqrt());
        println!(
            "{name}: eᵀΣ⁻¹e averages {mean:.3} of 3, errors {rms:.4} mm rms, {:.4} mm on average",
            bias.length() / seeds as f64
        );
        // χ² of 3 spreads by √6.
        assert!((mean - 3.0).abs() < 3.5 * (6.0 / seeds as f64).sqrt(), "{name}: {mean}");
        assert!(rms < rms_mm, "{name}: {rms}");
    }
}

/// Noise with a correlation of 0.9 from reading to reading, as filtered trackers have: the
/// covariance must account for fewer independent readings.
#[test]
fn correlated_noise_enlarges_covariance() {
    let seeds = draws(200);
    let mut sum = 0.0;
    for seed in 0..seeds {
        let mut random = Noise::new(77_000 + seed);
        let mut drift = DVec3::ZERO;
        // A slow manual swing: twelve rounds.
        let pose = |index: usize| {
            drift = 0.9 * drift + random.vector(0.2 * (1.0 - 0.81_f64).sqrt());
            let share = index as f64 / 600.0;
            let axis = DVec3::new((73.0 * share).cos(), (73.0 * share).sin(), 0.0);
            let mut pose = resting(DQuat::from_axis_angle(axis, 0.2 + 0.5 * (17.0 * share).sin()) * upright());
            pose.translation += drift;
            Pose::from_affine(pose)
        };
        let poses: Vec<_> = (0..600).map(pose).collect();
        let pivot = found(&poses);
        assert!(pivot.correlation_length > 3.0, "{}", pivot.correlation_length);
        sum += mahalanobis((pivot.tip_mm - TIP).to_array(), &pivot.tip_covariance_mm2);
    }
    let mean = sum / seeds as f64;
    println!("noise that lasts: eᵀΣ⁻¹e averages {mean:.2} of 3");
    assert!((1.0..4.5).contains(&mean), "{mean}");
}

#[test]
fn tip_frame_matches_plus() {
    let shown = |tip: DVec3| {
        let rows = tip_frame(tip).affine();
        let axes = rows.matrix3;
        assert!(
            (axes.determinant() - 1.0).abs() < 1e-12
                && (axes.transpose() * axes - DMat3::IDENTITY).abs_diff_eq(DMat3::ZERO, 1e-12)
        );
        assert!((axes.z_axis - tip.normalize()).length() < 1e-12 && (rows.translation - tip).length() < 1e-12);
        axes
    };
    // Along y: the frame's y is perpendicular to the shaft and x.
    assert!((shown(DVec3::new(0.0, 150.0, 0.0)).y_axis - DVec3::NEG_Z).length() < 1e-12);
    // Within 20° of x: perpendicular to the shaft and y.
    assert!((shown(DVec3::new(-150.0, 0.0, 0.0)).y_axis - DVec3::NEG_Z).length() < 1e-12);
    assert!((shown(DVec3::new(100.0, 0.0, 10.0)).y_axis.dot(DVec3::Y)).abs() < 1e-12);
}

#[test]
fn undetermined_tip_is_refused() {
    let noise = Errors { mm: 0.1, deg: 0.1, jump_every: 0 };
    assert_eq!(refused(&swung(9, noise, 1)), PivotError::TooFew { poses: 9, least: 10 });

    let one = vec![swung(1, NONE, 1)[0]; 200];
    assert_eq!(refused(&one), PivotError::OnePose { poses: 200 });

    // The stylus lies still, or is held still and trembles.
    let mut random = Noise::new(4);
    let mut still = |tremble_deg: f64| -> Vec<Pose> {
        (0..200)
            .map(|_| {
                let mut pose = resting(random.turn(tremble_deg.to_radians()) * upright());
                pose.translation += random.vector(0.2);
                Pose::from_affine(pose)
            })
            .collect()
    };
    for deg in [0.0, 0.1, 1.0] {
        assert!(matches!(refused(&still(deg)), PivotError::HardlyTurned { .. }), "{deg}");
    }
    assert!(calibrate(&still(5.0), &Settings::default()).is_ok());

    // Rolled in the fingers, or rocked one way, with a tracker's noise added.
    for axis in [TIP.normalize(), DVec3::Y] {
        let poses: Vec<_> = (0..200)
            .map(|i| {
                let mut pose = resting(upright() * DQuat::from_axis_angle(axis, (f64::from(i) * 0.1).sin()));
                pose.translation += random.vector(0.2);
                pose.matrix3 *= DMat3::from_quat(random.turn(0.2_f64.to_radians()));
                Pose::from_affine(pose)
            })
            .collect();
        let PivotError::OneAxis { axis: found, .. } = refused(&poses) else { panic!("{axis}") };
        assert!(found.dot(axis).abs() > 0.9999, "{found} {axis}");
    }
}

#[test]
fn jumps_slips_and_wrong_units_are_refused() {
    let noise = Errors { mm: 0.1, deg: 0.1, jump_every: 0 };
    // The tip slips into another hole for two fifths of the time.
    let mut poses = swung(200, noise, 3);
    for pose in &mut poses[120..] {
        let mut moved = pose.affine();
        moved.translation += DVec3::new(12.0, 0.0, -5.0);
        *pose = Pose::from_affine(moved);
    }
    let slipped = PivotError::Unsteady { outliers: 80, poses: 200, runs: vec![[120, 199]] };
    assert_eq!(refused(&poses), slipped);
    assert!(slipped.to_string().starts_with("80 of 200 poses contradict the others (poses 120 to 199): "));
    // If it slips for a fifth of the time, the rest determines the tip.
    let pivot = found(&[&poses[..120], &poses[170..]].concat());
    assert!((pivot.tip_mm - TIP).length() < 0.2 && pivot.outliers.len() >= 30);

    // A tip that moves over a table.
    let mut random = Noise::new(9);
    let mut led = swung(200, noise, 3);
    for pose in &mut led {
        let mut moved = pose.affine();
        moved.translation += random.vector(4.0);
        *pose = Pose::from_affine(moved);
    }
    let error = refused(&led);
    assert!(matches!(error, PivotError::Stray { rms_mm: 6.0..7.0, limit_mm: 2.0 }), "{error}");

    for (factor, message) in [
        (10.0, "or 108.9 mm if positions are 10 times too large, 42.9 mm if positions are 25.4 times too large"),
        (25.4, "108.9 mm if positions are 25.4 times too large"),
        (0.1, "108.9 mm if positions are cm and not mm"),
        (1.0 / 25.4, "42.9 mm if positions are cm and not mm, 108.9 mm if positions are inches and not mm"),
    ] {
        let scaled: Vec<_> = swung(200, noise, 5)
            .iter()
            .map(|pose| {
                let mut pose = pose.affine();
                pose.translation *= factor;
                Pose::from_affine(pose)
            })
            .collect();
        let error = refused(&scaled);
        assert!(matches!(error, PivotError::Length { .. }) && error.to_string().contains(message), "{error}");
    }

    let mut bad = swung(50, noise, 5);
    bad[17] = Pose::from_affine(DAffine3 { matrix3: bad[17].affine().matrix3 * 1.2, ..bad[17].affine() });
    assert!(matches!(refused(&bad), PivotError::NotRigid { index: 17, .. }));
    bad[17] = Pose::from_affine(DAffine3 { translation: DVec3::splat(f64::NAN), ..bad[16].affine() });
    assert!(matches!(refused(&bad), PivotError::NotRigid { index: 17, .. }));
}
