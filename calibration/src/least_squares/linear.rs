//! Solves the linear problem of each step, min |J·y + r|, by QR and singular values.

use nalgebra::{DMatrix, DVector};

/// A decomposed Jacobian, with the residuals along its singular vectors.
#[derive(Debug, Clone)]
pub(super) struct Linear {
    /// Singular values, the largest first.
    values: Vec<f64>,
    /// Right singular vectors, one per row.
    directions: DMatrix<f64>,
    /// The residuals along the left singular vectors.
    along: Vec<f64>,
}

/// Singular values below this share of the largest are rounding errors.
const ROUNDING: f64 = 1e-14;

impl Linear {
    /// Decomposes a Jacobian, row major, with at least as many rows as columns, and one
    /// residual per row; all finite.
    pub(super) fn of(columns: usize, jacobian: &[f64], residuals: &[f64]) -> Self {
        let factors = DMatrix::from_row_slice(residuals.len(), columns, jacobian).qr();
        let mut turned = DVector::from_column_slice(residuals);
        factors.q_tr_mul(&mut turned);
        let singular = factors.r().svd(true, true);
        let (Some(left), Some(directions)) = (singular.u, singular.v_t) else {
            // Both sets of vectors were requested.
            unreachable!("singular vectors");
        };
        let along = |k| left.column(k).iter().zip(turned.iter()).map(|(u, r)| u * r).sum();
        Self {
            along: (0..columns).map(along).collect(),
            values: singular.singular_values.as_slice().to_vec(),
            directions,
        }
    }

    /// Returns the step that minimises |J·y + r|² + damping·(largest singular value)²·|y|². It
    /// has no component along directions that rounding alone determines.
    pub(super) fn step(&self, damping: f64) -> Vec<f64> {
        let largest = self.values.first().copied().unwrap_or(0.0);
        let floor = damping * largest * largest;
        let mut step = vec![0.0; self.values.len()];
        for (k, (value, along)) in self.values.iter().zip(&self.along).enumerate() {
            if *value > ROUNDING * largest {
                let size = -value * along / (value * value + floor);
                step.iter_mut().enumerate().for_each(|(i, y)| *y += size * self.directions[(k, i)]);
            }
        }
        step
    }

    /// Returns the condition number: the largest singular value over the smallest, ∞ if that
    /// is 0.
    pub(super) fn condition(&self) -> f64 {
        match (self.values.first(), self.values.last()) {
            (Some(largest), Some(smallest)) => largest / smallest,
            _ => 1.0,
        }
    }

    /// Returns singular values and right singular vectors, the weakest first.
    pub(super) fn weakest_first(&self) -> impl Iterator<Item = (f64, Vec<f64>)> {
        let direction = |k: usize| (self.values[k], self.directions.row(k).iter().copied().collect());
        (0..self.values.len()).rev().map(direction)
    }

    /// Returns (JᵀJ)⁻¹, row major.
    pub(super) fn inverse_normal(&self) -> Vec<f64> {
        let n = self.values.len();
        let mut inverse = vec![0.0; n * n];
        for (k, value) in self.values.iter().enumerate() {
            for i in 0..n {
                for j in 0..n {
                    inverse[i * n + j] += self.directions[(k, i)] * self.directions[(k, j)] / (value * value);
                }
            }
        }
        inverse
    }
}
