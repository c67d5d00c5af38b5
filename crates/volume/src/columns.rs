//! Voxels in columns, for slices that stay perpendicular to one plane: those of the 3-DOF arm.
//!
//! Every slice then covers the same range of z with the same weights. The weight of a voxel is
//! a product w(x, y, z) = share(z)·w(x, y), and one number per column is enough (Ohbuchi, Chen
//! & Fuchs 1992, section 4.1): 4 bytes a voxel instead of 8. Columns are contiguous along z;
//! 8×8 of them make a tile, followed by their weights. Tiles exist only where something was
//! scanned. The volume grows in x and y without bound; its range of z is that of the image.
//! Under decay, the time of each column's last write follows the weights, 8 bytes a column.

use std::io;

use rustc_hash::FxHashMap;

use super::arena::Arena;
use super::brick::{BrickIndex, EDGE, VOXELS};
use super::read::{SEEN, Voxels};

/// Columns of a tile.
pub const COLUMNS: usize = EDGE * EDGE;
/// Columns are padded to whole vectors of this many voxels.
const VECTOR: usize = 16;

/// Position of a tile on the lattice: column index divided by 8, rounded down.
pub type TileIndex = [i32; 2];

/// The volume of columns.
pub struct ColumnVolume {
    /// Lattice index of each column's first voxel.
    first_z: i64,
    /// Weight of a column's voxels relative to the column's: the fraction of the kernel along z
    /// that lies on data.
    share: Vec<f32>,
    /// Voxels of a column with its padding.
    stride: usize,
    slots: FxHashMap<TileIndex, u32>,
    /// Lattice position of each slot's tile.
    places: Vec<TileIndex>,
    /// Whether columns keep the time of their last write.
    dated: bool,
    /// Tiles: Σ weight·value of 64 columns one after the other, x fastest, then Σ weight of
    /// each, then the time of each if they are dated.
    arena: Arena,
}

/// A tile for writing.
pub struct TileMut<'a> {
    /// Σ weight·value, column after column.
    pub columns: &'a mut [f32],
    /// Σ weight of each column.
    pub weights: &'a mut [f32],
    /// Time of each column's last write, ns; empty if columns are not dated.
    pub written_ns: &'a mut [i64],
}

impl<'a> TileMut<'a> {
    /// Splits the floats of a tile into its parts.
    pub fn new(tile: &'a mut [f32], stride: usize) -> Self {
        let (columns, rest) = tile.split_at_mut(COLUMNS * stride);
        let (weights, times) = rest.split_at_mut(COLUMNS);
        // Tiles begin at multiples of 64 floats, so that times are aligned.
        Self { columns, weights, written_ns: bytemuck::cast_slice_mut(times) }
    }
}

impl ColumnVolume {
    /// Returns an empty volume. Its columns begin at lattice index `first_z`; their voxels
    /// weigh `share`, in (0, 1]. Columns keep their time if `dated`.
    pub fn new(first_z: i64, share: Vec<f32>, dated: bool) -> Self {
        let stride = share.len().next_multiple_of(VECTOR);
        let arena = Arena::new(Self::floats(stride, dated) * size_of::<f32>());
        Self { first_z, share, stride, slots: FxHashMap::default(), places: Vec::new(), dated, arena }
    }

    /// Returns a copy; neither changes with the other.
    ///
    /// # Errors
    /// When the system has no memory to give.
    pub fn copy(&self) -> std::io::Result<Self> {
        Ok(Self {
            first_z: self.first_z,
            share: self.share.clone(),
            stride: self.stride,
            slots: self.slots.clone(),
            places: self.places.clone(),
            dated: self.dated,
            arena: self.arena.copy(self.places.len())?,
        })
    }

    #[inline]
    fn floats(stride: usize, dated: bool) -> usize {
        COLUMNS * (stride + 1 + if dated { size_of::<i64>() / size_of::<f32>() } else { 0 })
    }

    /// Number of tiles.
    pub fn tiles(&self) -> usize {
        self.places.len()
    }

    /// Voxels of a column, without padding.
    pub fn depth(&self) -> usize {
        self.share.len()
    }

    /// Number of allocated voxels.
    pub fn voxels(&self) -> u64 {
        (self.places.len() * COLUMNS * self.depth()) as u64
    }

    /// Voxels of a column with its padding to whole vectors.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Bytes of a tile.
    pub fn tile_bytes(&self) -> u64 {
        (self.tile_len() * size_of::<f32>()) as u64
    }

    /// Range of 8-voxel blocks along z that columns reach into, first and last.
    pub fn blocks_along_z(&self) -> std::ops::RangeInclusive<i32> {
        let block =
            |z: i64| i32::try_from(z.div_euclid(EDGE as i64)).expect("columns are made within the lattice's range");
        match self.depth() {
            // No blocks.
            0 => std::ops::RangeInclusive::new(1, 0),
            depth => block(self.first_z)..=block(self.first_z + depth as i64 - 1),
        }
    }

    /// The slot of a tile, if it exists.
    #[inline]
    pub fn find(&self, tile: TileIndex) -> Option<u32> {
        self.slots.get(&tile).copied()
    }

    /// Ensures that `more` tiles can be created.
    ///
    /// # Errors
    /// When the system has no memory to give, or beyond 2³²−1 tiles; nothing has changed then.
    pub fn reserve(&mut self, more: usize) -> io::Result<()> {
        let tiles = self.places.len() + more;
        if u32::try_from(tiles).is_err() {
            return Err(io::ErrorKind::OutOfMemory.into());
        }
        self.arena.reserve(tiles)
    }

    /// Creates a tile that does not exist.
    ///
    /// # Panics
    /// When no room was [reserved](Self::reserve) for it.
    pub fn insert(&mut self, tile: TileIndex) -> u32 {
        assert!(self.places.len() < self.arena.capacity(), "tiles are made in reserved room");
        let slot = self.places.len() as u32;
        let before = self.slots.insert(tile, slot);
        debug_assert_eq!(before, None, "a tile is made once");
        self.places.push(tile);
        slot
    }

    /// Floats of a tile.
    #[inline]
    pub fn tile_len(&self) -> usize {
        Self::floats(self.stride, self.dated)
    }

    /// Returns a tile's columns and their weights.
    #[inline]
    fn tile(&self, slot: u32) -> (&[f32], &[f32]) {
        let (columns, rest) = bytemuck::cast_slice(self.arena.piece(slot as usize)).split_at(COLUMNS * self.stride);
        (columns, &rest[..COLUMNS])
    }

    /// Time of a lattice column's last write, ns; `None` if nothing was written, or columns are
    /// not dated.
    pub fn written_ns(&self, x: i64, y: i64) -> Option<i64> {
        let (tile, column) = Self::tile_of(x, y)?;
        let slot = self.find(tile)? as usize;
        let floats: &[f32] = bytemuck::cast_slice(self.arena.piece(slot));
        let (_, rest) = floats.split_at(COLUMNS * self.stride);
        let (weights, times) = rest.split_at(COLUMNS);
        (self.dated && weights[column] > 0.0).then(|| bytemuck::cast_slice(times)[column])
    }

    /// Base address of each chunk of tiles, for the inserter that hands every tile to exactly
    /// one thread.
    pub fn chunk_pointers(&mut self) -> impl Iterator<Item = *mut f32> {
        self.arena.chunks_mut().map(|chunk| bytemuck::cast_slice_mut(chunk).as_mut_ptr())
    }

    /// Returns the chunk of a tile and the offset of its floats in the chunk, to be used with
    /// [`Self::chunk_pointers`].
    #[inline]
    pub fn locate(&self, slot: u32) -> (usize, usize) {
        let (chunk, place) = self.arena.locate(slot as usize);
        (chunk, place * self.tile_len())
    }

    /// Returns the position of a z index in the columns.
    #[inline]
    fn depth_of(&self, z: i64) -> Option<usize> {
        usize::try_from(z.checked_sub(self.first_z)?).ok().filter(|z| *z < self.depth())
    }

    /// Returns the tile of a column, and the column's index in it.
    #[inline]
    fn tile_of(x: i64, y: i64) -> Option<(TileIndex, usize)> {
        let edge = EDGE as i64;
        let [tx, ty] = [x, y].map(|v| i32::try_from(v.div_euclid(edge)).ok());
        Some(([tx?, ty?], (y.rem_euclid(edge) * edge + x.rem_euclid(edge)) as usize))
    }
}

impl ColumnVolume {
    /// Returns numerator and weight of a voxel of a tile.
    #[inline(always)]
    fn of_column(&self, columns: &[f32], weights: &[f32], column: usize, depth: usize) -> (f32, f32) {
        let share = self.share[depth];
        (share * columns[column * self.stride + depth], share * weights[column])
    }
}

impl Voxels for ColumnVolume {
    fn row(&self, [x, y, z]: [i64; 3], r: &mut [f32], w: &mut [f32]) {
        assert_eq!(r.len(), w.len());
        r.fill(0.0);
        w.fill(0.0);
        let Some(depth) = self.depth_of(z) else { return };
        let mut done = 0;
        while done < r.len() {
            let Some((tile, first)) = x.checked_add(done as i64).and_then(|x| Self::tile_of(x, y)) else {
                done += 1;
                continue;
            };
            let count = (EDGE - first % EDGE).min(r.len() - done);
            if let Some(slot) = self.find(tile) {
                let (columns, weights) = self.tile(slot);
                let places = r[done..done + count].iter_mut().zip(&mut w[done..done + count]);
                for (i, (r, w)) in places.enumerate() {
                    (*r, *w) = self.of_column(columns, weights, first + i, depth);
                }
            }
            done += count;
        }
    }

    fn block(&self, [x, y, z]: BrickIndex, r: &mut [f32; VOXELS], w: &mut [f32; VOXELS]) {
        r.fill(0.0);
        w.fill(0.0);
        let Some(slot) = self.find([x, y]) else { return };
        let (columns, weights) = self.tile(slot);
        let first = i64::from(z) * EDGE as i64;
        for layer in 0..EDGE {
            let Some(depth) = self.depth_of(first + layer as i64) else { continue };
            let (r, w) = (&mut r[layer * COLUMNS..][..COLUMNS], &mut w[layer * COLUMNS..][..COLUMNS]);
            for (column, (r, w)) in r.iter_mut().zip(w).enumerate() {
                (*r, *w) = self.of_column(columns, weights, column, depth);
            }
        }
    }

    fn seen_bounds(&self) -> Option<([i64; 3], [i64; 3])> {
        let mut lowest = [i64::MAX; 3];
        let mut highest = [i64::MIN; 3];
        for (slot, tile) in self.places.iter().enumerate() {
            let (_, weights) = self.tile(slot as u32);
            for (column, weight) in weights.iter().enumerate() {
                let seen = |share: &f32| share * weight > SEEN;
                let (Some(low), Some(high)) = (self.share.iter().position(seen), self.share.iter().rposition(seen))
                else {
                    continue;
                };
                let at = |axis: usize, inside: usize| i64::from(tile[axis]) * EDGE as i64 + inside as i64;
                let [x, y] = [at(0, column % EDGE), at(1, column / EDGE)];
                let first = [x, y, self.first_z + low as i64];
                let last = [x, y, self.first_z + high as i64];
                for axis in 0..3 {
                    lowest[axis] = lowest[axis].min(first[axis]);
                    highest[axis] = highest[axis].max(last[axis]);
                }
            }
        }
        (lowest[0] <= highest[0]).then_some((lowest, highest))
    }

    fn blocks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        let layers = self.blocks_along_z();
        Box::new(self.places.iter().flat_map(move |[x, y]| layers.clone().map(move |z| [*x, *y, z])))
    }

    fn bytes(&self) -> u64 {
        let tables = self.slots.capacity() * (size_of::<(TileIndex, u32)>() + 1)
            + self.places.capacity() * size_of::<TileIndex>()
            + self.share.capacity() * size_of::<f32>();
        self.places.len() as u64 * self.tile_bytes() + tables as u64
    }

    fn growth_bytes(&self) -> u64 {
        self.arena.growth_bytes(self.places.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two tiles on either side of the origin; column (−1, 3) weighs 2, column (9, 8) weighs 0.5.
    fn volume() -> ColumnVolume {
        let mut volume = ColumnVolume::new(-5, vec![0.5, 1.0, 1.0, 0.001], false);
        volume.reserve(2).unwrap();
        for (tile, column, weight) in [([-1, 0], 3 * 8 + 7, 2.0), ([1, 1], 1, 0.5)] {
            let slot = volume.insert(tile);
            assert_eq!(volume.find(tile), Some(slot));
            let stride = volume.stride();
            let floats: &mut [f32] = bytemuck::cast_slice_mut(volume.arena.piece_mut(slot as usize));
            floats[COLUMNS * stride + column] = weight;
            for z in 0..4 {
                floats[column * stride + z] = weight * (10.0 + z as f32);
            }
        }
        volume
    }

    #[test]
    fn voxel_weight_is_share_of_column() {
        let volume = volume();
        assert_eq!(volume.voxel([-1, 3, -5]), (10.0, 1.0));
        assert_eq!(volume.voxel([-1, 3, -4]), (22.0, 2.0));
        assert_eq!(volume.voxel([9, 8, -3]), (6.0, 0.5));
        for outside in [[-1, 3, -6], [-1, 3, -1], [-2, 3, -4], [5, 5, -4], [i64::MAX, 0, -4], [0, 0, i64::MIN]] {
            assert_eq!(volume.voxel(outside), (0.0, 0.0), "{outside:?}");
        }
        let (mut r, mut w) = ([9.0; 20], [9.0; 20]);
        volume.row([-8, 8, -4], &mut r, &mut w);
        assert_eq!(w, std::array::from_fn(|i| if i == 17 { 0.5 } else { 0.0 }));
        assert_eq!(r[17], 5.5);
    }

    #[test]
    fn bounds_blocks_and_bytes_match_content() {
        let volume = volume();
        // In the column of weight 0.5, the last voxel's weight is too small to count as seen;
        // in the column of weight 2 it is not.
        assert_eq!(volume.seen_bounds(), Some(([-1, 3, -5], [9, 8, -2])));
        assert_eq!(volume.blocks().collect::<Vec<_>>(), [[-1, 0, -1], [1, 1, -1]]);
        assert_eq!(volume.voxels(), 2 * 64 * 4);
        assert!(volume.bytes() < 2 * (64 * 16 * 4 + 256) + 400, "{}", volume.bytes());
        let empty = ColumnVolume::new(0, Vec::new(), false);
        assert_eq!((empty.seen_bounds(), empty.blocks().count()), (None, 0));
    }
}
