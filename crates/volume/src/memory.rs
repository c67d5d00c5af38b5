//! Data that a volume of bricks keeps besides sums.

/// Times of a brick under decay, ns since the first slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Epoch {
    /// Origin of its ticks, or of its forward decay.
    pub base_ns: i64,
    /// Time of the last slice that changed it.
    pub touched_ns: i64,
}

impl Epoch {
    /// Returns the epoch of a brick that begins now.
    pub fn at(elapsed_ns: i64) -> Self {
        Self { base_ns: elapsed_ns, touched_ns: elapsed_ns }
    }
}

/// Data that a volume keeps besides sums.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Memory {
    /// Nothing.
    #[default]
    Sums,
    /// The time of each voxel.
    Stamps,
    /// The age of each voxel, counted from an epoch of its brick.
    Ages,
    /// An epoch of each brick; weights are kept forward of it and fade at this rate, 1/s.
    Epochs {
        /// a, 1/s.
        rate_per_s: f64,
    },
    /// Sums of squares of each cell of voxels, for standard errors.
    Squares,
}

/// Returns the fraction of a brick's stored weights that remains at its last touch, under
/// forward decay.
pub(crate) fn remaining(rate_per_s: f64, epoch: Epoch) -> f32 {
    libm::exp(-rate_per_s * (epoch.touched_ns - epoch.base_ns) as f64 * 1e-9) as f32
}
