//! Directions across which the slices of a volume lie.

use glam::{DMat3, DVec3};

/// Outer products of the slices' normals, along the lattice's axes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Normals {
    sum: DMat3,
    slices: u64,
}

impl Normals {
    /// No slice.
    pub(crate) const NONE: Self = Self { sum: DMat3::ZERO, slices: 0 };

    /// Adds a slice's normal of any length.
    pub(crate) fn add(&mut self, normal: DVec3) {
        let normal = normal.normalize_or_zero();
        self.sum += DMat3::from_cols(normal * normal.x, normal * normal.y, normal * normal.z);
        self.slices += 1;
    }

    /// Returns the mean of n·nᵀ over the normals n; zero before the first. gᵀ·N·g is the mean
    /// square slope of a gradient g along them.
    pub(crate) fn mean(&self) -> DMat3 {
        self.sum * (1.0 / self.slices.max(1) as f64)
    }
}
