//! The picture's rows: finds the pixels a change reaches, and casts their rays again.

use std::ops::Range;

use simd::{Fused, Simd};

use crate::camera::Camera;
use crate::rays::cache::{Extent, RowCache};
use crate::rays::cast::Casting;
use crate::rays::composite::{Accumulated, Fold};
use crate::rays::line::Line;
use crate::rays::marks::Marks;
use crate::rays::visible_blocks::TileRow;
use crate::region::RenderRegion;
use crate::settings::Cache;
use crate::voxels::Sampler;
use crate::work::RenderWork;

/// Job that renders a pixel of a row again.
struct CastPixel<'a, const C: usize> {
    row: &'a mut Row<C>,
    at: usize,
    samples: [u32; 2],
    visible: &'a [u64],
    casting: Casting<'a, C>,
}

/// Job that marks the changed samples of a row's rays.
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

/// Job that sets up the rays of a row.
struct SetUp<'a> {
    lines: &'a mut Vec<Line>,
    camera: &'a Camera,
    region: &'a RenderRegion,
    j: u32,
}

impl Fused for SetUp<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { lines, camera, region, j } = self;
        let [low, high] = region.bounds().map(|at| std::array::from_fn(|a| at[a] - region.first()[a]));
        let parallel = (!camera.is_perspective()).then(|| camera.ray(0, j).step.recip());
        lines.clear();
        lines.extend((0..camera.size()[0]).map(|i| {
            let ray = camera.ray(i, j);
            Line::with(&ray, parallel.unwrap_or_else(|| ray.step.recip()), low, high, camera.samples())
        }));
    }
}

impl<const C: usize> Fused for CastPixel<'_, C> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.row.cast_pixel(self.at, self.samples, self.visible, self.casting);
    }
}

/// A row of pixels, and the data kept of their rays.
pub(crate) struct Row<const C: usize> {
    pub(crate) pixels: Vec<Accumulated<C>>,
    lines: Vec<Line>,
    extent: Extent,
    cache: RowCache<C>,
    /// Samples of each pixel's ray that may have changed.
    dirty: Vec<[u32; 2]>,
    pub(crate) work: RenderWork,
}

impl<const C: usize> Row<C> {
    /// Creates row `j`, transparent.
    pub(crate) fn new(camera: &Camera, region: &RenderRegion, (fold, simd): (Fold, Simd), j: u32) -> Self {
        let n = camera.size()[0] as usize;
        let mut row = Self {
            pixels: vec![Accumulated::CLEAR; n],
            lines: Vec::with_capacity(n),
            extent: Extent::default(),
            cache: RowCache::none(),
            dirty: Vec::with_capacity(n),
            work: RenderWork::default(),
        };
        row.turn(camera, region, (fold, simd), j);
        row
    }

    /// Sets the rays up for another view. The pixels and the memory of the cache stay until
    /// [`Self::reset_cache`].
    pub(crate) fn turn(&mut self, camera: &Camera, region: &RenderRegion, (fold, simd): (Fold, Simd), j: u32) {
        simd.fused(SetUp { lines: &mut self.lines, camera, region, j });
        self.extent = Extent::of(&self.lines, fold);
        self.dirty.clear();
        self.dirty.resize(self.lines.len(), [u32::MAX, 0]);
    }

    /// Returns the bytes that a cache would take.
    pub(crate) fn cache_bytes(&self, cache: Cache) -> u64 {
        self.extent.bytes::<C>(cache)
    }

    /// Starts to use a cache; all rays must still be transparent.
    pub(crate) fn keep(&mut self, cache: Cache, fold: Fold) {
        self.cache = RowCache::none();
        self.cache.lay_out(cache, &self.lines, fold);
    }

    /// Starts to use a cache in the memory of another view's cache; none of its rays has been
    /// cast, and all pixels are transparent.
    pub(crate) fn reset_cache(&mut self, cache: Cache, fold: Fold) {
        self.pixels.fill(Accumulated::CLEAR);
        self.cache.lay_out(cache, &self.lines, fold);
        self.mark_all();
    }

    /// Returns a row of the same rays, each restricted to some samples; transparent.
    pub(crate) fn restricted(&self, fold: Fold, own: impl Fn(&Line) -> [u32; 2]) -> Self {
        let restricted = |line: &Line| {
            let [first, end] = own(line);
            Line { first, end, ..*line }
        };
        let lines: Vec<Line> = self.lines.iter().map(restricted).collect();
        Self {
            pixels: vec![Accumulated::CLEAR; lines.len()],
            extent: Extent::of(&lines, fold),
            lines,
            cache: RowCache::none(),
            dirty: vec![[u32::MAX, 0]; self.lines.len()],
            work: RenderWork::default(),
        }
    }

    /// Returns the rays.
    pub(crate) fn lines(&self) -> &[Line] {
        &self.lines
    }

    /// Sets a pixel, and counts whether it has changed.
    pub(crate) fn set(&mut self, at: usize, pixel: Accumulated<C>) {
        self.work.pixels_changed += u64::from(!pixel.same_bits(&self.pixels[at]));
        self.pixels[at] = pixel;
    }

    /// Returns the number of a ray's first block, and the range of its blocks in [`Self::kept`].
    pub(crate) fn blocks_of(&self, at: usize, fold: Fold) -> (u32, Range<usize>) {
        self.cache.blocks_of(at, &self.lines[at], fold)
    }

    /// Returns the composited blocks, if they are kept. Blocks behind the end of a ray may be
    /// out of date.
    pub(crate) fn kept(&self) -> &[Accumulated<C>] {
        self.cache.blocks()
    }

    pub(crate) fn bytes(&self) -> u64 {
        let each = size_of::<Line>() + size_of::<Accumulated<C>>() + size_of::<[u32; 2]>();
        self.cache.bytes() + (self.lines.len() * each) as u64
    }

    /// Notes the samples of its rays that some changes can have reached, until the ray is cast.
    /// Returns the first pixel concerned and the one after the last.
    pub(crate) fn mark(&mut self, j: u32, marks: &Marks, simd: Simd) -> [usize; 2] {
        simd.fused(Marking { row: self, j, marks })
    }

    /// Marks all samples of all its rays as changed.
    fn mark_all(&mut self) {
        for (line, dirty) in self.lines.iter().zip(&mut self.dirty) {
            if line.first < line.end {
                *dirty = [line.first, line.end];
            }
        }
    }

    /// Casts the ray of a pixel again, if any of it may have changed since its last cast.
    pub(crate) fn cast(&mut self, at: usize, tiles: TileRow<'_>, casting: Casting<'_, C>) {
        let [from, to] = std::mem::replace(&mut self.dirty[at], [u32::MAX, 0]);
        if from < to {
            let visible = tiles.at(at);
            casting.simd.fused(CastPixel { row: self, at, samples: [from, to], visible, casting });
        }
    }

    /// Renders a pixel again; `samples` may have changed.
    #[inline(always)]
    fn cast_pixel(&mut self, at: usize, samples: [u32; 2], visible: &[u64], casting: Casting<'_, C>) {
        let inputs = (casting.sampler, casting.fold);
        let pixel = self.cache.pixel(at, &self.lines[at], samples, visible, inputs, &mut self.work);
        self.work.rays += 1;
        self.set(at, pixel);
    }
    /// Begins to cast the ray of a pixel in lockstep with others, if its samples are new, as those
    /// of all rays that meet the region are after a turn. Returns whether they are.
    #[inline(always)]
    pub(crate) fn begin(&mut self, at: usize, fold: Fold) -> bool {
        let [from, to] = std::mem::replace(&mut self.dirty[at], [u32::MAX, 0]);
        if from < to {
            debug_assert_eq!([from, to], [self.lines[at].first, self.lines[at].end]);
            self.cache.begin(at, &self.lines[at], fold);
        }
        from < to
    }

    /// Composites for the first time a block of a ray, of which the first sample and the one after
    /// the last are given; `None` if it is transparent.
    #[inline(always)]
    pub(crate) fn first_block(
        &mut self,
        at: usize,
        number: u32,
        [from, to]: [u32; 2],
        sampler: Sampler<'_, C>,
        fold: Fold,
    ) -> Option<Accumulated<C>> {
        let line = &self.lines[at];
        let [from, to] = [from.max(line.first), to.min(line.end)];
        if from >= to {
            return None;
        }
        let block = sampler.block(line, [from, to], fold.composite_mode, &mut self.work);
        self.cache.put_first(at, line, number, block.unwrap_or(Accumulated::CLEAR), fold);
        block
    }
}
