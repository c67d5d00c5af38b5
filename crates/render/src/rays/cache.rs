//! Data of a row's rays kept between pictures: nothing, their samples, the composited blocks, or
//! both.
//!
//! A change marks in each block which samples it affects. They are interpolated and composited
//! again when a ray reaches the block. Samples behind the end of the ray stay stale, possibly
//! for ever. If samples are kept, only the stale ones are interpolated again; otherwise the
//! whole block is.

use std::ops::Range;

use crate::classify::shade::Lit;
use crate::rays::cast::fold_block;
use crate::rays::composite::{Accumulated, Fold};
use crate::rays::line::Line;
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
    /// The stale samples of each block.
    stale: Vec<Stale>,
    blocks_of: Vec<usize>,
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
    fn samples(self) -> Option<[u32; 2]> {
        if self.from < self.to { Some([u32::from(self.from), u32::from(self.to)]) } else { None }
    }
}

/// Returns the number of the first block that a line meets, and the number of blocks.
fn blocks_of(line: &Line, fold: Fold) -> (u32, usize) {
    let first = line.first / fold.arity;
    let end = if line.first < line.end { (line.end - 1) / fold.arity + 1 } else { first };
    (first, (end - first) as usize)
}

fn held<T>(vector: &Vec<T>) -> usize {
    vector.capacity() * size_of::<T>()
}

/// Returns the bytes that a cache takes for some lines, without its tables.
pub(crate) fn bytes<const C: usize>(kind: Cache, lines: &[Line], fold: Fold) -> u64 {
    let samples: u64 = lines.iter().map(|l| u64::from(l.end - l.first)).sum();
    let blocks: u64 = lines.iter().map(|l| blocks_of(l, fold).1 as u64).sum();
    let of_samples = samples * size_of::<Lit<f32, C>>() as u64;
    let (of_blocks, stale) = (blocks * size_of::<Accumulated<C>>() as u64, blocks * size_of::<Stale>() as u64);
    match kind {
        Cache::None => 0,
        Cache::Linear => of_samples + stale,
        Cache::TwoLevel => of_samples + of_blocks + stale,
        Cache::OneLevel => of_blocks + stale,
    }
}

impl<const C: usize> RowCache<C> {
    /// Returns a cache that keeps nothing.
    pub(crate) fn none() -> Self {
        Self {
            kind: Cache::None,
            samples: Vec::new(),
            samples_of: Vec::new(),
            blocks: Vec::new(),
            stale: Vec::new(),
            blocks_of: Vec::new(),
        }
    }

    /// Returns a cache of rays that are all transparent.
    pub(crate) fn new(kind: Cache, lines: &[Line], fold: Fold) -> Self {
        let mut cache = Self::none();
        let [samples, blocks, stale] = cache.lay_out(kind, lines, fold);
        // The system allocates zeroed memory only on the first write.
        cache.samples = vec![Self::TRANSPARENT; samples];
        cache.blocks = vec![Accumulated::CLEAR; blocks];
        cache.stale = vec![Stale::NONE; stale];
        cache
    }

    const TRANSPARENT: Lit<f32, C> = Lit { colour: [0.0; C], alpha: 0.0 };

    /// Lays the cache out for other rays in the same memory. The caller must mark all samples as
    /// changed, because the content belongs to the old rays.
    pub(crate) fn reset(&mut self, kind: Cache, lines: &[Line], fold: Fold) {
        let [samples, blocks, stale] = self.lay_out(kind, lines, fold);
        self.samples.resize(samples, Self::TRANSPARENT);
        self.blocks.resize(blocks, Accumulated::CLEAR);
        self.stale.clear();
        self.stale.resize(stale, Stale::NONE);
    }

    /// Sets the start index of each ray; returns the numbers of samples, blocks and stale marks.
    fn lay_out(&mut self, kind: Cache, lines: &[Line], fold: Fold) -> [usize; 3] {
        self.kind = kind;
        self.samples_of.clear();
        self.blocks_of.clear();
        if kind == Cache::None {
            return [0; 3];
        }
        let (mut samples, mut blocks) = (0, 0);
        for line in lines {
            if kind.keeps_samples() {
                self.samples_of.push(samples);
                samples += (line.end - line.first) as usize;
            }
            self.blocks_of.push(blocks);
            blocks += blocks_of(line, fold).1;
        }
        [samples, if kind.keeps_blocks() { blocks } else { 0 }, blocks]
    }

    /// Returns the memory that it holds. While a view turns, that is of the longest rays so far.
    pub(crate) fn bytes(&self) -> u64 {
        (held(&self.samples) + held(&self.samples_of) + held(&self.blocks) + held(&self.stale) + held(&self.blocks_of))
            as u64
    }

    /// Returns the composited blocks, if they are kept.
    pub(crate) fn blocks(&self) -> &[Accumulated<C>] {
        &self.blocks
    }

    /// Returns the number of a ray's first block, and the range of its blocks in
    /// [`Self::blocks`].
    pub(crate) fn blocks_of(&self, at: usize, line: &Line, fold: Fold) -> (u32, Range<usize>) {
        let (first, count) = blocks_of(line, fold);
        (first, self.blocks_of[at]..self.blocks_of[at] + count)
    }

    /// Returns the pixel of ray number `at`, whose samples `from` up to `to` may have changed.
    #[inline(always)]
    pub(crate) fn pixel(
        &mut self,
        at: usize,
        line: &Line,
        [from, to]: [u32; 2],
        sampler: Sampler<'_, C>,
        fold: Fold,
        work: &mut RenderWork,
    ) -> Accumulated<C> {
        if self.kind == Cache::None {
            return sampler.cast(line, fold, work);
        }
        let (first, count) = blocks_of(line, fold);
        let stale = &mut self.stale[self.blocks_of[at]..][..count];
        let mut k = from;
        while k < to {
            let end = fold.block_end(k).min(to);
            stale[(k / fold.arity - first) as usize].add([k, end]);
            k = end;
        }
        let blocks = match self.kind.keeps_blocks() {
            true => &mut self.blocks[self.blocks_of[at]..][..count],
            false => &mut [],
        };
        let samples = match self.kind.keeps_samples() {
            true => &mut self.samples[self.samples_of[at]..][..(line.end - line.first) as usize],
            false => &mut [],
        };
        let mut all = Accumulated::CLEAR;
        let mut k = line.first;
        for (number, stale) in stale.iter_mut().enumerate() {
            let end = fold.block_end(k).min(line.end);
            let changed = std::mem::replace(stale, Stale::NONE).samples();
            if let Some([from, to]) = changed
                && self.kind.keeps_samples()
            {
                sampler.resample(
                    line,
                    [from, to],
                    &mut samples[(from - line.first) as usize..(to - line.first) as usize],
                    work,
                );
            }
            let block = match (changed, self.kind) {
                (None, Cache::TwoLevel | Cache::OneLevel) => blocks[number],
                (_, Cache::OneLevel) => {
                    sampler.block(line, [k, end], fold.composite_mode, work).unwrap_or(Accumulated::CLEAR)
                }
                _ => fold_block(&samples[(k - line.first) as usize..(end - line.first) as usize], fold.composite_mode),
            };
            if changed.is_some()
                && let Some(kept) = blocks.get_mut(number)
            {
                *kept = block;
                work.blocks_resolved += 1;
            }
            if all.ends_behind(&block, fold, work) {
                break;
            }
            k = end;
        }
        all
    }
}
