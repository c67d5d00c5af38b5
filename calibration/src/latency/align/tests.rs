//! Estimated lags against known ones: exact without noise, and within the stated standard error
//! with several kinds of noise.

use std::f64::consts::TAU;

use super::*;
use crate::error::LatencyError;
use crate::tests::draws::draws;
use crate::tests::noise::Noise as Random;

/// Noise of the frames' values, of their stamps and of the tracker.
#[derive(Clone, Copy)]
struct Noise {
    /// Standard deviation of values, px, and correlation from frame to frame.
    value: f64,
    goes_on: f64,
    /// Standard deviation of stamps, s.
    stamp: f64,
    /// Standard deviation of the tracker, mm.
    pose: f64,
}

const NONE: Noise = Noise { value: 0.0, goes_on: 0.0, stamp: 0.0, pose: 0.0 };

/// An operator who moves the probe up and down by 30 mm about once a second, never in the same way.
struct Hand {
    phases: [f64; 6],
}

impl Hand {
    fn new(random: &mut Random) -> Self {
        Self { phases: std::array::from_fn(|_| TAU * random.uniform()) }
    }

    fn at(&self, time: f64) -> [f64; 2] {
        let wave = |k: usize, hz: f64| (TAU * hz * time + self.phases[k]).sin();
        let turning = TAU * 0.9 * time + 1.5 * wave(0, 0.13) + 0.7 * wave(1, 0.31);
        let along = (13.0 + 2.5 * wave(2, 0.21)) * turning.sin() + 0.6 * wave(3, 2.3);
        [along, 1.5 * wave(4, 0.8) + 0.8 * wave(5, 0.37)]
    }
}

/// Simulates 12 frames and 45 poses a second for `duration` seconds; the tracker lags by `lag`.
/// Values follow both numbers, the second one only slightly.
fn session(random: &mut Random, lag: f64, duration: f64, noise: Noise) -> (Vec<TimedValue>, Spline<2>) {
    let hand = Hand::new(random);
    let mut poses = Vec::new();
    let mut time = -1.0;
    while time < duration + 1.0 {
        let place = hand.at(time - lag).map(|x| x + noise.pose * random.normal());
        poses.push((time, place));
        time += 0.018 + 0.008 * random.uniform();
    }
    let (mut values, mut time, mut before) = (Vec::new(), 0.0, random.normal());
    while time < duration {
        let [along, aside] = hand.at(time);
        before = noise.goes_on * before + (1.0 - noise.goes_on * noise.goes_on).sqrt() * random.normal();
        let value = 100.0 - 9.0 * along + 0.8 * aside + noise.value * before;
        values.push(TimedValue { time_s: time + noise.stamp * random.normal(), value });
        time += 0.075 + 0.02 * random.uniform();
    }
    (values, Spline::new(poses, 0.1).unwrap())
}

const RANGE: AlignOptions = AlignOptions { range_s: 0.5 };

#[test]
fn without_noise_only_spline_error_remains() {
    for (seed, lag) in [(1, 0.0), (2, 0.0648), (3, -0.0648), (4, 0.31), (5, -0.4)] {
        let (values, track) = session(&mut Random::new(seed), lag, 18.0, NONE);
        let found = align(&values, &track, &RANGE).unwrap();
        assert!((found.lag_s - lag).abs() < 2e-5 && found.se_s < 2e-5, "{lag}: {found:?}");
        // The residuals are spline errors, mostly at the motion's turns; the largest count as
        // outliers.
        assert!((found.gain + 9.0).abs() < 1e-2 && found.outliers < found.frames / 5, "{lag}: {found:?}");
    }
    // The lag is exact for an exact spline: inside a cubic polynomial, but not for joined
    // straight pieces.
    let at = |t: f64| (t - 5.0) * (t - 3.0) * (t - 1.0);
    let poses = (0..400).map(|i| 0.015 * f64::from(i)).map(|t| (t, [at(t)])).collect();
    let values: Vec<TimedValue> = (0..60)
        .map(|i| 2.0 + 0.03 * f64::from(i))
        .map(|t| TimedValue { time_s: t, value: 7.0 * at(t + 0.0123) })
        .collect();
    let found = align(&values, &Spline::new(poses, 0.1).unwrap(), &AlignOptions { range_s: 0.2 }).unwrap();
    assert!((found.lag_s - 0.0123).abs() < 1e-6, "{found:?}");
}

/// Returns the errors over their standard errors, for many seeds: the mean, the mean square,
/// and the root mean square error in ms.
fn scores(seeds: u64, noise: Noise, duration: f64) -> [f64; 3] {
    let (mut sum, mut squares, mut errors) = (0.0, 0.0, 0.0);
    for seed in 0..seeds {
        let mut random = Random::new(1000 + seed);
        let lag = 0.2 * (random.uniform() - 0.5);
        let (values, track) = session(&mut random, lag, duration, noise);
        let found = align(&values, &track, &RANGE).unwrap();
        let score = (found.lag_s - lag) / found.se_s;
        sum += score;
        squares += score * score;
        errors += (found.lag_s - lag).powi(2);
    }
    let n = seeds as f64;
    [sum / n, squares / n, 1e3 * (errors / n).sqrt()]
}

/// The mean square of 400 normal numbers is 1 ± 0.07.
#[test]
fn standard_error_matches_error() {
    let kinds = [
        ("even noise", Noise { value: 3.0, ..NONE }),
        ("noise that goes on", Noise { value: 3.0, goes_on: 0.7, ..NONE }),
        ("stamps that jitter", Noise { value: 0.5, stamp: 0.005, ..NONE }),
        ("all of them", Noise { value: 2.0, goes_on: 0.5, stamp: 0.003, pose: 0.1 }),
    ];
    for (name, noise) in kinds {
        let seeds = draws(400);
        let [mean, square, error_ms] = scores(seeds, noise, 18.0);
        println!("{name}: mean {mean:.3}, mean square {square:.3}, error {error_ms:.2} ms");
        // Four and three standard deviations of normal numbers' mean and mean square.
        let spread = 1.0 / (seeds as f64).sqrt();
        assert!(mean.abs() < 4.0 * spread, "{name}: {mean}");
        assert!((square - 1.0).abs() < 4.2 * spread, "{name}: {square}");
    }
}

#[test]
fn frames_with_wrong_line_are_outliers() {
    let noise = Noise { value: 1.0, ..NONE };
    for seed in 0..20 {
        let mut random = Random::new(seed);
        let (mut values, track) = session(&mut random, 0.07, 18.0, noise);
        for k in (3..values.len()).step_by(5) {
            values[k].value = 300.0 * random.uniform() - 50.0;
        }
        let found = align(&values, &track, &RANGE).unwrap();
        assert!((found.lag_s - 0.07).abs() < 4.0 * found.se_s && found.se_s < 1e-3, "{seed}: {found:?}");
        assert!(found.outliers > values.len() / 10);
    }
}

#[test]
fn undetermined_lag_is_refused_by_name() {
    let noise = Noise { value: 1.0, ..NONE };
    let (values, track) = session(&mut Random::new(1), 0.05, 18.0, noise);
    let moved = |by: f64| values.iter().map(|v| TimedValue { time_s: v.time_s + by, ..*v }).collect::<Vec<_>>();
    assert!(matches!(align(&moved(1000.0), &track, &RANGE), Err(LatencyError::NoOverlap { most: 0, .. })));
    assert!(matches!(align(&values[..20], &track, &RANGE), Err(LatencyError::NoOverlap { .. })));
    assert!(matches!(
        align(&moved(0.55), &track, &RANGE),
        Err(LatencyError::AtEdge { .. } | LatencyError::Unrelated { .. } | LatencyError::Ambiguous { .. })
    ));
    let at_edge = align(&moved(0.18), &track, &AlignOptions { range_s: 0.1 });
    assert!(matches!(at_edge, Err(LatencyError::AtEdge { .. })), "{at_edge:?}");
    let still: Vec<TimedValue> = values.iter().map(|v| TimedValue { value: 4.0, ..*v }).collect();
    assert_eq!(align(&still, &track, &RANGE), Err(LatencyError::Constant));
    let mut random = Random::new(9);
    let other: Vec<TimedValue> = values.iter().map(|v| TimedValue { value: 50.0 * random.normal(), ..*v }).collect();
    assert!(matches!(align(&other, &track, &RANGE), Err(LatencyError::Unrelated { .. })));
    // An even sine equals its own negative half a period later.
    let even = |t: f64| (TAU * 1.3 * t).sin();
    let poses = (0..1000).map(|i| 0.02 * f64::from(i)).map(|t| (t, [10.0 * even(t)])).collect();
    let seen: Vec<TimedValue> = (0..150)
        .map(|i| 2.0 + 0.1 * f64::from(i))
        .map(|t| TimedValue { time_s: t, value: 80.0 * even(t) + random.normal() })
        .collect();
    let found = align(&seen, &Spline::new(poses, 0.1).unwrap(), &RANGE);
    assert!(matches!(found, Err(LatencyError::Ambiguous { .. })), "{found:?}");
    // In a uniform motion lag and offset cannot be separated.
    let poses = (0..1000).map(|i| 0.02 * f64::from(i)).map(|t| (t, [10.0 * t])).collect();
    let seen: Vec<TimedValue> = (0..150)
        .map(|i| 2.0 + 0.1 * f64::from(i))
        .map(|t| TimedValue { time_s: t, value: 80.0 * t + random.normal() })
        .collect();
    let found = align(&seen, &Spline::new(poses, 0.1).unwrap(), &RANGE);
    assert!(
        matches!(
            found,
            Err(LatencyError::Unsure { .. } | LatencyError::AtEdge { .. } | LatencyError::Ambiguous { .. })
        ),
        "{found:?}"
    );
}
