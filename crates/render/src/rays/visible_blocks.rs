//! Empty-space skipping: the blocks of samples in which rays of a tile may meet anything visible.
//!
//! The picture is divided into tiles of 8×8 pixels. Each visible brick is projected to the picture
//! and enters the blocks of samples that rays of these tiles can have in it. All other blocks are
//! transparent, and a transparent block changes no bit of a ray. Rays therefore skip them, without
//! computing where their samples lie. Too many blocks may be entered, never too few.

use glam::DVec3;

use volume::brick::EDGE;

use crate::camera::Camera;
use crate::rays::composite::Fold;
use crate::rays::line::Line;
use crate::rays::slab::{SLACK, ViewRays};

/// Pixels along the edge of a tile.
pub(crate) const TILE: usize = 8;
/// Blocks of a word.
pub(crate) const BITS: u32 = u64::BITS;

/// The visible blocks of all tiles, a bit each, by their number along the ray.
pub(crate) struct VisibleBlocks {
    rays: ViewRays,
    fold: Fold,
    /// Tiles to the right and down.
    tiles: [usize; 2],
    /// Words of a tile.
    words: usize,
    bits: Vec<u64>,
}

/// The visible blocks of a row of tiles.
#[derive(Clone, Copy)]
pub(crate) struct TileRow<'a> {
    words: usize,
    bits: &'a [u64],
}

impl<'a> TileRow<'a> {
    /// Returns the visible blocks of the tile that holds a column of pixels.
    #[inline(always)]
    pub(crate) fn at(self, column: usize) -> &'a [u64] {
        &self.bits[column / TILE * self.words..][..self.words]
    }
}

impl VisibleBlocks {
    /// Creates a picture in which nothing is visible.
    pub(crate) fn new(camera: &Camera, fold: Fold) -> Self {
        let tiles = camera.size().map(|side| (side as usize).div_ceil(TILE));
        let words = words(camera.samples(), fold);
        let bits = vec![0; tiles[0] * tiles[1] * words];
        Self { rays: ViewRays::new(camera), fold, tiles, words, bits }
    }

    /// Enters a brick in which something may be visible, by its place in the render region.
    pub(crate) fn add(&mut self, brick: [i64; 3]) {
        let low = DVec3::from_array(brick.map(|b| (b * EDGE as i64) as f64));
        let (low, high) = (low - SLACK, low + EDGE as f64 + SLACK);
        let Some([columns, rows]) = self.rays.pixels(low, high) else { return };
        let [from, to] = self.rays.samples(low, high);
        if to < 0.0 {
            return;
        }
        // Conversions saturate at 0 and at the largest integer.
        let [first, last] = [from.ceil() as u32, to as u32].map(|k| self.fold.block_of(k));
        let end = last.saturating_add(1).min(self.words as u32 * BITS);
        let [columns, rows] = [columns, rows].map(|pixels| pixels.map(|pixel| pixel as usize / TILE));
        for y in rows[0]..=rows[1] {
            let tiles = y * self.tiles[0] + columns[0]..=y * self.tiles[0] + columns[1];
            for bits in self.bits.chunks_exact_mut(self.words).take(tiles.end() + 1).skip(*tiles.start()) {
                set(bits, first, end);
            }
        }
    }

    /// Returns the tiles of a row of pixels.
    pub(crate) fn of_row(&self, row: usize) -> TileRow<'_> {
        let words = self.tiles[0] * self.words;
        TileRow { words: self.words, bits: &self.bits[row / TILE * words..][..words] }
    }

    pub(crate) fn bytes(&self) -> u64 {
        size_of_val(&*self.bits) as u64
    }
}

/// Returns the words that hold the blocks of so many samples.
pub(crate) fn words(samples: u32, fold: Fold) -> usize {
    samples.div_ceil(fold.arity).div_ceil(BITS) as usize
}

/// Sets the bits of the blocks `first` up to but not including `end`.
#[inline(always)]
pub(crate) fn set(bits: &mut [u64], first: u32, end: u32) {
    if first >= end {
        return;
    }
    let last = end - 1;
    for word in first / BITS..=last / BITS {
        let from = if word == first / BITS { u64::MAX << (first % BITS) } else { u64::MAX };
        let to = if word == last / BITS { u64::MAX >> (BITS - 1 - last % BITS) } else { u64::MAX };
        bits[word as usize] |= from & to;
    }
}

/// Returns whether a block's bit is set.
#[inline(always)]
pub(crate) fn has(bits: &[u64], block: u32) -> bool {
    bits[(block / BITS) as usize] >> (block % BITS) & 1 != 0
}

/// Clears a block's bit.
#[inline(always)]
pub(crate) fn clear(bits: &mut [u64], block: u32) {
    bits[(block / BITS) as usize] &= !(1 << (block % BITS));
}

/// The blocks of a line, of which those that are not visible are left out; front to back.
pub(crate) struct Blocks<'a> {
    visible: Option<&'a [u64]>,
    /// Bits of the present word that are left, and its number.
    left: u64,
    word: u32,
    /// The blocks of the line, and their samples.
    blocks: [u32; 2],
    samples: [u32; 2],
    arity: u32,
}

impl<'a> Blocks<'a> {
    /// Creates an iterator; without `visible`, over all blocks.
    #[inline(always)]
    pub(crate) fn new(line: &Line, fold: Fold, visible: Option<&'a [u64]>) -> Self {
        let [first, end] = blocks_of(line, fold);
        let samples = [line.first, line.end];
        let mut blocks =
            Self { visible, left: 0, word: first / BITS, blocks: [first, end], samples, arity: fold.arity };
        blocks.left = blocks.word(first / BITS);
        blocks
    }

    /// Returns the line's visible blocks in a word.
    #[inline(always)]
    fn word(&self, word: u32) -> u64 {
        let [first, end] = self.blocks;
        if word * BITS >= end {
            return 0;
        }
        let before = if word == first / BITS { first % BITS } else { 0 };
        let behind = (word * BITS + BITS).saturating_sub(end);
        let visible = self.visible.map_or(u64::MAX, |visible| visible[word as usize]);
        visible & u64::MAX << before & u64::MAX >> behind
    }
}

impl Iterator for Blocks<'_> {
    /// A block's number, and its first sample and the one after the last.
    type Item = (u32, [u32; 2]);

    #[inline(always)]
    fn next(&mut self) -> Option<Self::Item> {
        while self.left == 0 {
            self.word += 1;
            if self.word * BITS >= self.blocks[1] {
                return None;
            }
            self.left = self.word(self.word);
        }
        let block = self.word * BITS + self.left.trailing_zeros();
        self.left &= self.left - 1;
        let begin = block * self.arity;
        let [first, end] = self.samples;
        Some((block, [begin.max(first), begin.saturating_add(self.arity).min(end)]))
    }
}

/// Returns the number of a line's first block, and the one after its last.
#[inline(always)]
pub(crate) fn blocks_of(line: &Line, fold: Fold) -> [u32; 2] {
    let first = fold.block_of(line.first);
    [first, if line.first < line.end { fold.block_of(line.end - 1) + 1 } else { first }]
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DMat3, DVec3};

    use sonoweave_core::frames::Transform;

    use super::*;
    use crate::camera::View;
    use crate::rays::composite::CompositeMode;
    use crate::region::RenderRegion;

    const SIZE: [u32; 2] = [90, 70];

    fn fold(arity: u32) -> Fold {
        Fold { arity, composite_mode: CompositeMode::Over, stop: 0.0 }
    }

    fn region() -> RenderRegion {
        let lattice = DMat3::from_rotation_z(0.3) * DMat3::from_diagonal(DVec3::new(0.5, 0.4, 0.9));
        let lattice = DAffine3 { matrix3: lattice, translation: DVec3::new(10.0, -4.0, 2.0) };
        RenderRegion::new(Transform::from_affine(lattice), [0; 3], [63, 47, 39]).unwrap()
    }

    /// Returns the tiles and blocks whose rays have a sample in a brick; a ray counts for its tile.
    fn met(camera: &Camera, region: &RenderRegion, brick: [i64; 3], fold: Fold) -> Vec<(usize, usize, u32)> {
        let [low, high] = region.bounds().map(|at| std::array::from_fn(|a| at[a] - region.first()[a]));
        let mut met = Vec::new();
        for j in 0..SIZE[1] {
            for i in 0..SIZE[0] {
                let line = Line::new(&camera.ray(i, j), low, high, camera.samples());
                let is_inside = |k: u32| (line.at(k).map(|x| (x / EDGE as f32).floor() as i64)) == brick;
                let blocks = (line.first..line.end).filter(|k| is_inside(*k)).map(|k| k / fold.arity);
                met.extend(blocks.map(|block| (i as usize / TILE, j as usize / TILE, block)));
            }
        }
        met.sort_unstable();
        met.dedup();
        met
    }

    #[test]
    fn block_is_visible_wherever_a_ray_meets_the_brick() {
        let region = region();
        let aim = region.centre_mm() + DVec3::new(1.0, 2.0, -1.0);
        let view = |azimuth, elevation| View { azimuth, elevation, ..View::default() };
        for (n, (view, step, arity)) in [
            (view(0.0, 0.0), 1.0, 16),
            (view(30.0, 20.0), 0.5, 16),
            (View { perspective: Some(40.0), ..view(70.0, -50.0) }, 1.0, 16),
            (View { perspective: Some(100.0), zoom: 1.0, ..view(10.0, 5.0) }, 1.0, 7),
            (View { zoom: 1.0, aim: Some(aim), roll: 33.0, ..view(200.0, 10.0) }, 3.0, 1),
            (View { perspective: Some(60.0), zoom: 1.0, aim: Some(aim), ..view(-20.0, 80.0) }, 1.0, u32::MAX),
        ]
        .into_iter()
        .enumerate()
        {
            let fold = fold(arity);
            let camera = Camera::new(&view, SIZE, step, &region).unwrap();
            let (mut needed, mut entered) = (0, 0);
            for brick in [[3, 2, 2], [4, 3, 2], [3, 2, 1], [4, 2, 3], [0, 5, 2], [7, 5, 4]] {
                let mut visible = VisibleBlocks::new(&camera, fold);
                visible.add(brick);
                let met = met(&camera, &region, brick, fold);
                for (x, y, block) in &met {
                    let tile = visible.of_row(y * TILE).at(x * TILE);
                    assert!(has(tile, *block), "{n}: brick {brick:?}, tile {x}, {y}, block {block}");
                }
                needed += met.len();
                entered += visible.bits.iter().map(|bits| bits.count_ones() as usize).sum::<usize>();
            }
            assert!(needed > 20 && entered < 4 * needed, "{n}: {entered} entered, {needed} needed");
        }
    }

    #[test]
    fn blocks_of_line_are_those_that_are_visible() {
        for arity in [1, 3, 16, u32::MAX] {
            let fold = fold(arity);
            for [first, end] in [[0, 0], [5, 5], [0, 1], [7, 300], [64, 128], [63, 65], [1000, 1001], [3, 2000]] {
                let line = Line { base: [0.0; 3], step: [0.0; 3], first, end };
                let mut visible = vec![0; words(2000, fold)];
                set(&mut visible, 1, 3.min(words(2000, fold) as u32 * BITS));
                set(&mut visible, 60, (2000 / arity).clamp(60, 130));
                let mut all = Vec::new();
                let mut k = first;
                while k < end {
                    let block = k / arity;
                    let to = (block * arity).saturating_add(arity).min(end);
                    all.push((block, [k, to]));
                    k = to;
                }
                assert_eq!(Vec::from_iter(Blocks::new(&line, fold, None)), all, "{first} to {end} by {arity}");
                all.retain(|(block, _)| has(&visible, *block));
                let found = Vec::from_iter(Blocks::new(&line, fold, Some(&visible)));
                assert_eq!(found, all, "{first} to {end} by {arity}, some visible");
            }
        }
    }
}
