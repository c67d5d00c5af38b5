//! Position of a volume in space.

/// Position of a volume in space: spacing and origin in mm, and the axes' directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Place {
    pub(crate) spacing: [f64; 3],
    pub(crate) origin: [f64; 3],
    pub(crate) axes: [[f64; 3]; 3],
}

impl Place {
    /// Spacing 1 mm, origin 0, axes along x, y, z.
    pub(crate) const PLAIN: Self =
        Self { spacing: [1.0; 3], origin: [0.0; 3], axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] };
}
