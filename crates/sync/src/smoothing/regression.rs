//! Weighted quadratic regression of vectors over time, robust against single outliers.

use glam::{DMat3, DVec3};

/// Squared residual beyond which a value counts less, in variances of one component: the 99 %
/// quantile of the χ² distribution with three degrees of freedom.
const OUTLYING: f64 = 11.345;
/// The median of the χ² distribution with one degree of freedom.
const MEDIAN: f64 = 0.454_936;
/// Fits with weights by the residuals of the fit before.
const PASSES: usize = 4;

/// A vector at a time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Value {
    /// Time from the middle, in half widths: −1 to 1.
    pub(super) at: f64,
    pub(super) vector: DVec3,
}

/// A fit in its middle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    /// The fitted vector.
    pub(super) vector: DVec3,
    /// Variance of the values about the fit, along an axis.
    pub(super) variance: f64,
    /// Variance of the fitted vector in variances of the values, if these are independent.
    pub(super) share: f64,
}

/// The powers 1, t, t².
fn powers(at: f64) -> DVec3 {
    DVec3::new(1.0, at, at * at)
}

/// Weight of a value by its time (tricube; Cleveland, J. Am. Stat. Assoc. 74, 1979).
fn by_time(at: f64) -> f64 {
    let near = (1.0 - at.abs().powi(3)).max(0.0);
    near.powi(3)
}

/// Returns the variances of components with mean 0, by their median squares: single outliers do
/// not matter, and axes may differ.
pub(super) fn variances(vectors: &[DVec3]) -> DVec3 {
    let mut squares = vec![0.0; vectors.len()];
    let mut variance = |axis: usize| {
        squares.iter_mut().zip(vectors).for_each(|(square, vector)| *square = vector[axis] * vector[axis]);
        let middle = squares.len() / 2;
        *squares.select_nth_unstable_by(middle, f64::total_cmp).1 / MEDIAN
    };
    DVec3::new(variance(0), variance(1), variance(2))
}

/// Fits a quadratic to values within one half width of its middle. Residuals with squares beyond
/// [`OUTLYING`] in variances of their axes, at least `least_variance`, lower the weight with their
/// fourth power. `None` if the values do not determine it.
pub(super) fn fit(values: &[Value], least_variance: f64) -> Option<Fit> {
    let mut weights: Vec<f64> = values.iter().map(|value| by_time(value.at)).collect();
    let mut residuals = vec![DVec3::ZERO; values.len()];
    for pass in 0..=PASSES {
        let (mut moments, mut sums) = (DMat3::ZERO, DMat3::ZERO);
        for (value, weight) in values.iter().zip(&weights) {
            let row = powers(value.at);
            let weighted = row * *weight;
            moments += outer(weighted, row);
            sums += outer(value.vector, weighted);
        }
        // Evenly spread values have a determinant of 2e-3 times the cube of the weights' sum, and
        // those on one side of the middle 1e-5.
        let is_determined = moments.determinant() > 1e-9 * moments.x_axis.x.powi(3);
        if !is_determined {
            return None;
        }
        let inverse = moments.inverse();
        let coefficients = sums * inverse;
        for (value, residual) in values.iter().zip(&mut residuals) {
            *residual = value.vector - coefficients * powers(value.at);
        }
        let scale = variances(&residuals).max(DVec3::splat(least_variance)).recip();
        let square = |residual: &DVec3| (*residual * *residual).dot(scale);
        if pass < PASSES && residuals.iter().any(|residual| square(residual) > OUTLYING) {
            for ((value, residual), weight) in values.iter().zip(&residuals).zip(&mut weights) {
                *weight = by_time(value.at) * (OUTLYING / square(residual).max(OUTLYING)).powi(2);
            }
            continue;
        }
        let (mut share, mut all, mut bound, mut spread) = (0.0, 0.0, 0.0, 0.0);
        for ((value, weight), residual) in values.iter().zip(&weights).zip(&residuals) {
            let row = powers(value.at);
            let leverage = inverse * row;
            share += (weight * leverage.x).powi(2);
            bound += weight * weight * row.dot(leverage);
            all += weight;
            spread += weight * residual.length_squared();
        }
        // The fit follows the values, so that the weights are less than their sum.
        let free = all - bound;
        let variance = if free > 1e-3 * all { spread / (3.0 * free) } else { f64::INFINITY };
        return Some(Fit { vector: coefficients.x_axis, variance, share });
    }
    None
}

/// Returns a bᵀ.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}
