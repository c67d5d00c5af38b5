//! The voxels that rays of a part need, and the pixels that a brick can change.

use volume::brick::{BrickIndex, EDGE};

use crate::rays::rows::Row;
use crate::rays::slab::{Footprint, ViewRays};
use crate::shaded::Dirty;

/// Voxels beyond its last sample that a part needs: the cell about it, the neighbours of its
/// corners, and one for rays between pixels, which differ a little from theirs in perspective.
pub(super) const MARGIN: f64 = 3.0;

/// Returns the voxels that a step of any ray leads down and up the z axis, at most.
pub(super) fn z_steps<const C: usize>(rows: &[Row<C>]) -> [f64; 2] {
    let steps = rows.iter().flat_map(Row::lines).map(|line| f64::from(line.step[2]));
    steps.fold([0.0, 0.0], |[down, up], step| [f64::max(down, -step), f64::max(up, step)])
}

/// Returns the first and last row of pixels that a brick can change, inclusive; `None` if it is
/// not in the picture. `first` is the lattice index of region coordinate 0.
pub(super) fn rows_of(brick: BrickIndex, first: [i64; 3], rays: &ViewRays) -> Option<[u32; 2]> {
    // A voxel changes the gradients of its neighbours.
    let low: [i64; 3] = std::array::from_fn(|a| i64::from(brick[a]) * EDGE as i64 - first[a] - 1);
    let dirty = Dirty { low, high: low.map(|at| at + EDGE as i64 + 1) };
    Footprint::new(&dirty, rays).map(|footprint| footprint.rows)
}
