//! A sphere under an anisotropic Gaussian.
//!
//! The isotropic part of the kernel has a closed form: it turns the hard sphere into a soft
//! one. The rest of the covariance, one-dimensional for most kernels, is integrated numerically
//! over that soft sphere. The trapezoid rule achieves a few parts in a million at a step
//! of 1.1 σe/√(σ²+e²), with σ and e the two widths. Sums of smooth functions over a whole line
//! converge exponentially.

use glam::{DMat3, DVec3};

use super::eigen::eigen;
use crate::elementary::{EDGE_REACH, exp};
use crate::paint::SphereProfile;
use crate::scene::Sphere;

/// Limit of the trapezoid rule, in σ of the integrated Gaussian.
const REACH: f64 = 5.0;

/// Gaussians narrower than this part of the soft edge are integrated by three points (Gauss and
/// Hermite), exact to the fifth power.
const NARROW: f64 = 0.2;

/// A sphere prepared for kernels that are nowhere narrower than a given σ.
pub(super) struct SphereUnder {
    sphere: Sphere,
    profile: SphereProfile,
    smallest_variance: f64,
    /// σ of the edge after the isotropic blur, mm.
    edge: f64,
}

impl SphereUnder {
    pub(super) fn new(sphere: Sphere, smallest_sigma: f64) -> Self {
        let smallest_variance = smallest_sigma * smallest_sigma;
        let soft = sphere.softened(smallest_variance);
        Self { sphere, profile: SphereProfile::new(soft), smallest_variance, edge: soft.edge_sigma }
    }

    pub(super) fn value(&self, world: DVec3, covariance: &DMat3) -> f64 {
        let (variances, axes) = eigen(covariance);
        let widest = variances.into_iter().fold(0.0, f64::max) + self.sphere.edge_sigma * self.sphere.edge_sigma;
        let beyond = world.distance(self.sphere.centre) - self.sphere.radius;
        if beyond.abs() > EDGE_REACH * widest.sqrt() && self.sphere.radius > EDGE_REACH * widest.sqrt() {
            return if beyond > 0.0 { self.sphere.outside } else { self.sphere.inside };
        }
        let [x, y, z] = variances.map(|variance| self.nodes(variance - self.smallest_variance));
        let mut sum = 0.0;
        for (dx, wx) in &x {
            for (dy, wy) in &y {
                let across = world + axes.x_axis * *dx + axes.y_axis * *dy;
                let line: f64 = z.iter().map(|(dz, wz)| wz * self.profile.value(across + axes.z_axis * *dz)).sum();
                sum += wx * wy * line;
            }
        }
        sum
    }

    /// Returns positions, mm, and weights of sum 1 that integrate over a Gaussian of the given
    /// variance.
    fn nodes(&self, variance: f64) -> Vec<(f64, f64)> {
        if variance <= 1e-7 * self.edge * self.edge {
            return vec![(0.0, 1.0)];
        }
        let sigma = variance.sqrt();
        if sigma < NARROW * self.edge {
            let far = 3.0_f64.sqrt() * sigma;
            return vec![(-far, 1.0 / 6.0), (0.0, 2.0 / 3.0), (far, 1.0 / 6.0)];
        }
        // The error's exponent is −(2π)²/2 σ²e²/(σ²+e²)/h²: 1e-7 at this step.
        let step = 1.1 * sigma * self.edge / (variance + self.edge * self.edge).sqrt();
        let count = (REACH * sigma / step).ceil() as i32;
        let at = |k: i32| f64::from(k) * step;
        let raw: Vec<(f64, f64)> = (-count..=count).map(|k| (at(k), exp(-0.5 * at(k) * at(k) / variance))).collect();
        let total: f64 = raw.iter().map(|(_, w)| w).sum();
        raw.into_iter().map(|(x, w)| (x, w / total)).collect()
    }
}
