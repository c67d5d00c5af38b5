//! The volume between contours by their areas and centroids alone, as a check of the body's.
//!
//! With areas A as vectors along the sweep and centroids c, the volume is ∫ A · dc (Watanabe 1982).
//! Planes need not be parallel.

use glam::DVec3;

use crate::contour::Contour;
use crate::contours::Contours;
use crate::cubic::weights;

/// Places and weights of a quadrature that is exact for polynomials of degree five, as the product
/// of two cubics' value and derivative is (Gauss & Legendre).
const QUADRATURE: [(f64, f64); 3] =
    [(0.112_701_665_379_258_31, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// Returns the volume, mm³, with areas and centroids straight between the contours:
/// ½ Σ (Aᵢ + Aᵢ₊₁) · (cᵢ₊₁ − cᵢ).
pub fn straight_mm3(contours: &Contours) -> f64 {
    let piece = |pair: &[Contour]| (pair[0].area() + pair[1].area()).dot(pair[1].centroid() - pair[0].centroid());
    0.5 * contours.list().windows(2).map(piece).sum::<f64>()
}

/// Returns the volume, mm³, with areas and centroids cubic between the contours (Treece, Prager,
/// Gee & Berman 1999).
pub fn cubic_mm3(contours: &Contours) -> f64 {
    let list = contours.list();
    let steps: Vec<f64> = list.windows(2).map(|pair| pair[0].centroid().distance(pair[1].centroid())).collect();
    let piece = |at: usize| {
        let before = at.checked_sub(1).map(|before| steps[before]);
        let at_share = |(share, weight): (f64, f64)| {
            let [value, derivative] = weights(before, steps[at], steps.get(at + 1).copied(), share);
            let sum = |of: fn(&Contour) -> DVec3, weights: glam::DVec4| {
                let used = (0..4).filter_map(|n| Some((n, list.get((at + n).checked_sub(1)?)?)));
                used.map(|(n, contour)| of(contour) * weights[n]).sum::<DVec3>()
            };
            weight * sum(Contour::area, value).dot(sum(Contour::centroid, derivative))
        };
        steps[at] * QUADRATURE.into_iter().map(at_share).sum::<f64>()
    };
    (0..steps.len()).map(piece).sum()
}
