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

use nalgebra::{DMatrix, DVector};

/// Sources of scatter.
pub const SOURCES: usize = 4;
/// Steps of the search, which goes on from one call to the next; each brings a component about half-way.
const STEPS: usize = 12;
/// Long steps at most …
const LEAPS: usize = 15;
/// … each of no more than so many of what two steps tell, …
const FARTHEST: f64 = 30.0;
/// … and of no more than so much of a variance's logarithm.
const LONGEST: f64 = 6.0;
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

    pub(super) fn variances(self) -> [f64; SOURCES] {
        [self.position_mm, self.turn_rad, self.dot_px[0], self.dot_px[1]].map(|sd| sd * sd)
    }

    fn of([position, turn, u, v]: [f64; SOURCES]) -> Self {
        Self { position_mm: position.sqrt(), turn_rad: turn.sqrt(), dot_px: [u.sqrt(), v.sqrt()] }
    }

    /// The scatter that makes the residuals of all pictures most likely.
    pub(super) fn most_likely(pictures: &[Scattered], start: Self) -> Self {
        Self::of(most_likely(pictures, start.variances(), Self::USUAL.variances()))
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
    /// What makes the residuals independent and of standard deviation 1, by the sources' variances; nothing is changed where there is no scatter.
    pub(super) fn whitening(&self, variances: [f64; SOURCES]) -> DMatrix<f64> {
        let n = self.residuals.len();
        let factor = self.covariance(&variances).cholesky().map(|factor| factor.l());
        let inverse = factor.and_then(|l| l.solve_lower_triangular(&DMatrix::identity(n, n)));
        inverse.unwrap_or_else(|| DMatrix::identity(n, n))
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

/// The variances of the sources that make the residuals of all pictures most likely; of the usual ones some part is left in any case.
pub(super) fn most_likely(pictures: &[Scattered], start: [f64; SOURCES], usual: [f64; SOURCES]) -> [f64; SOURCES] {
    let likely = Likely::new(pictures, usual);
    let mut variances = start;
    for _ in 0..STEPS {
        let next = likely.step(variances);
        let same = (0..SOURCES).all(|source| (next[source] / variances[source]).ln().abs() < SAME);
        variances = next;
        if same {
            break;
        }
    }
    variances
}

/// The same, by longer steps: of sources that do much the same to pictures the share of each is found slowly otherwise. Two steps tell how the logarithms of the variances go on, and a third makes the
/// extrapolation good (Varadhan & Roland's SQUAREM, Scand. J. Stat. 35, 2008).
pub(super) fn settled(pictures: &[Scattered], start: [f64; SOURCES], usual: [f64; SOURCES]) -> [f64; SOURCES] {
    let likely = Likely::new(pictures, usual);
    let mut variances = start;
    for _ in 0..LEAPS {
        let first = likely.step(variances);
        let second = likely.step(first);
        let change = |a: [f64; SOURCES], b: [f64; SOURCES]| -> [f64; SOURCES] {
            std::array::from_fn(|source| (b[source] / a[source]).ln())
        };
        let (speed, later) = (change(variances, first), change(first, second));
        let length = |of: &[f64; SOURCES]| of.iter().map(|x| x * x).sum::<f64>().sqrt();
        let slowing: [f64; SOURCES] = std::array::from_fn(|source| later[source] - speed[source]);
        let far = (length(&speed) / length(&slowing)).clamp(1.0, FARTHEST);
        let leap = |source: usize| {
            let way = 2.0 * far * speed[source] + far * far * slowing[source];
            variances[source] * way.clamp(-LONGEST, LONGEST).exp()
        };
        let there = if far.is_nan() { second } else { std::array::from_fn(leap) };
        let next = likely.step(there);
        let moved = length(&change(variances, next));
        variances = next;
        if moved < SAME {
            break;
        }
    }
    variances
}

/// How likely residuals are by variances of their sources.
struct Likely<'a> {
    pictures: &'a [Scattered],
    products: Vec<[DMatrix<f64>; SOURCES]>,
    floor: [f64; SOURCES],
}

impl<'a> Likely<'a> {
    fn new(pictures: &'a [Scattered], usual: [f64; SOURCES]) -> Self {
        let products = pictures.iter().map(Scattered::products).collect();
        Self { pictures, products, floor: usual.map(|variance| variance * LEAST) }
    }

    /// Variances that are no less likely.
    fn step(&self, mut variances: [f64; SOURCES]) -> [f64; SOURCES] {
        let (mut squares, mut traces) = ([0.0; SOURCES], [0.0; SOURCES]);
        for (picture, products) in self.pictures.iter().zip(&self.products) {
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
        for source in 0..SOURCES {
            if traces[source] > 0.0 {
                let factor = (squares[source] / traces[source]).sqrt();
                variances[source] = (variances[source] * factor).max(self.floor[source]);
            }
        }
        variances
    }
}

/// An entry of the covariance of T numbers where measurements repeat each other `lasting` times, n: were there only 1/n of them, H = H_data + H_known would be the information; the solution
/// weighs them as if there were all, so that its covariance is H⁻¹(n·H_data + H_known)H⁻¹. `known` is H_known, of the last K of the numbers.
pub(super) fn lasted<const T: usize, const K: usize>(
    all: &[[f64; T]; T],
    known: &[[f64; K]; K],
    lasting: f64,
    [i, j]: [usize; 2],
) -> f64 {
    let known = |a: usize, b: usize| all[i][T - K + a] * known[a][b] * all[j][T - K + b];
    let of_known: f64 = (0..K).flat_map(|a| (0..K).map(move |b| (a, b))).map(|(a, b)| known(a, b)).sum();
    lasting * all[i][j] - (lasting - 1.0) * of_known
}
