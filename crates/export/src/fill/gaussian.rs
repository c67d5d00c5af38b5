//! Normalised convolution: the distance-weighted mean of the seen voxels within the radius.
//!
//! A ball is not a product of intervals, so the sum cannot be separated by axes. It is computed
//! only for rows that have holes, eight voxels at once, in the order of the taps: z, then y,
//! then x.

use volume::brick::{EDGE, VOXELS};

use super::reach::{Reach, Tap};
use super::tile::{Holes, Tile};

/// Fills the holes of the brick at a corner; returns their number.
pub(super) fn fill(
    tile: &Tile,
    corner: [usize; 3],
    holes: &Holes,
    reach: &Reach,
    taps: &[Tap],
    values: &mut [f32; VOXELS],
) -> u64 {
    let [nx, ny, _] = tile.size.map(|n| n as i32);
    let mut filled = 0;
    for (row, bits) in holes.iter().enumerate().filter(|(_, bits)| **bits != 0) {
        let at = tile.held([corner[0], corner[1] + row % EDGE, corner[2] + row / EDGE], reach);
        let (mut sum, mut weights) = ([0.0_f32; EDGE], [0.0_f32; EDGE]);
        for Tap { step: [x, y, z], weight } in taps {
            let from = (at as i32 + (z * ny + y) * nx + x) as usize;
            let (value, seen) = (&tile.value[from..from + EDGE], &tile.seen[from..from + EDGE]);
            for i in 0..EDGE {
                sum[i] += weight * value[i];
                weights[i] += weight * seen[i];
            }
        }
        for x in 0..EDGE {
            if bits >> x & 1 == 1 && weights[x] > 0.0 {
                values[row * EDGE + x] = sum[x] / weights[x];
                filled += 1;
            }
        }
    }
    filled
}
