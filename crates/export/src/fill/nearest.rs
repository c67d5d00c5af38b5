//! The nearest seen voxel: exact, one axis at a time.
//!
//! A squared distance is a sum of squares of whole numbers, one an axis. The overall minimum is
//! therefore the minimum over z of the minimum over y of the minimum over x. This is a distance
//! transform that also keeps the position of the feature (Felzenszwalb & Huttenlocher 2012).
//! Within a radius of a few voxels an exhaustive test is faster than the lower envelope of
//! parabolas; it tests eight voxels at once. Each search goes up its axis and keeps the first of
//! equals: the lowest z, then y, then x.

use volume::brick::{EDGE, VOXELS};

use super::reach::{NEVER, ONE, Reach};
use super::tile::{Holes, Tile};

/// Replaces the stored distance and place by each of eight candidates that is nearer.
#[inline(always)]
fn keep_nearer(best: &mut [[i32; EDGE]; 2], square: [i32; EDGE], place: [i32; EDGE]) {
    for i in 0..EDGE {
        let nearer = square[i] < best[0][i];
        best[0][i] = if nearer { square[i] } else { best[0][i] };
        best[1][i] = if nearer { place[i] } else { best[1][i] };
    }
}

/// Fills the holes of the brick at a corner; returns their number.
pub(super) fn fill(
    tile: &mut Tile,
    corner: [usize; 3],
    holes: &Holes,
    reach: &Reach,
    values: &mut [f32; VOXELS],
) -> u64 {
    let [nx, ny, _] = tile.size;
    let layers = EDGE + 2 * reach.steps[2];
    // Search over y, for each row of the brick and of the layers before and behind it.
    let mut along_y = std::mem::take(&mut tile.along_y);
    along_y.clear();
    for z in 0..layers {
        for y in 0..EDGE {
            let mut best = [[NEVER; EDGE], [0; EDGE]];
            for (step, row) in (corner[1] + y..=corner[1] + y + 2 * reach.steps[1]).enumerate() {
                let square = reach.squares[1][step.abs_diff(reach.steps[1])];
                let from = ((corner[2] + z) * ny + row) * tile.width + corner[0];
                let (mut squares, mut places) = ([0; EDGE], [0; EDGE]);
                for (i, [along, x]) in tile.along_x[from..from + EDGE].iter().enumerate() {
                    (squares[i], places[i]) = (along + square, x + (row * nx) as i32);
                }
                keep_nearer(&mut best, squares, places);
            }
            along_y.push(best);
        }
    }
    let mut filled = 0;
    for (row, bits) in holes.iter().enumerate().filter(|(_, bits)| **bits != 0) {
        let (y, z) = (row % EDGE, row / EDGE);
        let mut best = [[NEVER; EDGE], [0; EDGE]];
        for step in 0..=2 * reach.steps[2] {
            let square = reach.squares[2][step.abs_diff(reach.steps[2])];
            let [squares, places] = along_y[(z + step) * EDGE + y];
            let layer = ((corner[2] + z + step) * ny * nx) as i32;
            keep_nearer(&mut best, squares.map(|s| s + square), places.map(|p| p + layer));
        }
        for x in 0..EDGE {
            if bits >> x & 1 == 1 && best[0][x] <= ONE {
                values[row * EDGE + x] = tile.value[best[1][x] as usize];
                filled += 1;
            }
        }
    }
    tile.along_y = along_y;
    filled
}
