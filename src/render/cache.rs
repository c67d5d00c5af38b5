//! What is kept of a row's rays between pictures: nothing, their samples, the folds of their blocks, or both.
//!
//! A change marks the blocks that it reaches; a marked block is folded again when a ray comes to it, and one behind the place where the ray ends stays marked,
//! perhaps for ever. With samples kept, only those that changed are interpolated again; without, a marked block's all are.

use std::ops::Range;

use super::cast::{Fold, Line, Sampler, Through, fold_block};
use super::settings::Cache;
use super::work::RenderWork;

/// What is kept of the rays of a row.
pub(super) struct RowCache<const C: usize> {
    kind: Cache,
    /// Colour and opacity of each sample of each ray on the stage, one after the other; and where each ray's begin.
    samples: Vec<f32>,
    samples_of: Vec<usize>,
    /// The fold of each block of each ray; and where each ray's begin.
    blocks: Vec<Through<C>>,
    stale: Vec<bool>,
    blocks_of: Vec<usize>,
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
    let of_samples = samples * ((C + 1) * size_of::<f32>()) as u64;
    let of_blocks = blocks * (size_of::<Through<C>>() + size_of::<bool>()) as u64;
    match kind {
        Cache::None => 0,
        Cache::Linear => of_samples,
        Cache::TwoLevel => of_samples + of_blocks,
        Cache::OneLevel => of_blocks,
    }
}

impl<const C: usize> RowCache<C> {
    /// Of rays of which all is transparent.
    pub(super) fn new(kind: Cache, lines: &[Line], fold: Fold) -> Self {
        let mut cache = Self {
            kind,
            samples: Vec::new(),
            samples_of: Vec::new(),
            blocks: Vec::new(),
            stale: Vec::new(),
            blocks_of: Vec::new(),
        };
        let (mut samples, mut blocks) = (0, 0);
        for line in lines {
            if kind.keeps_samples() {
                cache.samples_of.push(samples);
                samples += (line.end - line.first) as usize * (C + 1);
            }
            if kind.keeps_blocks() {
                cache.blocks_of.push(blocks);
                blocks += blocks_of(line, fold).1;
            }
        }
        cache.samples = vec![0.0; samples];
        cache.blocks = vec![Through::CLEAR; blocks];
        cache.stale = vec![false; blocks];
        cache
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
        let samples = match self.kind.keeps_samples() {
            true => {
                let samples = &mut self.samples[self.samples_of[at]..][..(line.end - line.first) as usize * (C + 1)];
                sampler.resample(line, [from, to], samples, work);
                &*samples
            }
            false => &[],
        };
        if self.kind == Cache::None {
            return sampler.cast(line, fold, work);
        }
        let kept =
            |k: u32, end: u32| &samples[(k - line.first) as usize * (C + 1)..(end - line.first) as usize * (C + 1)];
        let mut all = Through::CLEAR;
        let mut k = line.first;
        if !self.kind.keeps_blocks() {
            while k < line.end {
                let end = fold.block_end(k).min(line.end);
                if all.ends_behind(&fold_block(kept(k, end)), fold, work) {
                    break;
                }
                k = end;
            }
            return all;
        }
        let (first, count) = blocks_of(line, fold);
        let range = self.blocks_of[at]..self.blocks_of[at] + count;
        let (blocks, stale) = (&mut self.blocks[range.clone()], &mut self.stale[range]);
        let changed = (from / fold.arity - first) as usize..=((to - 1) / fold.arity - first) as usize;
        stale[changed].fill(true);
        for (block, stale) in blocks.iter_mut().zip(stale) {
            let end = fold.block_end(k).min(line.end);
            if std::mem::take(stale) {
                *block = match self.kind {
                    Cache::TwoLevel => fold_block(kept(k, end)),
                    _ => sampler.block(line, &mut k.clone(), end, work).unwrap_or(Through::CLEAR),
                };
                work.blocks_resolved += 1;
            }
            if all.ends_behind(block, fold, work) {
                break;
            }
            k = end;
        }
        all
    }
}
