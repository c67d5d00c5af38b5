//! Thin wires: the finest detail across two directions, endless along the third.

use glam::{DMat3, DVec3};

use crate::elementary::exp;

/// A straight, endless wire whose cross-section is a round Gaussian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wire {
    /// A point on it, world mm.
    pub point: DVec3,
    /// Unit vector along it, world.
    pub direction: DVec3,
    /// Standard deviation of its cross-section, mm.
    pub sigma: f64,
    /// Grey levels on its axis, above the background.
    pub amplitude: f64,
}

/// Wires on a background; at crossings they add up.
#[derive(Debug, Clone, PartialEq)]
pub struct Wires {
    /// Grey level far from every wire.
    pub background: f64,
    /// The wires.
    pub wires: Vec<Wire>,
}

impl Wires {
    /// Returns seven wires, 190 in 40, with a full width at half maximum of 0.5 mm, one voxel
    /// of the default spacing. They lie along the world's axes, the diagonals of its planes and
    /// that of its space, at least 4 mm apart.
    pub fn standard() -> Self {
        let sigma = 0.5 / (8.0 * std::f64::consts::LN_2).sqrt();
        let wires = [
            ([0.0, -8.0, -6.0], [1.0, 0.0, 0.0]),
            ([-12.0, 0.0, -1.0], [0.0, 1.0, 0.0]),
            ([9.0, -3.0, 0.0], [0.0, 0.0, 1.0]),
            ([0.0, 4.0, 4.0], [1.0, 1.0, 0.0]),
            ([0.0, -16.0, 0.0], [1.0, 0.0, 1.0]),
            ([16.0, 6.0, 0.0], [0.0, 1.0, 1.0]),
            ([-4.0, 8.0, -2.0], [1.0, 1.0, 1.0]),
        ]
        .map(|(point, direction)| Wire {
            point: DVec3::from_array(point),
            direction: DVec3::from_array(direction).normalize(),
            sigma,
            amplitude: 150.0,
        });
        Self { background: 40.0, wires: wires.to_vec() }
    }

    pub(super) fn blurred(&self, world: DVec3, covariance: &DMat3) -> f64 {
        self.background + self.wires.iter().map(|w| w.blurred(world, covariance)).sum::<f64>()
    }

    pub(super) fn softened(&self, variance: f64) -> Self {
        Self { background: self.background, wires: self.wires.iter().map(|w| w.softened(variance)).collect() }
    }
}

impl Wire {
    /// A σ²/√|S| exp(−xᵀS⁻¹x/2) over the two directions across the wire, S = σ²I + the covariance
    /// across.
    fn blurred(&self, world: DVec3, covariance: &DMat3) -> f64 {
        let (e, f) = self.direction.any_orthonormal_pair();
        let x = world - self.point;
        let (xe, xf) = (x.dot(e), x.dot(f));
        let variance = self.sigma * self.sigma;
        let (ce, cf) = (*covariance * e, *covariance * f);
        let (see, sef, sff) = (variance + e.dot(ce), f.dot(ce), variance + f.dot(cf));
        let determinant = see * sff - sef * sef;
        let quadratic = (sff * xe * xe - 2.0 * sef * xe * xf + see * xf * xf) / determinant;
        self.amplitude * variance / determinant.sqrt() * exp(-0.5 * quadratic)
    }

    fn softened(&self, variance: f64) -> Self {
        let (own, sum) = (self.sigma * self.sigma, self.sigma * self.sigma + variance);
        Self { sigma: sum.sqrt(), amplitude: self.amplitude * own / sum, ..*self }
    }
}
