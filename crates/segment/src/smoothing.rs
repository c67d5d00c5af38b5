//! Smoothed values of bricks: a Gaussian over the seen voxels alone.
//!
//! Sums of seen voxels are divided by the sum of their weights in the Gaussian (normalised
//! convolution, Knutsson & Westin 1993). An unseen voxel has no value, and gives none to others.

use glam::DVec3;
use rayon::prelude::*;

use surface::block::Block;
use volume::Values;
use volume::brick::{BrickIndex, EDGE, VOXELS};

use crate::error::SegmentError;
use crate::field::{Field, VoxelBox};

/// Reach of the Gaussian, in its standard deviations.
const REACH: f64 = 3.0;
/// Most voxels within the reach.
const MOST_VOXELS: u64 = 24;

/// A Gaussian on the lattice.
#[derive(Debug)]
pub(crate) struct Smoothing {
    /// Weights of the voxels along each axis.
    taps: [Vec<f32>; 3],
    reach: usize,
}

impl Smoothing {
    /// Returns a Gaussian of standard deviation `sigma_mm` on voxels of these edges, mm. With 0,
    /// values stay as they are.
    ///
    /// # Errors
    /// [`SegmentError::Setting`], [`SegmentError::Wide`].
    pub(crate) fn new(sigma_mm: f64, spacing: DVec3) -> Result<Self, SegmentError> {
        if !(sigma_mm >= 0.0 && sigma_mm.is_finite()) {
            return Err(SegmentError::Setting { setting: "the smoothing", value: sigma_mm, needs: "0 mm or more" });
        }
        let voxels = (REACH * sigma_mm / spacing.min_element()).ceil() as u64;
        if voxels > MOST_VOXELS {
            return Err(SegmentError::Wide { setting: "a smoothing", mm: sigma_mm, voxels, most: MOST_VOXELS });
        }
        let reach = voxels as usize;
        let taps = spacing.to_array().map(|edge| {
            let distance = |tap: usize| (tap as f64 - reach as f64) * edge / sigma_mm;
            let weight = |tap| if reach == 0 { 1.0 } else { libm::exp(-0.5 * distance(tap) * distance(tap)) };
            (0..=2 * reach).map(|tap| weight(tap) as f32).collect()
        });
        Ok(Self { taps, reach })
    }

    /// Returns the smoothed values of a brick's voxels, x fastest; NaN where they are unseen.
    pub(crate) fn brick<V: Values + ?Sized>(&self, volume: &V, brick: BrickIndex, block: &mut Block) -> Vec<f32> {
        let edge = EDGE + 2 * self.reach;
        block.read(volume, brick.map(|at| i64::from(at) * EDGE as i64 - self.reach as i64), edge);
        let seen = |value: &f32| if value.is_nan() { [0.0; 2] } else { [*value, 1.0] };
        let [sums, weights] = [0, 1].map(|kind| {
            let values: Vec<f32> = block.values.iter().map(|value| seen(value)[kind]).collect();
            self.sums(values, [edge; 3])
        });
        let centre = |voxel: usize| {
            let [x, y, z] = [voxel % EDGE, voxel / EDGE % EDGE, voxel / (EDGE * EDGE)].map(|at| at + self.reach);
            block.values[(z * edge + y) * edge + x]
        };
        let smoothed = |voxel: usize| if centre(voxel).is_nan() { f32::NAN } else { sums[voxel] / weights[voxel] };
        (0..VOXELS).map(smoothed).collect()
    }

    /// Smooths a whole field.
    pub(crate) fn field(&self, field: &Field) -> Field {
        let space = *field.space();
        let bricks: Vec<BrickIndex> = field.bricks().collect();
        let of_bricks: Vec<Vec<f32>> =
            bricks.par_iter().map_init(Block::default, |block, brick| self.brick(field, *brick, block)).collect();
        let mut values = vec![0.0; space.voxels()];
        for (brick, smoothed) in bricks.iter().zip(&of_bricks) {
            let own = VoxelBox { low: brick.map(|at| i64::from(at) * EDGE as i64), size: [EDGE; 3] };
            for (n, value) in smoothed.iter().enumerate() {
                if let Some(place) = space.place(own.voxel(n)) {
                    values[place] = *value;
                }
            }
        }
        Field::new(space, values)
    }

    /// Weighted sums along all axes, of the voxels that have the whole reach around them.
    fn sums(&self, values: Vec<f32>, size: [usize; 3]) -> Vec<f32> {
        let (sums, _) = self.taps.iter().enumerate().fold((values, size), |(values, mut size), (axis, taps)| {
            let sums = sums_along(&values, size, axis, taps);
            size[axis] -= taps.len() - 1;
            (sums, size)
        });
        sums
    }
}

/// Weighted sums along one axis of a box.
fn sums_along(values: &[f32], size: [usize; 3], axis: usize, taps: &[f32]) -> Vec<f32> {
    let step: usize = size[..axis].iter().product();
    let kept = size[axis] + 1 - taps.len();
    let mut sums = vec![0.0; values.len() / size[axis] * kept];
    for (values, sums) in values.chunks_exact(step * size[axis]).zip(sums.chunks_exact_mut(step * kept)) {
        for (k, tap) in taps.iter().enumerate() {
            sums.iter_mut().zip(&values[k * step..]).for_each(|(sum, value)| *sum += tap * value);
        }
    }
    sums
}
