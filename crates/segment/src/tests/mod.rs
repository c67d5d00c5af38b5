//! Volumes defined by functions, and contours of bodies.

use glam::{DAffine3, DVec3};

use sonoweave_core::frames::{Transform, Volume, World};
use volume::Values;
use volume::brick::{BrickIndex, EDGE};

mod body;
mod contours;
mod distance;
mod flood;
mod region;

/// Enough memory for all tests.
const LIMIT: u64 = 1 << 30;

/// A volume within a box of voxels, whose values are those of a function of the voxel; unseen where
/// it returns `None`.
struct Scene<F> {
    low: [i64; 3],
    high: [i64; 3],
    value: F,
}

impl<F: Fn([i64; 3]) -> Option<f32> + Sync> Values for Scene<F> {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        for (i, (value, weight)) in value.iter_mut().zip(weight).enumerate() {
            let voxel = [start[0] + i as i64, start[1], start[2]];
            let is_within = (0..3).all(|a| (self.low[a]..=self.high[a]).contains(&voxel[a]));
            let found = Some(voxel).filter(|_| is_within).and_then(|voxel| (self.value)(voxel));
            (*value, *weight) = found.map_or((0.0, 0.0), |value| (value, 1.0));
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        let along =
            |a: usize| (self.low[a].div_euclid(EDGE as i64) as i32)..=(self.high[a].div_euclid(EDGE as i64) as i32);
        Box::new(along(2).flat_map(move |z| along(1).flat_map(move |y| along(0).map(move |x| [x, y, z]))))
    }
}

/// Voxels of 0.5 mm whose first lies at the world's origin, along the world's axes.
fn lattice() -> Transform<World, Volume> {
    Transform::from_affine(DAffine3::from_scale(DVec3::splat(0.5)))
}

/// Returns a number from 0 to 1 for a voxel, the same for each call (Jarzynski & Olano 2020).
fn noise(voxel: [i64; 3]) -> f64 {
    let mut v = voxel.map(|at| (at as u32).wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    for _ in 0..2 {
        v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[2]));
        v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
        v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
        v = v.map(|n| n ^ (n >> 16));
    }
    f64::from(v[0]) / f64::from(u32::MAX)
}

/// Runs on some threads.
fn on<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}
