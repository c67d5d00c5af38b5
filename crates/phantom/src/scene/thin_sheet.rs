//! A thin sheet, such as a membrane in a water bath: it reveals only the kernel's width along
//! its normal.

use glam::{DMat3, DVec3};

use crate::elementary::exp;

/// An infinite sheet with a Gaussian profile along its normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThinSheet {
    /// Unit vector, world.
    pub normal: DVec3,
    /// Signed distance of its middle from the world's origin along `normal`, mm.
    pub offset: f64,
    /// Standard deviation of its profile, mm.
    pub sigma: f64,
    /// Grey levels in its middle, above the background.
    pub amplitude: f64,
    /// Grey level far from it.
    pub background: f64,
}

impl ThinSheet {
    /// Returns a sheet through the origin with a normal along the given direction (not zero):
    /// 190 in 40, with a full width at half maximum of 0.5 mm.
    pub fn standard(direction: DVec3) -> Self {
        let sigma = 0.5 / (8.0 * std::f64::consts::LN_2).sqrt();
        Self { normal: direction.normalize(), offset: 0.0, sigma, amplitude: 150.0, background: 40.0 }
    }

    pub(super) fn blurred(&self, world: DVec3, covariance: &DMat3) -> f64 {
        self.softened(self.normal.dot(*covariance * self.normal)).value(world)
    }

    fn value(&self, world: DVec3) -> f64 {
        let x = self.normal.dot(world) - self.offset;
        self.background + self.amplitude * exp(-0.5 * x * x / (self.sigma * self.sigma))
    }

    pub(super) fn softened(&self, variance: f64) -> Self {
        let sigma = (self.sigma * self.sigma + variance).sqrt();
        Self { sigma, amplitude: self.amplitude * self.sigma / sigma, ..*self }
    }
}
