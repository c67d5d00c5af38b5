//! A volume as those see it who only look: export, drawing, comparison. Bricks and columns are read alike.

use super::brick::BrickIndex;

/// Numerators and weights on a lattice. A voxel's value is r / w where w exceeds [`SEEN`](super::sparse::SEEN); elsewhere it was not seen.
pub trait Voxels {
    /// Numerator and weight of one voxel; zeros where nothing is held.
    fn voxel(&self, voxel: [i64; 3]) -> (f32, f32);

    /// Numerators and weights of the voxels from `start` on along x, as many as `r` and `w` hold; zeros where nothing is held.
    ///
    /// # Panics
    /// When `r` and `w` differ in length.
    fn row(&self, start: [i64; 3], r: &mut [f32], w: &mut [f32]);

    /// Smallest and largest lattice index of the voxels that were seen, both inclusive; `None` when nothing was.
    fn seen_bounds(&self) -> Option<([i64; 3], [i64; 3])>;

    /// The blocks of 8³ voxels that hold anything, each once, by lattice index divided by 8; in the order in which they were first touched.
    fn blocks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_>;

    /// Bytes held.
    fn bytes(&self) -> u64;
}
