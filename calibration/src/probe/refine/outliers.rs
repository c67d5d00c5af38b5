//! Outliers: dots and images that the others contradict.

use glam::DVec2;
use nalgebra::{DMatrix, DVector};

/// Limit of a dot's distance from the place predicted by the others of its image, in standard
/// deviations: chance exceeds it once in a million.
const DOT_REACH: f64 = 5.3;
/// Limit of an image's sum of squares above its mean, in standard deviations.
const PICTURE_REACH: f64 = 8.0;

/// Removes dots that the others of their image contradict, or all dots of an image unlike the
/// others. Returns whether there were any.
pub(super) fn leave_out(used: &mut [bool], dots: &[usize], residuals: &DVector<f64>, whitening: &DMatrix<f64>) -> bool {
    let n = residuals.len();
    let squares = (whitening * residuals).norm_squared();
    let mean = n as f64;
    // Q = C⁻¹: given the other dots, the covariance of a dot's residual is the inverse of its
    // block of Q.
    let precision = whitening.transpose() * whitening;
    let weighted = &precision * residuals;
    let alone = |dot: usize| {
        let (a, b, d) =
            (precision[(2 * dot, 2 * dot)], precision[(2 * dot, 2 * dot + 1)], precision[(2 * dot + 1, 2 * dot + 1)]);
        let inverse = glam::DMat2::from_cols_array(&[a, b, b, d]).inverse();
        let left = DVec2::new(weighted[2 * dot], weighted[2 * dot + 1]);
        left.dot(inverse * left)
    };
    let worst = (0..dots.len()).map(|dot| (alone(dot), dot)).max_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((square, dot)) = worst
        && square > DOT_REACH * DOT_REACH
    {
        used[dots[dot]] = false;
        return true;
    }
    if squares > mean + PICTURE_REACH * (2.0 * mean).sqrt() {
        used.fill(false);
        return true;
    }
    false
}
