//! Robust standard deviation, and Tukey's weights.

use crate::least_squares::loss::biweight;
use crate::statistics::median;

/// Factor from the median distance to the standard deviation of a normal distribution.
const NORMAL: f64 = 1.482_602_218_505_602;

/// Returns the standard deviation about 0 of normally distributed values with a few outliers.
/// Replaces the values by their distances.
pub(super) fn deviation_about_zero(values: &mut [f64]) -> f64 {
    values.iter_mut().for_each(|x| *x = x.abs());
    NORMAL * median(values)
}

/// Tukey's biweight for a residual in units of its scale: the weight, and the derivative of the
/// influence.
#[derive(Debug, Clone, Copy)]
pub(super) struct Biweight {
    pub(super) weight: f64,
    pub(super) slope: f64,
}

/// Gives 95 % efficiency for normal residuals (Maronna, Martin, Yohai & Salibián-Barrera,
/// Robust Statistics, 2nd ed., section 2.3).
const TUKEY: f64 = 4.685;

impl Biweight {
    pub(super) fn of(residual: f64, scale: f64) -> Self {
        let u = residual / (TUKEY * scale.max(f64::MIN_POSITIVE));
        let rest = 1.0 - u * u;
        Self { weight: biweight(u), slope: if rest > 0.0 { rest * (1.0 - 5.0 * u * u) } else { 0.0 } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outlier_does_not_move_deviation() {
        assert!((deviation_about_zero(&mut [-1.0, 1.0, 0.5, -0.5, 1e9]) - NORMAL).abs() < 1e-12);
    }
}
