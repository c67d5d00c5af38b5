//! The knots' motions by which slices agree best, with their covariance.

use glam::{DAffine3, DVec3};
use nalgebra::{DMatrix, DVector, SMatrix};

use super::crossed::Crossed;
use super::fit::{BySlice, Fit, sums};
use super::knots::{Knots, NUMBERS};
use crate::crossings::certainty::{jackknife, places, stretches, undetermined};
use crate::crossings::line::Lines;
use crate::crossings::state::{State, displacements};
use crate::crossings::{ALIKE, COARSE_MM, FINE_MM, some};
use crate::error::DriftError;
use crate::slices::Slices;
use crate::statistics::median;

/// Sum of squares of a motion's numbers that displaces the image by 1 mm.
pub(super) type Gram = SMatrix<f64, NUMBERS, NUMBERS>;

/// Motions of a scan's sweeps.
pub(super) struct Fitted {
    pub(super) crossed: Crossed,
    pub(super) knots: Knots,
    /// From mm about the image's middle to the probe.
    pub(super) probe_from_picture: DAffine3,
    /// The knots' numbers, and their covariance.
    pub(super) numbers: DVector<f64>,
    pub(super) covariance: DMatrix<f64>,
    /// Normal equations where the slices now are.
    equations: BySlice,
    /// The points at which displacements are stated, mm of the image.
    pub(super) points: [DVec3; 9],
    /// Medians of the correlations along the lines, before and after.
    pub(super) correlations: [f64; 2],
}

impl Fitted {
    /// Finds the motions, with a number of knots of each sweep.
    pub(super) fn new(slices: &Slices, per_sweep: usize) -> Result<Self, DriftError> {
        let start = State::of(slices);
        let crossed = Crossed::of(slices, &start)?;
        let knots = Knots::of(slices, &crossed, per_sweep, 1);
        let placing = start.placing(slices);
        let mut fit = Fit::new(&knots, placing.clone());
        // A part of the lines brings the method near.
        let some = some(&crossed.pairs);
        COARSE_MM.iter().for_each(|blur_mm| fit.improve(&Lines::new(slices, &some, *blur_mm)));
        let lines = Lines::new(slices, &crossed.pairs, FINE_MM);
        fit.improve(&lines);
        let [before, after] = [&placing, &fit.placing()].map(|placing| lines.correlations(placing));
        if let Some((sweep, correlation)) = crossed.worst(&after).filter(|(_, correlation)| !(*correlation >= ALIKE)) {
            return Err(DriftError::Unrelated { sweep, correlation, least: ALIKE });
        }
        let correlations = [before, after].map(|of| median(&mut of.into_iter().flatten().collect::<Vec<f64>>()));
        let equations = fit.equations(&lines);
        let covariance = covariance(slices, &equations, lines.pairs, &fit);
        Ok(Self {
            probe_from_picture: start.probe_from_picture,
            numbers: fit.numbers,
            covariance,
            equations,
            points: places(slices, &start),
            correlations,
            knots,
            crossed,
        })
    }

    /// Returns the matrix of normal equations of other knots, where the slices now are.
    pub(super) fn information(&self, of: &Knots) -> DMatrix<f64> {
        sums(of, &self.equations, &self.crossed.pairs, |_| true).0
    }

    /// Returns the matrix whose quadratic form of a motion is the image's mean square displacement,
    /// mm².
    pub(super) fn gram(&self) -> Gram {
        let of = |p: &DVec3| {
            let by = displacements(*p);
            let rows = SMatrix::<f64, 3, NUMBERS>::from_fn(|axis, number| by[number][axis]);
            rows.transpose() * rows
        };
        self.points.iter().map(of).sum::<Gram>() / self.points.len() as f64
    }
}

/// Returns the covariance of the knots' numbers.
fn covariance(slices: &Slices, equations: &BySlice, pairs: &[[usize; 2]], fit: &Fit<'_>) -> DMatrix<f64> {
    let stretches = stretches(slices, pairs);
    let count = stretches.iter().flatten().max().map_or(0, |last| last + 1);
    let touches = |line: usize, stretch: usize| pairs[line].iter().any(|slice| stretches[*slice] == Some(stretch));
    let without = |stretch: usize| fit.solved(fit.sums(equations, pairs, |line| !touches(line, stretch)));
    let changes: Vec<DVector<f64>> = (0..count).map(without).collect();
    let all = fit.sums(equations, pairs, |_| true).0;
    jackknife(&changes) + undetermined(&all, &fit.before())
}
