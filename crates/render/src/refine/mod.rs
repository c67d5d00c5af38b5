//! Refinement of a new view from its first coarse picture to the exact one, in steps short
//! enough to be interrupted.
//!
//! A new view invalidates all data kept of rays, and the light on every voxel changes. A few
//! rays first light the voxels they meet themselves ([`preview`]). Then, step by step, the
//! visible bricks are lit and the rows' rays set up. Rows of tiles are cast from the middle
//! outwards, several in a step; the others show the coarse picture until then.
//!
//! Adaptive rays refine the picture from rays of every eighth pixel, interpolated in between, to
//! every fourth, every second, and each ray that the picture needs. A picture of one depth depends
//! only on the volume, the view and the depth. A slice in between takes effect at once: the
//! regions it reaches start again from the coarsest rays.
//!
//! The last picture is bit for bit that of a renderer made for the view.

pub(crate) mod adaptive;
pub(crate) mod features;
pub(crate) mod preview;
pub(crate) mod refinement;
pub(crate) mod sparse;

use simd::Simd;
use simd::sharing::Sharing;
use volume::brick::EDGE;

use super::camera::Camera;
use super::classify::shade::Shader;
use super::layers::Layers;
use super::rays::cast::Casting;
use super::rays::composite::Fold;
use super::rays::marks::Marks;
use super::rays::rows::Row;
use super::rays::tile::CastTile;
use super::rays::visible_blocks::{TILE, TileRow};
use super::refine::adaptive::{DEPTHS, REGION};
use super::refine::preview::{PreviewInputs, Unlit};
use super::refine::refinement::Refinement;
pub(super) use super::refine::sparse::Sparse;
use super::region::RenderRegion;
use super::settings::{Cache, RenderSettings};
use super::shaded::{Dirty, Shaded};
use super::snapshot::VoxelSnapshot;
use super::voxels::{Sampler, Voxels};
use super::work::RenderWork;

/// Bricks that are lit, or searched for small features, in one step.
const BRICKS: usize = 64;
/// Rows whose rays are set up in one step.
const ROWS: usize = 32;
/// Rays that are cast in one step, about.
const RAYS: usize = 32_768;
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
    pub(super) sharing: Sharing<'a>,
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
    pub(super) fn choose<const C: usize>(settings: &RenderSettings, rows: &[Row<C>]) -> Self {
        let mut cache_choice =
            Self { requested: settings.cache, most: settings.cache_bytes, cache: Cache::None, notes: Vec::new() };
        cache_choice.choose_again(rows);
        cache_choice
    }

    fn choose_again<const C: usize>(&mut self, rows: &[Row<C>]) {
        let bytes = |cache: Cache| rows.iter().map(|row| row.cache_bytes(cache)).sum::<u64>();
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

impl<const C: usize> Layers<C> {
    /// Returns the inputs of coarse rays: voxels that have to be lit first, or lit voxels.
    fn preview_inputs<'a>(voxels: &'a Voxels<C>, relight: bool, context: Context<'a>) -> PreviewInputs<'a, C> {
        let Context { camera, region, snapshot, shader, fold, .. } = context;
        let unlit = voxels.lit().filter(|_| relight).map(|shaded| Unlit { snapshot, shaded, shader });
        PreviewInputs { camera, region, unlit, sampler: Sampler::new(voxels, shader), fold }
    }

    /// Updates the picture for boxes of changed voxels, from which the context's marks are made.
    pub(super) fn follow(&mut self, dirty: &[Dirty], context: Context<'_>, cache: Cache) -> RenderWork {
        let Context { marks, shader, fold, simd, sharing, .. } = context;
        let mut reached = Vec::new();
        if let (Some(sparse), Some(shaded)) = (&mut self.sparse, self.voxels.lit()) {
            reached.resize(sparse.regions.len(), false);
            sparse.features.update(shaded, dirty, sharing, &mut reached);
        }
        let mut work = RenderWork::default();
        if self.refinement.as_ref().is_some_and(|refinement| !refinement.chosen || self.sparse.is_none()) {
            // Pixels that still show the coarse picture are out of date.
            work.coarse_rays = self.preview(context);
        }
        if self.refinement.as_ref().is_some_and(|refinement| !refinement.chosen) {
            return work;
        }
        let Some(Sparse { regions, .. }) = &self.sparse else {
            work += self.cast(marks, shader, (fold, simd, sharing));
            return work;
        };
        reached.resize(regions.len(), false);
        let mut marked = vec![[0; 2]; self.rows.len()];
        let ready = self.refinement.as_ref().map(|refinement| refinement.ready.as_slice());
        sharing.chunks_beside(&mut self.rows, 1, &mut marked, |marked, j, rows| {
            if ready.is_none_or(|ready| ready[j]) {
                *marked = rows[0].mark(j as u32, marks, simd);
            }
        });
        marked.iter().enumerate().for_each(|(j, marked)| regions.reach(j, *marked, &mut reached));
        if ready.is_some() {
            // Pixels that still show only the first coarse picture are out of date now.
            for footprint in marks.footprints() {
                let [columns, rows] = [footprint.columns, footprint.rows].map(|pixels| pixels.map(|x| x as usize));
                (rows[0]..=rows[1]).for_each(|j| regions.reach(j, [columns[0], columns[1] + 1], &mut reached));
            }
        }
        let depths = if ready.is_some() { 1 } else { DEPTHS };
        let which: Vec<(usize, usize)> =
            reached.iter().enumerate().filter(|(_, reached)| **reached).map(|(at, _)| (at, depths)).collect();
        self.evaluate(&which, context, cache)
    }

    /// Casts the coarse rays that the context's marks reach, all of them at first, and draws their
    /// picture; returns their number.
    fn preview(&mut self, context: Context<'_>) -> u64 {
        let Context { marks, simd, sharing, .. } = context;
        let Self { voxels, rows, refinement: Some(refinement), sparse, .. } = self else { return 0 };
        let inputs = Self::preview_inputs(voxels, refinement.relight, context);
        let only = refinement.begun.then_some(marks.footprints());
        refinement.begun = true;
        let coarse_rays = refinement.preview.cast(inputs, only, simd, sharing);
        let (preview, ready) = (&refinement.preview, &refinement.ready);
        match sparse {
            Some(sparse) => {
                let width = context.camera.size()[0] as usize;
                sharing.chunks(&mut sparse.regions.seen, width, |j, pixels| preview.draw(j, pixels));
            }
            None => sharing.chunks(rows, 1, |j, rows| {
                if !ready[j] {
                    preview.draw(j, &mut rows[0].pixels);
                }
            }),
        }
        coarse_rays
    }

    /// Evaluates some regions, each to a depth.
    fn evaluate(&mut self, which: &[(usize, usize)], context: Context<'_>, cache: Cache) -> RenderWork {
        let Context { shader, fold, simd, sharing, .. } = context;
        let Self { voxels, rows, sparse: Some(Sparse { regions, features }), refinement, .. } = self else {
            return RenderWork::default();
        };
        let (Some((first, depths)), Some((last, _))) = (which.first(), which.last()) else {
            return RenderWork::default();
        };
        if let Some(refinement) = refinement {
            let row = |region: usize| regions.rows_of(region / regions.count()[0]);
            let range = row(*first)[0]..row(*last)[1] + 1;
            refinement.prepare(rows, range, REGION >> (depths - 1), (cache, fold), sharing);
        }
        let casting = Casting::new(voxels, shader, (fold, simd, sharing));
        regions.evaluate(which, |region| features.has(region), rows, casting)
    }

    /// Casts the next rows from the middle outwards.
    fn cast_next(&mut self, context: Context<'_>, cache: Cache) -> RenderWork {
        let Context { shader, fold, simd, sharing, .. } = context;
        let Self { voxels, rows, refinement: Some(refinement), .. } = self else {
            return RenderWork::default();
        };
        let casting = Casting::new(voxels, shader, (fold, simd, sharing));
        let count = (RAYS / (TILE * context.camera.size()[0] as usize)).max(1);
        let rest = refinement.waiting.len().saturating_sub(count);
        let due = refinement.waiting.split_off(rest);
        let mut works = vec![RenderWork::default(); rows.len().div_ceil(TILE)];
        let mut tiles: Vec<(usize, &mut [Row<C>])> = rows.chunks_mut(TILE).enumerate().collect();
        tiles.retain(|(row, _)| due.contains(row));
        sharing.chunks_beside(&mut tiles, 1, &mut works[..due.len()], |work, _, tiles| {
            let (number, rows) = &mut tiles[0];
            for row in &mut **rows {
                row.reset_cache(cache, fold);
                row.work = RenderWork::default();
            }
            cast_tiles(rows, casting.visible.of_row(*number * TILE), casting);
            rows.iter().for_each(|row| *work += row.work);
        });
        let mut sum = RenderWork::default();
        works.into_iter().for_each(|work| sum += work);
        let height = refinement.ready.len();
        due.iter().for_each(|row| refinement.ready[row * TILE..height.min((row + 1) * TILE)].fill(true));
        sum
    }

    /// Begins a new view; `relight` if the light on voxels has changed.
    pub(super) fn turn(&mut self, context: Context<'_>, epsilon: f32, relight: bool) {
        let Context { camera, region, fold, .. } = context;
        let bricks: Vec<[i64; 3]> = self.voxels.lit().into_iter().flat_map(Shaded::places).collect();
        self.voxels.turn(camera, fold);
        self.sparse = (epsilon > 0.0).then(|| Sparse::new(camera, region, epsilon, false));
        let mut refinement = Refinement::new(camera, relight.then(|| bricks.clone()), self.sparse.is_some());
        if self.sparse.is_some() {
            refinement.unsearched = bricks;
        }
        self.refinement = Some(refinement);
    }

    /// Casts the first coarse rays, unless that is done.
    pub(super) fn begin(&mut self, context: Context<'_>) -> RenderWork {
        match &self.refinement {
            Some(refinement) if !refinement.begun => self.follow(&[], context, Cache::None),
            _ => RenderWork::default(),
        }
    }

    /// Returns the current ray distance of the whole picture, pixels; `None` when it is
    /// finished.
    pub(super) fn spacing(&self) -> Option<usize> {
        let preview = self.refinement.as_ref()?.preview.spacing();
        let Some(Sparse { regions, .. }) = &self.sparse else { return Some(preview) };
        let depths = (0..regions.len()).map(|at| regions.depths(at)).min().unwrap_or(0);
        Some(if depths == 0 { preview } else { REGION >> (depths - 1) })
    }

    /// Does the next piece of work for a new view.
    pub(super) fn step(&mut self, context: Context<'_>, cache_choice: &mut CacheChoice) -> RenderWork {
        let Context { camera, region, snapshot, shader, fold, simd, sharing, .. } = context;
        let Some(refinement) = &mut self.refinement else { return RenderWork::default() };
        if !refinement.begun {
            return self.begin(context);
        }
        if !refinement.unlit.is_empty() {
            let rest = refinement.unlit.len().saturating_sub(BRICKS);
            let bricks = refinement.unlit.split_off(rest);
            // No cast ray depends on this light yet.
            let voxels_shaded = self.voxels.relight(snapshot, &bricks, shader, (simd, sharing));
            return RenderWork { voxels_shaded, ..RenderWork::default() };
        }
        if refinement.lined < self.rows.len() {
            let end = (refinement.lined + ROWS).min(self.rows.len());
            sharing.chunks(&mut self.rows[refinement.lined..end], 1, |at, rows| {
                rows[0].turn(camera, region, (fold, simd), (refinement.lined + at) as u32);
            });
            refinement.lined = end;
            return RenderWork::default();
        }
        if !refinement.chosen {
            cache_choice.choose_again(&self.rows);
            self.voxels.project();
            refinement.chosen = true;
        }
        if let (Some(sparse), Some(shaded)) = (&mut self.sparse, self.voxels.lit())
            && !refinement.unsearched.is_empty()
        {
            let rest = refinement.unsearched.len().saturating_sub(BRICKS);
            let edge = EDGE as i64;
            let whole = |at: [i64; 3]| Dirty { low: at.map(|x| x * edge), high: at.map(|x| x * edge + edge - 1) };
            let bricks: Vec<Dirty> = refinement.unsearched.drain(rest..).map(whole).collect();
            let mut reached = vec![false; sparse.regions.len()];
            // No region has reached a depth yet at which small features matter.
            sparse.features.update(shaded, &bricks, sharing, &mut reached);
            return RenderWork::default();
        }
        let work = match self.sparse.as_ref().map(Sparse::coarsest) {
            None => self.cast_next(context, cache_choice.cache),
            Some(Some((depths, regions))) => {
                let which: Vec<(usize, usize)> = regions.into_iter().map(|at| (at, depths + 1)).collect();
                return self.evaluate(&which, context, cache_choice.cache);
            }
            Some(None) => RenderWork::default(),
        };
        if self.refinement.as_ref().is_some_and(|refinement| refinement.waiting.is_empty()) {
            self.refinement = None;
        }
        work
    }
}

/// Casts the rays of a row of tiles, which are new.
fn cast_tiles<const C: usize>(rows: &mut [Row<C>], tiles: TileRow<'_>, casting: Casting<'_, C>) {
    let width = rows.first().map_or(0, |row| row.pixels.len());
    for first in (0..width).step_by(TILE) {
        let columns = first..(first + TILE).min(width);
        casting.simd.fused(CastTile { rows: &mut *rows, columns, visible: tiles.at(first), casting });
    }
}
