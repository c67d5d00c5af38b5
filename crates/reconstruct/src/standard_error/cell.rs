//! Sums of a cell of voxels, and the spread of its slices.

use volume::brick::{BrickIndex, CELLS, CellSquares, EDGE, VOXELS};
use volume::{BrickVolume, Voxels};

/// Part of a slice beyond one that counts as another.
const LEAST: f64 = 1e-4;
/// Cells along the edge of a block.
pub(super) const ACROSS: usize = EDGE / 2;

/// The voxels of a cell together.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    /// n.
    pub(super) slices: f64,
    /// s²; 0 for one slice.
    pub(super) variance: f64,
}

impl Cell {
    /// Returns the cell of voxels with these weights; `None` if none was seen.
    pub(super) fn new(weights: impl Iterator<Item = f32>, squares: CellSquares) -> Option<Self> {
        let [sum, sum2] = weights.map(f64::from).fold([0.0; 2], |[sum, sum2], w| [sum + w, sum2 + w * w]);
        let w2 = f64::from(squares.w2);
        if w2 <= 0.0 {
            return None;
        }
        // Above the rounding of one slice's sums.
        let slices = if sum2 > (1.0 + LEAST) * w2 { sum2 / w2 } else { 1.0 };
        let variance = if slices > 1.0 { f64::from(squares.s) / sum * slices / (slices - 1.0) } else { 0.0 };
        Some(Self { slices, variance })
    }

    /// Returns all cells of a block with these weights, x fastest.
    pub(super) fn of_block(volume: &BrickVolume, block: BrickIndex, weights: &[f32; VOXELS]) -> [Option<Self>; CELLS] {
        let Some(squares) = volume.squares(block) else { return [None; CELLS] };
        std::array::from_fn(|cell| {
            let at = position(cell, ACROSS);
            Self::new(voxels_of(at).map(|i| weights[i]), squares.cell(at))
        })
    }
}

/// Returns the position along x, y and z of an index in a cube of this edge, x fastest.
pub(super) fn position(index: usize, edge: usize) -> [usize; 3] {
    [index % edge, index / edge % edge, index / (edge * edge)]
}

/// Returns the index in its block of each voxel of a cell.
pub(super) fn voxels_of([x, y, z]: [usize; 3]) -> impl Iterator<Item = usize> {
    (0..8).map(move |i| ((2 * z + i / 4) * EDGE + 2 * y + i / 2 % 2) * EDGE + 2 * x + i % 2)
}

/// Returns the index in its block of the cell around a voxel.
pub(super) fn cell_around([x, y, z]: [usize; 3]) -> usize {
    ((z / 2) * ACROSS + y / 2) * ACROSS + x / 2
}
