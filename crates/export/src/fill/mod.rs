//! Fills holes between slices for an exported file, from seen voxels near them, and marks them
//! as filled.
//!
//! The volume itself does not change: [`Filled`] is a view of it. A seen voxel keeps its value
//! and weight; a filled one has the weight [`FILLED`], which no seen voxel has. Queries for seen
//! voxels treat filled ones as unseen; only the file writers interpret that weight.
//!
//! - [`FillMethod::Nearest`]: the value of the nearest seen voxel's centre. At equal distances the
//!   lowest lattice index z wins, then y, then x.
//! - [`FillMethod::Gaussian`]: the mean of all seen voxels within the radius, weighted by
//!   exp(−2·(distance ÷ radius)²): a Gaussian of half the radius, cut at its 2 σ (normalised
//!   convolution: Knutsson & Westin 1993).
//!
//! Both fill the same voxels: unseen ones of the box with a seen voxel within the radius, inside
//! the box or not. Squared distances are whole multiples of 2⁻²⁸ of the squared radius, so ties
//! are the same on every machine.
//!
//! The work is divided into tiles of 32³ voxels, and these into bricks of 8³. A brick is skipped
//! if it has no hole, or no seen voxel within the radius along each axis.
//!
//! - `reach`: extent of the radius along each axis, in squared distances and weights.
//! - `settings`: method and radius, and counts of the work.
//! - `tile`: voxels of a tile and around it.
//! - `bricks`: the bricks of a tile that need work.
//! - `nearest`, `gaussian`: the filling methods, a brick at a time.

mod bricks;
mod gaussian;
mod nearest;
mod reach;
mod settings;
mod tile;

use std::collections::BTreeSet;

use glam::DVec3;
use rayon::prelude::*;
use rustc_hash::{FxHashMap, FxHashSet};

use volume::Voxels;
use volume::brick::{BrickIndex, EDGE, VOXELS};

use super::ExportError;
use super::volume::DenseBox;
pub use reach::FARTHEST;
use reach::Reach;
pub use settings::{FILLED, FillMethod, FillWork, Filling};
use tile::{TILE_EDGE, Tile};

/// Tiles between two checks of the memory of filled voxels.
const BATCH: usize = 256;

/// A volume with its holes filled, for file writers.
pub struct Filled<'a> {
    volume: &'a dyn Voxels,
    filling: Filling,
    /// x fastest; NaN where nothing is filled.
    bricks: FxHashMap<BrickIndex, Box<[f32; VOXELS]>>,
    work: FillWork,
}

impl Filling {
    /// Checks that holes of a lattice of this spacing, mm, can be filled.
    ///
    /// # Errors
    /// [`ExportError`] when the radius reaches no voxel, or too many.
    pub fn check(&self, spacing: DVec3) -> Result<(), ExportError> {
        Reach::new(self.radius_mm, spacing.to_array()).map(drop)
    }

    /// Fills the holes of a box of a volume. Any number of threads gives the same result;
    /// `limit_bytes` limits the memory of the filled voxels.
    ///
    /// # Errors
    /// [`ExportError`] when the radius reaches no voxel, or too many, or memory or threads do not
    /// suffice.
    pub fn fill<'a>(
        &self,
        volume: &'a dyn Voxels,
        space: &DenseBox,
        threads: usize,
        limit_bytes: u64,
    ) -> Result<Filled<'a>, ExportError> {
        let reach = Reach::new(self.radius_mm, space.grid.spacing.to_array())?;
        let tiles = tiles(volume, space, &reach);
        let pool = match threads {
            0 | 1 => None,
            n => Some(
                rayon::ThreadPoolBuilder::new()
                    .num_threads(n)
                    .thread_name(|i| format!("fill-{i}"))
                    .build()
                    .map_err(|e| ExportError::Threads { threads: n, reason: e.to_string() })?,
            ),
        };
        let mut filled = Filled { volume, filling: *self, bricks: FxHashMap::default(), work: FillWork::default() };
        let taps = reach.taps();
        let run = |memory: &mut Tile, place: &[i64; 3]| {
            bricks::fill(memory, volume, space, *place, &reach, self.method, &taps)
        };
        for batch in tiles.chunks(BATCH) {
            let done: Vec<_> = match &pool {
                None => {
                    let mut memory = Tile::default();
                    batch.iter().map(|place| run(&mut memory, place)).collect()
                }
                Some(pool) => pool.install(|| batch.par_iter().map_init(Tile::default, run).collect()),
            };
            for (bricks, work) in done {
                filled.work += work;
                filled.bricks.extend(bricks);
            }
            if filled.added_bytes() > limit_bytes {
                return Err(ExportError::Memory { limit_mib: limit_bytes >> 20 });
            }
        }
        Ok(filled)
    }
}

/// Returns the tiles that hold voxels of the box within reach of a seen voxel, by index divided
/// by the tile's edge; in order.
fn tiles(volume: &dyn Voxels, space: &DenseBox, reach: &Reach) -> Vec<[i64; 3]> {
    let edge = EDGE as i64;
    let last: [i64; 3] = std::array::from_fn(|a| space.first[a] + space.grid.size[a] as i64 - 1);
    let mut found = BTreeSet::new();
    let mut before = None;
    for brick in volume.blocks() {
        let ends: [[i64; 2]; 3] = std::array::from_fn(|a| {
            let (low, steps) = (i64::from(brick[a]) * edge, reach.steps[a] as i64);
            let [low, high] = [(low - steps).max(space.first[a]), (low + edge - 1 + steps).min(last[a])];
            [low.div_euclid(TILE_EDGE), if low > high { i64::MIN } else { high.div_euclid(TILE_EDGE) }]
        });
        // Adjacent bricks mostly reach the same tiles.
        if before == Some(ends) {
            continue;
        }
        before = Some(ends);
        let [[x0, x1], [y0, y1], [z0, z1]] = ends;
        for z in z0..=z1 {
            for y in y0..=y1 {
                found.extend((x0..=x1).map(|x| [z, y, x]));
            }
        }
    }
    found.into_iter().map(|[z, y, x]| [x, y, z]).collect()
}

impl Filled<'_> {
    /// Returns the settings.
    pub fn filling(&self) -> Filling {
        self.filling
    }

    /// Returns the statistics.
    pub fn work(&self) -> FillWork {
        self.work
    }

    fn added_bytes(&self) -> u64 {
        (self.bricks.len() * VOXELS * size_of::<f32>()) as u64
    }
}

/// Enters the values of filled voxels; NaN is none.
fn enter(r: &mut [f32], w: &mut [f32], values: &[f32]) {
    for ((r, w), value) in r.iter_mut().zip(w).zip(values) {
        if !value.is_nan() {
            // A numerator for this weight: the quotient is the value.
            (*r, *w) = (FILLED * value, FILLED);
        }
    }
}

impl Voxels for Filled<'_> {
    fn row(&self, start: [i64; 3], r: &mut [f32], w: &mut [f32]) {
        self.volume.row(start, r, w);
        let edge = EDGE as i64;
        let index = |at: i64| i32::try_from(at.div_euclid(edge)).ok();
        let (Some(by), Some(bz)) = (index(start[1]), index(start[2])) else { return };
        let line = ((start[2].rem_euclid(edge) * edge + start[1].rem_euclid(edge)) * edge) as usize;
        let mut done = 0;
        while done < r.len() {
            let x = start[0] + done as i64;
            let inside = x.rem_euclid(edge) as usize;
            let count = (EDGE - inside).min(r.len() - done);
            if let Some(brick) = index(x).and_then(|bx| self.bricks.get(&[bx, by, bz])) {
                let row = done..done + count;
                enter(&mut r[row.clone()], &mut w[row], &brick[line + inside..line + inside + count]);
            }
            done += count;
        }
    }

    fn block(&self, block: BrickIndex, r: &mut [f32; VOXELS], w: &mut [f32; VOXELS]) {
        self.volume.block(block, r, w);
        if let Some(brick) = self.bricks.get(&block) {
            enter(r, w, &brick[..]);
        }
    }

    /// Bounds of the seen voxels; filled ones do not count.
    fn seen_bounds(&self) -> Option<([i64; 3], [i64; 3])> {
        self.volume.seen_bounds()
    }

    fn blocks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        let held: FxHashSet<BrickIndex> = self.volume.blocks().collect();
        let mut added: Vec<BrickIndex> = self.bricks.keys().filter(|brick| !held.contains(*brick)).copied().collect();
        added.sort_unstable_by_key(|[x, y, z]| [*z, *y, *x]);
        Box::new(self.volume.blocks().chain(added))
    }

    fn bytes(&self) -> u64 {
        self.volume.bytes() + self.added_bytes()
    }
}

#[cfg(test)]
mod tests;
