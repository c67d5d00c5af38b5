//! Work done for soft light.

/// Work done for soft light, before the picture is rendered.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SoftWork {
    /// Bricks of the volume in the render region.
    pub bricks: u64,
    /// Bricks whose values were smoothed: those in which anything may be visible.
    pub bricks_smoothed: u64,
    /// Variance that was taken for noise, grey levels².
    pub noise: f32,
}
