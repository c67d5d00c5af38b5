//! The picture's rows: which pixels a change reaches, and their rays anew.

use std::ops::Range;

use super::cache::{self, RowCache};
use super::camera::Camera;
use super::cast::{Fold, Line, Through};
use super::marks::Marks;
use super::settings::Cache;
use super::stage::Stage;
use super::voxels::Sampler;
use super::work::RenderWork;
use crate::simd::{Fused, Simd};

/// A pixel of a row anew.
struct Again<'a, const C: usize> {
    row: &'a mut Row<C>,
    at: usize,
    samples: [u32; 2],
    sampler: Sampler<'a, C>,
    fold: Fold,
}

/// What some changes may have done to a row's rays.
struct Marking<'a, const C: usize> {
    row: &'a mut Row<C>,
    j: u32,
    marks: &'a Marks,
}

impl<const C: usize> Fused for Marking<'_, C> {
    type Output = [usize; 2];

    #[inline(always)]
    fn run(self) -> [usize; 2] {
        let Row { lines, dirty, work, .. } = self.row;
        self.marks.note(self.j, lines, dirty, work)
    }
}

impl<const C: usize> Fused for Again<'_, C> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.row.again(self.at, self.samples, self.sampler, self.fold);
    }
}

/// A row of pixels, and what is kept of their rays.
pub(super) struct Row<const C: usize> {
    pub(super) pixels: Vec<Through<C>>,
    lines: Vec<Line>,
    cache: RowCache<C>,
    /// Samples of each pixel's ray that may have changed.
    dirty: Vec<[u32; 2]>,
    pub(super) work: RenderWork,
}

impl<const C: usize> Row<C> {
    /// Row `j`, transparent.
    pub(super) fn new(camera: &Camera, stage: &Stage, j: u32) -> Self {
        let n = camera.size()[0] as usize;
        let mut row = Self {
            pixels: vec![Through::CLEAR; n],
            lines: Vec::with_capacity(n),
            cache: RowCache::none(),
            dirty: Vec::with_capacity(n),
            work: RenderWork::default(),
        };
        row.turn(camera, stage, j);
        row
    }

    /// The same row of another view, transparent; the memory of what was kept stays until [`Self::keep_again`] lays it out anew.
    pub(super) fn turn(&mut self, camera: &Camera, stage: &Stage, j: u32) {
        let [width, _] = camera.size();
        let [low, high] = stage.bounds().map(|at| std::array::from_fn(|a| at[a] - stage.first()[a]));
        self.lines.clear();
        self.lines.extend((0..width).map(|i| Line::new(&camera.ray(i, j), low, high, camera.samples())));
        self.pixels.fill(Through::CLEAR);
        self.dirty.clear();
        self.dirty.resize(self.lines.len(), [u32::MAX, 0]);
    }

    /// Bytes that a cache would take.
    pub(super) fn cache_bytes(&self, cache: Cache, fold: Fold) -> u64 {
        cache::bytes::<C>(cache, &self.lines, fold)
    }

    /// Keeps more of its rays from now on; all must be transparent yet.
    pub(super) fn keep(&mut self, cache: Cache, fold: Fold) {
        self.cache = RowCache::new(cache, &self.lines, fold);
    }

    /// Keeps more of its rays from now on, in the memory of what it kept of another view's; nothing of them has been cast.
    pub(super) fn keep_again(&mut self, cache: Cache, fold: Fold) {
        self.cache.again(cache, &self.lines, fold);
        self.mark_all();
    }

    /// Leaves of each ray only some samples; all must be transparent yet.
    pub(super) fn restrict(&mut self, own: impl Fn(&Line) -> [u32; 2]) {
        for line in &mut self.lines {
            [line.first, line.end] = own(line);
        }
    }

    /// The number of a ray's first block, and where in [`Self::kept`] its blocks are.
    pub(super) fn blocks_of(&self, at: usize, fold: Fold) -> (u32, Range<usize>) {
        self.cache.blocks_of(at, &self.lines[at], fold)
    }

    /// Folds of blocks, where they are kept. Those behind the place where a ray has ended may be out of date.
    pub(super) fn kept(&self) -> &[Through<C>] {
        self.cache.blocks()
    }

    pub(super) fn bytes(&self) -> u64 {
        let each = size_of::<Line>() + size_of::<Through<C>>() + size_of::<[u32; 2]>();
        self.cache.bytes() + (self.lines.len() * each) as u64
    }

    /// Notes which samples of its rays some changes can have reached; they stay noted until the ray is cast. Returns the pixels that are concerned, the first and
    /// the one behind the last.
    pub(super) fn mark(&mut self, j: u32, marks: &Marks, simd: Simd) -> [usize; 2] {
        simd.fused(Marking { row: self, j, marks })
    }

    /// Notes that all samples of all its rays may have changed.
    fn mark_all(&mut self) {
        for (line, dirty) in self.lines.iter().zip(&mut self.dirty) {
            if line.first < line.end {
                *dirty = [line.first, line.end];
            }
        }
    }

    /// Casts the ray of a pixel again, if anything of it may have changed since it was cast last.
    pub(super) fn cast(&mut self, at: usize, sampler: Sampler<'_, C>, fold: Fold, simd: Simd) {
        let [from, to] = std::mem::replace(&mut self.dirty[at], [u32::MAX, 0]);
        if from < to {
            simd.fused(Again { row: self, at, samples: [from, to], sampler, fold });
        }
    }

    /// A pixel anew, of whose samples some may have changed.
    #[inline(always)]
    fn again(&mut self, at: usize, samples: [u32; 2], sampler: Sampler<'_, C>, fold: Fold) {
        let pixel = self.cache.pixel(at, &self.lines[at], samples, sampler, fold, &mut self.work);
        self.work.rays += 1;
        self.work.pixels_changed += u64::from(!pixel.same_bits(&self.pixels[at]));
        self.pixels[at] = pixel;
    }
}
