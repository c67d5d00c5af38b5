//! The samples of a ray and their composition.
//!
//! Samples are composited front to back in blocks of P, at fixed places along the ray. Within a
//! block C ← C + T·c, T ← T − T·α, starting from (0, 1). The blocks are then joined in the same
//! way; the ray ends when T falls below the stop. All pictures use this one order, whatever is
//! kept between them, so all give the same bits.
//!
//! Colour is premultiplied and T is transmittance. An opaque sample makes T zero exactly. A
//! transparent sample changes no bit and can be skipped.

use crate::camera::Ray;
use crate::classify::shade::Lit;
use crate::rays::composite::CompositeMode;
use crate::rays::run::{RUN, Run};
use crate::rays::slab::SLACK;
use crate::voxels::Sampler;
use crate::work::RenderWork;

/// Composited samples: premultiplied colour, and the transmittance to whatever lies behind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Through<const C: usize> {
    pub(crate) colour: [f32; C],
    pub(crate) transmittance: f32,
}

impl<const C: usize> Through<C> {
    /// No samples.
    pub(crate) const CLEAR: Self = Self { colour: [0.0; C], transmittance: 1.0 };

    /// Adds a sample behind.
    #[inline(always)]
    pub(crate) fn add(&mut self, colour: [f32; C], alpha: f32) {
        for (sum, c) in self.colour.iter_mut().zip(colour) {
            *sum = self.transmittance.mul_add(c, *sum);
        }
        self.transmittance = (-self.transmittance).mul_add(alpha, self.transmittance);
    }

    /// Adds a block behind; returns whether the ray ends with it.
    #[inline(always)]
    pub(crate) fn ends_behind(&mut self, block: &Self, fold: Fold, work: &mut RenderWork) -> bool {
        fold.law.join(self, block);
        work.blocks_folded += 1;
        fold.law.ends(self, fold.stop)
    }

    /// Adds a block behind.
    #[inline(always)]
    pub(crate) fn join(&mut self, block: &Self) {
        for (sum, c) in self.colour.iter_mut().zip(block.colour) {
            *sum = self.transmittance.mul_add(c, *sum);
        }
        self.transmittance *= block.transmittance;
    }

    pub(crate) fn same_bits(&self, other: &Self) -> bool {
        self.transmittance.to_bits() == other.transmittance.to_bits()
            && self.colour.iter().zip(&other.colour).all(|(a, b)| a.to_bits() == b.to_bits())
    }
}

/// Parameters for compositing samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fold {
    /// Samples of a block.
    pub(crate) arity: u32,
    /// The composite mode.
    pub(crate) law: CompositeMode,
    /// The ray ends at the end of a block if the transmittance is below this.
    pub(crate) stop: f32,
}

impl Fold {
    /// Returns the end of the block that holds a sample.
    #[inline(always)]
    pub(crate) fn block_end(self, k: u32) -> u32 {
        (k / self.arity + 1).saturating_mul(self.arity)
    }
}

/// A ray in single precision, and its samples within the render region: from `first`, up to but
/// not including `end`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    pub(crate) base: [f32; 3],
    pub(crate) step: [f32; 3],
    pub(crate) first: u32,
    pub(crate) end: u32,
}

impl Line {
    /// Returns the part of a ray of `samples` samples that lies within a voxel of the box `low`
    /// to `high`.
    pub(crate) fn new(ray: &Ray, low: [i64; 3], high: [i64; 3], samples: u32) -> Self {
        let [first, end] = span(ray, low, high, [0, samples]);
        Self { base: ray.base.as_vec3().to_array(), step: ray.step.as_vec3().to_array(), first, end }
    }

    /// Returns the region coordinates of a sample.
    pub(crate) fn at(&self, k: u32) -> [f32; 3] {
        // Exact: there are fewer than 2¹⁶ samples.
        let k = k as f32;
        let ([x, y, z], [bx, by, bz]) = (self.step, self.base);
        [x.mul_add(k, bx), y.mul_add(k, by), z.mul_add(k, bz)]
    }

    /// Returns the region coordinates of the sample before `k`.
    #[inline(always)]
    pub(crate) fn before(&self, k: u32) -> [f32; 3] {
        let k = k as f32 - 1.0;
        let ([x, y, z], [bx, by, bz]) = (self.step, self.base);
        [x.mul_add(k, bx), y.mul_add(k, by), z.mul_add(k, bz)]
    }
}

/// Returns the samples in a range of a ray that can lie within a voxel of a box; empty if there
/// are none. The box is widened by more than the samples' rounding in single precision.
pub(crate) fn span(ray: &Ray, low: [i64; 3], high: [i64; 3], [first, end]: [u32; 2]) -> [u32; 2] {
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
    /// Composites the samples of a line.
    #[inline(always)]
    pub(crate) fn cast(&self, line: &Line, fold: Fold, work: &mut RenderWork) -> Through<C> {
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

    /// Composites the samples `from` up to `to`; `None` if all are transparent.
    #[inline(always)]
    pub(crate) fn block(
        &self,
        line: &Line,
        [from, to]: [u32; 2],
        law: CompositeMode,
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

    /// Samples part of a line again, into the kept samples.
    #[inline(always)]
    pub(crate) fn resample(&self, line: &Line, [from, to]: [u32; 2], kept: &mut [Lit<f32, C>], work: &mut RenderWork) {
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

/// Composites the kept samples of a block.
#[inline(always)]
pub(crate) fn fold_block<const C: usize>(kept: &[Lit<f32, C>], law: CompositeMode) -> Through<C> {
    let mut block = Through::CLEAR;
    for Lit { colour, alpha } in kept {
        law.add(&mut block, *colour, *alpha);
    }
    block
}
