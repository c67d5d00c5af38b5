//! A straight wire between two points.

use glam::DVec3;

/// A straight wire.
#[derive(Debug, Clone, PartialEq)]
pub struct Wire {
    /// Its name, unique in the phantom.
    pub name: String,
    /// Its end points, between which it is held, mm.
    pub ends_mm: [DVec3; 2],
}

impl Wire {
    /// Returns the unit vector from its first end to its second.
    pub fn direction(&self) -> DVec3 {
        (self.ends_mm[1] - self.ends_mm[0]).normalize()
    }

    /// Returns its length, mm.
    pub fn length_mm(&self) -> f64 {
        self.ends_mm[0].distance(self.ends_mm[1])
    }

    /// Returns two unit vectors perpendicular to it and to each other.
    pub fn across(&self) -> [DVec3; 2] {
        let (first, second) = self.direction().any_orthonormal_pair();
        [first, second]
    }

    /// Returns the distance of a point from its line, and the nearest point along it: 0 at the
    /// first end, 1 at the second.
    pub fn nearest(&self, point_mm: DVec3) -> (f64, f64) {
        let along = self.ends_mm[1] - self.ends_mm[0];
        let share = (point_mm - self.ends_mm[0]).dot(along) / along.length_squared();
        (point_mm.distance(self.ends_mm[0] + share * along), share)
    }
}
