//! Registration of simulated phantoms at known places.

#![allow(clippy::print_stdout, reason = "figures, for who asks with --nocapture")]

use super::*;
use crate::error::LandmarksError;
use crate::least_squares::tests::jacobian::check_jacobian;
use crate::tests::draws::draws;
use crate::tests::noise::{Noise, mahalanobis};

const TIP: DVec3 = DVec3::new(4.0, -2.0, 140.0);
const RATE_HZ: f64 = 20.0;

/// Corners of a box and some more; no symmetry.
const PLACES: [[f64; 3]; 7] = [
    [0.0, 0.0, 0.0],
    [80.0, 5.0, 0.0],
    [75.0, 50.0, 20.0],
    [-5.0, 45.0, 5.0],
    [10.0, 0.0, 40.0],
    [60.0, -10.0, 45.0],
    [30.0, 55.0, 30.0],
];

fn places() -> Vec<DVec3> {
    PLACES.map(DVec3::from_array).to_vec()
}

fn landmarks(places: &[DVec3]) -> Vec<Landmark> {
    let named = |(i, position_mm): (usize, &DVec3)| Landmark { name: format!("#{i}"), position_mm: *position_mm };
    places.iter().enumerate().map(named).collect()
}

/// Returns the true pose of the phantom.
fn truth() -> DAffine3 {
    DAffine3::from_rotation_translation(
        DQuat::from_scaled_axis(DVec3::new(0.7, -1.4, 0.5)),
        DVec3::new(40.0, -120.0, 65.0),
    )
}

/// Simulates an operator with a stylus.
struct Hand {
    random: Noise,
    readings: Vec<Reading>,
    at: DVec3,
    /// Standard deviation of the tracker's positions, mm, and directions, degrees.
    noise: (f64, f64),
    /// Offset of the tip from its stated place, mm.
    tip_error: DVec3,
}

impl Hand {
    fn new(seed: u64, noise: (f64, f64)) -> Self {
        let at = DVec3::new(-60.0, 30.0, 200.0);
        Self { random: Noise::new(seed), readings: Vec::new(), at, noise, tip_error: DVec3::ZERO }
    }

    /// Adds a reading with the tip at a place and the stylus swung by 25° about an axis that is
    /// not the world's.
    fn read(&mut self, at: DVec3) {
        let time_s = self.readings.len() as f64 / RATE_HZ;
        let swing =
            DQuat::from_scaled_axis(DVec3::new((2.1 * time_s).cos(), (2.1 * time_s).sin(), 0.3 * time_s.sin()) * 0.43);
        let rotation = swing * DQuat::from_scaled_axis(DVec3::new(2.6, 0.4, -0.2));
        let turn = rotation * self.random.turn(self.noise.1.to_radians());
        let translation = at - rotation * (TIP + self.tip_error) + self.random.vector(self.noise.0);
        let pose = DAffine3::from_rotation_translation(turn, translation);
        self.readings.push(Reading { time_s, reference_from_stylus: Transform::from_affine(pose) });
    }

    /// Moves to a place in an arc, in 0.8 s.
    fn travel(&mut self, to: DVec3) {
        let from = self.at;
        for i in 1..16 {
            let share = f64::from(i) / 16.0;
            let lift = DVec3::new(0.0, 0.3, 1.0) * 40.0 * (std::f64::consts::PI * share).sin();
            self.read(from.lerp(to, share) + lift);
        }
        self.at = to;
    }

    fn rest(&mut self, at: DVec3, seconds: f64) {
        self.travel(at);
        for _ in 0..(seconds * RATE_HZ) as usize {
            self.read(at);
        }
    }

    /// Touches landmarks by their indices in a list, 2.5 s each.
    fn touch(&mut self, places: &[DVec3], order: &[usize]) {
        for &landmark in order {
            self.rest(truth().transform_point3(places[landmark]), 2.5);
        }
    }
}

fn all(seed: u64, noise: (f64, f64)) -> Vec<Reading> {
    let mut hand = Hand::new(seed, noise);
    hand.touch(&places(), &[0, 1, 2, 3, 4, 5, 6]);
    hand.readings
}

fn found(readings: &[Reading]) -> Registered {
    register(readings, TIP, &landmarks(&places()), &Settings::default()).expect("a registration")
}

fn refused(readings: &[Reading], places: &[DVec3]) -> LandmarksError {
    match register(readings, TIP, &landmarks(places), &Settings::default()) {
        Err(CalibrationError::Landmarks(error)) => error,
        other => panic!("{other:?}"),
    }
}

/// Returns the largest error of a landmark, mm.
fn off(registered: &Registered) -> f64 {
    let apart = |p: DVec3| registered.reference_from_phantom.point(p).distance(truth().transform_point3(p));
    places().into_iter().map(apart).fold(0.0, f64::max)
}

#[test]
fn registration_without_noise_is_exact() {
    let registered = found(&all(1, (0.0, 0.0)));
    assert!(off(&registered) < 1e-6, "{}", off(&registered));
    let turn = registered.reference_from_phantom.affine().matrix3.transpose() * truth().matrix3;
    assert!((turn - DMat3::IDENTITY).to_cols_array().iter().all(|x| x.abs() < 1e-8));
    assert!(!registered.by_order);
    assert_eq!((registered.touched.len(), registered.missed.len(), registered.elsewhere.len()), (7, 0, 0));
}

#[test]
fn order_pauses_gaps_repeats_and_jumps_do_not_matter() {
    let mut hand = Hand::new(3, (0.15, 0.1));
    hand.tip_error = DVec3::new(0.5, -0.4, 0.3);
    hand.rest(DVec3::new(150.0, 20.0, 0.0), 4.0);
    hand.touch(&places(), &[5, 0, 3, 3]);
    hand.rest(DVec3::new(-100.0, 60.0, 30.0), 2.0);
    hand.touch(&places(), &[1, 6, 0, 2]);
    for index in [140, 141, 300, 412] {
        let mut pose = hand.readings[index].reference_from_stylus.affine();
        pose.translation += DVec3::new(90.0, -40.0, 33.0);
        hand.readings[index].reference_from_stylus = Transform::from_affine(pose);
    }
    let registered = found(&hand.readings);
    assert_eq!(registered.missed, [4]);
    assert_eq!(registered.elsewhere.len(), 2);
    let rests: Vec<usize> = registered.touched.iter().map(|touched| touched.rests.len()).collect();
    assert_eq!(rests[0], 2, "{rests:?}");
    assert!(off(&registered) < 1.0 && registered.error_mm.rms < 0.8, "{} {:?}", off(&registered), registered.error_mm);
    assert!((0.1..0.6).contains(&registered.noise_mm), "{}", registered.noise_mm);
}

#[test]
fn derivatives_match_finite_differences() {
    let registered = found(&all(2, (0.2, 0.1)));
    let mut problem = Problem::new(&registered.touched, &places(), &truth());
    problem.pairs[3].1 += DVec3::new(3.0, -5.0, 1.0);
    let check = check_jacobian(&problem.parameters, &problem.parameters.start(), |s, b| problem.put(s, b));
    assert!(check.largest < 1e-7, "{check:?}");
}

/// Over many seeds, eᵀΣ⁻¹e at a point averages 3·15/13: three, times the factor for 15 degrees
/// of freedom. The errors are holes displaced from the places in the file.
#[test]
fn predicted_error_matches_actual_error() {
    let (seeds, hole_mm) = (draws(400), 0.3);
    let points = [DVec3::new(35.0, 20.0, 20.0), DVec3::new(35.0, 20.0, -60.0)];
    let mut sums = [0.0; 2];
    for seed in 0..seeds {
        let mut random = Noise::new(50_000 + seed);
        let made: Vec<DVec3> = places().iter().map(|p| *p + random.vector(hole_mm)).collect();
        let mut hand = Hand::new(seed, (0.02, 0.0));
        hand.touch(&made, &[0, 1, 2, 3, 4, 5, 6]);
        let registered = found(&hand.readings);
        for (sum, point) in sums.iter_mut().zip(points) {
            let error = registered.reference_from_phantom.point(point) - truth().transform_point3(point);
            *sum += mahalanobis(error.to_array(), &registered.covariance_at(point));
        }
    }
    for mean in sums.map(|sum| sum / seeds as f64) {
        println!("eᵀΣ⁻¹e at a point averages {mean:.2} of {:.2}", 3.0 * 15.0 / 13.0);
        // χ² of 3, times the factor, spreads by 2.8.
        assert!((mean - 3.0 * 15.0 / 13.0).abs() < 4.0 * 2.8 / (seeds as f64).sqrt(), "{mean}");
    }
}

#[test]
fn symmetric_landmarks_need_file_order() {
    // A rectangle maps to itself by half a turn.
    let places: Vec<DVec3> =
        [[0.0, 0.0], [60.0, 0.0], [60.0, 40.0], [0.0, 40.0]].map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec();
    let register = |order: &[usize]| {
        let mut hand = Hand::new(8, (0.1, 0.05));
        hand.touch(&places, order);
        register(&hand.readings, TIP, &landmarks(&places), &Settings::default())
    };
    let registered = register(&[0, 1, 2, 3]).expect("in the file's order");
    let apart = |p: &DVec3| registered.reference_from_phantom.point(*p).distance(truth().transform_point3(*p));
    assert!(places.iter().all(|p| apart(p) < 0.5));
    assert!(registered.by_order);
    assert_eq!(register(&[0, 2, 1, 3]).unwrap_err(), LandmarksError::Symmetric.into());
}

#[test]
fn wrong_phantom_or_readings_are_refused() {
    let places = places();
    let readings = all(4, (0.1, 0.05));

    let mirrored: Vec<DVec3> = places.iter().map(|p| DVec3::new(p.x, -p.y, p.z)).collect();
    assert_eq!(refused(&readings, &mirrored), LandmarksError::Mirrored { matched: 7, landmarks: 7 });

    for (factor, message) in [
        (10.0, "divided by 10.0000: they were converted from cm to mm twice; correct the numbers"),
        (
            25.4,
            "divided by 25.4000: they are in mm instead of inches, or were converted twice from inches; correct the numbers",
        ),
        (0.1, "divided by 0.1000: they are in cm instead of mm; correct the numbers"),
        (1.0 / 25.4, "divided by 0.0394: they are in inches instead of mm; correct the numbers"),
    ] {
        let scaled: Vec<Reading> = readings
            .iter()
            .map(|reading| {
                let mut pose = reading.reference_from_stylus.affine();
                pose.translation *= factor;
                Reading { reference_from_stylus: Transform::from_affine(pose), ..*reading }
            })
            .collect();
        let error = refused(&scaled, &places);
        assert_eq!(error.to_string(), format!("the tracker's positions fit if {message}"));
        let scaled: Vec<DVec3> = places.iter().map(|p| *p * factor).collect();
        let error = refused(&readings, &scaled);
        assert!(matches!(error, LandmarksError::Units { what: "the phantom's landmarks", .. }), "{error}");
    }

    let other: Vec<DVec3> = places.iter().map(|p| DVec3::new(1.3 * p.x, p.y - 0.4 * p.x, 1.7 * p.z + 9.0)).collect();
    let error = refused(&readings, &other);
    assert!(matches!(error, LandmarksError::NoMatch { rests: 7, least: 4, .. }), "{error}");
    // The tip of another stylus never rests.
    let error = register(&readings, DVec3::new(0.0, 60.0, 30.0), &landmarks(&places), &Settings::default());
    assert!(matches!(error, Err(CalibrationError::Landmarks(LandmarksError::NoMatch { .. }))), "{error:?}");

    assert_eq!(refused(&readings, &places[..2]), LandmarksError::TooFew { landmarks: 2 });
    let line: Vec<DVec3> = (0..5).map(|i| DVec3::new(f64::from(i) * 20.0, 3.0, 1.0)).collect();
    assert_eq!(refused(&readings, &line), LandmarksError::OnALine);
    assert_eq!(refused(&readings[..2], &places), LandmarksError::NoReadings { readings: 2 });

    // Four landmarks in a corner, with holes slightly displaced from the file.
    let mut near: Vec<DVec3> =
        vec![DVec3::ZERO, DVec3::new(9.0, 0.0, 1.0), DVec3::new(0.0, 11.0, 0.0), DVec3::new(7.0, 9.0, 4.0)];
    let mut hand = Hand::new(6, (0.05, 0.02));
    hand.touch(&near, &[0, 1, 2, 3]);
    near.push(DVec3::new(400.0, 300.0, 200.0));
    near[2].x += 1.2;
    let error = refused(&hand.readings, &near);
    assert!(matches!(error, LandmarksError::Uncertain { touched: 4, landmarks: 5, .. }), "{error}");

    // Three of the holes are displaced, but not as far as in another phantom.
    let mut worn = places.clone();
    for (place, by) in worn.iter_mut().zip([2.4, 0.0, -2.4, 0.0, 2.4, 0.0, -2.4]) {
        place.x += by;
    }
    let error = refused(&readings, &worn);
    assert!(matches!(error, LandmarksError::Limit { limit_mm: 1.5, .. }), "{error}");
}

#[test]
fn noise_estimate_ignores_hand_motion() {
    let mut random = Noise::new(12);
    let mut drawn = |swing_mm: f64| -> f64 {
        let at = |i: usize| DVec3::new((i as f64 * 0.05).sin(), (i as f64 * 0.031).cos(), 0.0) * swing_mm;
        let mut row: Vec<(f64, DVec3)> = (0..2000).map(|i| (i as f64 * 0.02, at(i) + random.vector(0.3))).collect();
        for (_, place) in row.iter_mut().step_by(17) {
            place.x += 200.0;
        }
        crate::rest::noise(&row).expect("a noise")
    };
    for swing_mm in [0.0, 30.0] {
        let noise = drawn(swing_mm);
        assert!((noise / 0.3 - 1.0).abs() < 0.25, "{swing_mm}: {noise}");
    }
    assert_eq!(crate::rest::noise(&[(0.0, DVec3::ZERO); 2]), None);
}
