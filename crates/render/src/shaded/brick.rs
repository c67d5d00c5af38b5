//! A brick of classified and lit voxels.

use volume::brick::EDGE;

use crate::classify::interval::{Interval, SIDES, Side};
use crate::classify::shade::Lit;

/// Voxels along an edge of a brick, including those kept of its neighbours.
pub(crate) const SIDE: usize = EDGE + 1;
/// Voxels of such a brick.
pub(crate) const CELLS: usize = SIDE * SIDE * SIDE;
/// Voxels of a face, without those.
pub(super) const FACE: usize = EDGE * EDGE;

/// The first voxels of a brick: the faces z = 0, y = 0 and x = 0, each with all that lies in it.
pub(super) type Border<const C: usize> = [Lit<f32, C>; 3 * FACE];

/// Colour (premultiplied) and opacity of a step, x fastest. The numbers of a voxel are adjacent
/// in memory, and so are neighbours along x: a sample is four loads.
#[derive(Clone)]
pub(crate) struct ShadedBrick<const C: usize> {
    pub(crate) cells: [Lit<f32, C>; CELLS],
    /// Number of voxels on each [`Side`].
    pub(super) sides: [u16; SIDES],
}

impl<const C: usize> ShadedBrick<C> {
    pub(super) fn transparent() -> Box<Self> {
        let mut sides = [0; SIDES];
        sides[Side::Clear as usize] = CELLS as u16;
        Box::new(Self { cells: [Lit { colour: [0.0; C], alpha: 0.0 }; CELLS], sides })
    }

    /// Returns whether the given voxels of a layer are transparent.
    pub(super) fn is_clear(&self, z: usize, voxels: u64) -> bool {
        voxels_of(z, voxels).all(|voxel| self.cells[cell(voxel)].alpha == 0.0)
    }

    /// Returns whether a cell holds these bits.
    #[inline(always)]
    pub(super) fn is(&self, cell: usize, lit: &Lit<f32, C>) -> bool {
        let before = &self.cells[cell];
        let mut same = before.alpha.to_bits() == lit.alpha.to_bits();
        for c in 0..C {
            same &= before.colour[c].to_bits() == lit.colour[c].to_bits();
        }
        same
    }

    #[inline(always)]
    pub(super) fn set(&mut self, cell: usize, lit: &Lit<f32, C>, interval: &Interval) {
        self.sides[interval.side(&self.cells[cell]) as usize] -= 1;
        self.sides[interval.side(lit) as usize] += 1;
        self.cells[cell] = *lit;
    }
}

/// Returns the cell that begins at a voxel of a brick.
pub(super) fn cell([x, y, z]: [usize; 3]) -> usize {
    (z * SIDE + y) * SIDE + x
}

/// Returns the voxels of a layer whose bits are set.
pub(super) fn voxels_of(z: usize, mut left: u64) -> impl Iterator<Item = [usize; 3]> {
    std::iter::from_fn(move || {
        let inside = (left != 0).then(|| left.trailing_zeros() as usize)?;
        left &= left - 1;
        Some([inside % EDGE, inside / EDGE, z])
    })
}
