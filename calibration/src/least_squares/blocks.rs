//! Residuals, their derivatives, and their noise.

use glam::{DMat3, DVec3};

use super::parameters::{Block, Parameters};

/// A lower triangle that maps the noise of N numbers to independent noise of standard
/// deviation 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Whitening<const N: usize>([[f64; N]; N]);

impl<const N: usize> Whitening<N> {
    /// Returns the whitening of independent numbers with one standard deviation.
    pub fn sd(sd: f64) -> Self {
        Self::sds([sd; N])
    }

    /// Returns the whitening of independent numbers with these standard deviations.
    pub fn sds(sds: [f64; N]) -> Self {
        let mut triangle = [[0.0; N]; N];
        for (i, sd) in sds.into_iter().enumerate() {
            triangle[i][i] = 1.0 / sd;
        }
        Self(triangle)
    }

    /// Returns the whitening of a covariance: the inverse of its Cholesky factor. A matrix that
    /// is not positive definite gives NaN, which [`solve`](super::solve()) refuses.
    pub fn covariance(covariance: &[[f64; N]; N]) -> Self {
        let mut factor = [[0.0; N]; N];
        for i in 0..N {
            for j in 0..=i {
                let rest = covariance[i][j] - (0..j).map(|k| factor[i][k] * factor[j][k]).sum::<f64>();
                factor[i][j] = if i == j { rest.sqrt() } else { rest / factor[j][j] };
            }
        }
        // Inverts column by column, from the diagonal down.
        let mut inverse = [[0.0; N]; N];
        for j in 0..N {
            let mut column = [0.0; N];
            for i in j..N {
                let unit = if i == j { 1.0 } else { 0.0 };
                column[i] = (unit - (j..i).map(|k| factor[i][k] * column[k]).sum::<f64>()) / factor[i][i];
            }
            inverse.iter_mut().zip(column).for_each(|(row, entry)| row[j] = entry);
        }
        Self(inverse)
    }

    fn apply(&self, row: usize, column: impl Fn(usize) -> f64) -> f64 {
        (0..=row).map(|k| self.0[row][k] * column(k)).sum()
    }
}

/// Returns the rows of a matrix, in the form for [`Residual::by`]: row i is the change of
/// residual i with a step's components.
pub fn rows(matrix: DMat3) -> [[f64; 3]; 3] {
    matrix.transpose().to_cols_array_2d()
}

/// Returns the derivative of R·x by a step of R from the left, with `point` = R·x: −[R·x]×. For
/// a step from the right it is R times this of x.
pub fn turned(point: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::X.cross(point), DVec3::Y.cross(point), DVec3::Z.cross(point))
}

/// All residuals at a state, whitened, in the order in which they were added.
#[derive(Debug, Clone)]
pub struct Blocks<'a> {
    /// First component of each block of parameters in a step.
    columns: &'a [Option<usize>],
    /// Components of a step.
    width: usize,
    /// Whether derivatives are requested.
    derivatives: bool,
    residuals: Vec<f64>,
    jacobian: Vec<f64>,
    /// End of each block of residuals.
    ends: Vec<usize>,
}

impl<'a> Blocks<'a> {
    /// Collects the residuals that `evaluate` adds at a state.
    pub(super) fn of(
        parameters: &Parameters,
        columns: &'a [Option<usize>],
        derivatives: bool,
        evaluate: impl FnOnce(&mut Self),
    ) -> Self {
        let width = parameters.steps();
        let (residuals, jacobian, ends) = (Vec::new(), Vec::new(), Vec::new());
        let mut blocks = Self { columns, width, derivatives, residuals, jacobian, ends };
        evaluate(&mut blocks);
        blocks
    }

    /// Adds a residual of N components that belong together: a robust loss judges them by their
    /// common length. The caller adds derivatives to the returned value; derivatives by
    /// parameters that are not named are 0.
    pub fn add<'b, const N: usize>(
        &'b mut self,
        residual: [f64; N],
        whitening: &'b Whitening<N>,
    ) -> Residual<'b, 'a, N> {
        let first = self.residuals.len();
        self.residuals.extend((0..N).map(|i| whitening.apply(i, |k| residual[k])));
        if self.derivatives {
            self.jacobian.resize((first + N) * self.width, 0.0);
        }
        self.ends.push(first + N);
        Residual { blocks: self, whitening, first }
    }

    /// Returns whether derivatives are requested; costly derivatives may be skipped otherwise.
    pub fn wants_derivatives(&self) -> bool {
        self.derivatives
    }

    /// Returns the whitened residuals.
    pub(super) fn residuals(&self) -> &[f64] {
        &self.residuals
    }

    /// Returns the derivatives of the whitened residuals, row major.
    pub(super) fn jacobian(&self) -> &[f64] {
        &self.jacobian
    }

    /// Returns the range of residuals of each block.
    pub(super) fn ranges(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        self.ends.iter().scan(0, |first, &end| Some(std::mem::replace(first, end)..end))
    }

    /// Returns each block's number of components and length, whitened.
    pub(super) fn lengths(&self) -> Vec<(usize, f64)> {
        let length = |range: std::ops::Range<usize>| {
            (range.len(), self.residuals[range].iter().map(|r| r * r).sum::<f64>().sqrt())
        };
        self.ranges().map(length).collect()
    }
}

/// A residual just added, to which derivatives can be added.
#[derive(Debug)]
pub struct Residual<'b, 'a, const N: usize> {
    blocks: &'b mut Blocks<'a>,
    whitening: &'b Whitening<N>,
    first: usize,
}

impl<const N: usize> Residual<'_, '_, N> {
    /// Adds the derivatives by a block of parameters. Row i is the change of residual i (as
    /// given, not whitened) with the components of the block's step.
    pub fn by<const K: usize>(self, block: impl Block<K>, derivatives: [[f64; K]; N]) -> Self {
        let Blocks { columns, width, derivatives: has_derivatives, jacobian, .. } = &mut *self.blocks;
        let (true, Some(column)) = (*has_derivatives, columns[block.place().block()]) else { return self };
        for i in 0..N {
            let at = (self.first + i) * *width + column;
            for (k, entry) in jacobian[at..at + K].iter_mut().enumerate() {
                *entry += self.whitening.apply(i, |j| derivatives[j][k]);
            }
        }
        self
    }
}
