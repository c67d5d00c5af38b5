//! Fills the holes of a tile, brick by brick.

use volume::Voxels;
use volume::brick::{BrickIndex, EDGE, VOXELS};

use super::reach::{Reach, Tap};
use super::settings::{FillMethod, FillWork};
use super::tile::{TILE_EDGE, Tile};
use super::{gaussian, nearest};
use crate::volume::DenseBox;

/// Values of a brick, x fastest; NaN where nothing is filled.
pub(super) type BrickValues = Box<[f32; VOXELS]>;

/// Fills the holes of the tile at `place` times its edge.
pub(super) fn fill(
    tile: &mut Tile,
    volume: &dyn Voxels,
    space: &DenseBox,
    place: [i64; 3],
    reach: &Reach,
    method: FillMethod,
    taps: &[Tap],
) -> (Vec<(BrickIndex, BrickValues)>, FillWork) {
    let edge = EDGE as i64;
    // The bricks of the tile that hold voxels of the box.
    let ends: [[i64; 2]; 3] = std::array::from_fn(|a| {
        let low = (place[a] * TILE_EDGE).max(space.first[a]);
        let high = (place[a] * TILE_EDGE + TILE_EDGE).min(space.first[a] + space.grid.size[a] as i64) - 1;
        [low.div_euclid(edge), high.div_euclid(edge)]
    });
    let bricks = ends.map(|[low, high]| (high - low + 1).max(0) as usize);
    let mut work = FillWork { bricks_considered: bricks.iter().product::<usize>() as u64, ..FillWork::default() };
    let mut filled = Vec::new();
    let first = ends.map(|[low, _]| low * edge);
    let [any_seen, all_seen] = tile.read(volume, first, bricks.map(|n| n * EDGE), reach);
    if all_seen || !any_seen {
        return (filled, work);
    }
    tile.search_rows(reach);
    for z in 0..bricks[2] {
        for y in 0..bricks[1] {
            for x in 0..bricks[0] {
                let corner = [x, y, z].map(|b| b * EDGE);
                let at: [i64; 3] = std::array::from_fn(|a| first[a] + corner[a] as i64);
                let (holes, count) = tile.holes(corner, at, space, reach);
                if count == 0 || !tile.has_seen(corner, at, space, reach) {
                    continue;
                }
                work.bricks_touched += 1;
                work.holes += count;
                let mut values = Box::new([f32::NAN; VOXELS]);
                let done = match method {
                    FillMethod::Nearest => nearest::fill(tile, corner, &holes, reach, &mut values),
                    FillMethod::Gaussian => gaussian::fill(tile, corner, &holes, reach, taps, &mut values),
                };
                work.filled += done;
                if done > 0 {
                    // Brick indices of a volume fit in 32 bits.
                    let brick = at.map(|i| i32::try_from(i.div_euclid(edge)));
                    if let [Ok(x), Ok(y), Ok(z)] = brick {
                        filled.push(([x, y, z], values));
                    }
                }
            }
        }
    }
    (filled, work)
}
