//! What is kept of a row's rays between pictures: nothing, their samples, the folds of their blocks, or both.
//!
//! A change notes in each block that it reaches which samples it concerns; they are interpolated and folded again when a ray comes to the block, and those
//! behind the place where the ray ends stay stale, perhaps for ever. With samples kept, only the stale ones are interpolated again; without, all of the block.

use std::ops::Range;

use super::cast::{Fold, Line, Through, fold_block};
use super::settings::Cache;
use super::shade::Lit;
use super::voxels::Sampler;
use super::work::RenderWork;

/// What is kept of the rays of a row.
pub(super) struct RowCache<const C: usize> {
    kind: Cache,
    /// Each sample of each ray on the stage, one after the other; and where each ray's begin.
    samples: Vec<Lit<f32, C>>,
    samples_of: Vec<usize>,
    /// The fold of each block of each ray; and where each ray's begin.
    blocks: Vec<Through<C>>,
    /// Of each block, what is not as the voxels say.
    stale: Vec<Stale>,
    blocks_of: Vec<usize>,
}

/// Samples of a block that are to be interpolated again, from one up to but not including another: all that is not as the voxels say, and perhaps more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Stale {
    from: u16,
    to: u16,
}

impl Stale {
    const NONE: Self = Self { from: u16::MAX, to: 0 };

    /// These too.
    #[inline(always)]
    fn add(&mut self, [from, to]: [u32; 2]) {
        // Samples are counted in 16 bits.
        *self = Self { from: self.from.min(from as u16), to: self.to.max(to as u16) };
    }

    #[inline(always)]
    fn samples(self) -> Option<[u32; 2]> {
        if self.from < self.to { Some([u32::from(self.from), u32::from(self.to)]) } else { None }
    }
}

/// Blocks that a line meets: the first one's number, and how many.
fn blocks_of(line: &Line, fold: Fold) -> (u32, usize) {
    let first = line.first / fold.arity;
    let end = if line.first < line.end { (line.end - 1) / fold.arity + 1 } else { first };
    (first, (end - first) as usize)
}

/// Bytes that a cache takes for some lines, tables apart.
pub(super) fn bytes<const C: usize>(kind: Cache, lines: &[Line], fold: Fold) -> u64 {
    let samples: u64 = lines.iter().map(|l| u64::from(l.end - l.first)).sum();
    let blocks: u64 = lines.iter().map(|l| blocks_of(l, fold).1 as u64).sum();
    let of_samples = samples * size_of::<Lit<f32, C>>() as u64;
    let (of_blocks, stale) = (blocks * size_of::<Through<C>>() as u64, blocks * size_of::<Stale>() as u64);
    match kind {
        Cache::None => 0,
        Cache::Linear => of_samples + stale,
        Cache::TwoLevel => of_samples + of_blocks + stale,
        Cache::OneLevel => of_blocks + stale,
    }
}

impl<const C: usize> RowCache<C> {
    /// Nothing is kept.
    pub(super) fn none() -> Self {
        Self {
            kind: Cache::None,
            samples: Vec::new(),
            samples_of: Vec::new(),
            blocks: Vec::new(),
            stale: Vec::new(),
            blocks_of: Vec::new(),
        }
    }

    /// Of rays of which all is transparent.
    pub(super) fn new(kind: Cache, lines: &[Line], fold: Fold) -> Self {
        let mut cache = Self::none();
        let [samples, blocks, stale] = cache.lay_out(kind, lines, fold);
        // Memory that is zero comes when it is written first.
        cache.samples = vec![Self::TRANSPARENT; samples];
        cache.blocks = vec![Through::CLEAR; blocks];
        cache.stale = vec![Stale::NONE; stale];
        cache
    }

    const TRANSPARENT: Lit<f32, C> = Lit { colour: [0.0; C], alpha: 0.0 };

    /// Of other rays, in the same memory; all of their samples must be noted to have changed, as what is kept is of others.
    pub(super) fn again(&mut self, kind: Cache, lines: &[Line], fold: Fold) {
        let [samples, blocks, stale] = self.lay_out(kind, lines, fold);
        self.samples.resize(samples, Self::TRANSPARENT);
        self.blocks.resize(blocks, Through::CLEAR);
        self.stale.clear();
        self.stale.resize(stale, Stale::NONE);
    }

    /// Where rays begin; how many samples, blocks and marks are to be kept.
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

    pub(super) fn bytes(&self) -> u64 {
        (size_of_val(&*self.samples)
            + size_of_val(&*self.samples_of)
            + size_of_val(&*self.blocks)
            + size_of_val(&*self.stale)
            + size_of_val(&*self.blocks_of)) as u64
    }

    /// Folds of blocks, where they are kept.
    pub(super) fn blocks(&self) -> &[Through<C>] {
        &self.blocks
    }

    /// The number of a ray's first block, and where in [`Self::blocks`] its blocks are.
    pub(super) fn blocks_of(&self, at: usize, line: &Line, fold: Fold) -> (u32, Range<usize>) {
        let (first, count) = blocks_of(line, fold);
        (first, self.blocks_of[at]..self.blocks_of[at] + count)
    }

    /// The pixel of ray number `at`, of whose samples those from `from` up to `to` may have changed.
    #[inline(always)]
    pub(super) fn pixel(
        &mut self,
        at: usize,
        line: &Line,
        [from, to]: [u32; 2],
        sampler: Sampler<'_, C>,
        fold: Fold,
        work: &mut RenderWork,
    ) -> Through<C> {
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
        let mut all = Through::CLEAR;
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
                (_, Cache::OneLevel) => sampler.block(line, [k, end], fold.law, work).unwrap_or(Through::CLEAR),
                _ => fold_block(&samples[(k - line.first) as usize..(end - line.first) as usize], fold.law),
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
