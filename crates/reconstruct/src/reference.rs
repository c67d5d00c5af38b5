//! The reconstruction directly from the equations: every voxel, every pixel, f64, no skipping.
//! Slow; the reference for the fast path.
//!
//! For each voxel with |plane distance| ≤ d the numerator gains f(n)·Σ k(u−uⱼ)k(v−vⱼ)cⱼbⱼ and
//! the weight f(n)·Σ k(u−uⱼ)k(v−vⱼ)cⱼ. The in-plane kernel is scaled so that its sum over the
//! infinite pixel lattice is 1 at every position (Ohbuchi, Chen & Fuchs 1992, section 4, as
//! normalised convolution). With decay, the existing sums fade first. If slices are selected
//! and not averaged, the voxel keeps the value and weight of one.

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use mask::Mask;
use sonoweave_core::slice::{Pixels, Slice};
use volume::Grid;

use super::compounding::Compounding;
use super::decay::{Decay, DecayClock, LEAST_TOUCH};
use super::kernel::AxisKernel;
use super::slab::{LEAST_CERTAINTY, Plane};

/// Sums at the voxels of a grid.
#[derive(Debug, Clone)]
pub struct Reference {
    /// Grid of the voxels.
    pub grid: Grid,
    /// Σ weight·value, x fastest.
    pub r: Vec<f64>,
    /// Σ weight.
    pub w: Vec<f64>,
    /// Time of each voxel's last write, ns: the slice's time under selection, the clock's under
    /// decay.
    latest_ns: Vec<i64>,
    compounding: Compounding,
    clock: DecayClock,
}

impl Reference {
    /// Returns empty sums on a grid, for averaging.
    ///
    /// # Panics
    /// When the grid has more voxels than memory can address.
    pub fn new(grid: Grid) -> Self {
        Self::compounding(grid, Compounding::Mean)
    }

    /// Returns empty sums on a grid, for the given compounding.
    ///
    /// # Panics
    /// Same as [`Self::new`].
    pub fn compounding(grid: Grid, compounding: Compounding) -> Self {
        let voxels = grid.voxels().and_then(|n| usize::try_from(n).ok()).expect("a grid that fits memory");
        let (zeros, clock) = (vec![0.0; voxels], DecayClock::default());
        Self { grid, r: zeros.clone(), w: zeros, latest_ns: vec![i64::MIN; voxels], compounding, clock }
    }

    /// Adds a slice with data inside the mask. A slice whose pose spans no plane adds nothing.
    pub fn insert(&mut self, slice: &Slice, mask: &Mask, kernels: &[AxisKernel; 3]) {
        let Some(plane) = Plane::new(slice.world_from_image) else { return };
        let image_from_voxel: DAffine3 = plane.image_from_world * self.grid.world_from_volume().affine();
        let [nx, ny, _] = self.grid.size.map(|n| n as usize);
        let compounding = self.compounding;
        self.clock = self.clock.after(slice.time_ns);
        let now_ns = self.clock.elapsed_ns();
        let layers = self.r.par_chunks_mut(nx * ny).zip(self.w.par_chunks_mut(nx * ny));
        let layers = layers.zip(self.latest_ns.par_chunks_mut(nx * ny)).enumerate();
        layers.for_each(|(z, ((r, w), latest_ns))| {
            for i in 0..nx * ny {
                let voxel = DVec3::new((i % nx) as f64, (i / nx) as f64, z as f64);
                let at = image_from_voxel.transform_point3(voxel);
                if at.z.abs() > kernels[2].support_mm {
                    continue;
                }
                let (value, certainty) = in_plane(slice, mask, kernels, plane.pixel_mm, [at.x, at.y]);
                if certainty < f64::from(LEAST_CERTAINTY) {
                    continue;
                }
                let mean = value / certainty;
                let selected = match compounding {
                    Compounding::Mean => {
                        let f = kernels[2].weight(at.z);
                        r[i] += f * value;
                        w[i] += f * certainty;
                        false
                    }
                    Compounding::Decay(decay) => {
                        let f = kernels[2].weight(at.z);
                        if f * certainty >= f64::from(LEAST_TOUCH) {
                            let passed_s = now_ns.saturating_sub(latest_ns[i]) as f64 * 1e-9;
                            let d = if w[i] == 0.0 { 0.0 } else { decay.factor(passed_s) };
                            let f = if matches!(decay, Decay::PaperLiteral { .. }) { (1.0 - d) * f } else { f };
                            r[i] = d * r[i] + f * value;
                            w[i] = d * w[i] + f * certainty;
                            latest_ns[i] = now_ns;
                        }
                        false
                    }
                    Compounding::Maximum => w[i] == 0.0 || mean > r[i],
                    Compounding::Latest => slice.time_ns >= latest_ns[i],
                };
                if selected {
                    (r[i], w[i], latest_ns[i]) = (mean, 1.0, slice.time_ns);
                }
            }
        });
    }

    /// The weighted mean at a voxel, if it was seen.
    pub fn value(&self, voxel: usize) -> Option<f64> {
        (self.w[voxel] > f64::from(volume::brick_volume::SEEN)).then(|| self.r[voxel] / self.w[voxel])
    }
}

/// Returns Σ k·c·b and Σ k·c around a position in pixels.
pub fn in_plane(slice: &Slice, mask: &Mask, kernels: &[AxisKernel; 3], pixel_mm: [f64; 2], at: [f64; 2]) -> (f64, f64) {
    let image = &slice.image;
    let pixel = |u: usize, v: usize| -> f64 {
        let i = v * image.width() as usize + u;
        match image.pixels() {
            Pixels::U8(p) => f64::from(p[i]),
            Pixels::U16(p) => f64::from(p[i]),
            Pixels::F32(p) => f64::from(p[i]),
        }
    };
    // Weights of the pixels from `first` on, scaled to sum 1 including pixels outside the
    // image.
    let axis = |a: usize| {
        let reach = kernels[a].support_mm / pixel_mm[a];
        let first = (at[a] - reach).ceil() as i64;
        let last = (at[a] + reach).floor() as i64;
        let weights: Vec<f64> = (first..=last).map(|j| kernels[a].weight((at[a] - j as f64) * pixel_mm[a])).collect();
        let total: f64 = weights.iter().sum();
        (first, weights.into_iter().map(|w| w / total).collect::<Vec<_>>())
    };
    let (first_u, along_u) = axis(0);
    let (first_v, along_v) = axis(1);
    let (mut value, mut certainty) = (0.0, 0.0);
    for (v, wv) in (first_v..).zip(&along_v) {
        let Some(row) = u32::try_from(v).ok().filter(|v| *v < mask.height()) else { continue };
        for span in mask.row(row) {
            let from = i64::from(span.start).max(first_u);
            let to = i64::from(span.end).min(first_u + along_u.len() as i64);
            for u in from..to {
                let weight = along_u[(u - first_u) as usize] * wv;
                value += weight * pixel(u as usize, v as usize);
                certainty += weight;
            }
        }
    }
    (value, certainty)
}
