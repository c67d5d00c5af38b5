//! Tests of the solver against closed forms, finite differences and many seeds.

#![allow(clippy::print_stdout, reason = "figures, for who asks with --nocapture")]

pub(crate) mod jacobian;

use glam::{DMat3, DQuat, DVec3};

use jacobian::check_jacobian;

use super::*;
use crate::tests::draws::draws;
use crate::tests::noise::{Noise as Random, mahalanobis};

/// Fits points of one frame to their images in another: turned, scaled along the axes and
/// shifted. It uses all kinds of blocks at once.
struct Similarity {
    parameters: Parameters,
    turn: Rotation,
    scale: Scale<3>,
    shift: Vector<3>,
    side: Side,
    pairs: Vec<(DVec3, DVec3)>,
    noise: Whitening<3>,
}

const TURN: DVec3 = DVec3::new(0.9, -1.2, 0.4);
const SCALE: DVec3 = DVec3::new(0.8, 1.3, 2.0);
const SHIFT: DVec3 = DVec3::new(120.0, -45.0, 10.0);

impl Similarity {
    fn new(side: Side, start: DQuat, noise_mm: f64, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let truth = DQuat::from_scaled_axis(TURN);
        let pair = |_| {
            let from = DVec3::new(random.between(-60.0, 60.0), random.between(-40.0, 40.0), random.between(0.0, 90.0));
            (from, truth * (SCALE * from) + SHIFT + random.vector(noise_mm))
        };
        let pairs = (0..40).map(pair).collect();
        let mut parameters = Parameters::new();
        let turn = parameters.rotation("turn", side, 0.1, start);
        let scale = parameters.scale("scale", ["x", "y", "z"], 0.1, [1.0; 3]);
        let shift = parameters.point("shift", 10.0, DVec3::ZERO);
        Self { parameters, turn, scale, shift, side, pairs, noise: Whitening::sd(noise_mm.max(1e-3)) }
    }

    fn put(&self, state: &State, blocks: &mut Blocks<'_>) {
        let turn = DMat3::from_quat(state.rotation(self.turn));
        let (scale, shift) = (DVec3::from(state.scale(self.scale)), state.point(self.shift));
        for (from, to) in &self.pairs {
            let scaled = scale * *from;
            let turned_point = turn * scaled;
            let by_turn = match self.side {
                Side::Left => turned(turned_point),
                Side::Right => turn * turned(scaled),
            };
            let by_scale = turn * DMat3::from_diagonal(scaled);
            blocks
                .add((turned_point + shift - *to).to_array(), &self.noise)
                .by(self.turn, rows(by_turn))
                .by(self.scale, rows(by_scale))
                .by(self.shift, rows(DMat3::IDENTITY));
        }
    }

    fn solve(&self, settings: &Settings) -> Solution {
        solve(&self.parameters, settings, |state, blocks| self.put(state, blocks)).expect("solved")
    }

    /// Returns the error of the rotation (as a step from the truth), of the scale's logarithm,
    /// and of the shift.
    fn error(&self, solution: &Solution) -> [f64; 9] {
        let truth = DQuat::from_scaled_axis(TURN);
        let found = solution.state.rotation(self.turn);
        let turn = match self.side {
            Side::Left => found * truth.inverse(),
            Side::Right => truth.inverse() * found,
        };
        let scale = DVec3::from(solution.state.scale(self.scale)) / SCALE;
        let parts = [turn.to_scaled_axis(), scale.map(f64::ln), solution.state.point(self.shift) - SHIFT];
        std::array::from_fn(|i| parts[i / 3][i % 3])
    }

    /// Returns the covariance of all nine.
    fn covariance(&self, solution: &Solution) -> [[f64; 9]; 9] {
        // Each number depends on its own parameter only.
        let unit = |first: usize| -> [[f64; 3]; 9] {
            std::array::from_fn(|i| std::array::from_fn(|k| if i == first + k { 1.0 } else { 0.0 }))
        };
        solution
            .certainty()
            .propagated(|all| all.by(self.turn, unit(0)).by(self.scale, unit(3)).by(self.shift, unit(6)))
    }
}

#[test]
fn derivatives_are_right_and_wrong_ones_are_found() {
    for side in [Side::Left, Side::Right] {
        let problem = Similarity::new(side, DQuat::from_rotation_x(0.7), 0.5, 1);
        let state =
            problem.parameters.moved(&problem.parameters.start(), &[0.3, -0.2, 0.5, 0.2, -0.1, 0.3, 4.0, -8.0, 2.0]);
        let check = check_jacobian(&problem.parameters, &state, |state, blocks| problem.put(state, blocks));
        assert!(check.largest < 1e-7, "{check:?}");
        let wrong = Similarity { side: if side == Side::Left { Side::Right } else { Side::Left }, ..problem };
        let check = check_jacobian(&wrong.parameters, &state, |state, blocks| wrong.put(state, blocks));
        assert!(check.largest > 0.1 && check.parameter.starts_with("turn about"), "{check:?}");
    }
}

#[test]
fn exact_data_are_solved_to_rounding_with_every_loss() {
    for side in [Side::Left, Side::Right] {
        for loss in [Loss::Quadratic, Loss::Huber, Loss::Cauchy] {
            let problem = Similarity::new(side, DQuat::from_scaled_axis(TURN + DVec3::new(0.8, 0.7, -0.9)), 0.0, 2);
            let solution = problem.solve(&Settings::robust(loss));
            let error = problem.error(&solution).iter().fold(0.0_f64, |most, e| most.max(e.abs()));
            assert!(error < 1e-9, "{side:?} {loss:?}: {error:e}, {:?}", solution.stopped);
            assert_ne!(solution.stopped, Stopped::Iterations);
        }
    }
}

/// Over many seeds, eᵀΣ⁻¹e of all nine parameters averages nine. The covariance thus matches
/// the errors, with estimated or known noise, and for either side.
#[test]
fn covariance_matches_errors() {
    for (side, noise) in [(Side::Left, Noise::Compared), (Side::Right, Noise::Compared), (Side::Left, Noise::Known)] {
        let seeds = draws(500);
        let settings = Settings { noise, ..Settings::default() };
        let mut sum = 0.0;
        for seed in 0..seeds {
            let problem = Similarity::new(side, DQuat::from_scaled_axis(TURN), 0.5, 100 + seed);
            let solution = problem.solve(&settings);
            sum += mahalanobis(problem.error(&solution), &problem.covariance(&solution));
        }
        let mean = sum / seeds as f64;
        // One χ² of 9 spreads by √18; 120 residuals with 111 degrees of freedom add 2 % to its
        // mean.
        let sampling = (18.0 / seeds as f64).sqrt();
        assert!((mean - 9.0).abs() < 3.5 * sampling + 0.2, "{side:?} {noise:?}: {mean}");
    }
}

/// A tenth of the points are off by 20 mm and more. Robust losses stay near the truth with a
/// valid covariance; plain least squares is far off.
#[test]
fn robust_losses_ignore_outliers_with_valid_covariance() {
    let seeds = draws(500);
    for (loss, least, most) in [(Loss::Huber, 8.3, 12.0), (Loss::Cauchy, 8.2, 10.5), (Loss::Tukey, 8.3, 10.0)] {
        let (mut sum, mut farthest) = (0.0, 0.0_f64);
        for seed in 0..seeds {
            let mut problem = Similarity::new(Side::Left, DQuat::from_scaled_axis(TURN), 0.5, 1000 + seed);
            let mut random = Random::new(seed);
            for pair in problem.pairs.iter_mut().step_by(10) {
                pair.1 += random.rotation() * DVec3::X * random.between(20.0, 60.0);
            }
            let solution = problem.solve(&Settings::robust(loss));
            sum += mahalanobis(problem.error(&solution), &problem.covariance(&solution));
            farthest = farthest.max(problem.error(&solution)[6..].iter().fold(0.0, |most: f64, e| most.max(e.abs())));
        }
        let mean = sum / seeds as f64;
        println!("{loss:?}: eᵀΣ⁻¹e averages {mean:.2} of 9, the shift is at most {farthest:.2} mm off");
        // The limits are of 500 draws. χ² of 9 spreads by √18, so fewer draws allow more.
        let more = 3.0 * ((18.0 / seeds as f64).sqrt() - (18.0_f64 / 500.0).sqrt());
        assert!((least - more..most + more).contains(&mean), "{loss:?}: {mean}");
    }
}

#[test]
fn tukey_excludes_outliers_exactly() {
    let mut problem = Similarity::new(Side::Right, DQuat::from_scaled_axis(TURN + DVec3::splat(0.02)), 0.0, 5);
    for pair in problem.pairs.iter_mut().step_by(4) {
        pair.1 += DVec3::new(30.0, -80.0, 10.0);
    }
    let first = problem.solve(&Settings::robust(Loss::Huber));
    problem.parameters.begin_at(&first.state);
    let solution = problem.solve(&Settings::robust(Loss::Tukey));
    let error = problem.error(&solution).iter().fold(0.0_f64, |most, e| most.max(e.abs()));
    assert!(error < 1e-9, "{error:e}");
    for (i, weight) in solution.weights.iter().enumerate() {
        assert_eq!(*weight == 0.0, i % 4 == 0, "{i}: {weight}");
    }
}

/// A straight line, whose covariance has a closed form.
#[test]
fn line_matches_closed_form() {
    let data = [(0.0, 1.1), (1.0, 2.9), (2.0, 5.2), (3.0, 6.8), (4.0, 9.1)];
    let mut parameters = Parameters::new();
    let line = parameters.vector("line", ["height", "slope"], "mm", 1.0, [50.0, -30.0]);
    let noise = Whitening::sd(2.0);
    let put = |state: &State, blocks: &mut Blocks<'_>| {
        let [height, slope] = state.vector(line);
        for (x, y) in data {
            blocks.add([height + slope * x - y], &noise).by(line, [[1.0, x]]);
        }
    };
    let solution = solve(&parameters, &Settings::default(), put).unwrap();
    let [height, slope] = solution.state.vector(line);
    assert!((height - 1.04).abs() < 1e-12 && (slope - 1.99).abs() < 1e-12, "{height} {slope}");
    let rss: f64 = data.iter().map(|(x, y)| (height + slope * x - y).powi(2)).sum();
    let variance = rss / 3.0;
    let covariance = solution.covariance(line);
    let expected = [[variance * 0.6, variance * -0.2], [variance * -0.2, variance * 0.1]];
    for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        assert!((covariance[i][j] - expected[i][j]).abs() < 1e-12, "{covariance:?}");
    }
    assert!((solution.cost - rss / 4.0).abs() < 1e-12 && (solution.spread - variance.sqrt() / 2.0).abs() < 1e-12);
    assert_eq!(solution.freedom, 3);
    let known = solve(&parameters, &Settings { noise: Noise::Known, ..Settings::default() }, put).unwrap();
    assert!((known.covariance(line)[1][1] - 4.0 * 0.1).abs() < 1e-12);
    // Variance of the line at x = 7.
    let there = known.certainty().propagated(|y| y.by(line, [[1.0, 7.0]]));
    assert!((there[0][0] - 4.0 * (0.6 - 2.0 * 7.0 * 0.2 + 49.0 * 0.1)).abs() < 1e-11);
}

/// Three more points at x = 7, predicted and measured.
#[test]
fn predicted_covariance_matches_measured() {
    let mut parameters = Parameters::new();
    let line = parameters.vector("line", ["height", "slope"], "", 1.0, [0.0; 2]);
    let noise = Whitening::sd(2.0);
    let settings = Settings { noise: Noise::Known, ..Settings::default() };
    let found = |data: &[f64]| {
        let put = |state: &State, blocks: &mut Blocks<'_>| {
            let [height, slope] = state.vector(line);
            for x in data {
                blocks.add([height + slope * x], &noise).by(line, [[1.0, *x]]);
            }
        };
        solve(&parameters, &settings, put).unwrap()
    };
    let (few, all) = (found(&[0.0, 1.0, 2.0]), found(&[0.0, 1.0, 2.0, 7.0, 7.0, 7.0]));
    let more = |x: f64| {
        few.certainty().with(3.0, |blocks| {
            blocks.add([0.0], &noise).by(line, [[1.0, x]]);
        })
    };
    let foreseen = more(7.0).unwrap().between(line, line);
    let measured = all.covariance(line);
    for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        assert!((foreseen[i][j] - measured[i][j]).abs() < 1e-12, "{foreseen:?} {measured:?}");
    }
    assert!(more(f64::NAN).is_none());
}

/// Undamped steps overshoot from here and never come back.
#[test]
fn diverging_gauss_newton_is_damped() {
    let mut parameters = Parameters::new();
    let rate = parameters.vector("rate", [""], "1/s", 1.0, [6.0]);
    let unit = Whitening::sd(1.0);
    let put = |state: &State, blocks: &mut Blocks<'_>| {
        let [x] = state.vector(rate);
        blocks.add([x.atan()], &unit).by(rate, [[1.0 / (1.0 + x * x)]]);
    };
    let solution = solve(&parameters, &Settings::default(), put).unwrap();
    assert!(solution.state.vector(rate)[0].abs() < 1e-12);
}

#[test]
fn correlated_noise_is_weighted_by_covariance() {
    // A number measured twice, with nearly equal errors: the weighted mean lies outside of both
    // (Gauss–Markov).
    let covariance = [[1.0, 1.8], [1.8, 4.0]];
    let whitening = Whitening::covariance(&covariance);
    let mut parameters = Parameters::new();
    let number = parameters.vector("number", [""], "mm", 1.0, [0.0]);
    let put = |state: &State, blocks: &mut Blocks<'_>| {
        let [x] = state.vector(number);
        blocks.add([x - 10.0, x - 11.0], &whitening).by(number, [[1.0], [1.0]]);
    };
    let solution = solve(&parameters, &Settings { noise: Noise::Known, ..Settings::default() }, put).unwrap();
    let determinant: f64 = 4.0 - 1.8 * 1.8;
    let [a, b] = [(4.0 - 1.8) / determinant, (1.0 - 1.8) / determinant];
    assert!((solution.state.vector(number)[0] - (a * 10.0 + b * 11.0) / (a + b)).abs() < 1e-12);
    assert!((solution.covariance(number)[0][0] - 1.0 / (a + b)).abs() < 1e-12);
}

#[test]
fn undetermined_directions_are_named() {
    let mut parameters = Parameters::new();
    let a = parameters.point("tip", 100.0, DVec3::ZERO);
    let b = parameters.point("pivot", 100.0, DVec3::ZERO);
    let unit = Whitening::sd(1.0);
    // Only the sum of the two is measured, and not along z.
    let put = |state: &State, blocks: &mut Blocks<'_>| {
        let sum = state.point(a) + state.point(b);
        for _ in 0..4 {
            let rows = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
            blocks.add([sum.x - 3.0, sum.y], &unit).by(a, rows).by(b, rows);
        }
    };
    let Err(Unsolved::Undetermined { directions }) = solve(&parameters, &Settings::default(), put) else {
        panic!("four directions are not determined");
    };
    assert_eq!(directions.len(), 4);
    for direction in &directions {
        let ([ax, ay, _], [bx, by, _]) = (direction.share(a), direction.share(b));
        assert!((ax + bx).abs() < 1e-12 && (ay + by).abs() < 1e-12, "{direction}");
        assert!(direction.sd.is_infinite());
    }
    // More data leave one undetermined direction, and the message names it.
    let more = |state: &State, blocks: &mut Blocks<'_>| {
        put(state, blocks);
        let difference = state.point(a) - state.point(b);
        let by = DMat3::IDENTITY;
        blocks.add(difference.to_array(), &Whitening::sd(1.0)).by(a, rows(by)).by(b, rows(-by));
    };
    let error = solve(&parameters, &Settings::default(), more).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the measurements do not determine 0.71·tip z + 0.71·pivot z; measure from other directions"
    );
    let Unsolved::Undetermined { directions } = error else { panic!("one direction is not determined") };
    // Components of rounding size are not named.
    assert_eq!(directions[0].leading(), "tip z and pivot z");
}

#[test]
fn fixed_block_stays_without_covariance() {
    let mut problem = Similarity::new(Side::Left, DQuat::from_scaled_axis(TURN), 0.0, 7);
    problem.parameters.hold(problem.turn);
    assert_eq!(problem.parameters.steps(), 6);
    let solution = problem.solve(&Settings::default());
    assert_eq!(solution.state.rotation(problem.turn), DQuat::from_scaled_axis(TURN).normalize());
    assert_eq!(solution.covariance(problem.turn), [[0.0; 3]; 3]);
    assert!(problem.error(&solution).iter().all(|e| e.abs() < 1e-9));
    assert_eq!(solution.directions().len(), 6);
    let check = check_jacobian(&problem.parameters, &solution.state, |state, blocks| problem.put(state, blocks));
    assert!(check.largest < 1e-7, "{check:?}");
}

#[test]
fn too_few_or_invalid_numbers_are_refused() {
    let mut problem = Similarity::new(Side::Left, DQuat::IDENTITY, 0.0, 7);
    problem.pairs.truncate(2);
    let error = solve(&problem.parameters, &Settings::default(), |s, b| problem.put(s, b)).unwrap_err();
    assert_eq!(error.to_string(), "6 measured numbers do not determine 9 parameters; measure more");
    let mut problem = Similarity::new(Side::Left, DQuat::IDENTITY, 0.0, 7);
    problem.pairs[11].0.y = f64::NAN;
    let error = solve(&problem.parameters, &Settings::default(), |s, b| problem.put(s, b)).unwrap_err();
    assert_eq!(error, Unsolved::NotFinite { block: 11 });
    let mut problem = Similarity::new(Side::Left, DQuat::IDENTITY, 0.0, 7);
    problem.noise = Whitening::covariance(&[[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let error = solve(&problem.parameters, &Settings::default(), |s, b| problem.put(s, b)).unwrap_err();
    assert_eq!(error, Unsolved::NotFinite { block: 0 });
}

/// A badly scaled problem: a rotation measured at one end of a metre, and columns that differ
/// by six orders of magnitude.
#[test]
fn condition_does_not_depend_on_units() {
    let conditions = [1.0, 1e-6].map(|unit| {
        let mut parameters = Parameters::new();
        let line = parameters.vector("height", [""], "mm", 10.0, [0.0]);
        let slope = parameters.vector("slope", [""], "a unit of choice", 0.1 * unit, [0.0]);
        let one = Whitening::sd(1.0);
        let solution = solve(&parameters, &Settings::default(), |state, blocks| {
            let ([height], [tilt]) = (state.vector(line), state.vector(slope));
            for i in 0..10 {
                let x = f64::from(i);
                let residual = height + tilt / unit * x - 5.0 - 0.25 * x;
                blocks.add([residual], &one).by(line, [[1.0]]).by(slope, [[x / unit]]);
            }
        })
        .unwrap();
        assert!((solution.state.vector(slope)[0] - 0.25 * unit).abs() < 1e-9 * unit);
        solution.condition
    });
    assert!((conditions[0] / conditions[1] - 1.0).abs() < 1e-9 && conditions[0] > 10.0, "{conditions:?}");
}
