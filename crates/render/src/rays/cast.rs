//! The samples of a ray and their composition.
//!
//! Samples are composited front to back in blocks of P, at fixed places along the ray. Within a
//! block C ← C + T·c, T ← T − T·α, starting from (0, 1). The blocks are then joined in the same
//! way; the ray ends when T falls below the stop. All pictures use this one order, whatever is
//! kept between them, so all give the same bits.
//!
//! Colour is premultiplied and T is transmittance. An opaque sample makes T zero exactly. A
//! transparent sample changes no bit and can be skipped.

use simd::Simd;
use simd::sharing::Sharing;

use crate::classify::shade::{Lit, Shader};
use crate::rays::composite::{Accumulated, CompositeMode, Fold};
use crate::rays::line::Line;
use crate::rays::run::{RUN, Run};
use crate::rays::visible_blocks::{Blocks, VisibleBlocks};
use crate::voxels::{Sampler, Voxels};
use crate::work::RenderWork;

/// Parameters for casting rays.
#[derive(Clone, Copy)]
pub(crate) struct Casting<'a, const C: usize> {
    pub(crate) sampler: Sampler<'a, C>,
    pub(crate) visible: &'a VisibleBlocks,
    pub(crate) fold: Fold,
    pub(crate) simd: Simd,
    pub(crate) sharing: Sharing<'a>,
}

impl<'a, const C: usize> Casting<'a, C> {
    pub(crate) fn new(
        voxels: &'a Voxels<C>,
        shader: &'a Shader<f32>,
        (fold, simd, sharing): (Fold, Simd, Sharing<'a>),
    ) -> Self {
        Self { sampler: Sampler::new(voxels, shader), visible: &voxels.visible, fold, simd, sharing }
    }
}

impl<const C: usize> Sampler<'_, C> {
    /// Composites the samples of a line in its visible blocks; all of them without `visible`.
    #[inline(always)]
    pub(crate) fn cast(
        &self,
        line: &Line,
        visible: Option<&[u64]>,
        fold: Fold,
        work: &mut RenderWork,
    ) -> Accumulated<C> {
        let mut all = Accumulated::CLEAR;
        for (_, samples) in Blocks::new(line, fold, visible) {
            let block = self.block(line, samples, fold.composite_mode, work);
            if let Some(block) = block
                && all.ends_behind(&block, fold, work)
            {
                break;
            }
        }
        all
    }

    /// Composites the samples `from` up to `to`; `None` if all are transparent.
    #[inline(always)]
    pub(crate) fn block(
        &self,
        line: &Line,
        [from, to]: [u32; 2],
        composite_mode: CompositeMode,
        work: &mut RenderWork,
    ) -> Option<Accumulated<C>> {
        let mut block = None;
        let mut run = Run::new();
        let mut k = from;
        while k < to {
            let n = (to - k).min(RUN);
            if self.run(line, k, n, &mut run, work) {
                let block = block.get_or_insert(Accumulated::CLEAR);
                for i in 0..n as usize {
                    let Lit { colour, alpha } = run.sample(i);
                    composite_mode.add(block, colour, alpha);
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
pub(crate) fn fold_block<const C: usize>(kept: &[Lit<f32, C>], composite_mode: CompositeMode) -> Accumulated<C> {
    let mut block = Accumulated::CLEAR;
    for Lit { colour, alpha } in kept {
        composite_mode.add(&mut block, *colour, *alpha);
    }
    block
}
