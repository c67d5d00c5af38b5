//! Standard errors of the nine numbers, and what the sweeps do not determine.
//!
//! The standard errors are a jackknife over stretches of slices. A sum over points would trust
//! itself too much: all points of a slice share the error of its pose.

use glam::DVec3;
use nalgebra::{DMatrix, DVector, SMatrix};

use super::fit::{BEFORE, Equations, Fit, Square, solved};
use super::line::Lines;
use super::state::{COUNT, Change, State, displacements};
use crate::error::Motion;
use crate::slices::Slices;

/// Slices of a stretch, and number of stretches.
const STRETCH: usize = 10;
const STRETCHES: std::ops::RangeInclusive<usize> = 6..=40;
/// Part of what is unknown before that a determined number may have kept.
const KEPT: f64 = 0.01;

/// Covariance of the nine numbers.
#[derive(Debug, Clone)]
pub(super) struct Certainty {
    pub(super) covariance: Square,
}

impl Certainty {
    pub(super) fn of(slices: &Slices, lines: &Lines<'_>, fit: &Fit) -> Self {
        let equations = Equations::of(&lines.points(&fit.state));
        let stretches = stretches(slices, lines.pairs);
        let count = stretches.iter().flatten().max().map_or(0, |last| last + 1);
        let touches =
            |line: usize, stretch: usize| lines.pairs[line].iter().any(|slice| stretches[*slice] == Some(stretch));
        let without = |stretch: usize| solved(equations.sum(|line| !touches(line, stretch)), &fit.total);
        let changes: Vec<DVector<f64>> =
            (0..count).map(|stretch| DVector::from_column_slice(without(stretch).as_slice())).collect();
        let a = equations.sum(|_| true).0;
        let a = DMatrix::from_column_slice(COUNT, COUNT, a.as_slice());
        let covariance = jackknife(&changes) + undetermined(&a, &DVector::from_column_slice(&BEFORE));
        Self { covariance: Square::from_column_slice(covariance.as_slice()) }
    }

    /// Returns the standard errors of the numbers.
    pub(super) fn errors(&self) -> Change {
        self.covariance.diagonal().map(f64::sqrt)
    }

    /// Returns the variance of a point's displacement, mm².
    pub(super) fn variance_mm2(&self, p: DVec3) -> f64 {
        let by = displacements(p);
        let rows = SMatrix::<f64, 3, COUNT>::from_fn(|axis, number| by.get(number).map_or(0.0, |by| by[axis]));
        (rows * self.covariance * rows.transpose()).trace()
    }

    /// Returns the motion that would help most, with this number of directions.
    pub(super) fn motion(&self, directions: usize) -> Motion {
        // In parts of what was unknown before.
        let shares = self.errors().component_div(&Change::from(BEFORE));
        let (worst, _) = shares.argmax();
        match directions {
            _ if worst == COUNT - 1 => Motion::Faster,
            0 | 1 => Motion::Turn,
            _ => Motion::Tilt,
        }
    }
}

/// Returns the covariance of numbers from those found without each of the stretches.
pub(crate) fn jackknife(without: &[DVector<f64>]) -> DMatrix<f64> {
    let (n, count) = (without.len() as f64, without.first().map_or(0, DVector::len));
    let mean = without.iter().fold(DVector::zeros(count), |sum, change| sum + change) / n;
    let spread = without.iter().fold(DMatrix::zeros(count, count), |sum, change| {
        let off = change - &mean;
        sum + &off * off.transpose()
    });
    spread * ((n - 1.0) / n)
}

/// Returns the stretch of each slice that takes part, in the order of time.
pub(crate) fn stretches(slices: &Slices, pairs: &[[usize; 2]]) -> Vec<Option<usize>> {
    let mut order: Vec<usize> = pairs.iter().flatten().copied().collect();
    order.sort_by(|a, b| slices.pixels[*a].0.total_cmp(&slices.pixels[*b].0).then(a.cmp(b)));
    order.dedup();
    let count = (order.len() / STRETCH).clamp(*STRETCHES.start(), *STRETCHES.end());
    let mut stretches = vec![None; slices.pixels.len()];
    for (rank, slice) in order.iter().enumerate() {
        stretches[*slice] = Some(rank * count / order.len());
    }
    stretches
}

/// Returns the covariance of what normal equations hardly determine, with standard deviations from
/// before: there the jackknife has no spread.
pub(crate) fn undetermined(a: &DMatrix<f64>, before: &DVector<f64>) -> DMatrix<f64> {
    let scale = DMatrix::from_diagonal(before);
    let eigen = (&scale * a * &scale).symmetric_eigen();
    let mut covariance = DMatrix::zeros(before.len(), before.len());
    for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        let kept = 1.0 / (1.0 + value.max(0.0));
        if kept > KEPT {
            let along = &scale * vector;
            covariance += &along * along.transpose() * kept;
        }
    }
    covariance
}

/// Returns the places of the stated points in mm of the image.
pub(crate) fn places(slices: &Slices, state: &State) -> [DVec3; 9] {
    State::points(slices).map(|pixel| state.picture_from_pixel.transform_point3(pixel))
}
