//! Refinement of a new view from its first coarse picture to the exact one, in steps short
//! enough to be interrupted.
//!
//! A new view invalidates all data kept of rays, and the light on every voxel changes. A few
//! rays first light the voxels they meet themselves ([`Preview`]). Then, step by step, the
//! visible bricks are lit and the rows' rays set up. The picture is refined from rays of every
//! eighth pixel, interpolated in between, to every fourth, every second, and each ray that the
//! picture needs.
//!
//! A picture of one depth depends only on the volume, the view and the depth. The last one is
//! bit for bit the picture of a renderer made for that view. A slice in between takes effect at
//! once: the regions it reaches start again from the coarsest rays.

pub(crate) mod adaptive;
pub(crate) mod features;
pub(crate) mod preview;
pub(crate) mod sparse;

use simd::Simd;
use simd::sharing::Sharing;
use volume::brick::EDGE;

use super::camera::Camera;
use super::classify::shade::Shader;
use super::layers::Layers;
use super::rays::composite::Fold;
use super::rays::marks::Marks;
use super::rays::rows::Row;
use super::refine::adaptive::{Casting, DEPTHS, REGION, Regions};
use super::refine::features::Features;
use super::refine::preview::{Preview, PreviewInputs, Unlit};
use super::refine::sparse::Refinement;
pub(super) use super::refine::sparse::Sparse;
use super::region::RenderRegion;
use super::settings::{Cache, RenderSettings};
use super::shaded::Dirty;
use super::snapshot::{Changed, VoxelSnapshot};
use super::voxels::{Sampler, Voxels};
use super::work::RenderWork;

/// Bricks that are lit, or searched for small features, in one step.
const BRICKS: usize = 64;
/// Rows whose rays are set up in one step.
const ROWS: usize = 32;
/// Regions that are refined in one step, by depth: about as many rays each.
const REGIONS: [usize; DEPTHS] = [1024, 512, 128, 64];

/// Inputs and parameters of a picture.
#[derive(Clone, Copy)]
pub(super) struct Context<'a> {
    pub(super) camera: &'a Camera,
    /// Rays that the last change may have reached.
    pub(super) marks: &'a Marks,
    pub(super) region: &'a RenderRegion,
    pub(super) snapshot: &'a VoxelSnapshot,
    pub(super) shader: &'a Shader<f32>,
    pub(super) fold: Fold,
    pub(super) simd: Simd,
    pub(super) sharing: Sharing,
}

/// Cache policy of the rays: the requested cache, or a smaller one if that would take too much
/// memory.
#[derive(Debug, Clone)]
pub(super) struct CacheChoice {
    requested: Cache,
    most: u64,
    pub(super) cache: Cache,
    /// Notes for the user: sentences.
    pub(super) notes: Vec<String>,
}

impl CacheChoice {
    /// Chooses by the bytes that caches of some rows would take.
    pub(super) fn choose<const C: usize>(settings: &RenderSettings, rows: &[Row<C>], fold: Fold) -> Self {
        let mut cache_choice =
            Self { requested: settings.cache, most: settings.cache_bytes, cache: Cache::None, notes: Vec::new() };
        cache_choice.choose_again(rows, fold);
        cache_choice
    }

    fn choose_again<const C: usize>(&mut self, rows: &[Row<C>], fold: Fold) {
        let bytes = |cache: Cache| rows.iter().map(|row| row.cache_bytes(cache, fold)).sum::<u64>();
        let smaller = [self.requested, Cache::OneLevel, Cache::None];
        self.cache = smaller.into_iter().find(|cache| bytes(*cache) <= self.most).unwrap_or(Cache::None);
        self.notes.clear();
        if self.cache != self.requested {
            self.notes.push(format!(
                "the {} ray cache would take {:.0} MB, more than the {:.0} MB that it may: the cache is {} instead; raise --cache-bytes, or ask for a \
                 smaller picture or a longer step",
                self.requested.name(),
                bytes(self.requested) as f64 / 1e6,
                self.most as f64 / 1e6,
                self.cache.name()
            ));
        }
    }
}

impl<const C: usize> Sparse<C> {
    /// Returns some of the least refined regions and their depth; `None` if all are refined.
    fn coarsest(&self) -> Option<(usize, Vec<usize>)> {
        let all = 0..self.regions.len();
        let depths = all.clone().map(|at| self.regions.depths(at)).min().filter(|depths| *depths < DEPTHS)?;
        Some((depths, all.filter(|at| self.regions.depths(*at) == depths).take(REGIONS[depths]).collect()))
    }
}

impl<const C: usize> Refinement<C> {
    /// Prepares the rows in `range` whose number is a multiple of `edge`, and the picture's last
    /// row.
    fn prepare(
        &mut self,
        rows: &mut [Row<C>],
        range: std::ops::Range<usize>,
        edge: usize,
        cache: Cache,
        context: Context<'_>,
    ) {
        let Context { fold, sharing, .. } = context;
        let (first, height) = (range.start, rows.len());
        sharing.chunks_beside(&mut rows[range.clone()], 1, &mut self.ready[range], |ready, at, rows| {
            let j = first + at;
            if !*ready && (j.is_multiple_of(edge) || j + 1 == height) {
                rows[0].reset_cache(cache, fold);
                *ready = true;
            }
        });
    }
}

impl<const C: usize> Layers<C> {
    /// Returns the inputs of coarse rays: voxels that have to be lit first, or lit voxels.
    fn preview_inputs<'a>(voxels: &'a Voxels<C>, relight: bool, context: Context<'a>) -> PreviewInputs<'a, C> {
        let Context { camera, region, snapshot, shader, fold, .. } = context;
        let unlit = match voxels {
            Voxels::Lit(shaded) if relight => Some(Unlit { snapshot, shaded, shader }),
            _ => None,
        };
        PreviewInputs { camera, region, unlit, sampler: Sampler::new(voxels, shader), fold }
    }

    /// Updates the picture for boxes of changed voxels, from which the context's marks are made.
    pub(super) fn follow(&mut self, dirty: &[Dirty], context: Context<'_>, cache: Cache) -> RenderWork {
        let Context { marks, shader, fold, simd, sharing, .. } = context;
        let Some(Sparse { regions, features, refinement }) = &mut self.sparse else {
            return self.cast(marks, shader, fold, simd, sharing);
        };
        let mut reached = vec![false; regions.len()];
        if let (Some(features), Voxels::Lit(shaded)) = (features, &self.voxels) {
            features.update(shaded, dirty, sharing, &mut reached);
        }
        if let Some(refinement) = refinement
            && !refinement.chosen
        {
            let inputs = Self::preview_inputs(&self.voxels, refinement.relight, context);
            let only = refinement.begun.then_some(marks.footprints());
            let coarse_rays = refinement.preview.cast(inputs, only, simd, sharing);
            refinement.preview.draw(&mut regions.seen, sharing);
            refinement.begun = true;
            return RenderWork { coarse_rays, ..RenderWork::default() };
        }
        let mut marked = vec![[0; 2]; self.rows.len()];
        let ready = refinement.as_ref().map(|refinement| refinement.ready.as_slice());
        sharing.chunks_beside(&mut self.rows, 1, &mut marked, |marked, j, rows| {
            if ready.is_none_or(|ready| ready[j]) {
                *marked = rows[0].mark(j as u32, marks, simd);
            }
        });
        marked.iter().enumerate().for_each(|(j, marked)| regions.reach(j, *marked, &mut reached));
        if refinement.is_some() {
            // Pixels that still show only the first coarse picture are out of date now.
            for footprint in marks.footprints() {
                let [columns, rows] = [footprint.columns, footprint.rows].map(|pixels| pixels.map(|x| x as usize));
                (rows[0]..=rows[1]).for_each(|j| regions.reach(j, [columns[0], columns[1] + 1], &mut reached));
            }
        }
        let depths = if refinement.is_some() { 1 } else { DEPTHS };
        let which: Vec<(usize, usize)> =
            reached.iter().enumerate().filter(|(_, reached)| **reached).map(|(at, _)| (at, depths)).collect();
        self.evaluate(&which, context, cache)
    }

    /// Evaluates some regions, each to a depth.
    fn evaluate(&mut self, which: &[(usize, usize)], context: Context<'_>, cache: Cache) -> RenderWork {
        let Context { shader, fold, simd, sharing, .. } = context;
        let Some(Sparse { regions, features, refinement }) = &mut self.sparse else { return RenderWork::default() };
        let (Some((first, depths)), Some((last, _))) = (which.first(), which.last()) else {
            return RenderWork::default();
        };
        if let Some(refinement) = refinement {
            let row = |region: usize| regions.rows_of(region / regions.count()[0]);
            let range = row(*first)[0]..row(*last)[1] + 1;
            refinement.prepare(&mut self.rows, range, REGION >> (depths - 1), cache, context);
        }
        let small = |region: usize| features.as_ref().is_some_and(|features| features.has(region));
        let casting = Casting { sampler: Sampler::new(&self.voxels, shader), fold, simd, sharing };
        regions.evaluate(which, small, &mut self.rows, casting)
    }

    /// Begins a new view; `relight` if the light on voxels has changed.
    pub(super) fn turn(&mut self, context: Context<'_>, epsilon: f32, relight: bool) {
        let Context { camera, region, .. } = context;
        let bricks: Vec<[i64; 3]> = match &self.voxels {
            Voxels::Lit(shaded) => shaded.places().collect(),
            Voxels::SampleClassifier(_) => Vec::new(),
        };
        let regions = Regions::new(camera.size(), epsilon, false);
        let features = (epsilon > 0.0).then(|| Features::new(camera, region, epsilon, regions.count()));
        let refinement = Refinement {
            preview: Preview::new(camera.size()),
            begun: false,
            relight,
            unsearched: if features.is_some() { bricks.clone() } else { Vec::new() },
            unlit: if relight { bricks } else { Vec::new() },
            lined: 0,
            chosen: false,
            ready: vec![false; self.rows.len()],
        };
        self.sparse = Some(Sparse { regions, features, refinement: Some(refinement) });
    }

    /// Casts the first coarse rays, unless that is done.
    pub(super) fn begin(&mut self, context: Context<'_>) -> RenderWork {
        match &self.sparse {
            Some(Sparse { refinement: Some(refinement), .. }) if !refinement.begun => {
                self.follow(&[], context, Cache::None)
            }
            _ => RenderWork::default(),
        }
    }

    /// Returns the current ray distance of the whole picture, pixels; `None` when it is
    /// finished.
    pub(super) fn spacing(&self) -> Option<usize> {
        let Sparse { regions, refinement, .. } = self.sparse.as_ref()?;
        let preview = refinement.as_ref()?.preview.spacing();
        let depths = (0..regions.len()).map(|at| regions.depths(at)).min().unwrap_or(0);
        Some(if depths == 0 { preview } else { REGION >> (depths - 1) })
    }

    /// Does the next piece of work for a new view.
    pub(super) fn step(&mut self, context: Context<'_>, cache_choice: &mut CacheChoice) -> RenderWork {
        let Context { camera, region, snapshot, shader, fold, simd, sharing, .. } = context;
        let Some(sparse) = &mut self.sparse else { return RenderWork::default() };
        let Some(refinement) = &mut sparse.refinement else { return RenderWork::default() };
        if !refinement.begun {
            return self.begin(context);
        }
        if !refinement.unlit.is_empty() {
            let rest = refinement.unlit.len().saturating_sub(BRICKS);
            let voxels: Vec<Changed> =
                refinement.unlit.drain(rest..).map(|at| Changed { at, voxels: [u64::MAX; EDGE] }).collect();
            // No cast ray depends on this light yet.
            let mut dirty = Vec::new();
            let voxels_shaded = self.voxels.update(snapshot, &voxels, shader, simd, sharing, &mut dirty);
            return RenderWork { voxels_shaded, ..RenderWork::default() };
        }
        if refinement.lined < self.rows.len() {
            let end = (refinement.lined + ROWS).min(self.rows.len());
            sharing.chunks(&mut self.rows[refinement.lined..end], 1, |at, rows| {
                rows[0].turn(camera, region, (refinement.lined + at) as u32);
            });
            refinement.lined = end;
            return RenderWork::default();
        }
        if !refinement.chosen {
            cache_choice.choose_again(&self.rows, fold);
            refinement.chosen = true;
        }
        if let (Some(features), Voxels::Lit(shaded)) = (&mut sparse.features, &self.voxels)
            && !refinement.unsearched.is_empty()
        {
            let rest = refinement.unsearched.len().saturating_sub(BRICKS);
            let edge = EDGE as i64;
            let whole = |at: [i64; 3]| Dirty { low: at.map(|x| x * edge), high: at.map(|x| x * edge + edge - 1) };
            let bricks: Vec<Dirty> = refinement.unsearched.drain(rest..).map(whole).collect();
            let mut reached = vec![false; sparse.regions.len()];
            // No region has reached a depth yet at which small features matter.
            features.update(shaded, &bricks, sharing, &mut reached);
            return RenderWork::default();
        }
        match sparse.coarsest() {
            Some((depths, regions)) => {
                let which: Vec<(usize, usize)> = regions.into_iter().map(|at| (at, depths + 1)).collect();
                self.evaluate(&which, context, cache_choice.cache)
            }
            None => {
                sparse.refinement = None;
                if sparse.features.is_none() {
                    self.sparse = None;
                }
                RenderWork::default()
            }
        }
    }
}
