use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DMat3, DVec3};
use proptest::prelude::*;

use sonoweave_core::frames::{Image, Probe, Transform};

use super::*;
use crate::error::ArmError;

fn three_turns() -> Arm {
    Arm::new([Joint::revolute(250.0, 40_000.0), Joint::revolute(220.0, 20_000.0), Joint::revolute(60.0, 8192.0)])
        .unwrap()
}

/// Generates joints of any kind with realistic dimensions.
fn joint() -> impl Strategy<Value = Joint> {
    let parts = (any::<bool>(), -180.0..180.0_f64, 20.0..300.0_f64, -1e5..1e5_f64, 10.0..1e5_f64, any::<bool>());
    parts.prop_map(|(turns, direction, length, zero_counts, counts, with)| {
        let joint =
            if turns { Joint::revolute(length, counts) } else { Joint::prismatic(direction, length, 0.01 * counts) };
        Joint { zero_counts, sign: if with { Sign::Plus } else { Sign::Minus }, ..joint }
    })
}

/// Generates arms with joint values.
fn arm() -> impl Strategy<Value = (Arm, Values)> {
    let values = [(-3.0..3.0_f64, -150.0..250.0_f64), (-3.0..3.0, -150.0..250.0), (-3.0..3.0, -150.0..250.0)];
    ([joint(), joint(), joint()], values).prop_map(|(joints, values)| {
        let value = |i: usize| if joints[i].kind == Kind::Revolute { values[i].0 } else { values[i].1 };
        (Arm::new(joints).unwrap(), std::array::from_fn(value))
    })
}

/// Returns the distance of two poses: mm, and rad within half a turn.
fn between(a: &PlanarPose, b: &PlanarPose) -> (f64, f64) {
    let turn = planar_pose::turned_near(a.heading_rad - b.heading_rad, 0.0);
    ((a.position_mm - b.position_mm).length(), turn.abs())
}

/// Computes the chain as documented: matrices multiplied, one per step.
fn product(arm: &Arm, values: &Values) -> glam::DAffine3 {
    let mut pose = glam::DAffine3::IDENTITY;
    for (joint, value) in arm.joints().iter().zip(values) {
        let (turn, length) = match joint.kind {
            Kind::Revolute => (*value, joint.length_mm),
            Kind::Prismatic { direction_deg } => (direction_deg.to_radians(), joint.length_mm + value),
        };
        pose *= glam::DAffine3::from_rotation_z(turn) * glam::DAffine3::from_translation(DVec3::new(length, 0.0, 0.0));
    }
    pose
}

#[test]
fn pose_matches_hand_computed_values() {
    let straight = three_turns();
    let pose = straight.pose(&straight.values(&[0, 0, 0]));
    assert_eq!((pose.position_mm, pose.heading_rad), (DVec2::new(530.0, 0.0), 0.0));
    // A quarter turn each: up, back, down.
    let bent = straight.pose(&straight.values(&[10_000, 5000, 2048]));
    assert!((bent.position_mm - DVec2::new(-220.0, 190.0)).length() < 1e-12, "{bent:?}");
    assert!((bent.heading_rad - 1.5 * PI).abs() < 1e-15);
    // Zeros and signs.
    let mut joints = *straight.joints();
    (joints[0].zero_counts, joints[0].sign) = (10_000.0, Sign::Minus);
    let other = Arm::new(joints).unwrap();
    assert_eq!(other.values(&[0, 0, 0])[0], FRAC_PI_2);
    // A table that slides along x and y and turns on top, with the slides' own lengths.
    let stage = [Joint::prismatic(0.0, 5.0, 100.0), Joint::prismatic(90.0, 7.0, 100.0), Joint::revolute(10.0, 360.0)];
    let stage = Arm::new(stage).unwrap();
    let pose = stage.pose(&stage.values(&[1500, 2000, -90]));
    assert!((pose.position_mm - DVec2::new(20.0 + 10.0, 27.0)).length() < 1e-12 && pose.heading_rad.abs() < 1e-12);
    // If u lies along z, the image's third column lies in the plane, whatever the joints do.
    let probe_from_image = Transform::<Probe, Image>::from_affine(glam::DAffine3::from_mat3(DMat3::from_cols(
        DVec3::Z * 0.2,
        DVec3::X * 0.2,
        DVec3::Y,
    )));
    let tracker_from_image = straight.tracker_from_probe(&[123, 4567, -891]) * probe_from_image;
    assert_eq!(tracker_from_image.vector(DVec3::X), DVec3::Z * 0.2);
    assert_eq!([DVec3::Y, DVec3::Z].map(|axis| tracker_from_image.vector(axis).z), [0.0; 2]);
}

#[test]
fn zeroed_arm_counts_from_home() {
    let home = [0.3, -1.1, 0.2];
    let arm = three_turns().zeroed_at(&home);
    let there = arm.pose(&home);
    assert!(between(&there, &arm.pose(&arm.values(&[0, 0, 0]))).0 < 1e-12);
    assert_eq!(arm.counts(&home).map(|count| count.abs() < 1e-9), [true; 3]);
}

#[test]
fn bad_numbers_are_refused_by_joint() {
    let good = *three_turns().joints();
    let refusal = |change: fn(&mut Joint)| {
        let mut joints = good;
        change(&mut joints[1]);
        Arm::new(joints)
    };
    let not_finite = |what| Err(ArmError::NotFinite { joint: 2, what }.into());
    assert_eq!(refusal(|joint| joint.length_mm = f64::NAN), not_finite("length"));
    assert_eq!(refusal(|joint| joint.zero_counts = f64::INFINITY), not_finite("zero"));
    assert_eq!(refusal(|joint| joint.counts_per_unit = -5.0), Err(ArmError::Counts { joint: 2, counts: -5.0 }.into()));
    assert_eq!(refusal(|joint| joint.length_mm = -1.0), Err(ArmError::Length { joint: 2, mm: -1.0 }.into()));
    let slide = refusal(|joint| joint.kind = Kind::Prismatic { direction_deg: f64::NAN });
    assert_eq!(slide, not_finite("direction"));
    assert!(Arm::new([Joint::prismatic(0.0, -4.0, 100.0); 3]).is_ok(), "a slide may rest behind its joint");
}

#[test]
fn unreachable_pose_reports_distance() {
    let arm = three_turns();
    let at = |x: f64, y: f64| PlanarPose { position_mm: DVec2::new(x, y), heading_rad: 0.0 };
    let refusal = |arm: &Arm, x: f64, y: f64| match arm.inverse(&at(x, y), Elbow::Up) {
        Err(CalibrationError::Arm(error)) => error,
        other => panic!("{other:?}"),
    };
    assert_eq!(refusal(&arm, 537.0, 0.0), ArmError::TooFar { by_mm: 7.0 });
    let ArmError::TooNear { by_mm } = refusal(&arm, 60.0, 12.0) else { panic!() };
    assert!((by_mm - 18.0).abs() < 1e-12);
    assert!(refusal(&arm, 537.0, 0.0).to_string().contains("by 7.000 mm"));
    // At full stretch there is one solution.
    let both = [Elbow::Up, Elbow::Down].map(|elbow| arm.inverse(&at(530.0, 0.0), elbow).unwrap());
    assert_eq!(both[0], both[1]);
    let even =
        Arm::new([Joint::revolute(200.0, 1e4), Joint::revolute(200.0, 1e4), Joint::revolute(50.0, 1e4)]).unwrap();
    assert_eq!(refusal(&even, 50.0, 0.0), ArmError::AnyAngle { joint: 1 });
    let slide = |degrees: f64| Joint::prismatic(degrees, 0.0, 100.0);
    let turn = Joint::revolute(50.0, 1e4);
    let stage = |a, b, c| Arm::new([a, b, c]).unwrap();
    let ArmError::Parallel { joints: [1, 2], degrees } = refusal(&stage(slide(30.0), slide(0.002), turn), 9.0, 9.0)
    else {
        panic!()
    };
    assert!((degrees - 0.002).abs() < 1e-9);
    assert!(matches!(
        refusal(&stage(slide(0.0), turn, slide(0.0)), 9.0, 9.0),
        ArmError::Parallel { joints: [1, 3], .. }
    ));
    assert!(matches!(
        refusal(&stage(turn, slide(5.0), slide(0.0)), 9.0, 9.0),
        ArmError::Parallel { joints: [2, 3], .. }
    ));
    assert_eq!(refusal(&stage(slide(0.0), turn, turn), 9.0, 60.0), ArmError::TooFar { by_mm: 10.0 });
    assert_eq!(refusal(&stage(turn, slide(90.0), turn), 80.0, 0.0), ArmError::TooNear { by_mm: 20.0 });
    let ArmError::TooFar { by_mm } = refusal(&stage(turn, turn, slide(0.0)), 9.0, 60.0) else { panic!() };
    assert!((by_mm - 10.0).abs() < 1e-12);
    let ArmError::Untwisted { degrees } = refusal(&stage(slide(10.0), slide(20.0), slide(30.0)), 0.0, 0.0) else {
        panic!()
    };
    assert!((degrees + 60.0).abs() < 1e-9);
}

#[test]
fn pose_out_of_plane_is_refused() {
    let pose = PlanarPose { position_mm: DVec2::new(30.0, -40.0), heading_rad: 2.5 };
    let there = pose.tracker_from_probe();
    assert!(between(&PlanarPose::nearest(&there, 0.0, 1e-9).unwrap(), &pose) < (1e-12, 1e-12));
    let tilted = |degrees: f64, mm: f64| {
        let off = glam::DAffine3::from_translation(DVec3::Z * mm)
            * there.affine()
            * glam::DAffine3::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), degrees.to_radians());
        PlanarPose::nearest(&Transform::from_affine(off), 0.1, 0.2)
    };
    assert!(between(&tilted(0.1, 0.05).unwrap(), &pose).1 < 1e-5);
    for (degrees, mm) in [(0.3, 0.0), (0.0, -0.2), (180.0, 0.0), (f64::NAN, 0.0), (0.0, f64::NAN)] {
        assert!(tilted(degrees, mm).is_err(), "{degrees} {mm}");
    }
    let Err(CalibrationError::Arm(ArmError::NotPlanar { mm, degrees, .. })) = tilted(0.3, 0.2) else { panic!() };
    assert!((degrees - 0.3).abs() < 1e-9 && (mm - 0.2).abs() < 1e-12, "{mm} {degrees}");
}

#[test]
fn condition_separates_stretched_from_bent() {
    let arm = three_turns();
    let [bent, nearly, stretched] = [1.6, 0.01, 0.0].map(|second| arm.condition(&[0.4, second, -0.3], 100.0));
    assert!((1.0..20.0).contains(&bent) && nearly > 50.0 * bent && stretched == f64::INFINITY, "{bent} {nearly}");
    // Three counts that move the pose by equal amounts in orthogonal directions: the optimum.
    let even = [
        Joint::prismatic(0.0, 0.0, 100.0),
        Joint::prismatic(90.0, 0.0, 100.0),
        Joint::revolute(0.0, 100.0 * std::f64::consts::TAU * 80.0),
    ];
    let condition = Arm::new(even).unwrap().condition(&[3.0, 4.0, 0.5], 80.0);
    assert!((condition - 1.0).abs() < 1e-12, "{condition}");
}

#[test]
fn rounding_error_matches_displacement() {
    let arm = three_turns();
    let mut random = 1_u64;
    let mut draw = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 11) as f64 / (1_u64 << 53) as f64
    };
    let point = DVec2::new(-80.0, 15.0);
    let (mut bounds, mut found, mut largest) = (0.0, 0.0, 0.0_f64);
    for _ in 0..20_000 {
        let values = [draw(), 0.5 + draw(), draw() - 0.5];
        let rounded = arm.values(&arm.counts(&values).map(|count| count.round() as i64));
        let off = (arm.pose(&values).point(point) - arm.pose(&rounded).point(point)).length();
        let bound = arm.displacement(&rounded, point, 0.5);
        largest = largest.max(off / bound.most_mm);
        (bounds, found) = (bounds + bound.rms_mm.powi(2), found + off * off);
    }
    // 20000 squares: half a per cent.
    let ratio = (found / bounds).sqrt();
    assert!((ratio - 1.0).abs() < 0.015 && largest <= 1.0 && largest > 0.9, "{ratio} {largest}");
}

#[test]
fn covariance_is_propagated_joint_covariance() {
    let (arm, values) = (three_turns(), [0.3, 1.0, -0.4]);
    let covariance = arm.covariance(&values, &[0.5, 1.0, 2.0]);
    let jacobian = arm.jacobian(&values);
    let variances: [f64; 3] = std::array::from_fn(|i| (arm.joints()[i].value_per_count() * [0.5, 1.0, 2.0][i]).powi(2));
    let plain = jacobian * DMat3::from_diagonal(DVec3::from_array(variances)) * jacobian.transpose();
    let off = (covariance - plain).to_cols_array().iter().map(|x| x.abs()).fold(0.0, f64::max);
    assert!(off < 1e-15 && covariance.determinant() > 0.0, "{off}");
}

/// A change of a joint's parameter, and its step size for differences.
type Change = (fn(&mut Joint, f64), f64);

proptest! {
    #[test]
    fn pose_is_product_of_steps((arm, values) in arm()) {
        let (found, plain) = (arm.pose(&values).tracker_from_probe().affine(), product(&arm, &values));
        prop_assert!((found.translation - plain.translation).length() < 1e-10);
        prop_assert!((found.matrix3 - plain.matrix3).to_cols_array().iter().all(|x| x.abs() < 1e-13));
    }

    #[test]
    fn inverse_leads_back_to_pose((arm, values) in arm()) {
        let pose = arm.pose(&values);
        for elbow in [Elbow::Up, Elbow::Down] {
            match arm.inverse(&pose, elbow) {
                Ok(back) => {
                    let (mm, rad) = between(&arm.pose(&back), &pose);
                    prop_assert!(mm < 1e-9 && rad < 1e-12, "{} mm, {} rad", mm, rad);
                }
                Err(CalibrationError::Arm(ArmError::Untwisted { degrees })) => prop_assert!(degrees.abs() < 1e-9),
                // A pose of the arm's own is refused at singular places only.
                Err(why) => prop_assert!(
                    matches!(why, CalibrationError::Arm(ArmError::Parallel { .. } | ArmError::AnyAngle { .. }))
                        && arm.condition(&values, 100.0) > 1e3,
                    "{}", why
                ),
            }
        }
    }

    #[test]
    fn inverse_near_returns_same_values((arm, values) in arm(), turns in -3..4_i32) {
        let values: Values = std::array::from_fn(|i| match arm.joints()[i].kind {
            Kind::Revolute => values[i] + f64::from(turns) * TAU,
            Kind::Prismatic { .. } => values[i],
        });
        // Both solutions coincide near a singularity.
        prop_assume!(arm.condition(&values, 100.0) < 1e4);
        let near = arm.values(&arm.counts(&values).map(|count| count.round() as i64));
        let back = arm.inverse_near(&arm.pose(&values), &near).unwrap();
        for (i, (a, b)) in back.iter().zip(values).enumerate() {
            prop_assert!((a - b).abs() < 1e-6, "joint {}: {} {}", i + 1, a, b);
        }
    }

    #[test]
    fn distant_pose_is_too_far_or_reached((arm, values) in arm(), off in 1e-6..500.0_f64) {
        let pose = arm.pose(&values);
        // Moves away from the base along the last link's line, by more than any length of the
        // arm.
        let far = PlanarPose { position_mm: pose.position_mm + (2000.0 + off) * DVec2::from_angle(pose.heading_rad + 1.0), ..pose };
        match arm.inverse(&far, Elbow::Up) {
            Ok(back) => prop_assert!(between(&arm.pose(&back), &far).0 < 1e-7),
            Err(CalibrationError::Arm(ArmError::TooFar { by_mm })) => prop_assert!(by_mm > 0.0 && by_mm < 5000.0),
            Err(why) => prop_assert!(!matches!(why, CalibrationError::Arm(ArmError::TooNear { .. })), "{}", why),
        }
    }

    #[test]
    fn derivatives_match_differences((arm, values) in arm()) {
        let derivatives = arm.derivatives(&values);
        let counts = arm.counts(&values);
        let pose = |arm: &Arm, values: &Values| {
            let PlanarPose { position_mm: p, heading_rad } = arm.pose(values);
            DVec3::new(p.x, p.y, heading_rad)
        };
        let close = |given: DVec3, plus: DVec3, minus: DVec3, step: f64| {
            let found = (plus - minus) / (2.0 * step);
            (given - found).length() <= 1e-6 * (1.0 + given.length())
        };
        for (i, by) in derivatives.iter().enumerate() {
            let step = if arm.joints()[i].kind == Kind::Revolute { 1e-5 } else { 1e-2 };
            let moved = |off: f64| {
                let mut values = values;
                values[i] += off;
                pose(&arm, &values)
            };
            prop_assert!(close(by.value, moved(step), moved(-step), step), "value {}: {}", i, by.value);
            let per_count = by.count - by.value * arm.joints()[i].value_per_count();
            prop_assert!(per_count.length() == 0.0);
            let changes: [(Change, DVec3); 4] = [
                ((|joint, off| joint.length_mm += off, 1e-2), by.length),
                ((|joint, off| joint.zero_counts += off, 1e-3 * arm.joints()[i].counts_per_unit.min(10.0)), by.zero_counts),
                ((|joint, off| joint.counts_per_unit += off, 1e-6 * arm.joints()[i].counts_per_unit), by.counts_per_unit),
                ((|joint, off| if let Kind::Prismatic { direction_deg } = &mut joint.kind { *direction_deg += off }, 1e-5), by.direction),
            ];
            for (n, ((change, step), given)) in changes.into_iter().enumerate() {
                // The counts stay fixed; the values they stand for change.
                let changed = |off: f64| {
                    let mut joints = *arm.joints();
                    change(&mut joints[i], off);
                    let arm = Arm::new(joints).unwrap();
                    pose(&arm, &std::array::from_fn(|i| arm.joints()[i].value(counts[i])))
                };
                let (plus, minus) = (changed(step), changed(-step));
                let found = (plus - minus) / (2.0 * step);
                // Rounding of numbers near 1000 mm, after a difference with so small a step.
                let rounding = 1e-12 / step;
                prop_assert!(
                    (given - found).length() <= 1e-5 * (1e-3 + given.length()) + rounding,
                    "parameter {} of joint {}: {} {}", n, i, given, found
                );
            }
        }
    }

    #[test]
    fn displacement_bounds_any_count_error(
        (arm, values) in arm(), off in [-1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64], point in [-200.0..200.0_f64, -200.0..200.0_f64], counts in 0.1..50.0_f64,
    ) {
        let point = DVec2::from_array(point);
        let moved: Values =
            std::array::from_fn(|i| values[i] + off[i] * counts * arm.joints()[i].value_per_count());
        let displaced = (arm.pose(&values).point(point) - arm.pose(&moved).point(point)).length();
        let bound = arm.displacement(&values, point, counts);
        prop_assert!(displaced <= bound.most_mm * (1.0 + 1e-12) + 1e-10, "{} {:?}", displaced, bound);
        prop_assert!(bound.rms_mm <= bound.most_mm);
    }
}
