//! A brick: 8×8×8 voxels that are allocated, filled and rendered together.

use serde::{Deserialize, Serialize};

/// Voxels along a brick's edge.
pub const EDGE: usize = 8;
/// Voxels in a brick.
pub const VOXELS: usize = EDGE * EDGE * EDGE;

/// Position of a brick on the lattice: voxel index divided by [`EDGE`], rounded down.
pub type BrickIndex = [i32; 3];

/// A box of bricks, from the lowest to the highest position, both inclusive. It is empty if an end
/// lies before its beginning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct BrickBox {
    /// Lowest position.
    pub low: BrickIndex,
    /// Highest position.
    pub high: BrickIndex,
}

impl BrickBox {
    /// No brick.
    pub const EMPTY: Self = Self { low: [0; 3], high: [-1; 3] };

    /// Whether it holds no brick.
    pub fn is_empty(&self) -> bool {
        (0..3).any(|a| self.low[a] > self.high[a])
    }

    /// Returns the lowest and the highest voxel, both inclusive.
    pub fn voxels(&self) -> [[i64; 3]; 2] {
        let first = |brick: BrickIndex| brick.map(|at| i64::from(at) * EDGE as i64);
        [first(self.low), first(self.high).map(|at| at + EDGE as i64 - 1)]
    }

    /// Returns the smallest box around both, neither of which is empty.
    #[must_use]
    pub fn around(&self, other: &Self) -> Self {
        Self {
            low: [0, 1, 2].map(|a| self.low[a].min(other.low[a])),
            high: [0, 1, 2].map(|a| self.high[a].max(other.high[a])),
        }
    }

    /// Returns the bricks that are in both boxes.
    #[must_use]
    pub fn within(&self, other: &Self) -> Self {
        Self {
            low: [0, 1, 2].map(|a| self.low[a].max(other.low[a])),
            high: [0, 1, 2].map(|a| self.high[a].min(other.high[a])),
        }
    }
}

/// Voxels of a tile along x, y and z: sixteen adjacent voxels, one vector of the hot loops.
///
/// A compact tile fits a slab better than a row of sixteen. Take the tiles that a slab ten
/// voxels thick meets, in its worst orientation: 7 in 10 of their voxels lie in the slab. With
/// rows it is 4 in 7 (measured).
pub const TILE: [usize; 3] = [4, 2, 2];

/// Numerator and weight of the weighted mean at each voxel, ordered by [`offset`]. The value is
/// `r / w` if `w` is large enough to count as seen.
///
/// 4 KiB: one voxel's neighbourhood costs one page and a handful of cache lines in any
/// orientation of the slice.
#[derive(Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C, align(64))]
pub struct Brick {
    /// Σ weight·value.
    pub r: [f32; VOXELS],
    /// Σ weight.
    pub w: [f32; VOXELS],
}

/// Time of each voxel's last write, in the writer's ticks; 0 before. Ordered by [`offset`].
#[derive(Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C, align(64))]
pub struct Stamps(pub [u32; VOXELS]);

/// Time of each voxel's last write, in 16-bit ticks of the decay since its brick's
/// [`Epoch`](super::memory::Epoch). Ordered by [`offset`].
#[derive(Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C, align(64))]
pub struct Ages(pub [u16; VOXELS]);

/// Cells of 2×2×2 voxels in a brick.
pub const CELLS: usize = VOXELS / 8;

/// Sums over the voxels of a cell of 2×2×2.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CellSquares {
    /// Σ weight².
    pub w2: f32,
    /// Σ weight·(value − mean)², about the weighted mean of each voxel's values so far.
    pub s: f32,
}

/// Sums from which standard errors follow, an eighth of the brick's size. There is one for each
/// cell of 2×2×2 voxels: neighbours have much the same error.
#[derive(Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C, align(64))]
pub struct Squares {
    /// For each tile, in their order: Σ weight² of its two cells, and Σ weight·(value − mean)² of
    /// both.
    pub tiles: [[f32; 4]; CELLS / 2],
}

impl Squares {
    /// Returns the sums of a cell, by its position in the brick.
    pub fn cell(&self, [x, y, z]: [usize; 3]) -> CellSquares {
        let tile = self.tiles[offset(2 * x, 2 * y, 2 * z) / (TILE[0] * TILE[1] * TILE[2])];
        CellSquares { w2: tile[x % 2], s: tile[2 + x % 2] }
    }
}

/// Returns the index of a voxel in its brick: tiles x fastest, and x fastest in a tile.
#[inline]
pub const fn offset(x: usize, y: usize, z: usize) -> usize {
    let [tx, ty, tz] = TILE;
    let tile = (z / tz * (EDGE / ty) + y / ty) * (EDGE / tx) + x / tx;
    tile * (tx * ty * tz) + (z % tz * ty + y % ty) * tx + x % tx
}

/// Copies the voxels of a brick in its order to x fastest, then y, then z.
#[inline]
pub(crate) fn in_lines(brick: &[f32; VOXELS], lines: &mut [f32; VOXELS]) {
    const RUN: usize = TILE[0];
    for (number, run) in brick.as_chunks::<RUN>().0.iter().enumerate() {
        let [x, y, z] = voxel_at(number * RUN);
        lines[(z * EDGE + y) * EDGE + x..][..RUN].copy_from_slice(run);
    }
}

/// Returns the voxel at an index in its brick: the inverse of [`offset`].
#[inline]
pub const fn voxel_at(place: usize) -> [usize; 3] {
    let [tx, ty, tz] = TILE;
    let (tile, lane) = (place / (tx * ty * tz), place % (tx * ty * tz));
    let (columns, rows) = (EDGE / tx, EDGE / ty);
    [
        tile % columns * tx + lane % tx,
        tile / columns % rows * ty + lane / tx % ty,
        tile / (columns * rows) * tz + lane / (tx * ty),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brick_is_one_page() {
        assert_eq!(size_of::<Brick>(), 4096);
    }

    #[test]
    fn voxel_offsets_unique_and_tiles_contiguous() {
        let mut seen = [false; VOXELS];
        for (place, seen) in seen.iter_mut().enumerate() {
            let [x, y, z] = voxel_at(place);
            assert_eq!(offset(x, y, z), place);
            *seen = x < EDGE && y < EDGE && z < EDGE;
        }
        assert!(seen.iter().all(|s| *s));
        assert_eq!([offset(1, 0, 0), offset(0, 1, 0), offset(0, 0, 1), offset(4, 0, 0)], [1, 4, 8, 16]);
    }
}
