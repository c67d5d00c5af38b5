//! Everything that is written beside the voxels.

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use volume::Grid;

use crate::error::BadMeta;
use crate::extent::Extent;
use crate::scalar::Scalar;

/// Description of a volume to be written. Two runs with the same description continue each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Voxels and shards.
    pub extent: Extent,
    /// World position of the centre of element 0, mm.
    pub origin: DVec3,
    /// Distance between neighbouring voxels along x, y, z, mm.
    pub spacing: DVec3,
    /// Columns are the unit directions of the index axes in the world. OME-Zarr 0.5 has no
    /// direction; other ones than the identity are written as a matrix of this program's own.
    pub direction: DMat3,
    /// Scalar type of the values.
    pub scalar: Scalar,
    /// Value of unseen voxels.
    pub unseen: f32,
    /// Whether to write `labels/seen`, by which viewers show where voxels were seen.
    pub label: bool,
    /// Values of black and white, if they are known.
    pub range: Option<[f32; 2]>,
    /// First and last voxel of the box that the slices' data reaches, both inclusive, by lattice
    /// index.
    pub slices_box: Option<[[i64; 3]; 2]>,
    /// Further fields by name, in order: the provenance.
    pub fields: Vec<(String, String)>,
    /// Name of the content: inputs and settings. A run continues another only with the same key.
    pub content_key: String,
}

impl Meta {
    /// Returns the grid of level 0, by the indices of its elements.
    pub fn grid(&self) -> Grid {
        Grid { origin: self.origin, spacing: self.spacing, direction: self.direction, size: self.extent.size }
    }

    /// Checks that the description can be written.
    pub(crate) fn check(&self) -> Result<(), BadMeta> {
        let Extent { first, size, shard, chunk } = self.extent;
        let voxels = size.iter().try_fold(1_u64, |n, s| n.checked_mul(*s));
        if voxels.is_none_or(|n| n == 0 || n > 1 << 62) {
            return Err(BadMeta::Size);
        }
        if shard == 0 || shard % 2 != 0 || chunk == 0 || shard % chunk != 0 || shard > 1 << 12 {
            return Err(BadMeta::Edges { shard, chunk });
        }
        for (axis, index) in ['x', 'y', 'z'].into_iter().zip(first) {
            if index.rem_euclid(shard as i64) != 0 {
                return Err(BadMeta::Unaligned { axis, index, edge: shard });
            }
        }
        let is_place = self.origin.is_finite()
            && self.spacing.to_array().iter().all(|s| *s > 0.0 && s.is_finite())
            && self.direction.determinant().abs() > 1e-6
            && self.direction.is_finite();
        if !is_place {
            return Err(BadMeta::Place);
        }
        let is_integer = |most: f32| self.unseen.fract() == 0.0 && (0.0..=most).contains(&self.unseen);
        let is_value = match self.scalar {
            Scalar::U8 => is_integer(255.0),
            Scalar::U16 => is_integer(65535.0),
            Scalar::F32 => true,
        };
        let unseen = BadMeta::Unseen { value: self.unseen, scalar: self.scalar.name() };
        if is_value { Ok(()) } else { Err(unseen) }
    }
}
