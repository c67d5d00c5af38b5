//! Tukey's weights.

use crate::least_squares::loss::biweight;

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
