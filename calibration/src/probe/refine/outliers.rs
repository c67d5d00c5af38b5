//! Dots and pictures that others contradict.

use glam::DVec2;
use nalgebra::{DMatrix, DVector};

/// A dot is left out that lies farther from where the others of its picture expect it, in standard deviations: of a million one does by chance.
const DOT_REACH: f64 = 5.3;
/// A picture is left out whose sum of squares is beyond its mean by so many standard deviations.
const PICTURE_REACH: f64 = 8.0;

/// Strikes out dots that the others of their picture contradict, or all of a picture that is not like the others; whether there were any.
pub(super) fn leave_out(used: &mut [bool], dots: &[usize], residuals: &DVector<f64>, whitening: &DMatrix<f64>) -> bool {
    let n = residuals.len();
    let squares = (whitening * residuals).norm_squared();
    let mean = n as f64;
    // Q = C⁻¹: of what is left of a dot when the others have told what they know, the covariance is the inverse of its own part of Q.
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
