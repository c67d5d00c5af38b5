//! A zone plate: one image shows the loss at every frequency, in every direction.

use glam::{DMat3, DVec3};

use crate::complex::{Complex, exp, sqrt};

/// mean + amplitude · cos(k r²), r the distance from the centre: spherical shells with a
/// frequency k r/π (cycles per mm) that grows with the distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ZonePlate {
    /// World mm.
    pub centre: DVec3,
    /// Mean grey level.
    pub mean: f64,
    /// Grey levels from the mean to a crest.
    pub amplitude: f64,
    /// k, rad/mm².
    pub chirp: f64,
    /// Variance of an isotropic Gaussian convolved with the plate, mm²; 0 for the plate itself.
    pub blur_variance: f64,
}

impl ZonePlate {
    /// Returns 128 ± 80 about the origin, with 0.4 cycles per mm at 20 mm: five voxels of 0.5
    /// mm per period.
    pub fn standard() -> Self {
        Self {
            centre: DVec3::ZERO,
            mean: 128.0,
            amplitude: 80.0,
            chirp: 0.02 * std::f64::consts::PI,
            blur_variance: 0.0,
        }
    }

    /// Real part of |I − 2ikC|^{−1/2} exp(ik xᵀ(I − 2ikC)⁻¹x) with C the covariance: the
    /// Gaussian integral of e^{ik|x+y|²}.
    ///
    /// The matrix is eliminated pivot by pivot. Its real part is positive definite, hence so is
    /// that of every pivot. The product of the pivots' principal roots is the root that starts
    /// at 1 for C = 0. The principal root of the determinant would be another one.
    pub(super) fn blurred(&self, world: DVec3, covariance: &DMat3) -> f64 {
        let x = world - self.centre;
        let c = *covariance + DMat3::from_diagonal(DVec3::splat(self.blur_variance));
        let off = |value: f64| Complex::new(0.0, -2.0 * self.chirp * value);
        let on = |value: f64| Complex::new(1.0, 0.0) + off(value);
        let real = |value: f64| Complex::new(value, 0.0);

        let first = on(c.x_axis.x);
        let (to_second, to_third) = (off(c.x_axis.y) * first.inv(), off(c.x_axis.z) * first.inv());
        let second = on(c.y_axis.y) - to_second * off(c.x_axis.y);
        let below = off(c.y_axis.z) - to_second * off(c.x_axis.z);
        let last = below * second.inv();
        let third = on(c.z_axis.z) - to_third * off(c.x_axis.z) - last * below;

        let x0 = real(x.x);
        let x1 = real(x.y) - to_second * x0;
        let x2 = real(x.z) - to_third * x0 - last * x1;
        let quadratic = x0 * x0 * first.inv() + x1 * x1 * second.inv() + x2 * x2 * third.inv();
        let root = sqrt(first) * sqrt(second) * sqrt(third);
        let value = root.inv() * exp(Complex::new(0.0, self.chirp) * quadratic);
        self.mean + self.amplitude * value.re
    }

    /// Returns the factor of one axis at `mm` from the centre along it. The plate is the real
    /// part of the product over three perpendicular axes.
    pub(crate) fn along_axis(&self, mm: f64) -> Complex {
        let spread = Complex::new(1.0, -2.0 * self.chirp * self.blur_variance).inv();
        sqrt(spread) * exp(Complex::new(0.0, self.chirp * mm * mm) * spread)
    }

    pub(super) fn softened(&self, variance: f64) -> Self {
        Self { blur_variance: self.blur_variance + variance, ..*self }
    }
}
