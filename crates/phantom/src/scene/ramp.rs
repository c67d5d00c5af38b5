//! A ramp: symmetric kernels leave it unchanged, so that it reveals every shift.

use glam::DVec3;

/// A grey level that is linear in world position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ramp {
    /// Grey level at the world's origin.
    pub at_origin: f64,
    /// Grey levels per mm along world x, y, z.
    pub gradient: DVec3,
}

impl Ramp {
    pub(super) fn value(&self, world: DVec3) -> f64 {
        self.at_origin + self.gradient.dot(world)
    }
}
