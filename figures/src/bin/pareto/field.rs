//! A result on a dense grid, of any method, interpolated between its voxels like by a renderer.

use glam::{DAffine3, DVec3};

use reconstruct::Settings;
use reconstruct::reference::Reference;
use sonoweave_core::frames::{Transform, Volume as VolumeFrame, World};
use volume::brick_volume::SEEN;
use volume::{Grid, Voxels};

use crate::baselines::Splat;
use crate::filling::fill_holes;

/// Grey levels on a grid, x fastest; NaN if unseen.
pub(crate) struct Field {
    grid: Grid,
    voxel_from_world: DAffine3,
    values: Vec<f32>,
}

impl Field {
    /// Makes a field of values on a grid of any orientation.
    pub(crate) fn new(grid: Grid, values: Vec<f32>) -> Self {
        Self { grid, voxel_from_world: grid.world_from_volume().inverse().affine(), values }
    }

    /// Makes a field of a volume, on its own lattice, over the seen box.
    pub(crate) fn of_volume(
        volume: &dyn Voxels,
        world_from_lattice: Transform<World, VolumeFrame>,
        settings: &Settings,
    ) -> Self {
        let (low, high) = volume.seen_bounds().unwrap_or(([0; 3], [0; 3]));
        let size = [0, 1, 2].map(|axis| (high[axis] - low[axis] + 1) as u64);
        let origin = world_from_lattice.point(DVec3::from_array(low.map(|x| x as f64)));
        let grid = Grid { origin, spacing: settings.spacing_mm, direction: settings.lattice_direction, size };
        let [nx, ny, nz] = size.map(|n| n as usize);
        let (mut r, mut w) = (vec![0.0; nx], vec![0.0; nx]);
        let mut values = Vec::with_capacity(nx * ny * nz);
        for z in 0..nz as i64 {
            for y in 0..ny as i64 {
                volume.row([low[0], low[1] + y, low[2] + z], &mut r, &mut w);
                values.extend(r.iter().zip(&w).map(|(r, w)| if *w > SEEN { r / w } else { f32::NAN }));
            }
        }
        Self::new(grid, values)
    }

    /// Returns whether grid and bits are equal.
    pub(crate) fn same_bits(&self, other: &Self) -> bool {
        let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        self.grid == other.grid && bits(&self.values) == bits(&other.values)
    }

    /// Makes a field of the voxels with more than `weight`.
    pub(crate) fn of_splat(splat: &Splat, grid: Grid, weight: f32) -> Self {
        let voxels = grid.size.map(|n| n as usize).iter().product();
        let values = (0..voxels).map(|i| splat.value(i, weight).unwrap_or(f32::NAN)).collect();
        Self::new(grid, values)
    }

    /// Makes a field of a reference in f64; its values are rounded to f32.
    pub(crate) fn of_reference(reference: &Reference) -> Self {
        let values = (0..reference.w.len()).map(|i| reference.value(i).map_or(f32::NAN, |v| v as f32)).collect();
        Self::new(reference.grid, values)
    }

    /// Fills holes over up to `reach` voxels.
    pub(crate) fn fill_holes(&mut self, reach: usize) {
        fill_holes(&mut self.values, self.grid.size.map(|n| n as usize), reach);
    }

    /// Interpolates trilinearly; `None` unless all eight surrounding voxels were seen.
    pub(crate) fn sample(&self, world: DVec3) -> Option<f64> {
        let at = self.voxel_from_world.transform_point3(world);
        let low = at.floor();
        let part = at - low;
        let [nx, ny, nz] = self.grid.size.map(|n| n as i64);
        let [x, y, z] = low.to_array().map(|x| x as i64);
        if x < 0 || y < 0 || z < 0 || x + 1 >= nx || y + 1 >= ny || z + 1 >= nz {
            return None;
        }
        let mut sum = 0.0;
        for (dz, wz) in [(0, 1.0 - part.z), (1, part.z)] {
            for (dy, wy) in [(0, 1.0 - part.y), (1, part.y)] {
                let row = (((z + dz) * ny + y + dy) * nx + x) as usize;
                let [a, b] = [self.values[row], self.values[row + 1]].map(f64::from);
                sum += wz * wy * (a + part.x * (b - a));
            }
        }
        (!sum.is_nan()).then_some(sum)
    }

    /// Returns central differences along the world's axes, over one voxel spacing to either
    /// side, grey levels per mm.
    pub(crate) fn slope(&self, world: DVec3) -> Option<DVec3> {
        let along = |axis: usize| {
            let step = DVec3::AXES[axis] * self.grid.spacing[axis];
            Some((self.sample(world + step)? - self.sample(world - step)?) / (2.0 * self.grid.spacing[axis]))
        };
        Some(DVec3::new(along(0)?, along(1)?, along(2)?))
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;

    fn field(value: impl Fn([usize; 3]) -> f32) -> Field {
        let grid = Grid {
            origin: DVec3::new(-2.0, 1.0, 0.5),
            spacing: DVec3::splat(0.5),
            direction: DMat3::from_rotation_z(0.3),
            size: [7, 6, 5],
        };
        Field::new(grid, (0..210).map(|i| value([i % 7, i / 7 % 6, i / 42])).collect())
    }

    #[test]
    fn linear_field_is_interpolated_exactly_unless_corner_unseen() {
        let linear = |[x, y, z]: [usize; 3]| 3.0 + 2.0 * x as f32 - y as f32 + 0.5 * z as f32;
        let grid = field(linear).grid;
        let index = DVec3::new(2.6, 2.2, 1.6);
        let place = grid.world_from_volume().point(index);
        let expected = 3.0 + 2.0 * index.x - index.y + 0.5 * index.z;
        assert!((field(linear).sample(place).unwrap() - expected).abs() < 1e-9);
        let slope = field(linear).slope(place).unwrap();
        assert!((slope - grid.direction * DVec3::new(4.0, -2.0, 1.0)).length() < 1e-9);
        let corner = index.floor().to_array().map(|x| x as usize);
        let holed = field(|at| if at == corner { f32::NAN } else { linear(at) });
        assert!(holed.sample(place).is_none() && holed.slope(place).is_none());
        assert!(field(linear).sample(grid.world_from_volume().point(DVec3::new(-0.2, 2.0, 1.0))).is_none());
    }
}
