//! Bricks that exist only where something was scanned.
//!
//! There are two levels. A hash map holds blocks of 8³ bricks, each a plain table of slots. An
//! arena holds the bricks, in chunks that never move. Finding the bricks of a row costs one hash
//! per 64 voxels, and growing never copies a brick. Memory follows the scanned region, wherever
//! in the world it is.

use std::io;

use rustc_hash::FxHashMap;

use super::arena::Arena;
use super::brick::{Ages, Brick, BrickIndex, EDGE, Squares, Stamps, VOXELS, in_lines, offset, voxel_at};
use super::memory::{Epoch, Memory, remaining};
pub use super::read::SEEN;
use super::read::Voxels;

/// Bricks along a block's edge.
const BLOCK: i32 = 8;
/// Bricks whose memory is reserved together, 2 MiB.
const CHUNK: usize = 512;
/// Slot of a brick that does not exist.
const ABSENT: u32 = u32::MAX;

/// Index of a brick in the arena; valid as long as the volume.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Slot(u32);

impl Slot {
    /// Index in the arena.
    #[inline]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// The sparse volume.
pub struct BrickVolume {
    blocks: FxHashMap<BrickIndex, Box<[u32; 512]>>,
    /// Fresh memory is zero, which is an empty brick.
    bricks: Arena,
    memory: Memory,
    /// Used for [`Memory::Stamps`].
    stamps: Arena,
    /// Used for [`Memory::Ages`].
    ages: Arena,
    /// Used for [`Memory::Squares`].
    squares: Arena,
    /// By slot, for [`Memory::Ages`] and [`Memory::Epochs`].
    epochs: Vec<Epoch>,
    /// Lattice position of each slot's brick; its length is the number of bricks.
    places: Vec<BrickIndex>,
}

#[inline]
fn block_of(brick: BrickIndex) -> (BrickIndex, usize) {
    let block = brick.map(|b| b.div_euclid(BLOCK));
    let [x, y, z] = brick.map(|b| b.rem_euclid(BLOCK) as usize);
    (block, (z * 8 + y) * 8 + x)
}

impl Default for BrickVolume {
    fn default() -> Self {
        Self::remembering(Memory::Sums)
    }
}

impl BrickVolume {
    /// Returns an empty volume.
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns an empty volume that keeps more than sums.
    pub fn remembering(memory: Memory) -> Self {
        // All arenas have equally many pieces in a chunk, so that a slot has the same position
        // in each.
        let arena = |bytes| Arena::in_chunks(bytes, CHUNK);
        Self {
            blocks: FxHashMap::default(),
            bricks: arena(size_of::<Brick>()),
            memory,
            stamps: arena(size_of::<Stamps>()),
            ages: arena(size_of::<Ages>()),
            squares: arena(size_of::<Squares>()),
            epochs: Vec::new(),
            places: Vec::new(),
        }
    }

    /// Returns a copy; neither changes with the other.
    ///
    /// # Errors
    /// When the system has no memory to give.
    pub fn copy(&self) -> io::Result<Self> {
        let bricks = self.places.len();
        let count = |arena: &Arena| bricks.min(arena.capacity());
        Ok(Self {
            blocks: self.blocks.clone(),
            bricks: self.bricks.copy(bricks)?,
            memory: self.memory,
            stamps: self.stamps.copy(count(&self.stamps))?,
            ages: self.ages.copy(count(&self.ages))?,
            squares: self.squares.copy(count(&self.squares))?,
            epochs: self.epochs.clone(),
            places: self.places.clone(),
        })
    }

    /// Bytes for one more brick, without tables.
    pub fn brick_bytes(&self) -> u64 {
        let beside = match self.memory {
            Memory::Sums => 0,
            Memory::Stamps => size_of::<Stamps>(),
            Memory::Ages => size_of::<Ages>() + size_of::<Epoch>(),
            Memory::Epochs { .. } => size_of::<Epoch>(),
            Memory::Squares => size_of::<Squares>(),
        };
        (size_of::<Brick>() + beside) as u64
    }

    /// Returns a brick's epoch.
    ///
    /// # Panics
    /// When the volume keeps none.
    #[inline]
    pub fn epoch(&self, slot: Slot) -> Epoch {
        self.epochs[slot.index()]
    }

    /// Sets a brick's epoch.
    ///
    /// # Panics
    /// When the volume keeps none.
    #[inline]
    pub fn set_epoch(&mut self, slot: Slot, epoch: Epoch) {
        self.epochs[slot.index()] = epoch;
    }

    /// Number of bricks.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether the volume is empty.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// The slot of a brick, if it exists.
    #[inline]
    pub fn find(&self, index: BrickIndex) -> Option<Slot> {
        let (block, place) = block_of(index);
        let slot = self.blocks.get(&block)?[place];
        (slot != ABSENT).then_some(Slot(slot))
    }

    /// Returns a finder for bricks that mostly lie beside each other.
    pub fn finder(&self) -> Finder<'_> {
        Finder { volume: self, block: [i32::MIN; 3], table: None }
    }

    /// Ensures that `more` bricks can be created.
    ///
    /// # Errors
    /// When the system has no memory to give, or beyond 2³²−1 bricks; nothing has changed then.
    pub fn reserve(&mut self, more: usize) -> io::Result<()> {
        let bricks = self.places.len() + more;
        if u32::try_from(bricks).is_err() {
            return Err(io::ErrorKind::OutOfMemory.into());
        }
        self.bricks.reserve(bricks)?;
        match self.memory {
            Memory::Stamps => self.stamps.reserve(bricks),
            Memory::Ages => self.ages.reserve(bricks),
            Memory::Squares => self.squares.reserve(bricks),
            Memory::Sums | Memory::Epochs { .. } => Ok(()),
        }
    }

    /// Returns the slot of a brick, creating it if needed, and whether it was created.
    ///
    /// # Panics
    /// When no room was [reserved](Self::reserve) for it.
    pub fn find_or_insert(&mut self, index: BrickIndex) -> (Slot, bool) {
        let (block, place) = block_of(index);
        let entry = &mut self.blocks.entry(block).or_insert_with(|| Box::new([ABSENT; 512]))[place];
        if *entry != ABSENT {
            return (Slot(*entry), false);
        }
        let slot = self.places.len();
        assert!(slot < self.bricks.capacity(), "bricks are made in reserved room");
        *entry = slot as u32;
        self.places.push(index);
        if matches!(self.memory, Memory::Ages | Memory::Epochs { .. }) {
            self.epochs.push(Epoch::at(0));
        }
        (Slot(slot as u32), true)
    }

    /// Returns a brick.
    #[inline]
    pub fn brick(&self, slot: Slot) -> &Brick {
        bytemuck::from_bytes(self.bricks.piece(slot.index()))
    }

    /// Returns a brick for writing.
    #[inline]
    pub fn brick_mut(&mut self, slot: Slot) -> &mut Brick {
        bytemuck::from_bytes_mut(self.bricks.piece_mut(slot.index()))
    }

    /// Returns the ages of a brick's voxels for writing; only meaningful with [`Memory::Ages`].
    ///
    /// # Panics
    /// When the volume keeps none.
    #[inline]
    pub fn ages_mut(&mut self, slot: Slot) -> &mut Ages {
        bytemuck::from_bytes_mut(self.ages.piece_mut(slot.index()))
    }

    /// Lattice position of a brick.
    #[inline]
    pub fn place(&self, slot: Slot) -> BrickIndex {
        self.places[slot.index()]
    }

    /// Iterates over all bricks with their positions, in the order in which they were first
    /// touched.
    pub fn iter(&self) -> impl Iterator<Item = (BrickIndex, &Brick)> {
        self.places.iter().enumerate().map(|(slot, place)| (*place, self.brick(Slot(slot as u32))))
    }

    /// Base address of each chunk, for the inserter that hands every brick to exactly one
    /// thread.
    pub fn chunk_pointers(&mut self) -> impl Iterator<Item = *mut Brick> {
        self.bricks.chunks_mut().map(|chunk| bytemuck::cast_slice_mut(chunk).as_mut_ptr())
    }

    /// Base addresses of the voxels' times, if they are kept.
    pub fn stamp_pointers(&mut self) -> impl Iterator<Item = *mut Stamps> {
        self.stamps.chunks_mut().map(|chunk| bytemuck::cast_slice_mut(chunk).as_mut_ptr())
    }

    /// Base addresses of the voxels' ages, if they are kept.
    pub fn age_pointers(&mut self) -> impl Iterator<Item = *mut Ages> {
        self.ages.chunks_mut().map(|chunk| bytemuck::cast_slice_mut(chunk).as_mut_ptr())
    }

    /// Base addresses of the sums of squares, if they are kept.
    pub fn square_pointers(&mut self) -> impl Iterator<Item = *mut Squares> {
        self.squares.chunks_mut().map(|chunk| bytemuck::cast_slice_mut(chunk).as_mut_ptr())
    }

    /// Returns the chunk of a slot and its position in the chunk, to be used with
    /// [`Self::chunk_pointers`].
    #[inline]
    pub fn locate(&self, slot: Slot) -> (usize, usize) {
        self.bricks.locate(slot.index())
    }

    /// Returns the conversion from stored to read sums. Under forward decay, sums are as of the
    /// brick's last touch, and seen voxels stay seen.
    fn reading(&self, slot: Slot) -> impl Fn(f32, f32) -> (f32, f32) + use<> {
        let remaining = match self.memory {
            Memory::Epochs { rate_per_s } => Some(remaining(rate_per_s, self.epoch(slot))),
            _ => None,
        };
        move |r, w| match remaining {
            Some(remaining) if w > 0.0 => {
                let scale = remaining.max(2.0 * SEEN / w);
                (r * scale, w * scale)
            }
            _ => (r, w),
        }
    }
}

impl Voxels for BrickVolume {
    fn voxel(&self, voxel: [i64; 3]) -> (f32, f32) {
        let mut brick = [0_i32; 3];
        for (b, v) in brick.iter_mut().zip(voxel) {
            match i32::try_from(v.div_euclid(EDGE as i64)) {
                Ok(index) => *b = index,
                Err(_) => return (0.0, 0.0),
            }
        }
        let Some(slot) = self.find(brick) else { return (0.0, 0.0) };
        let [x, y, z] = voxel.map(|v| v.rem_euclid(EDGE as i64) as usize);
        let brick = self.brick(slot);
        let place = offset(x, y, z);
        self.reading(slot)(brick.r[place], brick.w[place])
    }

    fn row(&self, start: [i64; 3], r: &mut [f32], w: &mut [f32]) {
        assert_eq!(r.len(), w.len());
        let edge = EDGE as i64;
        let [y, z] = [start[1], start[2]].map(|v| v.rem_euclid(edge) as usize);
        let mut finder = self.finder();
        let mut done = 0;
        while done < r.len() {
            let x = start[0] + done as i64;
            let inside = x.rem_euclid(edge) as usize;
            let count = (EDGE - inside).min(r.len() - done);
            let index = [x, start[1], start[2]].map(|v| i32::try_from(v.div_euclid(edge)).ok());
            let slot = match index {
                [Some(x), Some(y), Some(z)] => finder.find([x, y, z]),
                _ => None,
            };
            let (r, w) = (&mut r[done..done + count], &mut w[done..done + count]);
            match slot {
                Some(slot) => {
                    let (brick, reading) = (self.brick(slot), self.reading(slot));
                    for (i, (r, w)) in r.iter_mut().zip(w).enumerate() {
                        let place = offset(inside + i, y, z);
                        (*r, *w) = reading(brick.r[place], brick.w[place]);
                    }
                }
                None => {
                    r.fill(0.0);
                    w.fill(0.0);
                }
            }
            done += count;
        }
    }

    fn block(&self, block: BrickIndex, r: &mut [f32; VOXELS], w: &mut [f32; VOXELS]) {
        let Some(slot) = self.find(block) else {
            r.fill(0.0);
            w.fill(0.0);
            return;
        };
        let brick = self.brick(slot);
        in_lines(&brick.r, r);
        in_lines(&brick.w, w);
        if matches!(self.memory, Memory::Epochs { .. }) {
            let reading = self.reading(slot);
            for (r, w) in r.iter_mut().zip(w) {
                (*r, *w) = reading(*r, *w);
            }
        }
    }

    fn squares(&self, block: BrickIndex) -> Option<&Squares> {
        let slot = self.find(block).filter(|_| self.memory == Memory::Squares)?;
        Some(bytemuck::from_bytes(self.squares.piece(slot.index())))
    }

    fn seen_bounds(&self) -> Option<([i64; 3], [i64; 3])> {
        let mut lowest = [i64::MAX; 3];
        let mut highest = [i64::MIN; 3];
        for (place, brick) in self.iter() {
            let base = place.map(|b| i64::from(b) * EDGE as i64);
            // A brick inside the box found so far cannot widen it.
            if (0..3).all(|a| base[a] >= lowest[a] && base[a] + (EDGE as i64) - 1 <= highest[a]) {
                continue;
            }
            // Forward decay scales weights differently; there, any weight counts as seen.
            let least = if matches!(self.memory, Memory::Epochs { .. }) { 0.0 } else { SEEN };
            for voxel in 0..VOXELS {
                if brick.w[voxel] > least {
                    let at = voxel_at(voxel);
                    for a in 0..3 {
                        lowest[a] = lowest[a].min(base[a] + at[a] as i64);
                        highest[a] = highest[a].max(base[a] + at[a] as i64);
                    }
                }
            }
        }
        (lowest[0] <= highest[0]).then_some((lowest, highest))
    }

    fn blocks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        Box::new(self.places.iter().copied())
    }

    fn bytes(&self) -> u64 {
        let bricks = self.places.len() * self.brick_bytes() as usize;
        let tables = self.blocks.len() * (512 * 4 + size_of::<(BrickIndex, usize)>());
        (bricks + tables + self.places.capacity() * size_of::<BrickIndex>()) as u64
    }

    fn growth_bytes(&self) -> u64 {
        let arenas = [&self.bricks, &self.stamps, &self.ages, &self.squares];
        arenas.into_iter().map(|arena| arena.growth_bytes(self.places.len())).sum()
    }
}

/// Looks up bricks and remembers the block of the last one: along a row of bricks, one look-up
/// in eight computes the hash.
pub struct Finder<'a> {
    volume: &'a BrickVolume,
    block: BrickIndex,
    table: Option<&'a [u32; 512]>,
}

impl Finder<'_> {
    /// Same as [`BrickVolume::find`].
    #[inline]
    pub fn find(&mut self, index: BrickIndex) -> Option<Slot> {
        let (block, place) = block_of(index);
        if block != self.block {
            self.block = block;
            self.table = self.volume.blocks.get(&block).map(|table| &**table);
        }
        let slot = self.table?[place];
        (slot != ABSENT).then_some(Slot(slot))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bricks_exist_on_both_sides_of_origin() {
        let mut volume = BrickVolume::new();
        volume.reserve(4).unwrap();
        let places = [[0, 0, 0], [-1, 0, 0], [7, 8, -9], [1_000_000, -1_000_000, 3]];
        for place in places {
            assert_eq!(volume.find(place), None);
            let (slot, made) = volume.find_or_insert(place);
            assert!(made);
            assert_eq!(volume.find_or_insert(place), (slot, false));
            assert_eq!(volume.finder().find(place), Some(slot));
            assert_eq!(volume.place(slot), place);
        }
        assert_eq!(volume.len(), 4);
        assert_eq!(volume.find([1, 0, 0]), None);
    }

    #[test]
    fn copy_has_same_voxels_and_does_not_follow() {
        for memory in [Memory::Sums, Memory::Stamps, Memory::Ages, Memory::Epochs { rate_per_s: 1.0 }, Memory::Squares]
        {
            let mut volume = BrickVolume::remembering(memory);
            volume.reserve(CHUNK + 1).unwrap();
            for x in 0..=CHUNK as i32 {
                let (slot, _) = volume.find_or_insert([x, 0, 0]);
                volume.brick_mut(slot).w[3] = (x + 1) as f32;
            }
            let copy = volume.copy().unwrap();
            volume.brick_mut(Slot(0)).w[3] = 0.0;
            let bricks: Vec<(BrickIndex, f32)> = copy.iter().map(|(place, brick)| (place, brick.w[3])).collect();
            let expected: Vec<(BrickIndex, f32)> = (0..=CHUNK as i32).map(|x| ([x, 0, 0], (x + 1) as f32)).collect();
            assert_eq!(bricks, expected, "{memory:?}");
            assert_eq!(copy.find([7, 0, 0]), volume.find([7, 0, 0]));
        }
    }

    #[test]
    fn memory_depends_on_bricks_not_distance() {
        let mut volume = BrickVolume::new();
        volume.reserve(64).unwrap();
        for far in 0..64 {
            volume.find_or_insert([far * 10_000_000, 0, 0]);
        }
        assert!(volume.bytes() <= 64 * (4096 + 2100 + 64), "{}", volume.bytes());
        // All chunks, used or not: what the process holds.
        let held = |chunks: u64| chunks * CHUNK as u64 * 4096;
        assert_eq!(volume.growth_bytes() + 64 * 4096, held(3), "two chunks are being prepared");
        volume.reserve(CHUNK - 64).unwrap();
        assert_eq!(volume.growth_bytes() + 64 * 4096, held(3));
        volume.reserve(CHUNK).unwrap();
        assert_eq!(volume.growth_bytes() + 64 * 4096, held(5), "two more, as one is left");
    }

    #[test]
    fn bounds_are_those_of_seen_voxels() {
        let mut volume = BrickVolume::new();
        assert_eq!(volume.seen_bounds(), None);
        volume.reserve(2).unwrap();
        for (place, voxel) in [([-1, 0, 0], offset(7, 3, 2)), ([2, 1, 0], offset(0, 0, 5))] {
            let (slot, _) = volume.find_or_insert(place);
            volume.brick_mut(slot).w[voxel] = 1.0;
        }
        assert_eq!(volume.seen_bounds(), Some(([-1, 3, 2], [16, 8, 5])));
        assert_eq!(volume.voxel([-1, 3, 2]), (0.0, 1.0));
        assert_eq!(volume.voxel([-1, 3, 3]), (0.0, 0.0));
        assert_eq!(volume.voxel([i64::MAX, 0, 0]), (0.0, 0.0));
        let (mut r, mut w) = ([9.0; 30], [9.0; 30]);
        volume.row([-11, 3, 2], &mut r, &mut w);
        assert_eq!((r, w), ([0.0; 30], std::array::from_fn(|i| if i == 10 { 1.0 } else { 0.0 })));
        volume.row([0, 8, 5], &mut r, &mut w);
        assert_eq!(w.iter().position(|w| *w == 1.0), Some(16));
    }
}
