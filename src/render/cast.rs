//! A ray's samples and their fold.
//!
//! Samples are folded front to back in blocks of P, at fixed places along the ray: within a block C ← C + T·c, T ← T − T·α from (0, 1), then the
//! blocks in the same way, ending where T falls below the stop. That is the one order of all pictures, whatever is kept between them; so all are
//! the same bits. Colour is premultiplied and T is transmittance: an opaque sample makes T zero exactly, and a transparent one changes no bit and can be
//! passed over.

use super::camera::Ray;
use super::law::Law;
use super::run::{RUN, Run};
use super::shade::Lit;
use super::slab::SLACK;
use super::voxels::Sampler;
use super::work::RenderWork;

/// What is seen through so many samples: premultiplied colour, and how much of what lies behind is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Through<const C: usize> {
    pub(super) colour: [f32; C],
    pub(super) transmittance: f32,
}

impl<const C: usize> Through<C> {
    /// Nothing in the way.
    pub(super) const CLEAR: Self = Self { colour: [0.0; C], transmittance: 1.0 };

    /// Another sample behind.
    #[inline(always)]
    pub(super) fn add(&mut self, colour: [f32; C], alpha: f32) {
        for (sum, c) in self.colour.iter_mut().zip(colour) {
            *sum = self.transmittance.mul_add(c, *sum);
        }
        self.transmittance = (-self.transmittance).mul_add(alpha, self.transmittance);
    }

    /// Another block behind; whether the ray ends with it.
    #[inline(always)]
    pub(super) fn ends_behind(&mut self, block: &Self, fold: Fold, work: &mut RenderWork) -> bool {
        fold.law.join(self, block);
        work.blocks_folded += 1;
        fold.law.ends(self, fold.stop)
    }

    /// Another block behind.
    #[inline(always)]
    pub(super) fn join(&mut self, block: &Self) {
        for (sum, c) in self.colour.iter_mut().zip(block.colour) {
            *sum = self.transmittance.mul_add(c, *sum);
        }
        self.transmittance *= block.transmittance;
    }

    pub(super) fn same_bits(&self, other: &Self) -> bool {
        self.transmittance.to_bits() == other.transmittance.to_bits()
            && self.colour.iter().zip(&other.colour).all(|(a, b)| a.to_bits() == b.to_bits())
    }
}

/// How samples are folded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fold {
    /// Samples of a block.
    pub(super) arity: u32,
    /// How they make one.
    pub(super) law: Law,
    /// The ray ends at the end of a block where less of what is behind would be seen.
    pub(super) stop: f32,
}

impl Fold {
    /// Where the block of a sample ends.
    #[inline(always)]
    pub(super) fn block_end(self, k: u32) -> u32 {
        (k / self.arity + 1).saturating_mul(self.arity)
    }
}

/// A ray in single precision, and the samples of it that lie on the stage: from `first`, up to but not including `end`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    pub(super) base: [f32; 3],
    pub(super) step: [f32; 3],
    pub(super) first: u32,
    pub(super) end: u32,
}

impl Line {
    /// The part of a ray of `samples` samples within a voxel of the box `low` to `high`.
    pub(super) fn new(ray: &Ray, low: [i64; 3], high: [i64; 3], samples: u32) -> Self {
        let [first, end] = span(ray, low, high, [0, samples]);
        Self { base: ray.base.as_vec3().to_array(), step: ray.step.as_vec3().to_array(), first, end }
    }

    /// Stage coordinates of a sample.
    pub(super) fn at(&self, k: u32) -> [f32; 3] {
        // Exact: there are fewer than 2¹⁶ samples.
        let k = k as f32;
        let ([x, y, z], [bx, by, bz]) = (self.step, self.base);
        [x.mul_add(k, bx), y.mul_add(k, by), z.mul_add(k, bz)]
    }

    /// Stage coordinates of the sample before one.
    #[inline(always)]
    pub(super) fn before(&self, k: u32) -> [f32; 3] {
        let k = k as f32 - 1.0;
        let ([x, y, z], [bx, by, bz]) = (self.step, self.base);
        [x.mul_add(k, bx), y.mul_add(k, by), z.mul_add(k, bz)]
    }
}

/// Samples of a ray that can lie within a voxel of a box, of those in a range; empty where none can. The box is widened by more than the samples'
/// rounding in single precision.
pub(super) fn span(ray: &Ray, low: [i64; 3], high: [i64; 3], [first, end]: [u32; 2]) -> [u32; 2] {
    let (mut enter, mut leave) = (f64::from(first), f64::from(end) - 1.0);
    for a in 0..3 {
        let (base, step) = (ray.base[a], ray.step[a]);
        let (low, high) = (low[a] as f64 - 1.0 - SLACK, high[a] as f64 + 1.0 + SLACK);
        if step.abs() < 1e-12 {
            if base < low || base > high {
                return [first, first];
            }
            continue;
        }
        let (one, other) = ((low - base) / step, (high - base) / step);
        enter = enter.max(one.min(other));
        leave = leave.min(one.max(other));
    }
    if enter > leave {
        return [first, first];
    }
    // Between 0 and 65 000.
    let (from, to) = (enter.ceil() as u32, leave.floor() as u32 + 1);
    if from < to { [from, to] } else { [first, first] }
}

impl<const C: usize> Sampler<'_, C> {
    /// The fold of a line's samples as they are.
    #[inline(always)]
    pub(super) fn cast(&self, line: &Line, fold: Fold, work: &mut RenderWork) -> Through<C> {
        let mut all = Through::CLEAR;
        let mut k = line.first;
        while k < line.end {
            let end = fold.block_end(k).min(line.end);
            let block = self.block(line, [k, end], fold.law, work);
            if let Some(block) = block
                && all.ends_behind(&block, fold, work)
            {
                break;
            }
            k = end;
        }
        all
    }

    /// The samples from the first given up to the second, folded; `None` where all are transparent.
    #[inline(always)]
    pub(super) fn block(
        &self,
        line: &Line,
        [from, to]: [u32; 2],
        law: Law,
        work: &mut RenderWork,
    ) -> Option<Through<C>> {
        let mut block = None;
        let mut run = Run::new();
        let mut k = from;
        while k < to {
            let n = (to - k).min(RUN);
            if self.run(line, k, n, &mut run, work) {
                let block = block.get_or_insert(Through::CLEAR);
                for i in 0..n as usize {
                    let Lit { colour, alpha } = run.sample(i);
                    law.add(block, colour, alpha);
                }
            }
            k += n;
        }
        block
    }

    /// Samples part of a line again, into what is kept of it.
    #[inline(always)]
    pub(super) fn resample(&self, line: &Line, [from, to]: [u32; 2], kept: &mut [Lit<f32, C>], work: &mut RenderWork) {
        let mut run = Run::new();
        let mut k = from;
        while k < to {
            let n = (to - k).min(RUN);
            let kept = &mut kept[(k - from) as usize..][..n as usize];
            if self.run(line, k, n, &mut run, work) {
                for (i, kept) in kept.iter_mut().enumerate() {
                    *kept = run.sample(i);
                }
            } else {
                kept.fill(Lit { colour: [0.0; C], alpha: 0.0 });
            }
            k += n;
        }
    }
}

/// The fold of a block's samples as they were kept.
#[inline(always)]
pub(super) fn fold_block<const C: usize>(kept: &[Lit<f32, C>], law: Law) -> Through<C> {
    let mut block = Through::CLEAR;
    for Lit { colour, alpha } in kept {
        law.add(&mut block, *colour, *alpha);
    }
    block
}
