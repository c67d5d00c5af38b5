//! Joint covariance of parameters.

use nalgebra::{Cholesky, DMatrix};

use super::blocks::{Blocks, Residual, Whitening};
use super::parameters::{Block, Parameters};

/// The covariance of a step of all parameters at a state.
#[derive(Debug, Clone)]
pub struct Certainty {
    parameters: Parameters,
    columns: Vec<Option<usize>>,
    /// Covariance of a step's components.
    covariance: DMatrix<f64>,
}

impl Certainty {
    /// Takes a covariance, row major by a step's components.
    pub(super) fn new(parameters: &Parameters, columns: &[Option<usize>], covariance: &[f64]) -> Self {
        let n = parameters.steps();
        let covariance = DMatrix::from_row_slice(n, n, covariance);
        Self { parameters: parameters.clone(), columns: columns.to_vec(), covariance }
    }

    /// Returns the covariance of the steps of two blocks: rows for the first's components,
    /// columns for the second's; 0 for a fixed block.
    pub fn between<const K: usize, const L: usize>(&self, one: impl Block<K>, other: impl Block<L>) -> [[f64; L]; K] {
        match [one.place(), other.place()].map(|place| self.columns[place.block()]) {
            [Some(row), Some(column)] => {
                std::array::from_fn(|i| std::array::from_fn(|j| self.covariance[(row + i, column + j)]))
            }
            _ => [[0.0; L]; K],
        }
    }

    /// Returns the covariance, to first order, of N numbers that depend on the parameters.
    /// Their derivatives are given like those of a residual:
    ///
    /// ```text
    /// // Position of the image's corner: R·x + t.
    /// let covariance_mm2 = certainty
    ///     .propagated(|corner| corner.by(turn, rows(turned(r * x))).by(shift,
    /// rows(DMat3::IDENTITY)));
    /// ```
    pub fn propagated<const N: usize>(
        &self,
        derivatives: impl for<'b, 'a> FnOnce(Residual<'b, 'a, N>) -> Residual<'b, 'a, N>,
    ) -> [[f64; N]; N] {
        let rows = self.derivatives(|blocks| {
            let unit = Whitening::sd(1.0);
            derivatives(blocks.add([0.0; N], &unit));
        });
        let covariance = &rows * &self.covariance * rows.transpose();
        std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)]))
    }

    /// Returns the covariance with these additional residuals, each measured `times` times:
    /// information adds. `None` if a derivative is NaN.
    ///
    /// The update is C − CJᵀ(1/times + JCJᵀ)⁻¹JC, so that nearly undetermined directions are
    /// never inverted.
    pub fn with(&self, times: f64, put: impl FnOnce(&mut Blocks<'_>)) -> Option<Self> {
        let rows = self.derivatives(put);
        let gain = &self.covariance * rows.transpose();
        let spread = DMatrix::identity(rows.nrows(), rows.nrows()) / times + &rows * &gain;
        let half = Cholesky::new(spread)?.l().solve_lower_triangular(&gain.transpose())?;
        let covariance = &self.covariance - half.transpose() * half;
        Some(Self { covariance, ..self.clone() })
    }

    /// Returns the covariance of the whitened residuals that `put` adds, due to that of the
    /// parameters: the share of their noise that the fit has absorbed, if it used them.
    pub(crate) fn absorbed(&self, put: impl FnOnce(&mut Blocks<'_>)) -> DMatrix<f64> {
        let rows = self.derivatives(put);
        &rows * &self.covariance * rows.transpose()
    }

    /// Returns the whitened derivatives of the residuals that `put` adds, one row per residual.
    fn derivatives(&self, put: impl FnOnce(&mut Blocks<'_>)) -> DMatrix<f64> {
        let blocks = Blocks::of(&self.parameters, &self.columns, true, put);
        DMatrix::from_row_slice(blocks.residuals().len(), self.parameters.steps(), blocks.jacobian())
    }
}
