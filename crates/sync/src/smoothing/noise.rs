//! Noise of a moving sensor, from the third differences of its poses.
//!
//! A hand's motion hardly shows in them at 40 poses a second or more. White noise of variance s²
//! gives them a variance of 20 s², and a correlation of −3/4 between successive ones. Slower noise
//! gives less of both.

use glam::DVec3;

use super::regression::variances;

/// Variance of the third differences of white noise, in variances of the noise.
const THIRD: f64 = 20.0;
/// Third differences with a larger square, in variances of their axes, would rule the correlation.
const OUTLYING: f64 = 20.0;

/// Noise of one kind of component, positions or rotations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FastNoise {
    /// Variance along an axis, mm² or rad², the mean of the three.
    pub variance: f64,
    /// Correlation of successive third differences: −0.75 for white noise; 0 if all are equal.
    pub lag_1: f64,
}

/// Estimates the noise from third differences, in the order of time; `None` without two.
pub(super) fn of_third_differences(differences: &[DVec3]) -> Option<FastNoise> {
    if differences.len() < 2 {
        return None;
    }
    let spread = variances(differences);
    // An axis without noise says nothing.
    let scale = spread.map(|variance| if variance > 0.0 { 1.0 / variance } else { 0.0 });
    let (mut products, mut all) = (0.0, 0.0);
    for pair in differences.windows(2) {
        let [a, b] = [pair[0], pair[1]];
        let squares = [a, b].map(|one| (one * one).dot(scale));
        if squares.iter().all(|square| *square <= OUTLYING) {
            products += (a * b).dot(scale);
            all += 0.5 * (squares[0] + squares[1]);
        }
    }
    let lag_1 = if all > 0.0 { products / all } else { 0.0 };
    Some(FastNoise { variance: spread.element_sum() / (3.0 * THIRD), lag_1 })
}
