//! Slices and masks that a planar volume cannot hold.

use mask::Mask;
use sonoweave_core::region::ClipRect;

/// A slice or mask that a planar volume cannot hold: its weights are not a product of one
/// factor along z and one per column.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Departure {
    /// The data is not a rectangle: columns would be covered in part.
    #[error(
        "the picture's data is no rectangle ({data} pixels of the {rectangle} around them), as the planar path needs: choose a rectangular clip, the general path, or the upgrade on departure"
    )]
    Mask {
        /// Pixels that are data.
        data: u64,
        /// Pixels of the rectangle around them.
        rectangle: u64,
    },
    /// The slice lies out of the plane.
    #[error(
        "the slice leaves the scan's plane: the picture's corners lie up to {voxels:.3} voxel off, {tolerance_voxels} is allowed; choose the general path or the upgrade on departure, or a larger planar tolerance"
    )]
    Pose {
        /// Largest distance of a corner from its position in the plane, voxels.
        voxels: f64,
        /// Largest that is allowed.
        tolerance_voxels: f64,
    },
}

impl Departure {
    /// Returns the rectangle of a rectangular mask.
    ///
    /// # Errors
    /// [`Departure::Mask`], also for an empty mask.
    pub(crate) fn rectangle(mask: &Mask) -> Result<ClipRect, Self> {
        let bounds = mask.bounds();
        let rectangle = bounds.map_or(0, |r| u64::from(r.width) * u64::from(r.height));
        match bounds {
            Some(bounds) if rectangle == mask.area() => Ok(bounds),
            _ => Err(Self::Mask { data: mask.area(), rectangle }),
        }
    }
}
