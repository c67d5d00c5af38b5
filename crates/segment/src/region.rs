//! The region that grows from a seed: connected voxels within a range of values.
//!
//! 1. The range is given, or the mean and two standard deviations of the seen voxels in a ball.
//! 2. Voxels in the range by their smoothed values, connected with the seed by faces, are flooded.
//!    An unseen voxel is never among them.
//! 3. Pockets of seen voxels that they enclose are filled.
//! 4. The opening by a ball removes bridges that are thinner than it. The part with the seed stays.

use glam::DVec3;
use serde::Serialize;

use sonoweave_core::frames::{Transform, Volume, World};
use surface::block::Block;
use volume::Values;
use volume::brick::EDGE;

use crate::distance::Edges;
use crate::error::SegmentError;
use crate::field::{Field, VoxelBox};
use crate::flood::Flood;
pub use crate::flood::FloodWork;
use crate::smoothing::Smoothing;

/// Least seen voxels in the ball around the seed.
const LEAST_VOXELS: usize = 8;
/// Most voxels that the ball reaches along an axis.
const MOST_BALL: u64 = 32;
/// Largest cosine between two axes.
const SQUARE: f64 = 1e-4;
/// Voxels of the box around the region, so that its surface lies within.
const MARGIN: i64 = 5;
/// Distances of the surface's field, in voxels; farther ones are not needed.
const NEAR: f64 = 3.0;
/// Bytes a voxel of the box: the flags, and the distances while they are computed.
const VOXEL_BYTES: u64 = 4 + 3 * size_of::<f32>() as u64;

/// Settings by which a region grows.
#[derive(Debug, Clone, PartialEq)]
pub struct Growth {
    /// The seed, world mm.
    pub seed: DVec3,
    /// Lowest and highest smoothed value; `None` for mean ± 2 standard deviations of the ball.
    pub range: Option<[f32; 2]>,
    /// Radius of the ball around the seed, mm.
    pub radius_mm: f64,
    /// Standard deviation of the Gaussian, mm; `None` for one voxel.
    pub smoothing_mm: Option<f64>,
    /// Radius of the opening's ball, mm; 0 for none.
    pub opening_mm: f64,
    /// Largest volume, ml.
    pub limit_ml: f64,
    /// Least standard deviation of the default range: one grey level.
    pub grey_level: f32,
}

/// Numbers of a region.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Counts {
    /// Voxels of the region.
    pub voxels: u64,
    /// Those with a face to a voxel outside.
    pub border_voxels: u64,
    /// Faces to unseen voxels, beyond which the region may continue.
    pub unseen_faces: u64,
    /// Voxels of enclosed pockets, which were filled.
    pub filled: u64,
    /// Voxels that the opening removed.
    pub removed: u64,
}

/// A region of a volume.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    space: VoxelBox,
    edges: DVec3,
    inside: Vec<bool>,
    /// Lowest and highest smoothed value.
    pub range: [f32; 2],
    /// Standard deviation of the Gaussian, mm.
    pub smoothing_mm: f64,
    /// Numbers of voxels.
    pub counts: Counts,
    /// Volume, mm³: that of the voxels.
    pub volume_mm3: f64,
    /// Error of the volume, mm³: half of the border's voxels. It covers a border that lies up to
    /// half a voxel farther in or out everywhere, and nothing else.
    pub error_mm3: f64,
    /// Work done.
    pub work: FloodWork,
}

impl Growth {
    /// Grows the region. All memory for it may take `limit_bytes`.
    ///
    /// # Errors
    /// [`SegmentError`].
    pub fn grow<V: Values + ?Sized>(
        &self,
        volume: &V,
        world_from_lattice: Transform<World, Volume>,
        limit_bytes: u64,
    ) -> Result<Region, SegmentError> {
        self.check()?;
        let edges = right_angled(world_from_lattice)?;
        let voxel_mm3 = edges.element_product();
        let smoothing_mm = self.smoothing_mm.unwrap_or_else(|| voxel_mm3.cbrt());
        let smoothing = Smoothing::new(smoothing_mm, edges)?;
        let seed = world_from_lattice.inverse().point(self.seed).round();
        let seed = seed.to_array().map(|at| at as i64);
        let brick = seed.map(|at| at.div_euclid(EDGE as i64)).map(|at| i32::try_from(at).unwrap_or(i32::MAX));
        let [x, y, z] = seed.map(|at| at.rem_euclid(EDGE as i64) as usize);
        let value = smoothing.brick(volume, brick, &mut Block::default())[(z * EDGE + y) * EDGE + x];
        if value.is_nan() {
            return Err(SegmentError::SeedUnseen { at: self.seed.to_array() });
        }
        let range = self.range.map_or_else(|| self.ball_range(volume, seed, edges), Ok)?;
        if !(range[0]..=range[1]).contains(&value) {
            return Err(SegmentError::SeedRange { value, low: range[0], high: range[1] });
        }
        let limit = || SegmentError::Limit { limit_ml: self.limit_ml };
        let most = (1000.0 * self.limit_ml / voxel_mm3) as u64;
        let flood = Flood::new(volume, &smoothing, range, seed, most).ok_or_else(limit)?;
        let space = around(&flood);
        let needed_bytes = (space.voxels() as u64).saturating_mul(VOXEL_BYTES);
        if needed_bytes > limit_bytes {
            return Err(SegmentError::Memory { needed_bytes, limit_bytes });
        }
        let mut inside = vec![false; space.voxels()];
        flood.iter().filter_map(|voxel| space.place(voxel)).for_each(|place| inside[place] = true);
        let seen = seen(volume, &space);
        let filled = fill(&space, &mut inside, &seen);
        if flood.voxels + filled > most {
            return Err(limit());
        }
        let mut removed = 0;
        if self.opening_mm > 0.0 {
            let opened = Edges { size: space.size, spacing: edges }.open(&inside, self.opening_mm)?;
            let from = space.place(seed).into_iter().collect();
            inside = space.connected(from, |place| opened[place]);
            removed = flood.voxels + filled - count(&inside);
            if count(&inside) == 0 {
                return Err(SegmentError::Opened { radius_mm: self.opening_mm });
            }
        }
        let counts = Counts { filled, removed, ..Counts::of(&space, &inside, &seen) };
        Ok(Region {
            space,
            edges,
            inside,
            range,
            smoothing_mm,
            counts,
            volume_mm3: counts.voxels as f64 * voxel_mm3,
            error_mm3: 0.5 * counts.border_voxels as f64 * voxel_mm3,
            work: flood.work,
        })
    }

    fn check(&self) -> Result<(), SegmentError> {
        let positive = [("the radius of the ball", self.radius_mm), ("the limit", self.limit_ml)];
        for (setting, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return Err(SegmentError::Setting { setting, value, needs: "a finite number above 0" });
            }
        }
        match self.range {
            Some([low, high]) if !(low.is_finite() && high.is_finite() && low <= high) => {
                let value = f64::from(if low.is_finite() { high } else { low });
                Err(SegmentError::Setting {
                    setting: "the end of the range",
                    value,
                    needs: "finite, and not below its begin",
                })
            }
            _ => Ok(()),
        }
    }

    /// Returns mean ± 2 standard deviations of the seen voxels in the ball around the seed.
    fn ball_range<V: Values + ?Sized>(
        &self,
        volume: &V,
        seed: [i64; 3],
        edges: DVec3,
    ) -> Result<[f32; 2], SegmentError> {
        let voxels = (self.radius_mm / edges.min_element()).floor() as u64;
        if voxels > MOST_BALL {
            let setting = "a ball";
            return Err(SegmentError::Wide { setting, mm: self.radius_mm, voxels, most: MOST_BALL });
        }
        let (reach, edge) = (voxels as i64, 2 * voxels as usize + 1);
        let mut block = Block::default();
        block.read(volume, seed.map(|at| at - reach), edge);
        let ball = VoxelBox { low: [-reach; 3], size: [edge; 3] };
        let is_within = |place: &usize| {
            let offset = DVec3::from_array(ball.voxel(*place).map(|at| at as f64)) * edges;
            offset.length_squared() <= self.radius_mm * self.radius_mm
        };
        let values: Vec<f64> = (0..ball.voxels())
            .filter(is_within)
            .map(|place| f64::from(block.values[place]))
            .filter(|value| !value.is_nan())
            .collect();
        if values.len() < LEAST_VOXELS {
            let (voxels, least) = (values.len(), LEAST_VOXELS);
            return Err(SegmentError::FewVoxels { radius_mm: self.radius_mm, voxels, least });
        }
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
        let deviation = (squares / (values.len() - 1) as f64).sqrt().max(f64::from(self.grey_level));
        Ok([mean - 2.0 * deviation, mean + 2.0 * deviation].map(|value| value as f32))
    }
}

impl Region {
    /// Whether a voxel belongs to the region, by its lattice index.
    pub fn contains(&self, voxel: [i64; 3]) -> bool {
        self.space.place(voxel).is_some_and(|place| self.inside[place])
    }

    /// Returns the signed distance to the region's border near it, mm, positive inside, smoothed by
    /// one voxel. Its surface at 0 is that of the region.
    ///
    /// # Errors
    /// [`SegmentError::Wide`] for voxels of very unequal edges.
    pub fn field(&self) -> Result<Field, SegmentError> {
        let edges = Edges { size: self.space.size, spacing: self.edges };
        let near = NEAR * self.edges.max_element();
        let voxel = self.edges.element_product().cbrt();
        let to_inside = edges.squared(|place| self.inside[place], near);
        let to_outside = edges.squared(|place| !self.inside[place], near);
        let signed = |(inside, outside): (&f32, &f32)| {
            let distance = |squared: f32| f64::from(squared).sqrt().min(near) - 0.5 * voxel;
            (if *inside > 0.0 { -distance(*inside) } else { distance(*outside) }) as f32
        };
        let values = to_inside.iter().zip(&to_outside).map(signed).collect();
        Ok(Smoothing::new(voxel, self.edges)?.field(&Field::new(self.space, values)))
    }
}

impl Counts {
    fn of(space: &VoxelBox, inside: &[bool], seen: &[bool]) -> Self {
        let mut counts = Self { voxels: 0, border_voxels: 0, unseen_faces: 0, filled: 0, removed: 0 };
        for place in (0..inside.len()).filter(|place| inside[*place]) {
            counts.voxels += 1;
            counts.border_voxels += u64::from(space.beside(place).any(|beside| !inside[beside]));
            counts.unseen_faces += space.beside(place).filter(|beside| !seen[*beside]).count() as u64;
        }
        counts
    }
}

/// Returns the edges of voxels whose axes are at right angles, mm.
fn right_angled(world_from_lattice: Transform<World, Volume>) -> Result<DVec3, SegmentError> {
    let axes = world_from_lattice.affine().matrix3;
    let [x, y, z] = [axes.x_axis, axes.y_axis, axes.z_axis].map(DVec3::normalize_or_zero);
    match [x.dot(y), y.dot(z), z.dot(x)].into_iter().find(|cosine| cosine.abs() > SQUARE) {
        Some(cosine) => Err(SegmentError::Sheared { cosine }),
        None => Ok(DVec3::new(axes.x_axis.length(), axes.y_axis.length(), axes.z_axis.length())),
    }
}

/// Returns the box around the flooded voxels, with its margin.
fn around(flood: &Flood) -> VoxelBox {
    let ends = flood.iter().fold(None, |ends: Option<[[i64; 3]; 2]>, voxel| {
        let [low, high] = ends.unwrap_or([voxel; 2]);
        Some([[0, 1, 2].map(|a| low[a].min(voxel[a])), [0, 1, 2].map(|a| high[a].max(voxel[a]))])
    });
    let [low, high] = ends.unwrap_or_default();
    let size = [0, 1, 2].map(|a| (high[a] - low[a] + 1 + 2 * MARGIN) as usize);
    VoxelBox { low: low.map(|at| at - MARGIN), size }
}

/// Returns which voxels of a box are seen.
fn seen<V: Values + ?Sized>(volume: &V, space: &VoxelBox) -> Vec<bool> {
    let width = space.size[0];
    let (mut value, mut weight) = (vec![0.0; width], vec![0.0; width]);
    let mut seen = Vec::with_capacity(space.voxels());
    for row in 0..space.size[1] * space.size[2] {
        volume.values(space.voxel(row * width), &mut value, &mut weight);
        seen.extend(value.iter().zip(&weight).map(|(value, weight)| *weight > 0.0 && value.is_finite()));
    }
    seen
}

/// Adds the seen voxels that a set encloses; returns their number. Voxels from which others lead to
/// the border of the box, unseen ones among them, are not enclosed.
fn fill(space: &VoxelBox, inside: &mut [bool], seen: &[bool]) -> u64 {
    // The box has a margin, so that its first voxel is outside.
    let outside = space.connected(vec![0], |place| !inside[place]);
    let mut filled = 0;
    for place in (0..inside.len()).filter(|place| !outside[*place] && seen[*place]) {
        filled += u64::from(!inside[place]);
        inside[place] = true;
    }
    filled
}

fn count(inside: &[bool]) -> u64 {
    inside.iter().filter(|inside| **inside).count() as u64
}
