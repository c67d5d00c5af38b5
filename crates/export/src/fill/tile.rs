//! A tile: 4×4×4 bricks of the box, and the seen voxels in and around them.

use volume::Voxels;
use volume::brick::EDGE;
use volume::brick_volume::SEEN;

use super::reach::{NEVER, Reach};
use crate::volume::DenseBox;

/// Voxels along a tile's edge; large enough that the surrounding voxels are not most of the
/// reading.
pub(super) const TILE_EDGE: i64 = 32;

/// Holes of a brick in the box: a bit a voxel along x, by row y + 8 z.
pub(super) type Holes = [u8; EDGE * EDGE];

/// Voxels of a tile and, around it, as many as the radius reaches. The memory is reused for many
/// tiles.
#[derive(Default)]
pub(super) struct Tile {
    /// Stored voxels along x, y, z: bricks and their surroundings.
    pub(super) size: [usize; 3],
    /// 0 where nothing was seen.
    pub(super) value: Vec<f32>,
    /// 1 where something was seen, else 0.
    pub(super) seen: Vec<f32>,
    /// Voxels along x of the bricks alone.
    pub(super) width: usize,
    /// Squared distance along x to the row's nearest seen voxel, and its x among all stored
    /// ones. Indexed by row of all stored voxels and x of the bricks alone.
    pub(super) along_x: Vec<[i32; 2]>,
    weight: Vec<f32>,
    /// Memory of [`nearest`](super::nearest).
    pub(super) along_y: Vec<[[i32; EDGE]; 2]>,
}

impl Tile {
    /// Reads `inner` voxels of bricks from `first` on, and the surroundings that the radius
    /// reaches. Returns whether any voxel was seen, and whether all were.
    pub(super) fn read(&mut self, volume: &dyn Voxels, first: [i64; 3], inner: [usize; 3], reach: &Reach) -> [bool; 2] {
        self.size = std::array::from_fn(|a| inner[a] + 2 * reach.steps[a]);
        self.width = inner[0];
        let [nx, ny, nz] = self.size;
        let voxels = nx * ny * nz;
        for memory in [&mut self.value, &mut self.seen, &mut self.weight] {
            memory.resize(voxels, 0.0);
        }
        let start: [i64; 3] = std::array::from_fn(|a| first[a] - reach.steps[a] as i64);
        let (mut any, mut all) = (false, true);
        let rows =
            self.value.chunks_exact_mut(nx).zip(self.weight.chunks_exact_mut(nx)).zip(self.seen.chunks_exact_mut(nx));
        for (row, ((value, weight), mask)) in rows.enumerate() {
            volume.row([start[0], start[1] + (row % ny) as i64, start[2] + (row / ny) as i64], value, weight);
            for ((value, weight), mask) in value.iter_mut().zip(weight).zip(mask) {
                let here = seen(*value, *weight);
                *value = here.unwrap_or(0.0);
                *mask = f32::from(u8::from(here.is_some()));
                any |= here.is_some();
                all &= here.is_some();
            }
        }
        [any, all]
    }

    /// Returns the holes of a brick that begins at `corner` of the tile and `at` of the lattice,
    /// and their number.
    pub(super) fn holes(&self, corner: [usize; 3], at: [i64; 3], space: &DenseBox, reach: &Reach) -> (Holes, u64) {
        let inside = |axis: usize, step: usize| {
            let index = at[axis] + step as i64 - space.first[axis];
            (0..space.grid.size[axis] as i64).contains(&index)
        };
        let columns = (0..EDGE).fold(0_u8, |bits, x| bits | u8::from(inside(0, x)) << x);
        let mut holes = [0; EDGE * EDGE];
        let mut count = 0;
        for (row, bits) in holes.iter_mut().enumerate() {
            let (y, z) = (row % EDGE, row / EDGE);
            if !(inside(1, y) && inside(2, z)) {
                continue;
            }
            let from = self.held([corner[0], corner[1] + y, corner[2] + z], reach);
            let unseen = self.seen[from..from + EDGE].iter().enumerate();
            *bits = columns & unseen.fold(0, |bits, (x, seen)| bits | u8::from(*seen == 0.0) << x);
            count += u64::from(bits.count_ones());
        }
        (holes, count)
    }

    /// Returns the index among all stored voxels of a voxel of the bricks.
    pub(super) fn held(&self, voxel: [usize; 3], reach: &Reach) -> usize {
        let [x, y, z]: [usize; 3] = std::array::from_fn(|a| voxel[a] + reach.steps[a]);
        (z * self.size[1] + y) * self.size[0] + x
    }

    /// Finds the nearest seen voxel along x for each voxel of the bricks and of the rows around
    /// them; of two equally near the one of lower x.
    pub(super) fn search_rows(&mut self, reach: &Reach) {
        let (nx, steps) = (self.size[0], reach.steps[0]);
        let squares = &reach.squares[0];
        self.along_x.resize(self.seen.len() / nx * self.width, [NEVER, 0]);
        for (found, seen) in self.along_x.chunks_exact_mut(self.width).zip(self.seen.chunks_exact(nx)) {
            // The voxel at x of the bricks is stored at x + steps.
            let mut left = None;
            for x in 0..nx {
                if seen[x] > 0.0 {
                    left = Some(x);
                }
                if let Some(found) = x.checked_sub(steps).and_then(|inner| found.get_mut(inner)) {
                    *found = match left {
                        Some(left) if x - left <= steps => [squares[x - left], left as i32],
                        _ => [NEVER, 0],
                    };
                }
            }
            let mut right = None;
            for x in (steps..nx).rev() {
                if seen[x] > 0.0 {
                    right = Some(x);
                }
                if let (Some(right), Some(found)) = (right, found.get_mut(x - steps))
                    && right - x <= steps
                    && squares[right - x] < found[0]
                {
                    *found = [squares[right - x], right as i32];
                }
            }
        }
    }

    /// Returns whether a voxel was seen within the radius along each axis of a brick's part in
    /// the box.
    pub(super) fn has_seen(&self, corner: [usize; 3], at: [i64; 3], space: &DenseBox, reach: &Reach) -> bool {
        let ends: [[usize; 2]; 3] = std::array::from_fn(|a| {
            let beyond = space.first[a] + space.grid.size[a] as i64;
            let [low, high] = [space.first[a], beyond].map(|end| (end - at[a]).clamp(0, EDGE as i64) as usize);
            [corner[a] + low, corner[a] + high]
        });
        let [[x0, x1], ..] = ends;
        let rows = |axis: usize| ends[axis][0]..ends[axis][1] + 2 * reach.steps[axis];
        rows(2).any(|z| {
            rows(1).any(|y| {
                let row = (z * self.size[1] + y) * self.width;
                self.along_x[row + x0..row + x1].iter().any(|[square, _]| *square < NEVER)
            })
        })
    }
}

/// Returns a voxel's value, if it was seen.
fn seen(r: f32, w: f32) -> Option<f32> {
    (w > SEEN).then(|| r / w)
}
