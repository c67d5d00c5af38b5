//! Gauss and Newton's method: the knots' motions by which slices agree best along their lines.
//!
//! Derivatives are those at the slices' places of the round. They take a small change of the knots
//! for a motion of the slice where it then is. At a turn of 3° a step is off by a twentieth of
//! itself, which the next round makes good.

use glam::DAffine3;
use nalgebra::{DMatrix, DVector, SVector};

use super::knots::{Knots, NUMBERS};
use crate::crossings::fit::{Equations, MOST_MM, ROUNDS, displaced_mm};
use crate::crossings::line::Lines;
use crate::crossings::state::{Change, Placed, Placing};

/// Standard deviations of a knot's motion before anything is known: 2 mm, 2°.
const BEFORE: [f64; NUMBERS] = {
    const TURN: f64 = 2.0 * std::f64::consts::PI / 180.0;
    [2.0, 2.0, 2.0, TURN, TURN, TURN]
};
/// Displacement of a knot in a round below which the method has converged, mm: a tenth of the
/// smallest standard errors.
const LEAST_MM: f64 = 0.01;
/// Numbers of the motions of two slices.
const OF_BOTH: usize = 2 * NUMBERS;

/// The method's state.
pub(super) struct Fit<'a> {
    knots: &'a Knots,
    /// The slices by the poses in use.
    start: Placing,
    /// The knots' numbers.
    pub(super) numbers: DVector<f64>,
}

/// Normal equations, line by line, of the motions of two slices.
pub(super) type BySlice = Equations<OF_BOTH>;

/// Matrix and right side of the knots' normal equations.
type Sums = (DMatrix<f64>, DVector<f64>);

impl<'a> Fit<'a> {
    /// Begins without a motion.
    pub(super) fn new(knots: &'a Knots, start: Placing) -> Self {
        Self { knots, start, numbers: DVector::zeros(knots.count * NUMBERS) }
    }

    /// Returns the slices, moved.
    pub(super) fn placing(&self) -> Placing {
        let moved = |(slice, placed): (usize, &Option<Placed>)| {
            let by: DAffine3 = self.knots.moved(slice, &self.numbers);
            placed.map(|placed| Placed { world_from_picture: placed.world_from_picture * by, rate: placed.rate * by })
        };
        Placing { slices: self.start.slices.iter().enumerate().map(moved).collect(), ..self.start.clone() }
    }

    /// Returns the normal equations, line by line, of the motions of the two slices.
    pub(super) fn equations(&self, lines: &Lines<'_>) -> BySlice {
        let points = lines.points_by_slice(&self.placing());
        let both = |by: &[Change; 2]| SVector::from_fn(|k, _| by[k / NUMBERS][k % NUMBERS]);
        let line = |line: &Vec<_>| line.iter().map(|(difference, by)| (*difference, both(by))).collect();
        Equations::of(&points.iter().map(line).collect::<Vec<_>>())
    }

    /// Returns the sums of the knots' equations over the lines that `is_in` accepts.
    pub(super) fn sums(&self, equations: &BySlice, pairs: &[[usize; 2]], is_in: impl Fn(usize) -> bool) -> Sums {
        sums(self.knots, equations, pairs, is_in)
    }

    /// Returns the standard deviations of the knots' numbers before anything is known.
    pub(super) fn before(&self) -> DVector<f64> {
        DVector::from_fn(self.numbers.len(), |k, _| BEFORE[k % NUMBERS])
    }

    /// Returns the change that the normal equations ask for.
    pub(super) fn solved(&self, (mut a, b): Sums) -> DVector<f64> {
        let before = self.before().map(|sd| 1.0 / (sd * sd));
        let b = b + self.numbers.component_mul(&before);
        a += DMatrix::from_diagonal(&before);
        // Positive definite by what is known before.
        -a.cholesky().map_or_else(|| DVector::zeros(b.len()), |factor| factor.solve(&b))
    }

    /// Moves the knots until the slices agree no better.
    pub(super) fn improve(&mut self, lines: &Lines<'_>) {
        for _ in 0..ROUNDS {
            let mut change = self.solved(self.sums(&self.equations(lines), lines.pairs, |_| true));
            let mm = change.as_slice().chunks_exact(NUMBERS).map(displaced_mm).fold(0.0, f64::max);
            change *= (MOST_MM / mm).min(1.0);
            self.numbers += change;
            if mm < LEAST_MM {
                break;
            }
        }
    }
}

/// Returns the sums of knots' equations over the lines that `is_in` accepts.
pub(super) fn sums(knots: &Knots, equations: &BySlice, pairs: &[[usize; 2]], is_in: impl Fn(usize) -> bool) -> Sums {
    let size = knots.count * NUMBERS;
    let (mut a, mut b) = (DMatrix::zeros(size, size), DVector::zeros(size));
    let lines = pairs.iter().zip(&equations.lines).enumerate().filter(|(line, _)| is_in(*line));
    for (_, (pair, (of, with))) in lines {
        // The knots of the first slice, then those of the second, with their place in the line's.
        let sides = [0, 1].map(|side| knots.shares[pair[side]].iter().map(move |share| (side, share)));
        let all: Vec<(usize, &(usize, f64))> = sides.into_iter().flatten().collect();
        for (row, (knot, share)) in &all {
            let place = (knot * NUMBERS, row * NUMBERS);
            let own = with.fixed_rows::<NUMBERS>(place.1) * *share;
            let mut sum = b.fixed_rows_mut::<NUMBERS>(place.0);
            sum += own;
            for (column, (other, by)) in &all {
                let block = of.fixed_view::<NUMBERS, NUMBERS>(place.1, column * NUMBERS) * (share * by);
                let mut sum = a.fixed_view_mut::<NUMBERS, NUMBERS>(place.0, other * NUMBERS);
                sum += block;
            }
        }
    }
    (a, b)
}
