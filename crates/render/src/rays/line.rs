//! A ray in single precision, and the samples of it that lie in a box.

use glam::DVec3;

use crate::camera::Ray;
use crate::rays::slab::SLACK;

/// A ray in single precision, and its samples within the render region: from `first`, up to but
/// not including `end`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    pub(crate) base: [f32; 3],
    pub(crate) step: [f32; 3],
    pub(crate) first: u32,
    pub(crate) end: u32,
}

impl Line {
    /// Returns the part of a ray of `samples` samples that lies within a voxel of the box `low`
    /// to `high`.
    pub(crate) fn new(ray: &Ray, low: [i64; 3], high: [i64; 3], samples: u32) -> Self {
        Self::with(ray, ray.step.recip(), low, high, samples)
    }

    /// Same as [`Self::new`], given 1 / step, which parallel rays have in common.
    #[inline(always)]
    pub(crate) fn with(ray: &Ray, per_step: DVec3, low: [i64; 3], high: [i64; 3], samples: u32) -> Self {
        let [first, end] = span(ray, per_step, low, high, [0, samples]);
        Self { base: ray.base.as_vec3().to_array(), step: ray.step.as_vec3().to_array(), first, end }
    }

    /// Returns the region coordinates of a sample.
    #[inline(always)]
    pub(crate) fn at(&self, k: u32) -> [f32; 3] {
        // Exact: there are fewer than 2¹⁶ samples.
        let k = k as f32;
        let ([x, y, z], [bx, by, bz]) = (self.step, self.base);
        [x.mul_add(k, bx), y.mul_add(k, by), z.mul_add(k, bz)]
    }

    /// Returns the region coordinates of the sample before `k`.
    #[inline(always)]
    pub(crate) fn before(&self, k: u32) -> [f32; 3] {
        let k = k as f32 - 1.0;
        let ([x, y, z], [bx, by, bz]) = (self.step, self.base);
        [x.mul_add(k, bx), y.mul_add(k, by), z.mul_add(k, bz)]
    }
}

/// Returns the samples in a range of a ray that can lie within a voxel of a box, given 1 / step;
/// empty if there are none. The box is widened by more than the samples' rounding in single
/// precision.
#[inline(always)]
pub(crate) fn span(ray: &Ray, per_step: DVec3, low: [i64; 3], high: [i64; 3], [first, end]: [u32; 2]) -> [u32; 2] {
    let (mut enter, mut leave) = (f64::from(first), f64::from(end) - 1.0);
    for a in 0..3 {
        let (base, step) = (ray.base[a], ray.step[a]);
        let (low, high) = (low[a] as f64 - 1.0 - SLACK, high[a] as f64 + 1.0 + SLACK);
        if step.abs() < 1e-12 {
            if base < low || base > high {
                return [first, first];
            }
            continue;
        }
        let (one, other) = ((low - base) * per_step[a], (high - base) * per_step[a]);
        enter = enter.max(one.min(other));
        leave = leave.min(one.max(other));
    }
    if enter > leave {
        return [first, first];
    }
    // Between 0 and 65 000.
    let (from, to) = (enter.ceil() as u32, leave.floor() as u32 + 1);
    if from < to { [from, to] } else { [first, first] }
}
