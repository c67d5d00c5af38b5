//! Gauss and Newton's method: the numbers by which slices agree best along their lines.

use nalgebra::{SMatrix, SVector};

use super::line::{END_MARGIN_S, Lines};
use super::state::{COUNT, Change, State, displacements};
use crate::statistics::median;
use glam::DVec3;

pub(super) type Square = SMatrix<f64, COUNT, COUNT>;

/// Standard deviations of the numbers before anything is known: 10 mm, 10°, 10 %, 100 ms. They
/// keep a number where it is if no line depends on it.
pub(super) const BEFORE: [f64; COUNT] = {
    const TURN: f64 = 10.0 * std::f64::consts::PI / 180.0;
    [10.0, 10.0, 10.0, TURN, TURN, TURN, 0.1, 0.1, 0.1]
};
/// Rounds with images of one blur.
pub(crate) const ROUNDS: usize = 8;
/// Largest displacement of a point 25 mm from the image's middle in a round, mm, and the one below
/// which the method has converged.
pub(crate) const MOST_MM: f64 = 3.0;
const LEAST_MM: f64 = 0.001;
/// Largest change of the lag in a round, s.
const MOST_S: f64 = 0.03;
/// Cauchy's scale, in medians of the differences' amounts.
const SCALE: f64 = 2.0;
/// Smallest ratio of the influence's mean slope to the mean weight.
const LEAST_RATIO: f64 = 0.3;
/// Smallest standard deviation of differences, grey levels: that of rounding.
const ROUNDING: f64 = 0.3;

/// The method's state.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    pub(super) state: State,
    /// Sum of the changes.
    pub(super) total: Change,
}

/// Normal equations, line by line, in units of the differences' variance over one point a line: the
/// points of a line share the errors of two poses.
pub(crate) struct Equations<const N: usize> {
    pub(crate) lines: Vec<Sums<N>>,
}

/// Matrix and right side of normal equations.
pub(crate) type Sums<const N: usize> = (SMatrix<f64, N, N>, SVector<f64, N>);

impl<const N: usize> Equations<N> {
    /// Weights the points, differences with their derivatives, by Cauchy's function of the
    /// differences.
    pub(crate) fn of(points: &[Vec<(f64, SVector<f64, N>)>]) -> Self {
        let mut amounts: Vec<f64> = points.iter().flatten().map(|(difference, _)| difference.abs()).collect();
        let scale = (SCALE * median(&mut amounts)).max(ROUNDING);
        let weight = |difference: f64| 1.0 / (1.0 + (difference / scale).powi(2));
        // The influence of a difference is weight · difference. Its slope, which the step and the
        // standard errors depend on, is less than the weight; a mean ratio keeps the sums positive.
        let (weights, slopes) = points.iter().flatten().fold((0.0, 0.0), |(weights, slopes), (difference, _)| {
            let w = weight(*difference);
            (weights + w, slopes + w * (2.0 * w - 1.0))
        });
        let ratio = (slopes / weights).max(LEAST_RATIO);
        let none = || (SMatrix::zeros(), SVector::zeros());
        let sum = |line: &Vec<(f64, SVector<f64, N>)>| {
            let per = 1.0 / (scale * scale * line.len().max(1) as f64);
            line.iter().fold(none(), |(a, b): Sums<N>, (difference, by)| {
                let weight = per * weight(*difference);
                (a + by * by.transpose() * (weight * ratio), b + by * (difference * weight))
            })
        };
        Self { lines: points.iter().map(sum).collect() }
    }

    /// Returns the sums over the lines that `is_in` accepts.
    pub(super) fn sum(&self, is_in: impl Fn(usize) -> bool) -> Sums<N> {
        let lines = self.lines.iter().enumerate().filter(|(line, _)| is_in(*line));
        lines.fold((SMatrix::zeros(), SVector::zeros()), |(a, b), (_, (of, with))| (a + of, b + with))
    }
}

/// Returns the change that the normal equations ask for.
pub(super) fn solved((mut a, b): (Square, Change), total: &Change) -> Change {
    let before = Change::from(BEFORE.map(|sd| 1.0 / (sd * sd)));
    a += Square::from_diagonal(&before);
    let b = b + total.component_mul(&before);
    // Positive definite by what is known before.
    -a.cholesky().map_or_else(Change::zeros, |factor| factor.solve(&b))
}

impl Fit {
    /// Begins at a calibration with a lag.
    pub(super) fn new(start: State, lag_s: f64) -> Self {
        let mut total = Change::zeros();
        total[8] = lag_s;
        Self { state: start.changed(&total), total }
    }

    /// Changes the numbers until the slices agree no better.
    pub(super) fn improve(&mut self, lines: &Lines<'_>) {
        for _ in 0..ROUNDS {
            let equations = Equations::of(&lines.points(&self.state));
            let mut change = solved(equations.sum(|_| true), &self.total);
            let mm = displaced_mm(change.as_slice());
            change *= (MOST_MM / mm).min(MOST_S / change[8].abs()).min(1.0);
            let lag_s = (self.state.lag_s + change[8]).clamp(-END_MARGIN_S, END_MARGIN_S);
            change[8] = lag_s - self.state.lag_s;
            self.state = self.state.changed(&change);
            self.total += change;
            if mm < LEAST_MM {
                break;
            }
        }
    }
}

/// Returns the largest displacement of points about the image's middle, mm.
pub(crate) fn displaced_mm(change: &[f64]) -> f64 {
    let at = |p: DVec3| displacements(p).iter().zip(change).map(|(by, x)| *by * *x).sum::<DVec3>().length();
    let corners = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)];
    corners.iter().map(|(u, v)| at(DVec3::new(25.0 * u, 25.0 * v, 0.0))).fold(0.0, f64::max)
}
