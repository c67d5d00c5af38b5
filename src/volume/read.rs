//! A volume as those see it who only look: export, drawing, comparison. Bricks and columns are read alike.

use super::brick::{BrickIndex, EDGE, VOXELS};
use super::sparse::SEEN;

/// Numerators and weights on a lattice. A voxel's value is r / w where w exceeds [`SEEN`]; elsewhere it was not seen.
pub trait Voxels: Sync {
    /// Numerator and weight of one voxel; zeros where nothing is held.
    fn voxel(&self, voxel: [i64; 3]) -> (f32, f32);

    /// Numerators and weights of the voxels from `start` on along x, as many as `r` and `w` hold; zeros where nothing is held.
    ///
    /// # Panics
    /// When `r` and `w` differ in length.
    fn row(&self, start: [i64; 3], r: &mut [f32], w: &mut [f32]);

    /// Numerators and weights of a block of 8³ voxels, x fastest: the bits of [`Self::row`].
    fn block(&self, block: BrickIndex, r: &mut [f32; VOXELS], w: &mut [f32; VOXELS]) {
        for (line, (r, w)) in r.chunks_exact_mut(EDGE).zip(w.chunks_exact_mut(EDGE)).enumerate() {
            self.row(line_of(block, line), r, w);
        }
    }

    /// Smallest and largest lattice index of the voxels that were seen, both inclusive; `None` when nothing was.
    fn seen_bounds(&self) -> Option<([i64; 3], [i64; 3])>;

    /// The blocks of 8³ voxels that hold anything, each once, by lattice index divided by 8; in the order in which they were first touched.
    fn blocks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_>;

    /// Bytes held.
    fn bytes(&self) -> u64;
}

/// Values and weights on a lattice, for those who draw: what was divided, or read from a file.
pub trait Values: Sync {
    /// Value and weight of the voxels from `start` on along x, as many as `value` and `weight` hold; both 0 where nothing was seen.
    ///
    /// # Panics
    /// When `value` and `weight` differ in length.
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]);

    /// Values and weights of a block of 8³ voxels, x fastest: the bits of [`Self::values`].
    fn brick(&self, block: BrickIndex, value: &mut [f32; VOXELS], weight: &mut [f32; VOXELS]) {
        for (line, (value, weight)) in value.chunks_exact_mut(EDGE).zip(weight.chunks_exact_mut(EDGE)).enumerate() {
            self.values(line_of(block, line), value, weight);
        }
    }

    /// The blocks of 8³ voxels that may hold anything, each once, by lattice index divided by 8.
    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_>;
}

/// Lattice index of the first voxel of a line along x of a block.
fn line_of(block: BrickIndex, line: usize) -> [i64; 3] {
    let [x, y, z] = block.map(|b| i64::from(b) * EDGE as i64);
    [x, y + (line % EDGE) as i64, z + (line / EDGE) as i64]
}

/// Sums to values: what was not seen is 0 and weighs 0.
fn divide(value: &mut [f32], weight: &mut [f32]) {
    for (value, weight) in value.iter_mut().zip(weight) {
        let seen = *weight > SEEN;
        *value = if seen { *value / *weight } else { 0.0 };
        *weight = if seen { *weight } else { 0.0 };
    }
}

impl<V: Voxels + ?Sized> Values for V {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        self.row(start, value, weight);
        divide(value, weight);
    }

    fn brick(&self, block: BrickIndex, value: &mut [f32; VOXELS], weight: &mut [f32; VOXELS]) {
        self.block(block, value, weight);
        divide(value, weight);
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        self.blocks()
    }
}
