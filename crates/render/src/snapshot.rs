//! Value and weight of the voxels of the render region that can change what is seen, as last read
//! from the volume, and which of them have changed.

mod reading;

use std::ops::Range;

use simd::sharing::Sharing;
use volume::brick::{BrickIndex, EDGE, VOXELS};
use volume::{Prism, Values};

use super::region::RenderRegion;
use super::stock::Stock;

/// Bricks that one thread task dilates.
const DILATED_PER_TASK: usize = 64;
/// No brick.
pub(super) const ABSENT: u32 = u32::MAX;

/// No brick of a list.
const UNCHANGED: u32 = u32::MAX;

/// A bit for each voxel of a brick: bit y·8 + x of element z.
pub(super) type Bits = [u64; EDGE];

/// Columns x = 0 and x = 7 of a layer's bits.
pub(super) const FIRST_X: u64 = 0x0101_0101_0101_0101;
const LAST_X: u64 = 0x8080_8080_8080_8080;

/// The neighbours that share a face with a brick: axis and direction.
pub(super) const FACES: [(usize, i64); 6] = [(0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1)];

/// Whether a brick has shown anything.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Visibility {
    Never,
    /// For the first time in the present reading.
    Now,
    /// Before. A brick beside it that is not held was empty then.
    Before,
}

/// Value and weight of a brick's voxels, x fastest; both 0 where nothing was seen.
#[derive(Clone)]
pub(super) struct Brick {
    pub(super) value: [f32; VOXELS],
    pub(super) weight: [f32; VOXELS],
}

/// A brick of which nothing was seen.
static UNSEEN: Brick = Brick { value: [0.0; VOXELS], weight: [0.0; VOXELS] };

impl Default for Brick {
    fn default() -> Self {
        UNSEEN.clone()
    }
}

impl Brick {
    /// Reads a brick of the volume; voxels outside of a box count as unseen.
    fn read(&mut self, volume: &(impl Values + ?Sized), brick: BrickIndex, [low, high]: [[i64; 3]; 2]) {
        let Self { value, weight } = self;
        volume.brick(brick, value, weight);
        let start = brick.map(|b| i64::from(b) * EDGE as i64);
        let last = EDGE as i64 - 1;
        if (0..3).all(|a| start[a] >= low[a] && start[a] + last <= high[a]) {
            return;
        }
        for place in 0..VOXELS {
            let inside = [place % EDGE, place / EDGE % EDGE, place / (EDGE * EDGE)];
            if !(0..3).all(|a| (low[a]..=high[a]).contains(&(start[a] + inside[a] as i64))) {
                (value[place], weight[place]) = (0.0, 0.0);
            }
        }
    }
}

/// The region's bricks by place.
pub(super) struct BrickTable {
    size: [u32; 3],
    slots: Vec<u32>,
}

impl BrickTable {
    pub(super) fn new(size: [u32; 3]) -> Self {
        let n = size.iter().map(|s| *s as usize).product();
        Self { size, slots: vec![ABSENT; n] }
    }

    /// Returns the index of a place; `None` outside of the region.
    #[inline]
    pub(super) fn index(&self, at: [i64; 3]) -> Option<usize> {
        let inside = (0..3).all(|a| (0..i64::from(self.size[a])).contains(&at[a]));
        inside.then(|| ((at[2] * i64::from(self.size[1]) + at[1]) * i64::from(self.size[0]) + at[0]) as usize)
    }

    #[inline]
    pub(super) fn place(&self, index: usize) -> [i64; 3] {
        let [nx, ny, _] = self.size.map(|s| s as usize);
        [index % nx, index / nx % ny, index / (nx * ny)].map(|x| x as i64)
    }

    #[inline]
    pub(super) fn get(&self, at: [i64; 3]) -> Option<usize> {
        let slot = self.slots[self.index(at)?];
        (slot != ABSENT).then_some(slot as usize)
    }

    #[inline]
    pub(super) fn set(&mut self, index: usize, slot: u32) {
        self.slots[index] = slot;
    }

    /// Returns the slots by index.
    pub(super) fn slots(&self) -> &[u32] {
        &self.slots
    }

    pub(super) fn size(&self) -> [u32; 3] {
        self.size
    }

    /// Returns a larger table, and the indices there of those here: each place moves by so many
    /// bricks.
    pub(super) fn widened(&self, size: [u32; 3], by: [i64; 3]) -> (Self, impl Fn(usize) -> usize) {
        let mut wider = Self::new(size);
        let [nx, ny, _] = size.map(i64::from);
        let index = move |index: usize| {
            let [x, y, z] = self.place(index);
            (((z + by[2]) * ny + y + by[1]) * nx + x + by[0]) as usize
        };
        for (at, slot) in self.slots.iter().enumerate().filter(|(_, slot)| **slot != ABSENT) {
            wider.slots[index(at)] = *slot;
        }
        (wider, index)
    }

    fn bytes(&self) -> u64 {
        (self.slots.len() * size_of::<u32>()) as u64
    }
}

/// Returns disjoint mutable references to elements of a slice, by ascending index without
/// repetition.
pub(super) fn apart<T>(elements: &mut [T], indices: impl Iterator<Item = usize>) -> impl Iterator<Item = &mut T> {
    let (mut rest, mut passed) = (elements, 0);
    indices.filter_map(move |index| {
        let (head, tail) = std::mem::take(&mut rest).split_at_mut(index + 1 - passed);
        (rest, passed) = (tail, index + 1);
        head.last_mut()
    })
}

/// The voxels of the render region.
pub(super) struct VoxelSnapshot {
    first: [i64; 3],
    bounds: [[i64; 3]; 2],
    pub(super) table: BrickTable,
    /// Each brick is boxed: one table of all would be moved when it grows, and a new slice would
    /// wait for that.
    bricks: Vec<Box<Brick>>,
    /// Index in the table of each slot; and whether its brick has shown anything, so that its
    /// neighbours are held, too.
    indices: Vec<u32>,
    visibility: Vec<Visibility>,
    stock: Stock<Brick>,
    /// Scratch: the number of each slot's brick among the changed ones; and a bit for each place of
    /// the table that these reach, or that is to be read.
    numbers: Vec<u32>,
    reached: Vec<u64>,
}

/// A brick with changed voxels, by its place in the region.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Changed {
    pub(super) at: [i64; 3],
    pub(super) voxels: Bits,
}

impl Changed {
    /// Returns whether all of its voxels lie in a prism, in region coordinates.
    pub(super) fn lies_in(&self, prism: &Prism) -> bool {
        (0..VOXELS).filter(|place| self.voxels[place / 64] >> (place % 64) & 1 == 1).all(|place| {
            let inside = [place % EDGE, place / EDGE % EDGE, place / (EDGE * EDGE)];
            prism.holds(std::array::from_fn(|a| self.at[a] * EDGE as i64 + inside[a] as i64), 1e-6)
        })
    }
}

impl VoxelSnapshot {
    /// Creates an empty snapshot. Up to `stocked` bricks are made in advance.
    pub(super) fn new(region: &RenderRegion, stocked: usize) -> Self {
        let table = BrickTable::new(region.bricks());
        Self {
            first: region.first(),
            bounds: region.bounds(),
            // Room for all: a table that grows is moved to fresh memory.
            bricks: Vec::with_capacity(table.slots().len()),
            indices: Vec::with_capacity(table.slots().len()),
            visibility: Vec::with_capacity(table.slots().len()),
            table,
            stock: Stock::new(Box::default, stocked),
            numbers: Vec::new(),
            reached: Vec::new(),
        }
    }

    /// Writes the voxels whose gradient or value can have changed: the changed ones and their six
    /// neighbours, in bricks that hold anything. Each brick appears once, in the order of the
    /// table. One that appears in `changed` several times leaves all of its voxels with the first.
    pub(super) fn dilated(&mut self, changed: &mut [Changed], dilated: &mut Vec<Changed>, sharing: Sharing) {
        let Self { table, bricks, numbers, reached, .. } = self;
        numbers.resize(bricks.len(), UNCHANGED);
        reached.clear();
        reached.resize(table.slots().len().div_ceil(64), 0);
        for number in 0..changed.len() {
            let at = changed[number].at;
            let Some(slot) = table.get(at) else { continue };
            if numbers[slot] != UNCHANGED {
                let voxels = std::mem::take(&mut changed[number].voxels);
                join(&mut changed[numbers[slot] as usize].voxels, voxels);
                continue;
            }
            numbers[slot] = number as u32;
            let around = FACES.iter().map(|face| beside(at, *face)).chain([at]);
            let held = around.filter_map(|at| table.index(at)).filter(|index| table.slots()[*index] != ABSENT);
            held.for_each(|index| reached[index / 64] |= 1 << (index % 64));
        }
        dilated.clear();
        for (word, bits) in reached.iter().enumerate() {
            let mut left = *bits;
            while left != 0 {
                let at = table.place(64 * word + left.trailing_zeros() as usize);
                dilated.push(Changed { at, voxels: [0; EDGE] });
                left &= left - 1;
            }
        }
        let (table, numbers, changed) = (&*table, &mut *numbers, &*changed);
        let changed_at = |numbers: &[u32], at: [i64; 3]| changed.get(numbers[table.get(at)?] as usize);
        sharing.chunks(dilated, DILATED_PER_TASK, |_, dilated| {
            for Changed { at, voxels } in dilated {
                if let Some(changed) = changed_at(numbers, *at) {
                    *voxels = within(&changed.voxels);
                }
                for (axis, side) in FACES {
                    if let Some(changed) = changed_at(numbers, beside(*at, (axis, -side))) {
                        join(voxels, across(&changed.voxels, axis, side));
                    }
                }
            }
        });
        dilated.retain(|dilated| dilated.voxels != [0; EDGE]);
        changed.iter().filter_map(|changed| table.get(changed.at)).for_each(|slot| numbers[slot] = UNCHANGED);
    }

    /// Returns a brick and its face neighbours, in the order of [`FACES`].
    pub(super) fn neighbourhood(&self, at: [i64; 3]) -> Option<(&Brick, [Option<&Brick>; 6])> {
        let brick = &*self.bricks[self.table.get(at)?];
        let beside = FACES.map(|face| self.table.get(beside(at, face)).map(|slot| &*self.bricks[slot]));
        Some((brick, beside))
    }

    /// Moves all bricks into a wider region, each by so many bricks.
    pub(super) fn widen(&mut self, region: &RenderRegion, by: [i64; 3], stocked: usize) {
        let (wider, index) = self.table.widened(region.bricks(), by);
        self.indices.iter_mut().for_each(|at| *at = index(*at as usize) as u32);
        drop(index);
        let more = wider.slots.len() - self.bricks.len();
        self.bricks.reserve(more);
        self.indices.reserve(more);
        self.visibility.reserve(more);
        self.stock.hold(stocked);
        (self.table, self.first, self.bounds) = (wider, region.first(), region.bounds());
    }

    /// Takes over the bricks of another snapshot of the region, within some layers of voxels that
    /// it does not hold itself.
    pub(super) fn adopt(&mut self, other: Self, layers: &Range<i64>) {
        for ((index, brick), visibility) in other.indices.into_iter().zip(other.bricks).zip(other.visibility) {
            if begins_in(self.table.place(index as usize), layers) {
                self.hold(index as usize, brick, visibility);
            }
        }
    }

    /// Adds a brick.
    fn hold(&mut self, index: usize, brick: Box<Brick>, visibility: Visibility) {
        self.table.set(index, self.bricks.len() as u32);
        self.bricks.push(brick);
        self.indices.push(index as u32);
        self.visibility.push(visibility);
    }

    /// Returns the number of bricks that are held.
    pub(super) fn len(&self) -> usize {
        self.bricks.len()
    }

    /// Returns the number of those within some layers of voxels.
    pub(super) fn len_within(&self, layers: &Range<i64>) -> usize {
        (0..self.bricks.len()).filter(|slot| begins_in(self.place(*slot), layers)).count()
    }

    fn place(&self, slot: usize) -> [i64; 3] {
        self.table.place(self.indices[slot] as usize)
    }

    pub(super) fn bytes(&self) -> u64 {
        let bricks = self.bricks.len() + self.stock.len();
        self.table.bytes() + (bricks * (size_of::<Brick>() + size_of::<Box<Brick>>())) as u64
    }
}

fn join(voxels: &mut Bits, more: Bits) {
    voxels.iter_mut().zip(more).for_each(|(layer, more)| *layer |= more);
}

/// Returns the place beside another.
fn beside(mut at: [i64; 3], (axis, side): (usize, i64)) -> [i64; 3] {
    at[axis] += side;
    at
}

/// Returns whether a brick begins within some layers of voxels.
pub(super) fn begins_in(at: [i64; 3], layers: &Range<i64>) -> bool {
    layers.contains(&(at[2] * EDGE as i64))
}

/// Returns the voxels in which two bricks differ by a bit.
#[inline(always)]
fn difference(a: &Brick, b: &Brick) -> Bits {
    let mut differs = [0_u8; VOXELS];
    for (i, differs) in differs.iter_mut().enumerate() {
        let value = a.value[i].to_bits() ^ b.value[i].to_bits();
        let weight = a.weight[i].to_bits() ^ b.weight[i].to_bits();
        *differs = u8::from(value | weight != 0);
    }
    bits_of_all(&differs)
}

/// Returns the seen voxels of a brick whose values lie in an interval.
#[inline(always)]
fn within_interval(brick: &Brick, [low, high]: [f32; 2]) -> Bits {
    let mut lies = [0_u8; VOXELS];
    for (i, lies) in lies.iter_mut().enumerate() {
        let value = brick.value[i];
        *lies = u8::from(brick.weight[i] > 0.0) & u8::from(low <= value) & u8::from(value <= high);
    }
    bits_of_all(&lies)
}

/// Returns bytes of 0 or 1 as bits.
#[inline(always)]
fn bits_of_all(bytes: &[u8; VOXELS]) -> Bits {
    let mut bits = [0; EDGE];
    for (layer, lines) in bits.iter_mut().zip(bytes.as_chunks::<EDGE>().0.as_chunks::<EDGE>().0) {
        *layer = u64::from_le_bytes(lines.map(bits_of));
    }
    bits
}

/// Returns eight bytes of 0 or 1 as the bits of one.
#[inline(always)]
fn bits_of(bytes: [u8; 8]) -> u8 {
    // Byte k adds its bit to bit 56 + k of the product, as the factor has a bit at 7·(8 − k) for
    // each k. No two terms of the product meet, so that nothing is carried.
    (u64::from_le_bytes(bytes).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8
}

/// Returns the given voxels and their neighbours, inside the brick.
fn within(voxels: &Bits) -> Bits {
    std::array::from_fn(|z| {
        let layer = voxels[z];
        let beside = (layer & !LAST_X) << 1 | (layer & !FIRST_X) >> 1 | layer << 8 | layer >> 8;
        let below = if z > 0 { voxels[z - 1] } else { 0 };
        let above = if z + 1 < EDGE { voxels[z + 1] } else { 0 };
        layer | beside | below | above
    })
}

/// Returns the voxels of the neighbouring brick, on one side of an axis, that adjoin the given
/// voxels.
fn across(voxels: &Bits, axis: usize, side: i64) -> Bits {
    match (axis, side) {
        (0, -1) => voxels.map(|layer| (layer & FIRST_X) << 7),
        (0, _) => voxels.map(|layer| (layer & LAST_X) >> 7),
        (1, -1) => voxels.map(|layer| layer << 56),
        (1, _) => voxels.map(|layer| layer >> 56),
        (_, -1) => std::array::from_fn(|z| if z + 1 == EDGE { voxels[0] } else { 0 }),
        _ => std::array::from_fn(|z| if z == 0 { voxels[EDGE - 1] } else { 0 }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the bits of those voxels, given by region position, that a brick holds.
    fn bits(at: [i64; 3], voxels: &[[i64; 3]]) -> Bits {
        let mut bits = [0; EDGE];
        for v in voxels {
            let inside: [i64; 3] = std::array::from_fn(|a| v[a] - at[a] * EDGE as i64);
            if inside.iter().all(|x| (0..EDGE as i64).contains(x)) {
                bits[inside[2] as usize] |= 1 << (inside[1] * 8 + inside[0]);
            }
        }
        bits
    }

    #[test]
    fn changed_voxels_are_those_with_other_bits() {
        let old = Brick::default();
        for place in 0..VOXELS {
            let mut new = old.clone();
            new.value[place] = -0.0;
            new.weight[VOXELS - 1 - place] = 1e-40;
            let mut expected = [0; EDGE];
            for place in [place, VOXELS - 1 - place] {
                expected[place / 64] |= 1 << (place % 64);
            }
            assert_eq!(difference(&old, &new), expected, "{place}");
        }
        for byte in 0..=255_u8 {
            assert_eq!(bits_of(std::array::from_fn(|k| byte >> k & 1)), byte);
        }
    }

    #[test]
    fn dilation_adds_face_neighbours_at_every_place() {
        for place in 0..VOXELS {
            let voxel = [place % 8, place / 8 % 8, place / 64].map(|x| x as i64);
            let cross: Vec<[i64; 3]> = std::iter::once(voxel)
                .chain(FACES.map(|(axis, side)| {
                    let mut v = voxel;
                    v[axis] += side;
                    v
                }))
                .collect();
            let own = bits([0; 3], &[voxel]);
            assert_eq!(within(&own), bits([0; 3], &cross), "{voxel:?}");
            for (axis, side) in FACES {
                let mut at = [0; 3];
                at[axis] = side;
                assert_eq!(across(&own, axis, side), bits(at, &cross), "{voxel:?} {axis} {side}");
            }
        }
    }
}
