//! Fits to simulated touches of a plate by a known arm.

use std::f64::consts::TAU;

use glam::DVec2;

use super::*;
use crate::arm::check::check;
use crate::arm::inverse::Elbow;
use crate::arm::reach::Reach;
use crate::arm::{Joint, Kind, PlanarPose, Sign};
use crate::error::ArmError;
use crate::least_squares::tests::jacobian::check_jacobian;
use crate::tests::draws::draws;
use crate::tests::noise::Noise as Random;

const TURN: f64 = 40_000.0;

fn truth() -> Arm {
    let mut joints = [Joint::revolute(252.3, TURN), Joint::revolute(198.7, TURN), Joint::revolute(81.4, TURN)];
    joints[1].sign = Sign::Minus;
    for (joint, zero) in joints.iter_mut().zip([0.0, 311.25, -87.5]) {
        joint.zero_counts = zero;
    }
    Arm::new(joints).unwrap()
}

/// Returns the start values: lengths by a rule, zeros by eye.
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

/// Touches each divot from several sides, elbow left and right, with a error in the divot of
/// `tip_sd_mm`.
fn touches(arm: &Arm, tip_sd_mm: f64, seed: u64, sides: usize) -> Vec<Touch> {
    let mut random = Random::new(seed);
    let mut touches = Vec::new();
    for (divot, at) in plate().iter().enumerate() {
        let place = DVec2::from_angle(0.4).rotate(*at) + DVec2::new(180.0, 60.0);
        for side in 0..sides {
            for elbow in [Elbow::Up, Elbow::Down] {
                let placed = place + DVec2::new(random.normal(), random.normal()) * tip_sd_mm;
                let heading = 0.9 * (side as f64 / sides as f64) * TAU;
                let pose = PlanarPose { position_mm: placed, heading_rad: heading };
                if let Ok(values) = arm.inverse(&pose, elbow) {
                    touches.push(Touch { counts: arm.counts(&values), of: divot });
                }
            }
        }
    }
    touches
}

#[test]
fn derivatives_match_finite_differences() {
    let arm =
        Arm::new([Joint::revolute(250.0, TURN), Joint::prismatic(80.0, 40.0, 100.0), Joint::revolute(90.0, 9000.0)])
            .unwrap();
    let options = Options {
        counts_per_unit: true,
        tip_mm: DVec2::new(12.0, -7.0),
        directions: [false, true, false],
        ..Options::default()
    };
    let some: Vec<Touch> = (0..8)
        .map(|n| Touch {
            counts: [900.0 * f64::from(n), 1500.0 - 340.0 * f64::from(n), 700.0 * f64::from(n % 3)],
            of: n as usize % 6,
        })
        .collect();
    let plate = plate();
    let pairs: Vec<Touch> = some.iter().enumerate().map(|(n, touch)| Touch { of: n / 2, ..*touch }).collect();
    for (known, touches) in [
        (Known::Divots(&plate), &some),
        (Known::Divots(&plate[..1]), &some.iter().map(|touch| Touch { of: 0, ..*touch }).collect()),
        (Known::Distances(&[80.0, 90.0, 100.0, 110.0]), &pairs),
    ] {
        let model = Model::new(&arm, &known, touches, &options);
        let found =
            check_jacobian(&model.parameters, &model.parameters.start(), |state, blocks| model.put(state, blocks));
        assert!(found.largest < 1e-7, "{known:?} {found:?}");
    }
}

#[test]
fn fit_without_noise_is_exact() {
    let all = touches(&truth(), 0.0, 1, 5);
    let fitted = fit(&guess(), &Known::Divots(&plate()), &all, &Options::default()).unwrap();
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
fn fit_standard_deviations_match_errors_over_many_draws() {
    let mut sum = 0.0;
    let seeds = draws(400);
    for seed in 0..seeds {
        let all = touches(&truth(), 0.1, seed, 4);
        let fitted = fit(&guess(), &Known::Divots(&plate()), &all, &Options::default()).unwrap();
        for found in &fitted.found {
            let mut joint = truth().joints()[found.joint - 1];
            let value = *found.what.of(&mut joint).unwrap();
            sum += ((found.value - value) / found.sd).powi(2) / fitted.found.len() as f64;
        }
        assert!((fitted.spread - 1.0).abs() < 0.5, "{}", fitted.spread);
    }
    let mean = sum / seeds as f64;
    assert!((mean - 1.0).abs() < 3.0 / (seeds as f64).sqrt(), "{mean}");
}

#[test]
fn slipped_tip_is_reported_as_outlier() {
    let mut all = touches(&truth(), 0.05, 9, 4);
    all[7].counts[1] += 400.0;
    let fitted = fit(&guess(), &Known::Divots(&plate()), &all, &Options::default()).unwrap();
    assert_eq!(fitted.outliers, [7]);
    assert!((fitted.arm.joints()[1].length_mm - 198.7).abs() < 0.1);
}

fn refusal(fitted: Result<Fitted, CalibrationError>) -> ArmError {
    match fitted {
        Err(CalibrationError::Arm(error)) => error,
        other => panic!("{other:?}"),
    }
}

#[test]
fn undetermined_parameters_are_refused_by_name() {
    let refused = |touches: &[Touch], plate: &[DVec2], options: &Options| {
        refusal(fit(&guess(), &Known::Divots(plate), touches, options))
    };
    let all = touches(&truth(), 0.05, 2, 4);
    let of_one: Vec<Touch> = all.iter().filter(|touch| touch.of == 0).copied().collect();
    assert_eq!(refused(&of_one, &plate(), &Options::default()), ArmError::OneDivot);
    let few = refused(&[all[0], all[all.len() - 1]], &plate(), &Options::default());
    assert!(matches!(few, ArmError::Few { touches: 2, .. }), "{few}");
    let missing = [all[0], Touch { of: 6, ..all[1] }];
    let unknown = ArmError::Unknown { touch: 2, what: "divot", of: 7, count: 6 };
    assert_eq!(refused(&missing, &plate(), &Options::default()), unknown);
    // One touch per divot with the same heading: lengths and zeros cannot be separated.
    let once: Vec<Touch> = all.iter().step_by(8).copied().collect();
    let open = refused(&once, &plate(), &Options::default());
    assert!(matches!(open, ArmError::Undetermined { .. } | ArmError::Few { .. }), "{open}");
    let zero = Options { zeros: [true; 3], ..Options::default() };
    let open = refused(&all, &plate(), &zero);
    assert!(matches!(&open, ArmError::Undetermined { what, .. } if what.contains("zero of joint 1")), "{open}");
}

#[test]
fn plate_in_other_units_is_refused_with_factor() {
    let all = touches(&truth(), 0.05, 2, 4);
    for (factor, unit) in [(0.1, "cm"), (1.0 / 25.4, "inches")] {
        let other: Vec<DVec2> = plate().iter().map(|at| *at * factor).collect();
        let error = refusal(fit(&guess(), &Known::Divots(&other), &all, &Options::default()));
        assert!(matches!(error, ArmError::Units { unit: found, .. } if found == unit), "{error}");
    }
}

#[test]
fn check_names_slipped_encoder_and_bent_link() {
    let well = touches(&truth(), 0.1, 11, 3);
    let checked = check(&truth(), &Known::Divots(&plate()), &well, &Options::default(), 0.14).unwrap();
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
        let checked = check(&truth(), &Known::Divots(&plate()), &slipped, &Options::default(), 0.14).unwrap();
        let advice = checked.advice();
        assert!(
            checked.changed && advice.starts_with(&format!("the zero of joint {} has moved by 2", joint + 1)),
            "{advice}"
        );
    }
    let mut bent = *truth().joints();
    bent[0].length_mm += 4.0;
    bent[1].length_mm -= 3.0;
    let checked = check(&Arm::new(bent).unwrap(), &Known::Divots(&plate()), &well, &Options::default(), 0.14).unwrap();
    assert!(checked.changed && checked.advice().contains("bent or loose"), "{checked:?}");
}

/// Simulates touches of each place from these headings, with alternating elbow.
fn touched(arm: &Arm, places: &[DVec2], headings: &[f64], tip_sd_mm: f64, seed: u64) -> Vec<[f64; JOINTS]> {
    let mut random = Random::new(seed);
    let mut all = Vec::new();
    for at in places {
        for (side, heading_rad) in headings.iter().enumerate() {
            let placed = *at + DVec2::new(random.normal(), random.normal()) * tip_sd_mm;
            let elbow = if side % 2 == 0 { Elbow::Up } else { Elbow::Down };
            let pose = PlanarPose { position_mm: placed, heading_rad: *heading_rad };
            all.extend(arm.inverse(&pose, elbow).ok().map(|values| arm.counts(&values)));
        }
    }
    all
}

fn of_point(arm: &Arm, tip_sd_mm: f64, seed: u64) -> Vec<Touch> {
    let headings: Vec<f64> = (0..16).map(|side| f64::from(side) * 0.35).collect();
    let counts = touched(arm, &[DVec2::new(230.0, 90.0)], &headings, tip_sd_mm, seed);
    counts.into_iter().map(|counts| Touch { counts, of: 0 }).collect()
}

/// Touches of a bar of 150 mm, laid near and far and turned.
fn of_bar(arm: &Arm, tip_sd_mm: f64, seed: u64) -> Vec<Touch> {
    let mut all = Vec::new();
    for laid in 0..24_u32 {
        let n = f64::from(laid);
        let middle = DVec2::from_angle(0.3 * n) * (180.0 + 60.0 * (1.7 * n).sin());
        let half = DVec2::from_angle(1.1 * n) * 75.0;
        for (end, at) in [middle - half, middle + half].into_iter().enumerate() {
            let heading = at.to_angle() + 2.0 * (2.3 * n + end as f64).sin();
            let counts =
                touched(arm, &[at], &[heading, heading], tip_sd_mm, seed * 1000 + u64::from(laid) * 2 + end as u64);
            // The elbow bends to one side and, with the bar laid again, to the other.
            all.extend(counts.get(laid as usize % 2).map(|counts| Touch { counts: *counts, of: laid as usize }));
        }
    }
    let is_whole = |of: usize| all.iter().filter(|touch| touch.of == of).count() == 2;
    let kept: Vec<usize> = (0..24).filter(|of| is_whole(*of)).collect();
    let place = |of: usize| kept.iter().position(|kept| *kept == of);
    all.iter().filter_map(|touch| Some(Touch { of: place(touch.of)?, ..*touch })).collect()
}

/// Returns the mean squared error over the reported variance, over many draws.
fn mean_ratio(known: &Known<'_>, touches: impl Fn(u64) -> Vec<Touch>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for seed in 0..200 {
        let mut start = guess();
        let options = Options::of(&start, known);
        // Lengths that are not fitted are known.
        for joint in (0..JOINTS).filter(|joint| !options.lengths[*joint]) {
            start.joints[joint].length_mm = truth().joints()[joint].length_mm;
        }
        let fitted = fit(&start, known, &touches(seed), &options).unwrap();
        for found in &fitted.found {
            let mut joint = truth().joints()[found.joint - 1];
            sum += ((found.value - *found.what.of(&mut joint).unwrap()) / found.sd).powi(2);
            count += 1.0;
        }
    }
    sum / count
}

#[test]
fn one_point_determines_zeros_and_two_lengths() {
    let known = Known::Divots(&[DVec2::ZERO]);
    let mean = mean_ratio(&known, |seed| of_point(&truth(), 0.1, seed));
    assert!((mean - 1.0).abs() < 0.3, "{mean}");
    let options = Options { lengths: [true; JOINTS], ..Options::of(&guess(), &known) };
    assert_eq!(fit(&guess(), &known, &of_point(&truth(), 0.1, 3), &options).unwrap_err(), ArmError::OneDivot.into());
}

#[test]
fn known_distances_determine_zeros_and_lengths() {
    let mut known = 0;
    let mean = {
        let pairs = of_bar(&truth(), 0.0, 1);
        known += pairs.len() / 2;
        let distances = vec![150.0; known];
        let exact = fit(&guess(), &Known::Distances(&distances), &pairs, &Options::default()).unwrap();
        assert!(exact.rms_mm < 1e-6, "{}", exact.rms_mm);
        mean_ratio(&Known::Distances(&distances), |seed| of_bar(&truth(), 0.1, seed))
    };
    assert!(known >= 16 && (mean - 1.0).abs() < 0.3, "{known} {mean}");
    let inches = vec![150.0 / 25.4; known];
    let error = refusal(fit(&guess(), &Known::Distances(&inches), &of_bar(&truth(), 0.1, 2), &Options::default()));
    assert!(matches!(error, ArmError::Units { unit: "inches", .. }), "{error}");
    let one = &of_bar(&truth(), 0.1, 2)[1..];
    let error = refusal(fit(&guess(), &Known::Distances(&inches), one, &Options::default()));
    assert_eq!(error, ArmError::Ends { distance: 1, touches: 1 });
    let checked =
        check(&truth(), &Known::Distances(&vec![150.0; known]), &of_bar(&truth(), 0.1, 2), &Options::default(), 0.14);
    assert!(!checked.unwrap().changed);
}

#[test]
fn few_distances_use_known_noise() {
    // Fitting 5 numbers to 12 distances leaves less than their noise; the largest residuals are
    // no outliers.
    let distances = [150.0; 12];
    let pairs = |seed| of_bar(&truth(), 0.1, seed).into_iter().filter(|touch| touch.of < 12).collect::<Vec<_>>();
    let mean = mean_ratio(&Known::Distances(&distances), pairs);
    // Student's t distribution with 7 degrees of freedom has variance 7/5.
    assert!((mean / 1.4 - 1.0).abs() < 0.3, "{mean}");
}

#[test]
fn arm_lengths_in_other_units_are_refused() {
    let all = touches(&truth(), 0.05, 2, 4);
    for (factor, unit) in [(0.1, "cm"), (1.0 / 25.4, "inches")] {
        let mut start = guess();
        start.joints.iter_mut().for_each(|joint| joint.length_mm *= factor);
        let error = refusal(fit(&start, &Known::Divots(&plate()), &all, &Options::default()));
        assert!(matches!(error, ArmError::Units { arm_unit, .. } if arm_unit == unit), "{error}");
    }
}

#[test]
fn one_pose_and_unmoved_joints_are_refused() {
    let known = Known::Divots(&[DVec2::ZERO]);
    let options = Options::of(&guess(), &known);
    let one = of_point(&truth(), 0.1, 5)[0];
    let mut random = Random::new(4);
    let still: Vec<Touch> =
        (0..12).map(|_| Touch { counts: one.counts.map(|count| count + random.normal()), of: 0 }).collect();
    assert_eq!(refusal(fit(&guess(), &known, &still, &options)), ArmError::OnePose { touches: 12 });
    // A fixed wrist makes one link of two.
    let mut tied = touches(&truth(), 0.05, 2, 4);
    let heading = |touch: &Touch| truth().joints()[2].value(touch.counts[2]);
    tied.retain(|touch| heading(touch).abs() < 1.0);
    let plate = plate();
    for touch in &mut tied {
        let place = DVec2::from_angle(0.4).rotate(plate[touch.of]) + DVec2::new(180.0, 60.0);
        let mut stiff = *truth().joints();
        stiff[1].length_mm += stiff[2].length_mm;
        stiff[2].length_mm = 0.0;
        let pose = PlanarPose { position_mm: place, heading_rad: 0.0 };
        let values = Arm::new(stiff).unwrap().inverse(&pose, Elbow::Up).unwrap();
        touch.counts = truth().counts(&[values[0], values[1], 0.0]);
    }
    let error = refusal(fit(&guess(), &Known::Divots(&plate), &tied, &Options::default()));
    assert!(
        matches!(&error, ArmError::Undetermined { why, .. } if why.contains("joint 3 has turned by 0.0°")),
        "{error}"
    );
}

#[test]
fn prismatic_joint_gives_one_point_a_scale() {
    let arm =
        Arm::new([Joint::revolute(250.0, TURN), Joint::prismatic(80.0, 140.0, 100.0), Joint::revolute(90.0, TURN)])
            .unwrap();
    let known = Known::Divots(&[DVec2::ZERO]);
    let touches = of_point(&arm, 0.0, 1);
    let mut start = arm;
    (start.joints[0].length_mm, start.joints[2].length_mm, start.joints[2].zero_counts) = (245.0, 92.0, 300.0);
    start.joints[1].kind = Kind::Prismatic { direction_deg: 78.0 };
    let fitted = fit(&start, &known, &touches, &Options::of(&start, &known)).unwrap();
    assert!(fitted.rms_mm < 1e-6, "{}", fitted.rms_mm);
    let lengths = [0, 2].map(|joint| fitted.arm.joints()[joint].length_mm - arm.joints()[joint].length_mm);
    assert!(lengths.iter().all(|off| off.abs() < 1e-5), "{lengths:?}");
}

#[test]
fn tip_sd_over_reach_matches_errors() {
    // Compares the root mean square error of the tip, over draws and poses, with the reported
    // one.
    let known = plate();
    let known = Known::Divots(&known);
    let (mut off, mut predicted) = (0.0, 0.0);
    for seed in 0..100 {
        let fitted = fit(&guess(), &known, &touches(&truth(), 0.1, seed, 4), &Options::default()).unwrap();
        for n in 0..20 {
            let n = f64::from(n);
            let counts = [2000.0 * n, 12_000.0 * (0.7 * n).sin(), 9000.0 * (1.3 * n).cos()];
            let touch = Touch { counts, of: 0 };
            let tip = |arm: &Arm| arm.pose(&model::values(arm, &touch)).position_mm;
            off += tip(&fitted.arm).distance_squared(tip(&truth()));
            predicted += fitted.sd_at(&model::values(&fitted.arm, &touch)).powi(2);
        }
        let reach = Reach::of(&fitted);
        assert!(reach.rms_mm > 0.0 && reach.rms_mm <= reach.most_mm && reach.rings.len() == 4);
        assert!(reach.rings.windows(2).all(|two| two[0].mm[1] == two[1].mm[0]), "{reach:?}");
    }
    let ratio = (off / predicted).sqrt();
    assert!((ratio - 1.0).abs() < 0.15, "{ratio}");
}
