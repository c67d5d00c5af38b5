//! The planar path's sums directly from the equations: every voxel, every pixel, three
//! dimensions, f64.
//!
//! The sums equal those of [`Reference`], except at the border of the data, where each axis is
//! tested separately.

use rayon::prelude::*;

use mask::Mask;
use sonoweave_core::slice::Slice;

use crate::kernel::AxisKernel;
use crate::reference::{Reference, in_plane};
use crate::slab::{LEAST_CERTAINTY, Plane};

/// Adds a slice whose data is a rectangle. A slice whose pose spans no plane, or without data,
/// adds nothing.
pub fn insert(reference: &mut Reference, slice: &Slice, mask: &Mask, kernels: &[AxisKernel; 3]) {
    let (Some(plane), Some(data)) = (Plane::new(slice.world_from_image), mask.bounds()) else { return };
    let image_from_voxel = plane.image_from_world * reference.grid.world_from_volume().affine();
    let ranges = [(data.x, data.width), (data.y, data.height)];
    let [nx, ny, _] = reference.grid.size.map(|n| n as usize);
    let voxels = reference.r.par_chunks_mut(nx * ny).zip(reference.w.par_chunks_mut(nx * ny)).enumerate();
    voxels.for_each(|(z, (r, w))| {
        for i in 0..nx * ny {
            let voxel = glam::DVec3::new((i % nx) as f64, (i / nx) as f64, z as f64);
            let at = image_from_voxel.transform_point3(voxel);
            let enough = |axis: usize| {
                let (first, count) = ranges[axis];
                share(&kernels[axis], plane.pixel_mm[axis], at[axis], first, count) >= f64::from(LEAST_CERTAINTY)
            };
            if at.z.abs() <= kernels[2].support_mm && enough(0) && enough(1) {
                let (value, certainty) = in_plane(slice, mask, kernels, plane.pixel_mm, [at.x, at.y]);
                let f = kernels[2].weight(at.z);
                r[i] += f * value;
                w[i] += f * certainty;
            }
        }
    });
}

/// Returns the fraction of the kernel around `at` (pixels) that lies on `count` pixels from
/// `first` on.
fn share(kernel: &AxisKernel, pixel_mm: f64, at: f64, first: u32, count: u32) -> f64 {
    let reach = kernel.support_mm / pixel_mm;
    let weights = ((at - reach).ceil() as i64..=(at + reach).floor() as i64)
        .map(|j| (j, kernel.weight((at - j as f64) * pixel_mm)));
    let on_data = |j: i64| (i64::from(first)..i64::from(first) + i64::from(count)).contains(&j);
    let total: f64 = weights.clone().map(|(_, w)| w).sum();
    weights.filter(|(j, _)| on_data(*j)).map(|(_, w)| w).sum::<f64>() / total
}
