//! How sure parameters are together.

use nalgebra::{Cholesky, DMatrix};

use super::blocks::{Blocks, Residual, Whitening};
use super::parameters::{Block, Parameters};

/// The covariance of a step of all parameters at a state.
#[derive(Debug, Clone)]
pub struct Certainty {
    parameters: Parameters,
    columns: Vec<Option<usize>>,
    /// Of a step's components.
    covariance: DMatrix<f64>,
}

impl Certainty {
    /// Of a covariance, row major by a step's components.
    pub(super) fn new(parameters: &Parameters, columns: &[Option<usize>], covariance: &[f64]) -> Self {
        let n = parameters.steps();
        let covariance = DMatrix::from_row_slice(n, n, covariance);
        Self { parameters: parameters.clone(), columns: columns.to_vec(), covariance }
    }

    /// Covariance of the steps of two blocks: rows the first's components, columns the second's; 0 of a block that is held.
    pub fn between<const K: usize, const L: usize>(&self, one: impl Block<K>, other: impl Block<L>) -> [[f64; L]; K] {
        match [one.place(), other.place()].map(|place| self.columns[place.block()]) {
            [Some(row), Some(column)] => {
                std::array::from_fn(|i| std::array::from_fn(|j| self.covariance[(row + i, column + j)]))
            }
            _ => [[0.0; L]; K],
        }
    }

    /// Covariance, to first order, of N numbers that depend on the parameters, whose derivatives are given as those of a residual are:
    ///
    /// ```text
    /// // Where the image's corner lies: R·x + t.
    /// let covariance_mm2 = certainty.propagated(|corner| corner.by(turn, rows(turned(r * x))).by(shift, rows(DMat3::IDENTITY)));
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

    /// As sure as it would be if all of these residuals had been measured too, each so many times: information adds. `None` where one of their derivatives is no number.
    ///
    /// By what they change, C − CJᵀ(1/times + JCJᵀ)⁻¹JC: nothing that is hardly determined is inverted.
    pub fn with(&self, times: f64, put: impl FnOnce(&mut Blocks<'_>)) -> Option<Self> {
        let rows = self.derivatives(put);
        let gain = &self.covariance * rows.transpose();
        let spread = DMatrix::identity(rows.nrows(), rows.nrows()) / times + &rows * &gain;
        let half = Cholesky::new(spread)?.l().solve_lower_triangular(&gain.transpose())?;
        let covariance = &self.covariance - half.transpose() * half;
        Some(Self { covariance, ..self.clone() })
    }

    /// Whitened derivatives of what is put down: a row a residual.
    fn derivatives(&self, put: impl FnOnce(&mut Blocks<'_>)) -> DMatrix<f64> {
        let blocks = Blocks::of(&self.parameters, &self.columns, true, put);
        DMatrix::from_row_slice(blocks.residuals().len(), self.parameters.steps(), blocks.jacobian())
    }
}
