//! The picture's rows: which pixels a change reaches, and their rays anew.

use std::ops::Range;

use super::cache::{self, RowCache};
use super::camera::Camera;
use super::cast::{Fold, Line, Sampler, Through, span};
use super::settings::Cache;
use super::shaded::Dirty;
use super::stage::Stage;
use super::work::RenderWork;
use crate::simd::{Fused, Simd};

/// Pixels around the projection of a box that its rays may reach: rounding, and a pixel's own extent.
const MARGIN: f64 = 1.0;

/// The pixels that a box can reach.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Footprint {
    dirty: Dirty,
    /// First and last pixel to the right and down, inclusive.
    columns: [u32; 2],
    rows: [u32; 2],
}

impl Footprint {
    /// Of a box of changed voxels; `None` where it is not in the picture.
    pub(super) fn new(dirty: Dirty, camera: &Camera) -> Option<Self> {
        let [width, height] = camera.size();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in 0..8_usize {
            let at = std::array::from_fn(|a| match corner >> a & 1 {
                0 => dirty.low[a] as f64 - 1.0,
                _ => dirty.high[a] as f64 + 1.0,
            });
            // Beside the eye of a perspective view a box may be anywhere.
            let pixel = camera.project(glam::DVec3::from_array(at));
            let [least, most] = pixel.map_or([[f64::NEG_INFINITY; 2], [f64::INFINITY; 2]], |p| [p; 2]);
            for a in 0..2 {
                low[a] = low[a].min(least[a]);
                high[a] = high[a].max(most[a]);
            }
        }
        let axis = |a: usize, size: u32| {
            let (first, last) = ((low[a] - MARGIN).ceil(), (high[a] + MARGIN).floor());
            let most = f64::from(size) - 1.0;
            (first <= most && last >= 0.0).then(|| [first.max(0.0) as u32, last.min(most) as u32])
        };
        Some(Self { dirty, columns: axis(0, width)?, rows: axis(1, height)? })
    }
}

/// A pixel of a row anew.
struct Again<'a, const C: usize> {
    row: &'a mut Row<C>,
    at: usize,
    samples: [u32; 2],
    sampler: Sampler<'a, C>,
    fold: Fold,
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
        let [width, _] = camera.size();
        let [low, high] = stage.bounds().map(|at| std::array::from_fn(|a| at[a] - stage.first()[a]));
        let lines: Vec<Line> = (0..width).map(|i| Line::new(&camera.ray(i, j), low, high, camera.samples())).collect();
        let n = lines.len();
        Self {
            pixels: vec![Through::CLEAR; n],
            lines,
            cache: RowCache::new(Cache::None, &[], Fold { arity: 1, stop: 0.0 }),
            dirty: vec![[u32::MAX, 0]; n],
            work: RenderWork::default(),
        }
    }

    /// Bytes that a cache would take.
    pub(super) fn cache_bytes(&self, cache: Cache, fold: Fold) -> u64 {
        cache::bytes::<C>(cache, &self.lines, fold)
    }

    /// Keeps more of its rays from now on; all must be transparent yet.
    pub(super) fn keep(&mut self, cache: Cache, fold: Fold) {
        self.cache = RowCache::new(cache, &self.lines, fold);
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

    /// Notes which samples of its rays some boxes can have changed; they stay noted until the ray is cast. Returns the pixels that are concerned, the first and
    /// the one behind the last.
    pub(super) fn mark(&mut self, j: u32, footprints: &[Footprint], camera: &Camera) -> [usize; 2] {
        let (mut first, mut end) = (self.lines.len(), 0);
        for Footprint { dirty, columns, rows } in footprints {
            if j < rows[0] || j > rows[1] {
                continue;
            }
            for i in columns[0]..=columns[1] {
                let at = i as usize;
                let line = &self.lines[at];
                let [from, to] = span(&camera.ray(i, j), dirty.low, dirty.high, [line.first, line.end]);
                if from < to {
                    let known = &mut self.dirty[at];
                    *known = [known[0].min(from), known[1].max(to)];
                    (first, end) = (first.min(at), end.max(at + 1));
                }
            }
        }
        [first, end]
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
