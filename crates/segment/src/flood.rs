//! Voxels within a range that are connected with a seed by faces, brick by brick.
//!
//! A brick's voxels are bits, so that one step of all its voxels is a few shifts. Bricks are
//! smoothed when the flood first reaches them. Those reached at once are done in parallel, and the
//! set is the same in any order.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::Serialize;

use surface::block::Block;
use volume::Values;
use volume::brick::{BrickIndex, EDGE, VOXELS};

use crate::smoothing::Smoothing;

/// A bit for each voxel of a brick: bit 8·y + x of the layer z.
pub(crate) type Layers = [u64; EDGE];

/// Voxels of a layer with the lowest x, and those with the highest.
const LOWEST_X: u64 = u64::MAX / 255;
const HIGHEST_X: u64 = LOWEST_X << (EDGE - 1);

/// Counters of the work done, which show that only the region's bricks were smoothed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct FloodWork {
    /// Bricks whose values were smoothed: those of the region, and those beside it.
    pub bricks_smoothed: u64,
    /// Steps from bricks to those beside them.
    pub steps: u64,
}

/// A brick that the flood has reached.
struct Reached {
    /// Voxels that are seen and in the range.
    open: Layers,
    /// Those that are connected with the seed.
    reached: Layers,
}

/// Connected voxels.
pub(crate) struct Flood {
    bricks: BTreeMap<BrickIndex, Reached>,
    /// Number of the voxels.
    pub(crate) voxels: u64,
    pub(crate) work: FloodWork,
}

impl Flood {
    /// Finds the voxels that are connected with the seed, and whose smoothed values are in the
    /// range; `None` if they are more than `most`. Unseen voxels are never among them.
    pub(crate) fn new<V: Values + ?Sized>(
        volume: &V,
        smoothing: &Smoothing,
        [low, high]: [f32; 2],
        seed: [i64; 3],
        most: u64,
    ) -> Option<Self> {
        let mut flood = Self { bricks: BTreeMap::new(), voxels: 0, work: FloodWork::default() };
        let mut entering = BTreeMap::new();
        let brick = seed.map(|at| i32::try_from(at.div_euclid(EDGE as i64)).ok());
        if let [Some(x), Some(y), Some(z)] = brick {
            let [bx, by, bz] = seed.map(|at| at.rem_euclid(EDGE as i64) as usize);
            let mut layers = [0; EDGE];
            layers[bz] = 1 << (EDGE * by + bx);
            entering.insert([x, y, z], layers);
        }
        while !entering.is_empty() {
            let missing: Vec<BrickIndex> =
                entering.keys().filter(|brick| !flood.bricks.contains_key(*brick)).copied().collect();
            let open = |block: &mut Block, brick: &BrickIndex| {
                bits(
                    |voxel, values: &[f32]| (low..=high).contains(&values[voxel]),
                    &smoothing.brick(volume, *brick, block),
                )
            };
            let opened: Vec<Layers> = missing.par_iter().map_init(Block::default, open).collect();
            flood.work.bricks_smoothed += missing.len() as u64;
            flood.work.steps += 1;
            let new = opened.into_iter().map(|open| Reached { open, reached: [0; EDGE] });
            flood.bricks.extend(missing.into_iter().zip(new));
            let all: Vec<(BrickIndex, Layers)> = entering.into_iter().collect();
            let spread: Vec<Layers> = all.par_iter().map(|(brick, from)| flood.bricks[brick].spread(from)).collect();
            entering = BTreeMap::new();
            for ((brick, _), reached) in all.into_iter().zip(spread) {
                let Some(at) = flood.bricks.get_mut(&brick) else { continue };
                let new: Layers = std::array::from_fn(|z| reached[z] & !at.reached[z]);
                at.reached = reached;
                flood.voxels += new.iter().map(|layer| u64::from(layer.count_ones())).sum::<u64>();
                leave(brick, &new, &mut entering);
            }
            if flood.voxels > most {
                return None;
            }
        }
        Some(flood)
    }

    /// Returns the voxels.
    pub(crate) fn iter(&self) -> impl Iterator<Item = [i64; 3]> {
        self.bricks.iter().flat_map(|(brick, at)| {
            (0..VOXELS).filter(|voxel| (at.reached[voxel / (EDGE * EDGE)] >> (voxel % (EDGE * EDGE))) & 1 == 1).map(
                |voxel| {
                    let within = [voxel % EDGE, voxel / EDGE % EDGE, voxel / (EDGE * EDGE)];
                    [0, 1, 2].map(|a| i64::from(brick[a]) * EDGE as i64 + within[a] as i64)
                },
            )
        })
    }
}

impl Reached {
    /// Returns the open voxels that are connected within the brick with those reached, or `from`.
    fn spread(&self, from: &Layers) -> Layers {
        let mut reached: Layers = std::array::from_fn(|z| (from[z] & self.open[z]) | self.reached[z]);
        loop {
            let next: Layers = std::array::from_fn(|z| {
                let layer = reached[z];
                let along_x = ((layer & !HIGHEST_X) << 1) | ((layer & !LOWEST_X) >> 1);
                let along_y = (layer << EDGE) | (layer >> EDGE);
                let below = z.checked_sub(1).map_or(0, |z| reached[z]);
                let above = reached.get(z + 1).copied().unwrap_or(0);
                (layer | along_x | along_y | below | above) & self.open[z]
            });
            if next == reached {
                return reached;
            }
            reached = next;
        }
    }
}

/// Returns a bit for each voxel of a brick.
fn bits(is: impl Fn(usize, &[f32]) -> bool, values: &[f32]) -> Layers {
    const LAYER: usize = EDGE * EDGE;
    std::array::from_fn(|z| (0..LAYER).fold(0, |layer, at| layer | (u64::from(is(z * LAYER + at, values)) << at)))
}

/// Adds the voxels beside new ones in the six bricks around, which the flood enters next.
fn leave(brick: BrickIndex, new: &Layers, entering: &mut BTreeMap<BrickIndex, Layers>) {
    const LAST: usize = EDGE - 1;
    let faces: [Layers; 6] = [
        new.map(|layer| (layer & LOWEST_X) << LAST),
        new.map(|layer| (layer & HIGHEST_X) >> LAST),
        new.map(|layer| layer << (EDGE * LAST)),
        new.map(|layer| layer >> (EDGE * LAST)),
        std::array::from_fn(|z| if z == LAST { new[0] } else { 0 }),
        std::array::from_fn(|z| if z == 0 { new[LAST] } else { 0 }),
    ];
    for (number, face) in faces.iter().enumerate().filter(|(_, face)| face.iter().any(|layer| *layer != 0)) {
        let mut beside = brick;
        let Some(at) = beside[number / 2].checked_add(if number.is_multiple_of(2) { -1 } else { 1 }) else { continue };
        beside[number / 2] = at;
        let layers = entering.entry(beside).or_insert([0; EDGE]);
        layers.iter_mut().zip(face).for_each(|(layer, face)| *layer |= face);
    }
}
