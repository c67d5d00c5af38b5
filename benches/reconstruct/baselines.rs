//! Baseline methods, on the same frames with the same mask: every pixel is added to the nearest
//! voxel, or distributed over the eight voxels around it.
//!
//! Both are forward mappings into a dense grid, like IGSIO's (the engine of PLUS and of 3D
//! Slicer's live reconstruction), optimised for a fair comparison. A row of pixels is traversed
//! in fixed point with 40 fractional bits. A pixel then costs three additions, and its error over
//! a row stays below 1e-9 voxels. The grid holds the whole scan, so no pixel is tested against
//! its borders. Sums are kept in single precision beside their weights. One thread.

use std::error::Error;

use glam::{DAffine3, DVec3};

use mask::Mask;
use sonoweave_core::slice::{Pixels, Slice};
use volume::Grid;

/// Fractional bits of a position in the grid.
const FRACTION: u32 = 40;
const ONE: f64 = (1_u64 << FRACTION) as f64;

/// Method of adding a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Drop {
    /// Adds to the nearest voxel.
    Nearest,
    /// Adds to the nearest voxel, whose mean is kept as a byte: every hit rounds it down, as the
    /// peers' nearest mode does. The weight, 256 per hit in 16 bits, saturates. This is not a
    /// fair baseline; it shows the origin of their bias.
    NearestInBytes,
    /// Adds to the eight voxels around the pixel, with trilinear weights.
    Trilinear,
}

impl Drop {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Nearest => "nearest voxel, mean in f32",
            Self::NearestInBytes => "nearest voxel, mean in bytes",
            Self::Trilinear => "trilinear, mean in f32",
        }
    }
}

/// A dense volume that pixels are added to.
pub(crate) struct Splat {
    drop: Drop,
    size: [i64; 3],
    voxel_from_world: DAffine3,
    /// Σ weight·value and Σ weight, x fastest.
    sums: Vec<[f32; 2]>,
    /// Mean and weight of [`Drop::NearestInBytes`].
    bytes: Vec<(u8, u16)>,
}

impl Splat {
    /// Creates an empty volume.
    ///
    /// # Errors
    /// If the grid does not fit into memory.
    pub(crate) fn new(drop: Drop, grid: &Grid) -> Result<Self, Box<dyn Error>> {
        let voxels = usize::try_from(grid.voxels().ok_or("the grid has too many voxels")?)?;
        let in_bytes = drop == Drop::NearestInBytes;
        Ok(Self {
            drop,
            size: grid.size.map(|n| n as i64),
            voxel_from_world: grid.world_from_volume().affine().inverse(),
            sums: vec![[0.0; 2]; if in_bytes { 0 } else { voxels }],
            bytes: vec![(0, 0); if in_bytes { voxels } else { 0 }],
        })
    }

    /// Adds a frame's data to the volume.
    ///
    /// # Errors
    /// If the frame does not have 8 bits or leaves the grid.
    pub(crate) fn insert(&mut self, slice: &Slice, mask: &Mask) -> Result<(), Box<dyn Error>> {
        let Pixels::U8(pixels) = slice.image.pixels() else {
            return Err("the baselines take pictures of 8 bits".into());
        };
        let voxel_from_image = self.voxel_from_world * slice.world_from_image.affine();
        let width = mask.width() as usize;
        let inside = |u: u32, v: u32| {
            let at = voxel_from_image.transform_point3(DVec3::new(f64::from(u), f64::from(v), 0.0));
            // Both methods reach at most one voxel further.
            (0..3).all(|a| at[a] >= 0.0 && at[a] < (self.size[a] - 1) as f64)
        };
        let (right, bottom) = (mask.width() - 1, mask.height() - 1);
        if ![(0, 0), (right, 0), (0, bottom), (right, bottom)].into_iter().all(|(u, v)| inside(u, v)) {
            return Err("a slice leaves the baselines' grid".into());
        }
        let fixed = |p: DVec3| p.to_array().map(|x| (x * ONE).round() as i64);
        let step = fixed(voxel_from_image.matrix3.x_axis);
        // Adding half a voxel and rounding down gives the nearest voxel.
        let rounding = DVec3::splat(if self.drop == Drop::Trilinear { 0.0 } else { 0.5 });
        for v in 0..mask.height() {
            for span in mask.row(v) {
                let first = DVec3::new(f64::from(span.start), f64::from(v), 0.0);
                let start = fixed(voxel_from_image.transform_point3(first) + rounding);
                let row = &pixels[v as usize * width..][span.start as usize..span.end as usize];
                match self.drop {
                    Drop::Nearest => self.nearest(row, start, step),
                    Drop::NearestInBytes => self.nearest_in_bytes(row, start, step),
                    Drop::Trilinear => self.trilinear(row, start, step),
                }
            }
        }
        Ok(())
    }

    fn nearest(&mut self, row: &[u8], [mut x, mut y, mut z]: [i64; 3], step: [i64; 3]) {
        let [nx, ny, _] = self.size;
        for pixel in row {
            let at = ((z >> FRACTION) * ny + (y >> FRACTION)) * nx + (x >> FRACTION);
            let sums = &mut self.sums[at as usize];
            sums[0] += f32::from(*pixel);
            sums[1] += 1.0;
            (x, y, z) = (x + step[0], y + step[1], z + step[2]);
        }
    }

    fn nearest_in_bytes(&mut self, row: &[u8], [mut x, mut y, mut z]: [i64; 3], step: [i64; 3]) {
        let [nx, ny, _] = self.size;
        for pixel in row {
            let at = ((z >> FRACTION) * ny + (y >> FRACTION)) * nx + (x >> FRACTION);
            let (mean, weight) = &mut self.bytes[at as usize];
            let before = u32::from(*weight);
            *mean = ((u32::from(*pixel) * 256 + u32::from(*mean) * before) / (before + 256)) as u8;
            *weight = weight.saturating_add(256);
            (x, y, z) = (x + step[0], y + step[1], z + step[2]);
        }
    }

    fn trilinear(&mut self, row: &[u8], [mut x, mut y, mut z]: [i64; 3], step: [i64; 3]) {
        let [nx, ny, _] = self.size;
        let (row_on, layer_on) = (nx as usize, (nx * ny) as usize);
        for pixel in row {
            let at = (((z >> FRACTION) * ny + (y >> FRACTION)) * nx + (x >> FRACTION)) as usize;
            let value = f32::from(*pixel);
            // The upper 32 bits of the fraction exceed single precision.
            let [fx, fy, fz] = [x, y, z].map(|p| (p >> (FRACTION - 32)) as u32 as f32 * (1.0 / 4_294_967_296.0));
            let along_x = [1.0 - fx, fx];
            for (layer, wz) in [(at, 1.0 - fz), (at + layer_on, fz)] {
                for (at, wy) in [(layer, 1.0 - fy), (layer + row_on, fy)] {
                    let weight = wz * wy;
                    for (sums, wx) in self.sums[at..at + 2].iter_mut().zip(along_x) {
                        sums[0] += weight * wx * value;
                        sums[1] += weight * wx;
                    }
                }
            }
            (x, y, z) = (x + step[0], y + step[1], z + step[2]);
        }
    }

    /// Returns the mean at a voxel with a total weight above `weight`.
    pub(crate) fn value(&self, voxel: usize, weight: f32) -> Option<f32> {
        match self.drop {
            Drop::NearestInBytes => {
                let (mean, hits) = self.bytes[voxel];
                (f32::from(hits) / 256.0 > weight).then(|| f32::from(mean))
            }
            Drop::Nearest | Drop::Trilinear => {
                let [sum, total] = self.sums[voxel];
                (total > weight).then(|| sum / total)
            }
        }
    }
}

/// Returns the expected Σ weight·value and Σ weight: each pixel separately, in f64.
///
/// # Errors
/// The same as [`Splat`]; the mean in bytes has no definition other than its code.
pub(crate) fn plain(drop: Drop, grid: &Grid, slices: &[Slice], mask: &Mask) -> Result<Vec<[f64; 2]>, Box<dyn Error>> {
    let voxels = usize::try_from(grid.voxels().ok_or("the grid has too many voxels")?)?;
    let [nx, ny, _] = grid.size.map(|n| n as usize);
    let mut sums = vec![[0.0_f64; 2]; voxels];
    for slice in slices {
        let Pixels::U8(pixels) = slice.image.pixels() else {
            return Err("the baselines take pictures of 8 bits".into());
        };
        let voxel_from_image = grid.world_from_volume().inverse() * slice.world_from_image;
        for v in 0..mask.height() {
            for u in mask.row(v).iter().flat_map(|span| span.start..span.end) {
                let value = f64::from(pixels[(v * mask.width() + u) as usize]);
                let at = voxel_from_image.point(DVec3::new(f64::from(u), f64::from(v), 0.0));
                let mut add = |p: DVec3, weight: f64| {
                    let [x, y, z] = p.to_array().map(|x| x as usize);
                    let sums = &mut sums[(z * ny + y) * nx + x];
                    sums[0] += weight * value;
                    sums[1] += weight;
                };
                match drop {
                    Drop::Nearest => add((at + 0.5).floor(), 1.0),
                    Drop::Trilinear => {
                        let low = at.floor();
                        for corner in 0..8 {
                            let on =
                                DVec3::new(f64::from(corner & 1), f64::from(corner >> 1 & 1), f64::from(corner >> 2));
                            let weight = 1.0 - (at - low - on).abs();
                            add(low + on, weight.x * weight.y * weight.z);
                        }
                    }
                    Drop::NearestInBytes => return Err("bytes have no plain form".into()),
                }
            }
        }
    }
    Ok(sums)
}
