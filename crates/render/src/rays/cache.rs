//! Data of a row's rays kept between pictures: nothing, their samples, the composited blocks, or
//! both.
//!
//! A change marks the blocks that it affects, and in each which samples. They are interpolated
//! and composited again when a ray reaches the block. Blocks behind the end of the ray, and those
//! in which nothing is visible, stay stale, possibly for ever. If samples are kept, only the stale
//! ones are interpolated again; otherwise the whole block is.
//!
//! After a turn of the view all blocks are stale and no sample is kept. The first cast keeps the
//! composited blocks, and the first change of a block its samples, too: most blocks are not
//! changed before the next turn, and need not be written to memory.

use std::ops::Range;

use crate::classify::shade::Lit;
use crate::rays::cast::fold_block;
use crate::rays::composite::{Accumulated, Fold};
use crate::rays::line::Line;
use crate::rays::visible_blocks::{Blocks, blocks_of, clear, has, set, words};
use crate::settings::Cache;
use crate::voxels::Sampler;
use crate::work::RenderWork;

/// Data kept of the rays of a row.
pub(crate) struct RowCache<const C: usize> {
    kind: Cache,
    /// The samples of each ray within the render region, ray after ray; and the start index of
    /// each ray.
    samples: Vec<Lit<f32, C>>,
    samples_of: Vec<usize>,
    /// The composited blocks of each ray; and the start index of each ray.
    blocks: Vec<Accumulated<C>>,
    blocks_of: Vec<usize>,
    /// Stale blocks, a bit each, by their number along the ray; so many words a ray.
    stale: Vec<u64>,
    words: usize,
    /// If samples are kept: the blocks of which none is, a bit each; and the stale samples of the
    /// others.
    unsampled: Vec<u64>,
    stale_samples: Vec<Stale>,
}

/// Samples of a block to be interpolated again, from `from` up to but not including `to`: all
/// that differ from the voxels, and perhaps more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Stale {
    from: u16,
    to: u16,
}

impl Stale {
    const NONE: Self = Self { from: u16::MAX, to: 0 };

    /// Adds a range of samples.
    #[inline(always)]
    fn add(&mut self, [from, to]: [u32; 2]) {
        // Sample numbers fit in 16 bits.
        *self = Self { from: self.from.min(from as u16), to: self.to.max(to as u16) };
    }

    #[inline(always)]
    fn samples(self) -> [u32; 2] {
        [u32::from(self.from), u32::from(self.to)]
    }
}

fn held<T>(vector: &Vec<T>) -> usize {
    vector.capacity() * size_of::<T>()
}

/// Samples and blocks of all lines of a row, and words for the bits of its blocks.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Extent {
    samples: u64,
    blocks: u64,
    words: u64,
}

impl Extent {
    pub(crate) fn of(lines: &[Line], fold: Fold) -> Self {
        let (mut extent, mut end) = (Self::default(), 0);
        for line in lines {
            extent.samples += u64::from(line.end - line.first);
            extent.blocks += count_of(line, fold) as u64;
            end = end.max(line.end);
        }
        extent.words = (words(end, fold) * lines.len()) as u64;
        extent
    }

    /// Returns the bytes that a cache takes, without its tables.
    pub(crate) fn bytes<const C: usize>(self, kind: Cache) -> u64 {
        let bits = self.words * size_of::<u64>() as u64;
        let of_samples =
            self.samples * size_of::<Lit<f32, C>>() as u64 + self.blocks * size_of::<Stale>() as u64 + bits;
        let of_blocks = self.blocks * size_of::<Accumulated<C>>() as u64;
        match kind {
            Cache::None => 0,
            Cache::Linear => of_samples + bits,
            Cache::TwoLevel => of_samples + of_blocks + bits,
            Cache::OneLevel => of_blocks + bits,
        }
    }
}

/// Returns the number of a line's blocks.
fn count_of(line: &Line, fold: Fold) -> usize {
    let [first, end] = blocks_of(line, fold);
    (end - first) as usize
}

impl<const C: usize> RowCache<C> {
    /// Returns a cache that keeps nothing.
    pub(crate) fn none() -> Self {
        Self {
            kind: Cache::None,
            samples: Vec::new(),
            samples_of: Vec::new(),
            blocks: Vec::new(),
            blocks_of: Vec::new(),
            stale: Vec::new(),
            words: 0,
            unsampled: Vec::new(),
            stale_samples: Vec::new(),
        }
    }

    const TRANSPARENT: Lit<f32, C> = Lit { colour: [0.0; C], alpha: 0.0 };

    /// Lays the cache out for other rays, in the memory of earlier ones. New memory is transparent.
    /// The next cast of each ray must say that all its samples have changed, because the content
    /// belongs to earlier rays.
    pub(crate) fn lay_out(&mut self, kind: Cache, lines: &[Line], fold: Fold) {
        self.kind = kind;
        self.samples_of.clear();
        self.blocks_of.clear();
        let (mut samples, mut blocks, mut end) = (0, 0, 0);
        let kept = if kind == Cache::None { &[] } else { lines };
        for line in kept {
            if kind.keeps_samples() {
                self.samples_of.push(samples);
                samples += (line.end - line.first) as usize;
            }
            self.blocks_of.push(blocks);
            blocks += count_of(line, fold);
            end = end.max(line.end);
        }
        self.words = words(end, fold);
        let bits = kept.len() * self.words;
        self.samples.resize(samples, Self::TRANSPARENT);
        self.blocks.resize(if kind.keeps_blocks() { blocks } else { 0 }, Accumulated::CLEAR);
        self.stale.resize(bits, 0);
        self.unsampled.resize(if kind.keeps_samples() { bits } else { 0 }, 0);
        self.stale_samples.resize(if kind.keeps_samples() { blocks } else { 0 }, Stale::NONE);
    }

    /// Returns the memory that it holds. While a view turns, that is of the longest rays so far.
    pub(crate) fn bytes(&self) -> u64 {
        let of_samples = held(&self.samples) + held(&self.samples_of) + held(&self.stale_samples);
        let of_blocks = held(&self.blocks) + held(&self.blocks_of) + held(&self.stale) + held(&self.unsampled);
        (of_samples + of_blocks) as u64
    }

    /// Returns the composited blocks, if they are kept.
    pub(crate) fn blocks(&self) -> &[Accumulated<C>] {
        &self.blocks
    }

    /// Returns the number of a ray's first block, and the range of its blocks in
    /// [`Self::blocks`].
    pub(crate) fn blocks_of(&self, at: usize, line: &Line, fold: Fold) -> (u32, Range<usize>) {
        let [first, end] = blocks_of(line, fold);
        (first, self.blocks_of[at]..self.blocks_of[at] + (end - first) as usize)
    }

    /// Returns the pixel of ray number `at`, whose samples `from` up to `to` may have changed.
    /// Blocks that are not `visible` are transparent.
    #[inline(always)]
    pub(crate) fn pixel(
        &mut self,
        at: usize,
        line: &Line,
        changed: [u32; 2],
        visible: &[u64],
        (sampler, fold): (Sampler<'_, C>, Fold),
        work: &mut RenderWork,
    ) -> Accumulated<C> {
        if self.kind == Cache::None {
            return sampler.cast(line, Some(visible), fold, work);
        }
        let mut ray = self.ray(at, line, fold);
        // As after a turn; a slice changes few samples of a ray.
        let is_new = changed == [line.first, line.end];
        ray.mark(changed, is_new, fold);
        let mut all = Accumulated::CLEAR;
        for (number, samples) in Blocks::new(line, fold, Some(visible)) {
            let block = ray.block(line, (number, samples), is_new, (sampler, fold), work);
            if all.ends_behind(&block, fold, work) {
                break;
            }
        }
        all
    }

    /// Begins a ray whose samples are new: nothing is known of it.
    #[inline(always)]
    pub(crate) fn begin(&mut self, at: usize, line: &Line, fold: Fold) {
        if self.kind != Cache::None {
            self.ray(at, line, fold).mark([line.first, line.end], true, fold);
        }
    }

    /// Keeps a block of a ray whose samples are new. Its samples are not kept.
    #[inline(always)]
    pub(crate) fn put_first(&mut self, at: usize, line: &Line, number: u32, block: Accumulated<C>, fold: Fold) {
        if self.kind.keeps_blocks() {
            clear(&mut self.stale[at * self.words..][..self.words], number);
            self.blocks[self.blocks_of[at] + (number - fold.block_of(line.first)) as usize] = block;
        }
    }

    #[inline(always)]
    fn ray(&mut self, at: usize, line: &Line, fold: Fold) -> Ray<'_, C> {
        let [first, end] = blocks_of(line, fold);
        let count = (end - first) as usize;
        let bits = at * self.words..(at + 1) * self.words;
        let blocks = self.blocks_of[at]..self.blocks_of[at] + count;
        let (samples, unsampled, stale_samples) = match self.kind.keeps_samples() {
            true => (
                &mut self.samples[self.samples_of[at]..][..(line.end - line.first) as usize],
                &mut self.unsampled[bits.clone()],
                &mut self.stale_samples[blocks.clone()],
            ),
            false => Default::default(),
        };
        Ray {
            kind: self.kind,
            first,
            samples,
            blocks: if self.kind.keeps_blocks() { &mut self.blocks[blocks] } else { &mut [] },
            stale: &mut self.stale[bits],
            unsampled,
            stale_samples,
        }
    }
}

/// Data kept of one ray.
struct Ray<'a, const C: usize> {
    kind: Cache,
    /// Number of the first block.
    first: u32,
    samples: &'a mut [Lit<f32, C>],
    blocks: &'a mut [Accumulated<C>],
    stale: &'a mut [u64],
    unsampled: &'a mut [u64],
    stale_samples: &'a mut [Stale],
}

impl<const C: usize> Ray<'_, C> {
    /// Marks samples as changed, which are all if it `is_new`.
    #[inline(always)]
    fn mark(&mut self, [from, to]: [u32; 2], is_new: bool, fold: Fold) {
        if from >= to {
            return;
        }
        let [first, last] = [fold.block_of(from), fold.block_of(to - 1)];
        set(self.stale, first, last + 1);
        if is_new {
            if !self.unsampled.is_empty() {
                set(self.unsampled, first, last + 1);
            }
            return;
        }
        for (block, stale) in (first..=last).zip(self.stale_samples.iter_mut().skip((first - self.first) as usize)) {
            let begin = block * fold.arity;
            stale.add([from.max(begin), to.min(begin.saturating_add(fold.arity))]);
        }
    }

    /// Returns a block, composited again if it is stale. `is_new` says whether the whole ray is.
    #[inline(always)]
    fn block(
        &mut self,
        line: &Line,
        (number, [k, end]): (u32, [u32; 2]),
        is_new: bool,
        (sampler, fold): (Sampler<'_, C>, Fold),
        work: &mut RenderWork,
    ) -> Accumulated<C> {
        let at = (number - self.first) as usize;
        let samples = [k, end].map(|k| (k - line.first) as usize);
        let is_stale = has(self.stale, number);
        if !is_stale && self.kind.keeps_blocks() {
            return self.blocks[at];
        }
        if is_stale {
            clear(self.stale, number);
            work.blocks_resolved += u64::from(self.kind.keeps_blocks());
        }
        let keeps_samples = self.kind == Cache::Linear || self.kind == Cache::TwoLevel && !is_new;
        if !keeps_samples {
            let block = sampler.block(line, [k, end], fold.composite_mode, work).unwrap_or(Accumulated::CLEAR);
            self.blocks[at] = block;
            return block;
        }
        if is_stale {
            let changed = std::mem::replace(&mut self.stale_samples[at], Stale::NONE);
            let [from, to] = match has(self.unsampled, number) {
                true => [k, end],
                false => changed.samples(),
            };
            clear(self.unsampled, number);
            let kept = [from, to].map(|k| (k - line.first) as usize);
            sampler.resample(line, [from, to], &mut self.samples[kept[0]..kept[1]], work);
        }
        let block = fold_block(&self.samples[samples[0]..samples[1]], fold.composite_mode);
        if let Some(kept) = self.blocks.get_mut(at) {
            *kept = block;
        }
        block
    }
}
