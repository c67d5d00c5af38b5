//! Noise sources of the dots: the tracker's noise, which moves all dots of an image together,
//! and that of each dot's centre.
//!
//! An image's residuals have the covariance
//!
//! ```text
//! C = σ_t² ΣTTᵀ + σ_r² ΣRRᵀ + σ_u² UUᵀ + σ_v² VVᵀ
//! ```
//!
//! T and R contain the derivatives by the shifts and rotations of each sensor at its own place.
//! U and V contain those by each dot's shift along u and v. The four variances are the most
//! likely ones, given the residuals. They are found by steps that never reduce the likelihood
//! (Zhou, Hu, Qiao & Zhou, *MM algorithms for variance components models*, J. Comput. Graph.
//! Stat. 28, 2019).

use nalgebra::{DMatrix, DVector};

/// Number of noise sources.
pub const SOURCES: usize = 4;
/// Steps per call; the next call continues. Each step brings a component about half-way.
const STEPS: usize = 12;
/// Maximum number of long steps …
const LEAPS: usize = 15;
/// … each at most this multiple of the extrapolation of two steps …
const FARTHEST: f64 = 30.0;
/// … and at most this change of a variance's logarithm.
const LONGEST: f64 = 6.0;
/// Relative change of a component at which the search ends.
const SAME: f64 = 1e-4;
/// Largest share of a source's residuals that counts as absorbed: with more, there are too few
/// images.
const MOST_ABSORBED: f64 = 0.9;
/// Least value of a component relative to its typical size: images without any noise have
/// rounding errors.
const LEAST: f64 = 1e-18;

/// Standard deviations of the noise sources.
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
    /// Start values: typical of an electromagnetic tracker and dots of some pixels.
    pub const USUAL: Self = Self { position_mm: 0.3, turn_rad: 0.004, dot_px: [1.5, 1.0] };

    pub(super) fn variances(self) -> [f64; SOURCES] {
        [self.position_mm, self.turn_rad, self.dot_px[0], self.dot_px[1]].map(|sd| sd * sd)
    }

    fn of([position, turn, u, v]: [f64; SOURCES]) -> Self {
        Self { position_mm: position.sqrt(), turn_rad: turn.sqrt(), dot_px: [u.sqrt(), v.sqrt()] }
    }

    /// Returns the scatter that makes the residuals of all images most likely.
    pub(super) fn most_likely(pictures: &[Scattered], start: Self) -> Self {
        Self::of(most_likely(pictures, start.variances(), Self::USUAL.variances()))
    }
}

/// An image's residuals with their noise sources.
#[derive(Debug, Clone)]
pub(super) struct Scattered {
    /// mm.
    pub(super) residuals: DVector<f64>,
    /// Derivatives by each source's unit steps: sensors' positions, their turns, dots along u,
    /// along v.
    pub(super) by: [DMatrix<f64>; SOURCES],
}

impl Scattered {
    /// Returns the matrix that makes the residuals independent with standard deviation 1, given
    /// the sources' variances; the identity without scatter.
    pub(super) fn whitening(&self, variances: [f64; SOURCES]) -> DMatrix<f64> {
        let n = self.residuals.len();
        let factor = self.covariance(&variances).cholesky().map(|factor| factor.l());
        let inverse = factor.and_then(|l| l.solve_lower_triangular(&DMatrix::identity(n, n)));
        inverse.unwrap_or_else(|| DMatrix::identity(n, n))
    }

    fn covariance(&self, variances: &[f64; SOURCES]) -> DMatrix<f64> {
        sum(&self.products(), variances)
    }

    /// Returns the covariance per unit of each source's variance.
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

/// Returns the sources' variances that make the residuals of all images most likely. A small
/// share of the usual ones always remains.
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

/// Does the same with longer steps, because sources with similar effects converge slowly. Two
/// steps give the trend of the variances' logarithms, and a third corrects the extrapolation
/// (Varadhan & Roland's SQUAREM, Scand. J. Stat. 35, 2008).
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

/// Likelihood of residuals, given the variances of their sources.
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

    /// Returns variances that are at least as likely.
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

/// Sums by which the most likely variances, and with them the parameters' covariance, are too
/// small: the parameters absorb part of the residuals.
///
/// With whitened sources B and the absorbed covariance A of an image's whitened residuals,
/// a source's residuals lose the share Σ tr BᵀAB / Σ tr BᵀB of their squares. The same
/// Σ tr BᵀAB, times the source's variance, is its share of the parameters' covariance.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Absorbed {
    lost: [f64; SOURCES],
    whole: [f64; SOURCES],
}

impl Absorbed {
    /// Adds an image.
    pub(super) fn add(&mut self, scattered: &Scattered, whitening: &DMatrix<f64>, absorbed: &DMatrix<f64>) {
        for (source, by) in scattered.by.iter().enumerate() {
            let whitened = whitening * by;
            self.whole[source] += whitened.norm_squared();
            self.lost[source] += whitened.component_mul(&(absorbed * &whitened)).sum();
        }
    }

    /// Returns the factor of the parameters' covariance that corrects this: N / (N − p − 2) for
    /// one source, N residuals and p parameters. N / (N − p) corrects the mean of the variance.
    /// The rest is the variance of Student's distribution with N − p degrees of freedom, because
    /// the scatter is uncertain itself.
    pub(super) fn factor(&self, variances: [f64; SOURCES]) -> f64 {
        let of = |source: usize| {
            // A source's share of the parameters and of the residuals.
            let [lost, whole] = [self.lost, self.whole].map(|of| of[source] * variances[source]);
            let share = if whole > 0.0 { ((lost + 2.0) / whole).clamp(0.0, MOST_ABSORBED) } else { 0.0 };
            (lost, 1.0 / (1.0 - share))
        };
        let all = [0, 1, 2, 3].map(of);
        let weights: f64 = all.iter().map(|(weight, _)| weight).sum();
        if weights > 0.0 { all.iter().map(|(weight, factor)| weight * factor).sum::<f64>() / weights } else { 1.0 }
    }
}

/// Returns an entry of the covariance of T numbers for measurements correlated over `lasting` =
/// n images. Only 1/n of them is independent, so the true information is H = H_data + H_known.
/// The solution weights all of them, so its covariance is H⁻¹(n·H_data + H_known)H⁻¹. `known`
/// is H_known, for the last K of the numbers.
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
