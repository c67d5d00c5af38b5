//! Blurs scenes without closed form, by summation over a lattice finer than the kernel and the
//! scene.
//!
//! The scene is painted once on a fine lattice, which is cheap. Each voxel takes the mean of
//! the points around it, weighted by its own covariance. The error of the sum is that part of
//! the scene's spectrum, shifted by the lattice's frequency, which passes the kernel. The step
//! is at most 0.75 of the smallest σ and a third of the scene's finest detail. The error is
//! then below 1e-3 grey levels for Marschner and Lobb's rings. It is below 0.05 for speckle,
//! whose amplitude has a kink at each of its zeros. The kernel is truncated at 5 σ, where it
//! has fallen to 1.5e-5.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use volume::Grid;

use super::kernel::{Covariances, EffectiveKernel, voxel_centre};
use crate::PhantomError;
use crate::elementary::exp;
use crate::grid::voxels;
use crate::paint::{Painter, Sheet};
use crate::scene::Scene;

/// Radius of the kernel, in σ.
const REACH: f64 = 5.0;

/// Step of the lattice, in the kernel's smallest σ.
const STEP: f64 = 0.75;

/// Lattice points in memory at once, 128 MiB; a single layer of voxels may need more.
const POINTS: u64 = 1 << 25;

/// Largest number of points for a layer of voxels, 1 GiB.
const MOST_POINTS: u64 = 1 << 28;

/// Steps of the Gaussian's table over its radius: linear interpolation errs by 5e-8.
const TABLE_STEPS: usize = 8192;

pub(super) fn sample(
    painter: &Painter,
    kernel: &EffectiveKernel,
    covariances: &Covariances,
    grid: &Grid,
) -> Result<Vec<f32>, PhantomError> {
    let mut volume = vec![0.0_f32; voxels(grid)?];
    let layer = (grid.size[0] * grid.size[1]) as usize;
    let step = (STEP * kernel.smallest()).min(finest_step(painter.scene()));
    let margin = REACH * kernel.largest() + step;
    let table = GaussTable::new();
    let mut first = 0;
    while first < grid.size[2] {
        // Paint as many layers at once as fit, at least one.
        let mut count = 1;
        let mut lattice = Lattice::around(grid, first..first + 1, step, margin)?;
        while first + count < grid.size[2]
            && let Ok(more) = Lattice::around(grid, first..first + count + 1, step, margin)
            && more.points() <= POINTS
        {
            (lattice, count) = (more, count + 1);
        }
        let values = lattice.paint(painter);
        let voxels = &mut volume[first as usize * layer..][..count as usize * layer];
        voxels.par_chunks_exact_mut(layer).enumerate().for_each(|(n, voxels)| {
            let z = first + n as u64;
            let nearby = covariances.near_layer(grid, z);
            for (k, voxel) in voxels.iter_mut().enumerate() {
                let world = voxel_centre(grid, k as u64, z);
                *voxel = lattice.mean(&values, world, &nearby.at(world), &table) as f32;
            }
        });
        first += count;
    }
    Ok(volume)
}

/// Returns the step, mm, required by the scene's finest detail.
fn finest_step(scene: &Scene) -> f64 {
    match scene {
        // A third of the finest rings' period.
        Scene::MarschnerLobb(f) => f.unit_mm / (1.5 * std::f64::consts::PI * f.rings),
        Scene::Speckle(speckle) => speckle.pitch_mm / 3.0,
        _ => f64::INFINITY,
    }
}

/// A box of points, axes along the world's, x fastest.
#[derive(Debug, Clone, Copy)]
struct Lattice {
    origin: DVec3,
    step: f64,
    size: [usize; 3],
}

impl Lattice {
    /// Returns all points within `margin` of the box around some layers of a grid.
    fn around(grid: &Grid, layers: std::ops::Range<u64>, step: f64, margin: f64) -> Result<Self, PhantomError> {
        let [nx, ny, _] = grid.size.map(|n| (n - 1) as f64);
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for z in [layers.start as f64, (layers.end - 1) as f64] {
            for (x, y) in [(0.0, 0.0), (nx, 0.0), (0.0, ny), (nx, ny)] {
                let corner = grid.world_from_volume().point(DVec3::new(x, y, z));
                (low, high) = (low.min(corner), high.max(corner));
            }
        }
        let first = ((low - margin) / step).floor();
        let count = ((high + margin) / step).ceil() - first + 1.0;
        let points = count.x * count.y * count.z;
        if points > MOST_POINTS as f64 {
            return Err(PhantomError::KernelTooThin { points, limit: MOST_POINTS });
        }
        Ok(Self { origin: first * step, step, size: count.to_array().map(|n| n as usize) })
    }

    fn points(&self) -> u64 {
        self.size.iter().map(|n| *n as u64).product()
    }

    fn paint(&self, painter: &Painter) -> Vec<f32> {
        let [nx, ny, nz] = self.size;
        let mut values = vec![0.0_f32; nx * ny * nz];
        values.par_chunks_exact_mut(nx * ny).enumerate().for_each(|(z, layer)| {
            let sheet = Sheet {
                origin: self.origin + DVec3::Z * (self.step * z as f64),
                step_u: DVec3::X * self.step,
                step_v: DVec3::Y * self.step,
                width: nx,
                height: ny,
            };
            let mut grey = vec![0.0; layer.len()];
            painter.paint(&sheet, &mut grey);
            for (to, from) in layer.iter_mut().zip(grey) {
                *to = from as f32;
            }
        });
        values
    }

    /// Returns the mean around a point with Gaussian weights. The exponent is completed to
    /// squares one axis at a time. The weight is therefore a product of factors for the layer,
    /// the row and the point.
    fn mean(&self, values: &[f32], world: DVec3, covariance: &DMat3, table: &GaussTable) -> f64 {
        let p = covariance.inverse();
        let (pxx, shift_xy, shift_xz) = (p.x_axis.x, p.x_axis.y / p.x_axis.x, p.x_axis.z / p.x_axis.x);
        let syy = p.y_axis.y - shift_xy * p.x_axis.y;
        let shift_yz = (p.y_axis.z - shift_xy * p.x_axis.z) / syy;
        let szz = covariance.z_axis.z.recip();
        let [nx, ny, nz] = self.size;
        let at = (world - self.origin) / self.step;
        let (mut sum, mut weights) = (0.0, 0.0);
        for z in self.within(at.z, REACH / szz.sqrt(), nz) {
            let dz = (z as f64 - at.z) * self.step;
            let tz = dz * szz.sqrt();
            let left = (REACH * REACH - tz * tz).max(0.0);
            let middle_y = at.y - shift_yz * dz / self.step;
            for y in self.within(middle_y, (left / syy).sqrt(), ny) {
                let dy = (y as f64 - at.y) * self.step;
                let ty = (y as f64 - middle_y) * self.step * syy.sqrt();
                let left = (left - ty * ty).max(0.0);
                let middle_x = at.x - (shift_xy * dy + shift_xz * dz) / self.step;
                let span = self.within(middle_x, (left / pxx).sqrt(), nx);
                let scale = self.step * pxx.sqrt() * table.per_sigma;
                let row = &values[(z * ny + y) * nx..][..nx];
                let (mut row_sum, mut row_weights) = (0.0, 0.0);
                let first = span.start as f64 - middle_x;
                for (n, value) in (0_u32..).zip(&row[span]) {
                    let weight = table.at((first + f64::from(n)).abs() * scale);
                    row_sum += weight * f64::from(*value);
                    row_weights += weight;
                }
                let outer = table.at(tz.abs() * table.per_sigma) * table.at(ty.abs() * table.per_sigma);
                sum += outer * row_sum;
                weights += outer * row_weights;
            }
        }
        sum / weights
    }

    /// Returns the indices within `reach` mm of index `middle` on an axis of `count` points.
    fn within(&self, middle: f64, reach: f64, count: usize) -> std::ops::Range<usize> {
        let reach = reach / self.step;
        let first = (middle - reach).ceil().max(0.0);
        let end = ((middle + reach).floor() + 1.0).min(count as f64).max(first);
        first as usize..end as usize
    }
}

/// Table of e^{−t²/2} up to the kernel's radius: at each step the value and the change to the
/// next.
struct GaussTable {
    entries: Box<[[f64; 2]; TABLE_STEPS + 1]>,
    per_sigma: f64,
}

impl GaussTable {
    fn new() -> Self {
        let per_sigma = TABLE_STEPS as f64 / REACH;
        let value = |k: usize| {
            let t = k as f64 / per_sigma;
            exp(-0.5 * t * t)
        };
        let mut entries = Box::new([[0.0; 2]; TABLE_STEPS + 1]);
        for (k, entry) in entries.iter_mut().enumerate() {
            *entry = [value(k), value(k + 1) - value(k)];
        }
        Self { entries, per_sigma }
    }

    /// Returns the value at a distance in steps of the table.
    #[inline(always)]
    fn at(&self, steps: f64) -> f64 {
        let k = (steps as u32).min(TABLE_STEPS as u32);
        let [value, change] = self.entries[k as usize];
        value + (steps - f64::from(k)) * change
    }
}
