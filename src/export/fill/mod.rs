//! Holes between slices, filled for a file that leaves: with what was seen near them, and marked as filled for ever.
//!
//! Nothing here changes the volume: it is looked at through [`Filled`], in which a voxel that was seen is what it was, and a filled one has the weight [`FILLED`],
//! which no seen voxel has. Whoever asks whether a voxel was seen is told that it was not; only the writers of files know what the weight means.
//!
//! - [`Law::Nearest`]: the value of the nearest seen voxel's centre. Of several at the same distance it is that of the lowest z, of these that of the lowest y, of
//!   these that of the lowest x index of the lattice.
//! - [`Law::Gaussian`]: the mean of all seen voxels within the radius, weighted by exp(−2·(distance ÷ radius)²): a Gaussian of half the radius, cut at its 2 σ
//!   (normalised convolution: Knutsson & Westin 1993).
//!
//! Both fill the same voxels: those of the box that were not seen and have a seen voxel within the radius, inside the box or not. Squared distances are whole numbers
//! of 2⁻²⁸ of the squared radius, so that what is equally far is equally far on every machine.
//!
//! The work goes by tiles of 32³ voxels, and within them by bricks of 8³: one that has no hole, or no seen voxel within the radius along each axis, is passed over.
//!
//! - `reach`: how far the radius goes along each axis, in squared distances and weights.
//! - `tile`: voxels of a tile and around it, and the bricks in it that are worth the work.
//! - `nearest`, `gaussian`: the laws, a brick at a time.

mod gaussian;
mod nearest;
mod reach;
mod tile;

use std::collections::BTreeSet;

use glam::DVec3;
use rayon::prelude::*;
use rustc_hash::{FxHashMap, FxHashSet};

use super::volume::DenseBox;
use crate::volume::Voxels;
use crate::volume::brick::{BrickIndex, EDGE, VOXELS};
use crate::volume::sparse::SEEN;
use reach::Reach;
use tile::{TILE_EDGE, Tile};

/// Weight of a voxel that was filled, and of no other.
pub const FILLED: f32 = -1.0;
/// No farther than so many voxels along any axis: wider holes are not between slices, and their edges say nothing of their middle.
pub const FARTHEST: usize = 32;
/// Tiles between two looks at the memory that the filled voxels take.
const BATCH: usize = 256;

/// Where a filled voxel's value is from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Law {
    /// The nearest seen voxel.
    Nearest,
    /// The seen voxels around, nearer ones more.
    Gaussian,
}

impl Law {
    /// The name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nearest => "nearest",
            Self::Gaussian => "gaussian",
        }
    }
}

/// How holes are filled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filling {
    /// What with.
    pub law: Law,
    /// From how far away, mm.
    pub radius_mm: f64,
}

impl std::fmt::Display for Filling {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} within {} mm", self.law.name(), self.radius_mm)
    }
}

/// What filling did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FillWork {
    /// Bricks of 8³ voxels that the box and the tiles in reach have in common.
    pub bricks_considered: u64,
    /// Those of them with a hole in the box, and a seen voxel within the radius along each axis of what of them lies in the box: no others are worked on.
    pub bricks_touched: u64,
    /// Voxels of touched bricks that were not seen, in the box.
    pub holes: u64,
    /// Those that were filled.
    pub filled: u64,
}

impl std::ops::AddAssign for FillWork {
    fn add_assign(&mut self, other: Self) {
        self.bricks_considered += other.bricks_considered;
        self.bricks_touched += other.bricks_touched;
        self.holes += other.holes;
        self.filled += other.filled;
    }
}

/// Why nothing is filled.
#[derive(Debug, thiserror::Error)]
pub enum FillError {
    /// No radius that fills anything.
    #[error(
        "holes cannot be filled from within {radius_mm} mm: the nearest voxels are {nearest_mm} mm apart; give a larger radius"
    )]
    Radius {
        /// As given.
        radius_mm: f64,
        /// The smallest spacing.
        nearest_mm: f64,
    },
    /// One that reaches too far.
    #[error(
        "holes cannot be filled from within {radius_mm} mm: that is more than {FARTHEST} voxels of {nearest_mm} mm; give a smaller radius, or a coarser spacing"
    )]
    Far {
        /// As given.
        radius_mm: f64,
        /// The smallest spacing.
        nearest_mm: f64,
    },
    /// More than may be taken.
    #[error(
        "the filled voxels take more than the {limit_mib} MiB that the volume may take: give a smaller radius, crop the volume, or raise --max-memory"
    )]
    Memory {
        /// MiB.
        limit_mib: u64,
    },
    /// The system gives no threads.
    #[error("{0} threads cannot be started to fill holes: {1}")]
    Threads(usize, String),
}

/// A volume with its holes filled, as files have it.
pub struct Filled<'a> {
    volume: &'a dyn Voxels,
    filling: Filling,
    /// x fastest; NaN where nothing is filled.
    bricks: FxHashMap<BrickIndex, Box<[f32; VOXELS]>>,
    work: FillWork,
}

impl Filling {
    /// Whether holes of a lattice of such a spacing, mm, can be filled so.
    ///
    /// # Errors
    /// [`FillError`] when the radius reaches no voxel, or too many.
    pub fn check(&self, spacing: DVec3) -> Result<(), FillError> {
        Reach::new(self.radius_mm, spacing.to_array()).map(drop)
    }

    /// Fills the holes of a box of a volume, on so many threads, of which any number fills the same; `limit_bytes` is what the filled voxels may take.
    ///
    /// # Errors
    /// [`FillError`] when the radius reaches no voxel, or too many, or memory or threads do not suffice.
    pub fn fill<'a>(
        &self,
        volume: &'a dyn Voxels,
        space: &DenseBox,
        threads: usize,
        limit_bytes: u64,
    ) -> Result<Filled<'a>, FillError> {
        let reach = Reach::new(self.radius_mm, space.grid.spacing.to_array())?;
        let tiles = tiles(volume, space, &reach);
        let pool = match threads {
            0 | 1 => None,
            n => Some(
                rayon::ThreadPoolBuilder::new()
                    .num_threads(n)
                    .thread_name(|i| format!("fill-{i}"))
                    .build()
                    .map_err(|e| FillError::Threads(n, e.to_string()))?,
            ),
        };
        let mut filled = Filled { volume, filling: *self, bricks: FxHashMap::default(), work: FillWork::default() };
        let taps = reach.taps();
        let run = |memory: &mut Tile, place: &[i64; 3]| memory.fill(volume, space, *place, &reach, self.law, &taps);
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
                return Err(FillError::Memory { limit_mib: limit_bytes >> 20 });
            }
        }
        Ok(filled)
    }
}

/// The tiles that hold voxels of the box which a seen voxel may reach, by index divided by the tile's edge; in order.
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
        // Bricks beside each other mostly reach the same tiles.
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
    /// How holes are filled.
    pub fn filling(&self) -> Filling {
        self.filling
    }

    /// What filling did.
    pub fn work(&self) -> FillWork {
        self.work
    }

    fn added_bytes(&self) -> u64 {
        (self.bricks.len() * VOXELS * size_of::<f32>()) as u64
    }
}

impl Voxels for Filled<'_> {
    fn voxel(&self, voxel: [i64; 3]) -> (f32, f32) {
        let (mut r, mut w) = ([0.0], [0.0]);
        self.row(voxel, &mut r, &mut w);
        (r[0], w[0])
    }

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
                let values = &brick[line + inside..line + inside + count];
                for ((r, w), value) in r[done..done + count].iter_mut().zip(&mut w[done..done + count]).zip(values) {
                    if !value.is_nan() {
                        // A sum of this weight: divided by it, it is the value.
                        (*r, *w) = (FILLED * value, FILLED);
                    }
                }
            }
            done += count;
        }
    }

    /// Of what was seen: what was filled was not.
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

/// The smallest of three lengths.
fn finest(spacing: [f64; 3]) -> f64 {
    DVec3::from_array(spacing).min_element()
}

/// A voxel's value, if it was seen.
fn seen(r: f32, w: f32) -> Option<f32> {
    (w > SEEN).then(|| r / w)
}

#[cfg(test)]
mod tests;
