//! Grids of truth volumes: the one that covers a scan, and the limit of their size.

use glam::{DMat3, DVec3};

use sonoweave_core::frames::{Image as ImageFrame, Transform, World};
use volume::Grid;

use super::PhantomError;

/// 4 GiB of single precision.
const MAX_VOXELS: u64 = 1 << 30;

/// Returns the grid of the lattice points within `margin_mm` of the box around all pixels of
/// all slices; its axes are the world's.
///
/// The lattice is anchored at the world's origin in multiples of `spacing` (mm): it does not
/// depend on the slices. Each slice is given by its pose and its size in pixels.
///
/// # Errors
/// [`PhantomError`] if a spacing is not positive, the margin is negative, there is no slice, or
/// the grid would exceed 2³⁰ voxels.
pub fn covering_grid(
    slices: impl IntoIterator<Item = (Transform<World, ImageFrame>, [u32; 2])>,
    spacing: DVec3,
    margin_mm: f64,
) -> Result<Grid, PhantomError> {
    for mm in spacing.to_array() {
        PhantomError::check_length("the voxels' spacing", mm)?;
    }
    if !(margin_mm >= 0.0 && margin_mm.is_finite()) {
        return Err(PhantomError::Length { what: "the margin around the slices", mm: margin_mm });
    }
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (world_from_image, [width, height]) in slices {
        for corner in corners(&world_from_image, [width, height]) {
            (low, high) = (low.min(corner), high.max(corner));
        }
    }
    if !(low.is_finite() && high.is_finite()) {
        return Err(PhantomError::Frames { frames: 0, limit: u32::MAX });
    }
    let first = ((low - margin_mm) / spacing).ceil();
    let last = ((high + margin_mm) / spacing).floor();
    // A coarse lattice may have no point within the margin; the volume is then the nearest one.
    let size = (last - first + 1.0).max(DVec3::ONE);
    let size = size.to_array().map(|n| n as u64);
    let grid = Grid { origin: first * spacing, spacing, direction: DMat3::IDENTITY, size };
    voxels(&grid)?;
    Ok(grid)
}

pub(super) fn voxels(grid: &Grid) -> Result<usize, PhantomError> {
    match grid.voxels() {
        Some(n) if n <= MAX_VOXELS => Ok(n as usize),
        _ => Err(PhantomError::VolumeSize { size: grid.size, limit: MAX_VOXELS }),
    }
}

pub(super) fn corners(world_from_image: &Transform<World, ImageFrame>, size: [u32; 2]) -> [DVec3; 4] {
    let [u, v] = size.map(|n| f64::from(n) - 1.0);
    [[0.0, 0.0], [u, 0.0], [0.0, v], [u, v]].map(|[u, v]| world_from_image.point(DVec3::new(u, v, 0.0)))
}
