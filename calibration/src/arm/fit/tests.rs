//! Touches of a plate by an arm that is known.

use std::f64::consts::TAU;

use glam::DVec2;

use super::*;
use crate::arm::PlanarPose;
use crate::arm::Sign;
use crate::arm::check::check;
use crate::arm::inverse::Elbow;
use crate::least_squares::check_jacobian;
use crate::noise::Noise as Random;

const TURN: f64 = 40_000.0;

fn truth() -> Arm {
    let mut joints = [Joint::revolute(252.3, TURN), Joint::revolute(198.7, TURN), Joint::revolute(81.4, TURN)];
    joints[1].sign = Sign::Minus;
    for (joint, zero) in joints.iter_mut().zip([0.0, 311.25, -87.5]) {
        joint.zero_counts = zero;
    }
    Arm::new(joints).unwrap()
}

/// As a rule and a look at the arm say.
fn guess() -> Arm {
    let mut joints = *truth().joints();
    for (joint, (length, zero)) in joints.iter_mut().zip([(250.0, 0.0), (200.0, 0.0), (80.0, 0.0)]) {
        (joint.length_mm, joint.zero_counts) = (length, zero);
    }
    Arm::new(joints).unwrap()
}

/// Three by two divots, 60 mm apart.
fn plate() -> Vec<DVec2> {
    (0..6).map(|n| DVec2::new(60.0 * f64::from(n % 3), 60.0 * f64::from(n / 3))).collect()
}

/// Each divot from several sides, elbow left and right; seated with a spread in mm.
fn touches(arm: &Arm, seat_mm: f64, seed: u64, sides: usize) -> Vec<Touch> {
    let mut random = Random::new(seed);
    let mut touches = Vec::new();
    for (divot, at) in plate().iter().enumerate() {
        let place = DVec2::from_angle(0.4).rotate(*at) + DVec2::new(180.0, 60.0);
        for side in 0..sides {
            for elbow in [Elbow::Up, Elbow::Down] {
                let seated = place + DVec2::new(random.normal(), random.normal()) * seat_mm;
                let heading = 0.9 * (side as f64 / sides as f64) * TAU;
                let pose = PlanarPose { position_mm: seated, heading_rad: heading };
                if let Ok(values) = arm.inverse(&pose, elbow) {
                    touches.push(Touch { counts: arm.counts(&values), divot });
                }
            }
        }
    }
    touches
}

#[test]
fn derivatives_are_those_that_differences_find() {
    let arm =
        Arm::new([Joint::revolute(250.0, TURN), Joint::prismatic(80.0, 40.0, 100.0), Joint::revolute(90.0, 9000.0)])
            .unwrap();
    let options = Options { counts_per_unit: true, tip_mm: DVec2::new(12.0, -7.0), ..Options::default() };
    let some: Vec<Touch> = (0..8)
        .map(|n| Touch {
            counts: [900.0 * f64::from(n), 1500.0 - 340.0 * f64::from(n), 700.0 * f64::from(n % 3)],
            divot: n as usize % 6,
        })
        .collect();
    let plate = plate();
    let model = Model::new(&arm, &plate, &some, &options);
    let found =
        check_jacobian(&model.parameters, &model.parameters.start(), |state, blocks| model.put(state, &some, blocks));
    assert!(found.largest < 1e-7, "{found:?}");
}

#[test]
fn without_noise_the_arm_is_found_to_a_millionth() {
    let all = touches(&truth(), 0.0, 1, 5);
    let fitted = fit(&guess(), &plate(), &all, &Options::default()).unwrap();
    for (found, joint) in fitted.found.iter().zip([1, 2, 2, 3, 3]) {
        assert_eq!(found.joint, joint, "{found:?}");
    }
    for (one, other) in fitted.arm.joints().iter().zip(truth().joints()) {
        assert!((one.length_mm - other.length_mm).abs() < 1e-6, "{one} {other}");
        assert!(((one.zero_counts - other.zero_counts) * TAU / TURN).abs() < 1e-8, "{one} {other}");
    }
    assert!(fitted.rms_mm < 1e-6 && fitted.outliers.is_empty());
}

#[test]
fn what_is_said_of_the_error_is_so_over_many_arms() {
    let mut sum = 0.0;
    for seed in 0..400 {
        let all = touches(&truth(), 0.1, seed, 4);
        let fitted = fit(&guess(), &plate(), &all, &Options::default()).unwrap();
        for found in &fitted.found {
            let mut joint = truth().joints()[found.joint - 1];
            let value = *found.what.of(&mut joint).unwrap();
            sum += ((found.value - value) / found.sd).powi(2) / fitted.found.len() as f64;
        }
        assert!((fitted.spread - 1.0).abs() < 0.5, "{}", fitted.spread);
    }
    let mean = sum / 400.0;
    assert!((mean - 1.0).abs() < 0.15, "{mean}");
}

#[test]
fn a_tip_that_slipped_out_is_left_out_and_named() {
    let mut all = touches(&truth(), 0.05, 9, 4);
    all[7].counts[1] += 400.0;
    let fitted = fit(&guess(), &plate(), &all, &Options::default()).unwrap();
    assert_eq!(fitted.outliers, [7]);
    assert!((fitted.arm.joints()[1].length_mm - 198.7).abs() < 0.1);
}

#[test]
fn what_touches_do_not_tell_is_refused_by_name() {
    let said = |touches: &[Touch], plate: &[DVec2], options: &Options| {
        fit(&guess(), plate, touches, options).unwrap_err().to_string()
    };
    let all = touches(&truth(), 0.05, 2, 4);
    let of_one: Vec<Touch> = all.iter().filter(|touch| touch.divot == 0).copied().collect();
    assert!(said(&of_one, &plate(), &Options::default()).contains("touch at least two"));
    assert!(said(&[all[0], all[all.len() - 1]], &plate(), &Options::default()).contains("too few"));
    let missing = [all[0], Touch { divot: 6, ..all[1] }];
    assert!(said(&missing, &plate(), &Options::default()).contains("touch 2 is of divot 7, and the plate has 6"));
    // Once from one side each, with the same heading: lengths and zeros are one to them.
    let once: Vec<Touch> = all.iter().step_by(8).copied().collect();
    let refused = said(&once, &plate(), &Options::default());
    assert!(refused.contains("do not tell") || refused.contains("too few"), "{refused}");
    let zero = Options { zeros: [true; 3], ..Options::default() };
    assert!(said(&all, &plate(), &zero).contains("zero of joint 1"), "{}", said(&all, &plate(), &zero));
}

#[test]
fn a_plate_in_other_units_is_told_by_its_factor() {
    let all = touches(&truth(), 0.05, 2, 4);
    for (factor, unit) in [(0.1, "cm"), (1.0 / 25.4, "inches")] {
        let other: Vec<DVec2> = plate().iter().map(|at| *at * factor).collect();
        let said = fit(&guess(), &other, &all, &Options::default()).unwrap_err().to_string();
        assert!(said.contains(&format!("in {unit}")), "{said}");
    }
}

#[test]
fn a_running_arm_is_told_from_one_whose_encoder_has_slipped() {
    let well = touches(&truth(), 0.1, 11, 3);
    let checked = check(&truth(), &plate(), &well, &Options::default(), 0.14).unwrap();
    assert!(!checked.changed && checked.advice().is_empty(), "{checked:?}");
    for joint in [1, 2] {
        let slipped: Vec<Touch> = well
            .iter()
            .map(|touch| {
                let mut counts = touch.counts;
                counts[joint] += 250.0;
                Touch { counts, ..*touch }
            })
            .collect();
        let checked = check(&truth(), &plate(), &slipped, &Options::default(), 0.14).unwrap();
        let advice = checked.advice();
        assert!(
            checked.changed && advice.starts_with(&format!("the zero of joint {} has moved by 2", joint + 1)),
            "{advice}"
        );
    }
    let mut bent = *truth().joints();
    bent[0].length_mm += 4.0;
    bent[1].length_mm -= 3.0;
    let checked = check(&Arm::new(bent).unwrap(), &plate(), &well, &Options::default(), 0.14).unwrap();
    assert!(checked.changed && checked.advice().contains("bent or loose"), "{checked:?}");
}
