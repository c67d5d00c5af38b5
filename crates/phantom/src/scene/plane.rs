//! A plane edge: blur neither shifts nor bends it, but widens its rise.

use glam::{DMat3, DVec3};

use crate::elementary::{EDGE_REACH, normal_cdf};

/// Two half spaces that meet in a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Unit vector from the `below` side to the `above` side, world.
    pub normal: DVec3,
    /// Signed distance of the plane from the world's origin along `normal`, mm.
    pub offset: f64,
    /// Grey level on the side from which the normal points away.
    pub below: f64,
    /// Grey level on the side to which the normal points.
    pub above: f64,
    /// σ of the Gaussian that softens the edge, mm; 0 is a hard edge.
    pub edge_sigma: f64,
}

impl Plane {
    /// Returns a hard edge through the origin between 60 and 180, with a normal along the given
    /// direction (not zero).
    pub fn standard(direction: DVec3) -> Self {
        Self { normal: direction.normalize(), offset: 0.0, below: 60.0, above: 180.0, edge_sigma: 0.0 }
    }

    /// Φ(distance / σ), with σ² the sum of the edge's and the blur's along the normal: no
    /// shift, a 10–90 % rise of 2.563 σ.
    pub(super) fn blurred(&self, world: DVec3, covariance: &DMat3) -> f64 {
        let distance = self.normal.dot(world) - self.offset;
        let sigma = (self.edge_sigma * self.edge_sigma + self.normal.dot(*covariance * self.normal)).sqrt();
        let part = if distance.abs() >= EDGE_REACH * sigma {
            if distance >= 0.0 { 1.0 } else { 0.0 }
        } else {
            normal_cdf(distance / sigma)
        };
        self.below + (self.above - self.below) * part
    }

    pub(super) fn softened(&self, variance: f64) -> Self {
        Self { edge_sigma: (self.edge_sigma * self.edge_sigma + variance).sqrt(), ..*self }
    }
}
