//! A ray's samples and their fold.
//!
//! Samples are folded front to back in blocks of P, at fixed places along the ray: within a block C ← C + T·c, T ← T − T·α from (0, 1), then the
//! blocks in the same way, ending where T falls below the stop. That is the one order of all pictures, whatever is kept between them; so all are
//! the same bits. Colour is premultiplied and T is transmittance: an opaque sample makes T zero exactly, and a transparent one changes no bit and can be
//! passed over.

use super::camera::Ray;
use super::shaded::{SIDE, Shaded};
use super::shown::ABSENT;
use super::work::RenderWork;
use crate::volume::brick::EDGE;

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
        for (sum, c) in self.colour.iter_mut().zip(block.colour) {
            *sum = self.transmittance.mul_add(c, *sum);
        }
        self.transmittance *= block.transmittance;
        work.blocks_folded += 1;
        self.transmittance < fold.stop
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
    base: [f32; 3],
    step: [f32; 3],
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
    #[inline(always)]
    pub(super) fn at(&self, k: u32) -> [f32; 3] {
        // Exact: there are fewer than 2¹⁶ samples.
        let k = k as f32;
        let ([x, y, z], [bx, by, bz]) = (self.step, self.base);
        [x.mul_add(k, bx), y.mul_add(k, by), z.mul_add(k, bz)]
    }

    /// How many samples from the one at `at` on, at least one, certainly lie in the same brick.
    #[inline(always)]
    fn stay(&self, at: [f32; 3], brick: [i32; 3]) -> u32 {
        let mut least = f32::INFINITY;
        for a in 0..3 {
            // Along an axis without a step a sample never leaves. Rounding moves one by less than a hundredth of a voxel.
            let face = (brick[a] + i32::from(self.step[a] > 0.0)) as f32 * EDGE as f32;
            if self.step[a] != 0.0 {
                least = least.min(((face - at[a]).abs() - 1e-2) / self.step[a].abs());
            }
        }
        least.max(1.0) as u32
    }
}

/// Samples of a ray that can lie within a voxel of a box, of those in a range; empty where none can. The box is widened by more than the samples'
/// rounding in single precision.
pub(super) fn span(ray: &Ray, low: [i64; 3], high: [i64; 3], [first, end]: [u32; 2]) -> [u32; 2] {
    const SLACK: f64 = 1e-2;
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

/// Reads shaded voxels between their places.
#[derive(Clone, Copy)]
pub(super) struct Sampler<'a, const C: usize> {
    shaded: &'a Shaded<C>,
    size: [i32; 3],
}

impl<'a, const C: usize> Sampler<'a, C> {
    pub(super) fn new(shaded: &'a Shaded<C>) -> Self {
        Self { shaded, size: shaded.table.size().map(|s| s as i32) }
    }

    /// The sample at a place, and its brick; `None` in the place of what is transparent.
    #[inline(always)]
    fn sample(&self, at: [f32; 3]) -> ([i32; 3], Option<([f32; C], f32)>) {
        // Closures would be functions of their own, without the caller's instruction set.
        let [x, y, z] = at;
        let floor = [x.floor(), y.floor(), z.floor()];
        let cell = [floor[0] as i32, floor[1] as i32, floor[2] as i32];
        let brick = [cell[0] >> 3, cell[1] >> 3, cell[2] >> 3];
        for a in 0..3 {
            if brick[a] < 0 || brick[a] >= self.size[a] {
                return (brick, None);
            }
        }
        let index = (brick[2] * self.size[1] + brick[1]) as usize * self.size[0] as usize + brick[0] as usize;
        let slot = self.shaded.table.slots()[index];
        if slot == ABSENT {
            return (brick, None);
        }
        let brick_of = &self.shaded.bricks[slot as usize];
        if !brick_of.is_filled() {
            return (brick, None);
        }
        let corner = ((cell[2] & 7) as usize * SIDE + (cell[1] & 7) as usize) * SIDE + (cell[0] & 7) as usize;
        let part = [x - floor[0], y - floor[1], z - floor[2]];
        let mut colour = [0.0; C];
        for (colour, cells) in colour.iter_mut().zip(&brick_of.colour) {
            *colour = between(cells, corner, part);
        }
        (brick, Some((colour, between(&brick_of.alpha, corner, part))))
    }

    /// The fold of a line's samples as they are.
    #[inline(always)]
    pub(super) fn cast(&self, line: &Line, fold: Fold, work: &mut RenderWork) -> Through<C> {
        let mut all = Through::CLEAR;
        let mut k = line.first;
        while k < line.end {
            let end = fold.block_end(k).min(line.end);
            let block = self.block(line, &mut k, end, work);
            if let Some(block) = block
                && all.ends_behind(&block, fold, work)
            {
                break;
            }
        }
        all
    }

    /// The samples from `k` up to `end` folded; `None` where all are transparent. Leaves `k` where the next block's samples begin that may not be.
    #[inline(always)]
    pub(super) fn block(&self, line: &Line, k: &mut u32, end: u32, work: &mut RenderWork) -> Option<Through<C>> {
        let mut block = None;
        while *k < end {
            let at = line.at(*k);
            match self.sample(at) {
                (_, Some((colour, alpha))) => {
                    block.get_or_insert(Through::CLEAR).add(colour, alpha);
                    work.samples += 1;
                    *k += 1;
                }
                (brick, None) => {
                    let stay = line.stay(at, brick).min(line.end - *k);
                    work.samples_skipped += u64::from(stay);
                    *k += stay;
                }
            }
        }
        block
    }

    /// Samples part of a line again, into what is kept of it: colour and opacity of each sample from the line's first on.
    #[inline(always)]
    pub(super) fn resample(&self, line: &Line, [from, to]: [u32; 2], kept: &mut [f32], work: &mut RenderWork) {
        for k in from..to {
            let kept = &mut kept[(k - line.first) as usize * (C + 1)..][..C + 1];
            match self.sample(line.at(k)).1 {
                Some((colour, alpha)) => {
                    kept[..C].copy_from_slice(&colour);
                    kept[C] = alpha;
                    work.samples += 1;
                }
                None => {
                    kept.fill(0.0);
                    work.samples_skipped += 1;
                }
            }
        }
    }
}

/// The fold of a block's samples as they were kept.
#[inline(always)]
pub(super) fn fold_block<const C: usize>(kept: &[f32]) -> Through<C> {
    let mut block = Through::CLEAR;
    for sample in kept.chunks_exact(C + 1) {
        let mut colour = [0.0; C];
        colour.copy_from_slice(&sample[..C]);
        block.add(colour, sample[C]);
    }
    block
}

/// Trilinear, x first.
#[inline(always)]
fn between(cells: &[f32], corner: usize, [x, y, z]: [f32; 3]) -> f32 {
    // One check for the eight.
    let cells = &cells[corner..][..SIDE * SIDE + SIDE + 2];
    let mut faces = [0.0; 2];
    for (dz, face) in faces.iter_mut().enumerate() {
        let at = dz * SIDE * SIDE;
        let a = x.mul_add(cells[at + 1] - cells[at], cells[at]);
        let b = x.mul_add(cells[at + SIDE + 1] - cells[at + SIDE], cells[at + SIDE]);
        *face = y.mul_add(b - a, a);
    }
    z.mul_add(faces[1] - faces[0], faces[0])
}
