//! Read access to a volume, for export, rendering and comparison. Bricks and columns are read
//! alike.

use super::brick::{BrickIndex, EDGE, Squares, VOXELS};

/// A voxel whose weight does not exceed this is unseen. A sample at the kernel's peak weighs
/// about 1; this is the far end of its tail.
pub const SEEN: f32 = 1e-3;

/// Numerators and weights on a lattice. A voxel's value is r / w if w exceeds [`SEEN`];
/// otherwise it is unseen.
pub trait Voxels: Sync {
    /// Returns numerator and weight of one voxel, the same bits as [`Self::row`]; zeros if nothing
    /// is stored.
    fn voxel(&self, voxel: [i64; 3]) -> (f32, f32) {
        let (mut r, mut w) = ([0.0], [0.0]);
        self.row(voxel, &mut r, &mut w);
        (r[0], w[0])
    }

    /// Reads numerators and weights of the voxels from `start` along x, as many as `r` and `w`
    /// hold; zeros if nothing is stored.
    ///
    /// # Panics
    /// When `r` and `w` differ in length.
    fn row(&self, start: [i64; 3], r: &mut [f32], w: &mut [f32]);

    /// Reads numerators and weights of a block of 8³ voxels, x fastest: the same bits as
    /// [`Self::row`].
    fn block(&self, block: BrickIndex, r: &mut [f32; VOXELS], w: &mut [f32; VOXELS]) {
        for (line, (r, w)) in r.chunks_exact_mut(EDGE).zip(w.chunks_exact_mut(EDGE)).enumerate() {
            self.row(line_of(block, line), r, w);
        }
    }

    /// Returns the sums of squares of a block of 8³ voxels; `None` if nothing is stored, or the
    /// volume keeps none.
    fn squares(&self, _block: BrickIndex) -> Option<&Squares> {
        None
    }

    /// Smallest and largest lattice index of the seen voxels, both inclusive; `None` when
    /// nothing was seen.
    fn seen_bounds(&self) -> Option<([i64; 3], [i64; 3])>;

    /// Iterates over the blocks of 8³ voxels that hold anything, each once, by lattice index
    /// divided by 8, in the order in which they were first touched.
    fn blocks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_>;

    /// Bytes used.
    fn bytes(&self) -> u64;

    /// Bytes that are held for the volume to grow, beyond those used.
    fn growth_bytes(&self) -> u64 {
        0
    }
}

/// Values and weights on a lattice, for renderers: computed from sums, or read from a file.
pub trait Values: Sync {
    /// Reads value and weight of the voxels from `start` along x, as many as `value` and
    /// `weight` hold; both 0 for unseen voxels.
    ///
    /// # Panics
    /// When `value` and `weight` differ in length.
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]);

    /// Reads values and weights of a block of 8³ voxels, x fastest: the same bits as
    /// [`Self::values`].
    fn brick(&self, block: BrickIndex, value: &mut [f32; VOXELS], weight: &mut [f32; VOXELS]) {
        lines(self, block, value, weight);
    }

    /// Iterates over the blocks of 8³ voxels that may hold anything, each once, by lattice
    /// index divided by 8.
    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_>;
}

/// Reads a block line by line along x: the default of [`Values::brick`].
pub(crate) fn lines(
    volume: &(impl Values + ?Sized),
    block: BrickIndex,
    value: &mut [f32; VOXELS],
    weight: &mut [f32; VOXELS],
) {
    for (line, (value, weight)) in value.chunks_exact_mut(EDGE).zip(weight.chunks_exact_mut(EDGE)).enumerate() {
        volume.values(line_of(block, line), value, weight);
    }
}

/// Returns the lattice index of the first voxel of a line along x of a block.
#[inline]
fn line_of(block: BrickIndex, line: usize) -> [i64; 3] {
    let [x, y, z] = block.map(|b| i64::from(b) * EDGE as i64);
    [x, y + (line % EDGE) as i64, z + (line / EDGE) as i64]
}

/// Converts sums to values; unseen voxels get value 0 and weight 0.
#[inline]
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
