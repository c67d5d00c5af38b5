//! The part of the lattice that a volume has, its shards, and its pyramid levels.

use serde::{Deserialize, Serialize};

/// Position of a shard in an array, in shards along z, y, x.
pub type ShardIndex = [u64; 3];

/// Voxels along the edge of a shard and of a chunk.
const EDGES: [u64; 2] = [128, 32];
/// The same, from [`LARGE`] voxels on.
const LARGE_EDGES: [u64; 2] = [256, 64];
/// Number of voxels from which on shards are larger.
const LARGE: u128 = 1 << 30;
/// Voxels along the longest edge of the coarsest level.
const COARSEST: u64 = 128;

/// The part of the lattice that a volume has.
///
/// Element 0 lies at a multiple of the shard's edge. Cells of the pyramid are then the same while
/// the volume grows, and the same for each part of it alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Extent {
    /// Lattice index of element 0, along x, y, z.
    pub first: [i64; 3],
    /// Voxels along x, y, z.
    pub size: [u64; 3],
    /// Voxels along the edge of a shard: an even number, and a multiple of the chunk's.
    pub shard: u64,
    /// Voxels along the edge of a chunk, the smallest part that can be read.
    pub chunk: u64,
}

impl Extent {
    /// Returns the extent from the shard of the lowest seen voxel to the highest seen voxel, both
    /// inclusive. Shards are larger for large volumes.
    pub fn around([low, high]: [[i64; 3]; 2]) -> Self {
        let of = |[shard, chunk]: [u64; 2]| {
            let first = low.map(|l| l.div_euclid(shard as i64) * shard as i64);
            let size = std::array::from_fn(|a| (high[a] - first[a] + 1).max(0) as u64);
            Self { first, size, shard, chunk }
        };
        let small = of(EDGES);
        if small.size.iter().map(|n| u128::from(*n)).product::<u128>() < LARGE { small } else { of(LARGE_EDGES) }
    }

    /// Returns the number of pyramid levels: until the longest edge has at most 128 voxels.
    pub fn levels(&self) -> usize {
        let longest = self.size.into_iter().max().unwrap_or(0);
        (0..64).find(|level| longest.div_ceil(1 << level) <= COARSEST).map_or(64, |level| level as usize + 1)
    }

    /// Returns the voxels of a level along z, y, x.
    pub fn shape(&self, level: usize) -> [u64; 3] {
        let [x, y, z] = self.size.map(|n| n.div_ceil(1 << level));
        [z, y, x]
    }

    /// Returns the number of a level's shards along z, y, x.
    pub fn shards(&self, level: usize) -> [u64; 3] {
        self.shape(level).map(|n| n.div_ceil(self.shard))
    }

    /// Returns all shards of a level, x fastest.
    pub fn shard_indices(&self, level: usize) -> impl Iterator<Item = ShardIndex> + use<> {
        let [nz, ny, nx] = self.shards(level);
        (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [z, y, x])))
    }

    /// Returns the voxels of a shard along z, y, x: those within the array, which ends within its
    /// last shards. `None` if there is no such shard.
    pub fn shard_size(&self, level: usize, index: ShardIndex) -> Option<[usize; 3]> {
        let (shape, shards) = (self.shape(level), self.shards(level));
        let is_inside = level < self.levels() && (0..3).all(|a| index[a] < shards[a]);
        is_inside.then(|| std::array::from_fn(|a| (shape[a] - index[a] * self.shard).min(self.shard) as usize))
    }

    /// Returns the lattice index of a shard's first voxel at level 0, along x, y, z.
    pub fn shard_first(&self, [z, y, x]: ShardIndex) -> [i64; 3] {
        let at = [x, y, z];
        std::array::from_fn(|a| self.first[a] + (at[a] * self.shard) as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extent_begins_at_multiples_of_its_shard() {
        let small = Extent::around([[-1, 0, 127], [5, 128, 127]]);
        assert_eq!((small.first, small.size), ([-128, 0, 0], [134, 129, 128]));
        assert_eq!((small.shard, small.chunk), (128, 32));
        let large = Extent::around([[-1, 0, 0], [1022, 1023, 1023]]);
        assert_eq!((large.first, large.size), ([-256, 0, 0], [1279, 1024, 1024]));
        assert_eq!((large.shard, large.chunk), (256, 64));
    }

    #[test]
    fn levels_end_at_128_voxels() {
        let of = |size: [u64; 3]| Extent { first: [0; 3], size, shard: 128, chunk: 32 };
        assert_eq!([[128, 1, 1], [129, 1, 1], [1, 256, 3], [1, 1, 257]].map(|s| of(s).levels()), [1, 2, 2, 3]);
        assert_eq!(of([257, 3, 1]).shape(2), [1, 1, 65]);
        assert_eq!(of([1, 1, u64::MAX >> 1]).levels(), 57);
    }

    #[test]
    fn last_shards_end_with_the_array() {
        let extent = Extent { first: [-128, 0, 256], size: [130, 128, 300], shard: 128, chunk: 32 };
        assert_eq!(extent.shards(0), [3, 1, 2]);
        assert_eq!(extent.shard_size(0, [2, 0, 1]), Some([44, 128, 2]));
        assert_eq!(extent.shard_size(0, [3, 0, 0]), None);
        assert_eq!(extent.shard_size(3, [0, 0, 0]), None);
        assert_eq!(extent.shard_first([1, 0, 1]), [0, 0, 384]);
        assert_eq!(extent.shard_indices(0).count(), 6);
    }
}
