//! A regular box of voxels in the world. A voxel's position is its centre; x is the fastest index.

use glam::{DAffine3, DMat3, DVec3};

use sonoweave_core::frames::{Transform, Volume, World};

/// Origin, spacing, direction and size of a dense volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// World position of the centre of voxel (0, 0, 0), mm.
    pub origin: DVec3,
    /// Distance between neighbouring voxels along each index axis, mm.
    pub spacing: DVec3,
    /// Columns are the unit directions of the index axes in the world.
    pub direction: DMat3,
    /// Voxels along each index axis.
    pub size: [u64; 3],
}

impl Grid {
    /// Maps voxel indices to world mm.
    pub fn world_from_volume(&self) -> Transform<World, Volume> {
        Transform::from_affine(DAffine3 {
            matrix3: self.direction * DMat3::from_diagonal(self.spacing),
            translation: self.origin,
        })
    }

    /// Number of voxels; `None` when it does not fit 64 bits.
    pub fn voxels(&self) -> Option<u64> {
        self.size[0].checked_mul(self.size[1])?.checked_mul(self.size[2])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxel_zero_at_origin_and_x_along_first_direction() {
        let grid = Grid {
            origin: DVec3::new(1.0, 2.0, 3.0),
            spacing: DVec3::new(0.5, 1.0, 2.0),
            direction: DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z),
            size: [4, 5, 6],
        };
        let world_from_volume = grid.world_from_volume();
        assert_eq!(world_from_volume.point(DVec3::ZERO), grid.origin);
        assert_eq!(world_from_volume.point(DVec3::X), DVec3::new(1.0, 2.5, 3.0));
        assert_eq!(world_from_volume.point(DVec3::Y), DVec3::new(0.0, 2.0, 3.0));
        assert_eq!(grid.voxels(), Some(120));
    }

    #[test]
    fn grid_beyond_64_bits_has_no_voxel_count() {
        let grid =
            Grid { origin: DVec3::ZERO, spacing: DVec3::ONE, direction: DMat3::IDENTITY, size: [u64::MAX, 2, 1] };
        assert_eq!(grid.voxels(), None);
    }
}
