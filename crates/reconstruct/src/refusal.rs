//! Reasons why a slice is not inserted.

use volume::brick::Brick;

use super::planar::Departure;
use super::settings::SettingsError;

/// Reason why a slice was not inserted. The volume is as before.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refused {
    /// Same image and same pose as the slice before: it adds nothing.
    #[error("the picture and its pose are those of the slice before; move the probe")]
    Repeated,
    /// The image size differs from that of the mask.
    #[error("the picture has {}×{} pixels; this reconstruction began with {}×{}: begin a new one", found[0], found[1], expected[0], expected[1])]
    Size {
        /// Pixels along u and v.
        found: [u32; 2],
        /// Pixels along u and v that the reconstruction began with.
        expected: [u32; 2],
    },
    /// The pose spans no plane: it is not finite, or its image axes have no length or the same
    /// direction.
    #[error("the pose places no plane in the world; check the calibration's matrix")]
    Degenerate,
    /// The pose is so far away that voxel indices would not fit.
    #[error("the slice lies beyond the lattice's 32-bit brick indices: check the poses' unit, or the voxel spacing")]
    OutOfRange,
    /// The time is so far from the first slice's that the order of slices cannot be kept.
    #[error("the slice's time lies more than 59 hours from the first slice's: check the recording's time stamps")]
    OutOfTime,
    /// The volume would take more memory than allowed.
    #[error(
        "the volume would need {needed} more bricks of 8×8×8 voxels than the limit of {limit_bytes} bytes allows: choose a coarser spacing, crop the picture, or raise the memory limit"
    )]
    Memory {
        /// Bricks beyond the limit; at least this many.
        needed: u64,
        /// The limit, bytes.
        limit_bytes: u64,
    },
    /// The planar path cannot hold the slice.
    #[error(transparent)]
    Departure(#[from] Departure),
    /// The settings do not fit the slice's pixel size.
    #[error(transparent)]
    Settings(#[from] SettingsError),
}

impl Refused {
    /// Returns [`Refused::Memory`] for at least this many bytes beyond the limit.
    pub(super) fn memory(bytes: u64, limit_bytes: u64) -> Self {
        Self::Memory { needed: bytes.div_ceil(size_of::<Brick>() as u64), limit_bytes }
    }
}

/// Reason why a slice was not inserted as it was decided elsewhere. The volume is as before.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RepeatError {
    /// The slice cannot be inserted.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// The decision was taken with other kernels.
    #[error(
        "the slice's kernels are not those of the plan to the last bit, as another processor, C library or version made it: reconstruct all parts where the plan was made, or make the plan here"
    )]
    OtherKernels,
}
