//! One of the three planes: its position in the picture, and the voxel values of its pixels.

use super::VoxelValue;

/// Position of a plane in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Panel {
    /// Index axes (0 = x) that run right and down, and the one that the plane cuts.
    pub axes: [usize; 3],
    /// Voxel index along the axis that the plane cuts.
    pub at: u64,
    /// The plane's first pixel, right and down from the picture's corner.
    pub corner: [u32; 2],
    /// The plane's pixels, right and down.
    pub size: [u32; 2],
    pub(super) voxels: [u64; 2],
}

impl Panel {
    /// Returns the pixel at the centre of a voxel in the plane, given its indices along the
    /// rightward and the downward axis.
    pub fn pixel_of(&self, voxel: [u64; 2]) -> [u32; 2] {
        std::array::from_fn(|k| {
            let at = (voxel[k] as f64 + 0.5) / self.voxels[k] as f64 * f64::from(self.size[k]);
            self.corner[k] + (at as u32).min(self.size[k] - 1)
        })
    }

    /// Returns the grey levels of the plane's pixels, `None` if the nearest voxel is unseen.
    /// Values are interpolated between seen voxels only; filled ones contribute only if the
    /// nearest is filled.
    pub(super) fn sample(&self, voxel: &impl Fn([u64; 3]) -> Option<VoxelValue>) -> Vec<Option<VoxelValue>> {
        let [right, down, cut] = self.axes;
        let value = |u: u64, v: u64| {
            let mut index = [0; 3];
            (index[right], index[down], index[cut]) = (u, v, self.at);
            voxel(index).filter(|shown| shown.value().is_finite())
        };
        let along = |k: usize| -> Vec<Between> {
            (0..self.size[k]).map(|pixel| Between::of(pixel, self.size[k], self.voxels[k])).collect()
        };
        let (columns, rows) = (along(0), along(1));
        let mut plane = Vec::with_capacity(columns.len() * rows.len());
        for row in &rows {
            for column in &columns {
                let seen = value(column.nearest, row.nearest).map(|nearest| {
                    let (mut sum, mut weights) = (0.0, 0.0);
                    for (u, wu) in column.ends {
                        for (v, wv) in row.ends {
                            if let Some(x) = value(u, v).and_then(|shown| shown.beside(nearest)) {
                                sum += wu * wv * f64::from(x);
                                weights += wu * wv;
                            }
                        }
                    }
                    // The nearest voxel always contributes, with at least a quarter of the
                    // weight.
                    nearest.with((sum / weights) as f32)
                });
                plane.push(seen);
            }
        }
        plane
    }
}

/// A pixel's position between two voxels of an axis.
struct Between {
    nearest: u64,
    /// The voxels on both sides and their weights; the same one twice at the volume's faces.
    ends: [(u64, f64); 2],
}

impl Between {
    fn of(pixel: u32, pixels: u32, voxels: u64) -> Self {
        let at = (f64::from(pixel) + 0.5) / f64::from(pixels) * voxels as f64 - 0.5;
        let low = at.floor();
        let part = at - low;
        let clamp = |index: f64| (index.max(0.0) as u64).min(voxels - 1);
        let ends = [(clamp(low), 1.0 - part), (clamp(low + 1.0), part)];
        Self { nearest: ends[usize::from(part >= 0.5)].0, ends }
    }
}
