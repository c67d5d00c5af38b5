//! Detection of features so small that they can lie unnoticed between the corner rays of a
//! region.
//!
//! A cell of 2³ voxels (more if a pixel covers many) has the strength of its strongest voxel:
//! opacity of a step plus brightest colour. A cell is lone if it stands out by more than ε along
//! the picture's horizontal or vertical. It is compared with all cells at about its own depth
//! that lie half a region's edge plus one cell to either side.
//!
//! A dot stands out along both axes; a wire, or a sheet seen edge-on, along one, at any angle to
//! the lattice. A sheet facing the eye, the inside and face of a body, and even noise do not
//! stand out; the corner rays meet them anyway. Regions that show a lone cell are split
//! completely.
//!
//! Each region counts the lone cells it shows, so the result depends only on the volume and the
//! view, not on the order of changes. The test finds spots that are more opaque or brighter than
//! their surroundings. A small hole in opaque tissue is found only if a corner ray passes
//! through it. The test ignores occlusion: that costs rays, but no error.

use glam::DVec3;

use simd::sharing::Sharing;
use volume::brick::EDGE;

use crate::camera::Camera;
use crate::classify::shade::Lit;
use crate::rays::slab::{Footprint, ViewRays};
use crate::refine::adaptive::REGION;
use crate::region::RenderRegion;
use crate::shaded::{Dirty, SIDE, Shaded};

/// Bricks that one thread task tests.
const BRICKS_PER_TASK: usize = 16;
/// Quantization steps of a cell's strength, which is at most 2.
const STEPS: f32 = 65_535.0 / 2.0;

/// The lone cells of a render region, and the pixel regions that show them.
pub(crate) struct Features {
    /// Voxels along the edge of a cell, and cells along the edge of a brick.
    edge: usize,
    side: usize,
    bricks: [i64; 3],
    /// Strength of each cell, brick by brick.
    cells: Vec<u16>,
    /// A bit for each of a brick's cells, of which there are 64 at most.
    lone: Vec<u64>,
    /// Offsets of the compared cells: horizontally and vertically, to both sides.
    beside: [Vec<[i64; 3]>; 2],
    /// Largest of these offsets along each axis.
    reach: [i64; 3],
    threshold: u16,
    /// Lone cells of each pixel region.
    shown: Vec<u32>,
    regions: [usize; 2],
    queued: Vec<bool>,
    rays: ViewRays,
}

impl Features {
    /// Creates the features of an empty render region; `regions` to the right and down.
    pub(crate) fn new(camera: &Camera, region: &RenderRegion, epsilon: f32, regions: [usize; 2]) -> Self {
        let bricks = region.bricks().map(i64::from);
        let linear = region.region_from_world().matrix3;
        // A pixel is widest at the far end of a perspective view.
        let axes = camera.axes();
        let far = region.centre_mm() + axes.forward * region.radius_mm();
        let project = |at: DVec3| camera.project(region.region_from_world().transform_point3(at)).unwrap_or([0.0; 2]);
        let pixels_per_mm = (project(far + axes.right)[0] - project(far)[0]).abs().max(1e-9);
        let half_mm = 0.5 * REGION as f64 / pixels_per_mm;
        let voxels = half_mm / region.spacing_mm().min_element();
        let edge = if voxels <= 6.0 {
            2
        } else if voxels <= 12.0 {
            4
        } else {
            EDGE
        };
        // One cell farther than half a region, because a cell's strongest voxel can lie anywhere
        // in it.
        let distance_mm = half_mm + edge as f64 * region.spacing_mm().max_element();
        // Nothing lies beyond the render region.
        let distance_mm = distance_mm.min(3.0 * region.radius_mm());
        let cells = |mm: DVec3| linear * mm / edge as f64;
        let depth = cells(axes.forward);
        let deeper = depth / depth.abs().max_element();
        let steps = (distance_mm * depth.abs().max_element()).ceil() as i32;
        let beside = [axes.right, axes.up].map(|across| {
            let mut places: Vec<[i64; 3]> = Vec::new();
            // Nearest depth first: most neighbours are found there.
            for step in (0..=steps).flat_map(|step| [step, -step]) {
                for side in [1.0, -1.0] {
                    let at = cells(across * (side * distance_mm)) + deeper * f64::from(step);
                    let place = at.round().to_array().map(|x| x as i64);
                    if !places.contains(&place) && place != [0; 3] {
                        places.push(place);
                    }
                }
            }
            places
        });
        let reach = std::array::from_fn(|a| beside.iter().flatten().map(|place| place[a].abs()).max().unwrap_or(0));
        let side = EDGE / edge;
        let count = bricks.iter().map(|b| *b as usize).product::<usize>();
        Self {
            edge,
            side,
            bricks,
            cells: vec![0; count * side * side * side],
            lone: vec![0; count],
            beside,
            reach,
            threshold: (epsilon * STEPS) as u16,
            shown: vec![0; regions[0] * regions[1]],
            regions,
            queued: vec![false; count],
            rays: ViewRays::new(camera),
        }
    }

    /// Returns whether a region shows a lone cell.
    pub(crate) fn has(&self, region: usize) -> bool {
        self.shown.get(region).is_some_and(|shown| *shown > 0)
    }

    /// Updates the features from boxes of changed voxels, each within a brick. Sets `reached`
    /// for regions that now show their first lone cell, or no longer show any.
    pub(crate) fn update<const C: usize>(
        &mut self,
        shaded: &Shaded<C>,
        dirty: &[Dirty],
        sharing: Sharing,
        reached: &mut [bool],
    ) {
        let mut bricks: Vec<(usize, u64)> = Vec::new();
        for dirty in dirty {
            self.update_cells(shaded, dirty, &mut bricks);
        }
        let features = &*self;
        sharing.chunks(&mut bricks, BRICKS_PER_TASK, |_, bricks| {
            for (brick, lone) in bricks {
                *lone = features.lone_cells(*brick);
            }
        });
        for (brick, lone) in bricks {
            self.queued[brick] = false;
            let mut differ = std::mem::replace(&mut self.lone[brick], lone) ^ lone;
            while differ != 0 {
                let cell = differ.trailing_zeros() as usize;
                differ &= differ - 1;
                self.count(brick, cell, lone >> cell & 1 != 0, reached);
            }
        }
    }

    fn brick_place(&self, brick: usize) -> [i64; 3] {
        let [nx, ny, _] = self.bricks;
        let brick = brick as i64;
        [brick % nx, brick / nx % ny, brick / (nx * ny)]
    }

    fn brick_index(&self, at: [i64; 3]) -> Option<usize> {
        let inside = (0..3).all(|a| (0..self.bricks[a]).contains(&at[a]));
        inside.then(|| ((at[2] * self.bricks[1] + at[1]) * self.bricks[0] + at[0]) as usize)
    }

    /// Returns the strength of a cell of the render region.
    fn strength(&self, at: [i64; 3]) -> u16 {
        // A power of two.
        let shift = self.side.trailing_zeros();
        let Some(brick) = self.brick_index(at.map(|x| x >> shift)) else { return 0 };
        let [x, y, z] = at.map(|x| x as usize & (self.side - 1));
        self.cells[(((brick << shift | z) << shift | y) << shift) | x]
    }

    /// Recomputes the cells of a box of voxels, and adds the bricks whose lone cells may depend
    /// on them.
    fn update_cells<const C: usize>(&mut self, shaded: &Shaded<C>, dirty: &Dirty, bricks: &mut Vec<(usize, u64)>) {
        let at = dirty.low.map(|x| x.div_euclid(EDGE as i64));
        let Some(brick) = self.brick_index(at) else { return };
        let filled = shaded.filled(at);
        let of = |x: i64| x.rem_euclid(EDGE as i64) as usize / self.edge;
        let (low, high) = (dirty.low.map(of), dirty.high.map(of));
        let mut changed: Option<[[usize; 3]; 2]> = None;
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    let strength = filled.map_or(0.0, |brick| strongest(brick, self.edge, [x, y, z]));
                    let strength = (strength * STEPS).ceil() as u16;
                    let cell = ((brick * self.side + z) * self.side + y) * self.side + x;
                    if std::mem::replace(&mut self.cells[cell], strength) != strength {
                        let [low, high] = changed.get_or_insert([[x, y, z]; 2]);
                        for (a, x) in [x, y, z].into_iter().enumerate() {
                            (low[a], high[a]) = (low[a].min(x), high[a].max(x));
                        }
                    }
                }
            }
        }
        let Some([low, high]) = changed else { return };
        let side = self.side as i64;
        let from: [i64; 3] =
            std::array::from_fn(|a| (at[a] * side + low[a] as i64 - self.reach[a]).div_euclid(side).max(0));
        let to: [i64; 3] = std::array::from_fn(|a| {
            (at[a] * side + high[a] as i64 + self.reach[a]).div_euclid(side).min(self.bricks[a] - 1)
        });
        for z in from[2]..=to[2] {
            for y in from[1]..=to[1] {
                for x in from[0]..=to[0] {
                    if let Some(brick) = self.brick_index([x, y, z])
                        && !std::mem::replace(&mut self.queued[brick], true)
                    {
                        bricks.push((brick, 0));
                    }
                }
            }
        }
    }

    /// Returns the lone cells of a brick.
    fn lone_cells(&self, brick: usize) -> u64 {
        let count = self.side * self.side * self.side;
        let cells = &self.cells[brick * count..][..count];
        if cells.iter().all(|strength| *strength <= self.threshold) {
            return 0;
        }
        let first = self.brick_place(brick).map(|x| x * self.side as i64);
        let mut lone = 0;
        for (cell, strength) in cells.iter().enumerate().filter(|(_, strength)| **strength > self.threshold) {
            let inside = [cell % self.side, cell / self.side % self.side, cell / (self.side * self.side)];
            let at: [i64; 3] = std::array::from_fn(|a| first[a] + inside[a] as i64);
            let enough = strength - self.threshold;
            let stands_out = self.beside.iter().any(|places| {
                !places.iter().any(|place| self.strength(std::array::from_fn(|a| at[a] + place[a])) >= enough)
            });
            lone |= u64::from(stands_out) << cell;
        }
        lone
    }

    /// Adds or removes one lone cell in all regions that show it.
    fn count(&mut self, brick: usize, cell: usize, more: bool, reached: &mut [bool]) {
        let place = self.brick_place(brick);
        let inside = [cell % self.side, cell / self.side % self.side, cell / (self.side * self.side)];
        let low: [i64; 3] = std::array::from_fn(|a| place[a] * EDGE as i64 + (inside[a] * self.edge) as i64);
        let high = low.map(|x| x + self.edge as i64 - 1);
        let Some(footprint) = Footprint::new(&Dirty { low, high }, &self.rays) else { return };
        let [columns, rows] = [footprint.columns, footprint.rows].map(|pixels| pixels.map(|x| x as usize / REGION));
        for y in rows[0]..=rows[1].min(self.regions[1] - 1) {
            for x in columns[0]..=columns[1].min(self.regions[0] - 1) {
                let at = y * self.regions[0] + x;
                let before = self.shown[at];
                self.shown[at] = if more { before + 1 } else { before - 1 };
                reached[at] |= (before == 0) != (self.shown[at] == 0);
            }
        }
    }

    pub(crate) fn bytes(&self) -> u64 {
        (size_of_val(&*self.cells) + size_of_val(&*self.lone) + size_of_val(&*self.shown) + self.queued.len()) as u64
    }
}

/// Returns the largest sum of opacity and brightest colour in a cell of a brick.
fn strongest<const C: usize>(brick: &crate::shaded::ShadedBrick<C>, edge: usize, cell: [usize; 3]) -> f32 {
    let [x, y, z] = cell.map(|x| x * edge);
    let mut most = 0.0_f32;
    for z in z..z + edge {
        for y in y..y + edge {
            let row = (z * SIDE + y) * SIDE + x;
            for at in row..row + edge {
                let Lit { colour, alpha } = &brick.cells[at];
                most = most.max(alpha + colour.iter().fold(0.0_f32, |most, channel| most.max(*channel)));
            }
        }
    }
    most
}
