//! What scatters dots about their wires: the tracker's noise, which moves all dots of a picture together, and that of each dot's centre.
//!
//! A picture's residuals have the covariance
//!
//! ```text
//! C = σ_t² ΣTTᵀ + σ_r² ΣRRᵀ + σ_u² UUᵀ + σ_v² VVᵀ
//! ```
//!
//! T and R by the shifts and turns of each sensor at its own place, U and V by each dot's shift along u and v. How large the four are is found from the residuals themselves, as likely as
//! can be, by steps that never make it less likely (Zhou, Hu, Qiao & Zhou, *MM algorithms for variance components models*, J. Comput. Graph. Stat. 28, 2019).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Sources of scatter.
pub const SOURCES: usize = 4;
/// Steps of the search, which goes on from one call to the next; each brings a component about half-way.
const STEPS: usize = 12;
/// A component changes by less than this of itself at the end.
const SAME: f64 = 1e-4;
/// Of a component that begins at 1 in its typical unit no less is left: pictures without any noise have rounding.
const LEAST: f64 = 1e-18;

/// Standard deviations of what scatters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scatter {
    /// A sensor's position, along each axis, mm.
    pub position_mm: f64,
    /// A sensor's orientation, about each axis, rad.
    pub turn_rad: f64,
    /// A dot's centre along u and v, pixels.
    pub dot_px: [f64; 2],
}

impl Scatter {
    /// Before anything is known: an electromagnetic tracker's, and dots of some pixels.
    pub const USUAL: Self = Self { position_mm: 0.3, turn_rad: 0.004, dot_px: [1.5, 1.0] };

    fn variances(self) -> [f64; SOURCES] {
        [self.position_mm, self.turn_rad, self.dot_px[0], self.dot_px[1]].map(|sd| sd * sd)
    }

    fn of([position, turn, u, v]: [f64; SOURCES]) -> Self {
        Self { position_mm: position.sqrt(), turn_rad: turn.sqrt(), dot_px: [u.sqrt(), v.sqrt()] }
    }
}

/// A picture's residuals by what scatters them.
#[derive(Debug, Clone)]
pub(super) struct Scattered {
    /// mm.
    pub(super) residuals: DVector<f64>,
    /// Derivatives by each source's unit steps: sensors' positions, their turns, dots along u, along v.
    pub(super) by: [DMatrix<f64>; SOURCES],
}

impl Scattered {
    /// The covariance's factor; `None` where there is none, without any scatter.
    pub(super) fn factor(&self, scatter: Scatter) -> Option<Cholesky<f64, Dyn>> {
        self.covariance(&scatter.variances()).cholesky()
    }

    fn covariance(&self, variances: &[f64; SOURCES]) -> DMatrix<f64> {
        sum(&self.products(), variances)
    }

    /// What one unit of each source's variance makes.
    fn products(&self) -> [DMatrix<f64>; SOURCES] {
        [0, 1, 2, 3].map(|source| &self.by[source] * self.by[source].transpose())
    }
}

fn sum(products: &[DMatrix<f64>; SOURCES], variances: &[f64; SOURCES]) -> DMatrix<f64> {
    let mut sum = &products[0] * variances[0];
    for (product, variance) in products.iter().zip(variances).skip(1) {
        sum.zip_apply(product, |entry, part| *entry += variance * part);
    }
    sum
}

/// The scatter that makes the residuals of all pictures most likely.
pub(super) fn most_likely(pictures: &[Scattered], start: Scatter) -> Scatter {
    let floor = Scatter::USUAL.variances().map(|variance| variance * LEAST);
    let mut variances = start.variances();
    let products: Vec<_> = pictures.iter().map(Scattered::products).collect();
    for _ in 0..STEPS {
        let (mut squares, mut traces) = ([0.0; SOURCES], [0.0; SOURCES]);
        for (picture, products) in pictures.iter().zip(&products) {
            let Some(factor) = sum(products, &variances).cholesky() else { continue };
            let weighted = factor.solve(&picture.residuals);
            for (source, by) in picture.by.iter().enumerate() {
                if by.ncols() == 0 {
                    continue;
                }
                squares[source] += (by.transpose() * &weighted).norm_squared();
                if let Some(whitened) = factor.l_dirty().solve_lower_triangular(by) {
                    traces[source] += whitened.norm_squared();
                }
            }
        }
        let mut same = true;
        for source in 0..SOURCES {
            if traces[source] > 0.0 {
                let factor = (squares[source] / traces[source]).sqrt();
                same &= (factor - 1.0).abs() < SAME;
                variances[source] = (variances[source] * factor).max(floor[source]);
            }
        }
        if same {
            break;
        }
    }
    Scatter::of(variances)
}
