//! Volumes defined by functions.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use sonoweave_core::frames::{Transform, Volume, World};
use volume::Values;
use volume::brick::{BrickIndex, EDGE};

use crate::mesh::Mesh;
use crate::surface_nets::extract;
use crate::work::SurfaceWork;

mod compensation;
mod files;
mod nets;
mod reference;

/// Enough memory for all meshes of the tests.
pub(super) const LIMIT: u64 = 1 << 30;

/// A volume within a box of voxels, whose values are those of a function of the voxel; unseen where
/// it returns `None`.
pub(super) struct Field<F> {
    pub(super) low: [i64; 3],
    pub(super) high: [i64; 3],
    pub(super) value: F,
}

impl<F: Fn([i64; 3]) -> Option<f32> + Sync> Values for Field<F> {
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

/// Voxels of `spacing` mm whose first lies at the world's origin, along the world's axes.
pub(super) fn lattice(spacing: f64) -> Transform<World, Volume> {
    Transform::from_affine(DAffine3::from_scale(DVec3::splat(spacing)))
}

/// Turned voxels of unequal edges, and far from the world's origin.
pub(super) fn turned_lattice() -> Transform<World, Volume> {
    Transform::from_affine(DAffine3 {
        matrix3: DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 2.0) / 3.0, 0.7))
            * DMat3::from_diagonal(DVec3::new(0.5, 0.4, 0.6)),
        translation: DVec3::new(120.0, -80.0, 300.0),
    })
}

/// Extracts the surface at half of 255.
pub(super) fn half_level<V: Values>(volume: &V, world_from_lattice: Transform<World, Volume>) -> (Mesh, SurfaceWork) {
    extract(volume, 127.5, world_from_lattice, LIMIT).unwrap()
}
