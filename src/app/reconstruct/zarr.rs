//! A reconstructed volume as OME-Zarr: its shards are written from bricks, the whole volume at
//! once or region by region.

use std::collections::BTreeSet;
use std::path::Path;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use export::volume::{DenseBox, Encoding, Scalar, written_box};
use mask::Mask;
use ome_zarr::{Extent, Meta, OmeZarrError, OmeZarrWriter, ShardIndex, ShardWriter};
use pipeline::Outcome;
use reconstruct::Settings;
use sonoweave_core::frames::{Transform, Volume, World};
use volume::Voxels;
use volume::brick::{BrickBox, BrickIndex, EDGE};

use crate::app::provenance::range;
use crate::app::sha256;
use crate::failure::Failure;

/// End of the name of such a volume, in lower case.
const END: &str = ".ome.zarr";

/// Whether a path's name is that of an OME-Zarr volume.
pub(crate) fn is_ome_zarr(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().to_ascii_lowercase().ends_with(END))
}

/// Properties of a volume to be written.
pub(super) struct Description<'a> {
    /// First and last voxel, both inclusive: those that slices reach, or a box that was given.
    pub(super) bounds: [[i64; 3]; 2],
    /// Maps voxel indices to world mm.
    pub(super) world_from_lattice: Transform<World, Volume>,
    /// Settings of the reconstruction.
    pub(super) settings: &'a Settings,
    /// Encoding of the values.
    pub(super) encoding: Encoding,
    /// Values of black and white.
    pub(super) range: [f32; 2],
    /// Box of the slices' data, unless the volume is cropped.
    pub(super) slices_box: Option<[[i64; 3]; 2]>,
    /// Whether the volume has the label of seen voxels.
    pub(super) label: bool,
    /// Pixels that are data.
    mask: &'a Mask,
    /// SHA-256 over the slices.
    slices_sha256: [u8; 32],
}

impl<'a> Description<'a> {
    /// Describes a volume by its reconstruction.
    pub(super) fn of(outcome: &'a Outcome, bounds: [[i64; 3]; 2], encoding: Encoding, is_cropped: bool) -> Self {
        let reconstructor = &outcome.reconstructor;
        Self {
            bounds,
            world_from_lattice: reconstructor.world_from_lattice(),
            settings: reconstructor.settings(),
            encoding,
            range: range(outcome.pixels, &encoding),
            slices_box: outcome.reached.filter(|_| !is_cropped),
            label: false,
            mask: &outcome.mask.mask,
            slices_sha256: outcome.slices_sha256,
        }
    }

    /// Adds the label of seen voxels, if it is wanted.
    pub(super) fn with_label(self, label: bool) -> Self {
        Self { label, ..self }
    }

    /// Returns the voxels and their shards.
    pub(super) fn extent(&self) -> Extent {
        Extent::around(self.bounds)
    }

    /// Returns the SHA-256 of all that the voxels follow from: the recording and the calibration,
    /// by `fields` and the hash of pixels beside a header, the slices, the mask and the settings.
    fn content_key(&self, fields: &[(String, String)], data_sha256: Option<&str>) -> String {
        let Settings { spacing_mm, lattice_origin_mm, lattice_direction, method, compounding, .. } = self.settings;
        let Settings { sigma_mm, support, max_weight, .. } = self.settings;
        let text = format!(
            "{spacing_mm:?} {lattice_origin_mm:?} {lattice_direction:?} {method:?} {compounding:?} {sigma_mm:?} \
             {support:?} {max_weight:?} {:?} {:?} {:?} {fields:?}{}",
            self.encoding,
            self.mask,
            self.slices_sha256,
            data_sha256.unwrap_or_default()
        );
        sha256::of(text)
    }

    /// Returns what is needed to write it. `fields` describe its origin.
    pub(super) fn described(&self, fields: Vec<(String, String)>, data_sha256: Option<&str>) -> Described {
        let Self { bounds, encoding, range, slices_box, .. } = *self;
        let space = self.space();
        let meta = Meta {
            extent: self.extent(),
            origin: space.grid.origin,
            spacing: space.grid.spacing,
            direction: space.grid.direction,
            scalar: match encoding.scalar {
                Scalar::U8 => ome_zarr::Scalar::U8,
                Scalar::U16 => ome_zarr::Scalar::U16,
                Scalar::F32 => ome_zarr::Scalar::F32,
            },
            unseen: encoding.unseen,
            label: self.label,
            range: Some(range),
            slices_box,
            content_key: self.content_key(&fields, data_sha256),
            fields,
        };
        Described { meta, bounds, encoding }
    }

    /// Returns the box of all elements.
    pub(super) fn space(&self) -> DenseBox {
        let Extent { first, size, .. } = self.extent();
        DenseBox::new(first, size, self.world_from_lattice, self.settings)
    }
}

/// Everything that is needed to write the volume, or a region of it.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Described {
    /// Everything that is written beside the voxels.
    pub(super) meta: Meta,
    bounds: [[i64; 3]; 2],
    pub(super) encoding: Encoding,
}

impl Described {
    /// Returns the box of all elements.
    pub(super) fn space(&self, outcome: &Outcome) -> DenseBox {
        let (Extent { first, size, .. }, reconstructor) = (self.meta.extent, &outcome.reconstructor);
        DenseBox::new(first, size, reconstructor.world_from_lattice(), reconstructor.settings())
    }
}

/// A volume that is being written.
pub(super) struct Target<'a> {
    described: &'a Described,
    pool: rayon::ThreadPool,
}

impl<'a> Target<'a> {
    /// Prepares to write by so many threads.
    ///
    /// # Errors
    /// [`Failure`] when the threads cannot be started.
    pub(super) fn new(described: &'a Described, threads: usize) -> Result<Self, Failure> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.max(1)).build()?;
        Ok(Self { described, pool })
    }

    /// Whether all shards of a region are written.
    pub(super) fn has(&self, writer: &ShardWriter, region: &BrickBox) -> bool {
        self.shards(Some(region)).into_iter().all(|shard| writer.is_done(0, shard))
    }

    /// Writes the shards of a region, or all; those that hold nothing are left out.
    ///
    /// # Errors
    /// [`Failure`] when a file cannot be written; what is written is kept for another run.
    pub(super) fn write(
        &self,
        writer: &ShardWriter,
        volume: &dyn Voxels,
        region: Option<&BrickBox>,
    ) -> Result<(), Failure> {
        let held: BTreeSet<ShardIndex> = volume.blocks().filter_map(|block| self.shard_of(block)).collect();
        let written = self.pool.install(|| {
            self.shards(region).par_iter().try_for_each(|shard| match held.contains(shard) {
                true => self.write_shard(writer, volume, *shard),
                false => writer.leave_out(*shard),
            })
        });
        Ok(written?)
    }

    /// Writes the pyramid, and gives the volume its name.
    ///
    /// # Errors
    /// [`Failure`] when a file cannot be written; an earlier volume is unchanged.
    pub(super) fn finish(&self, writer: OmeZarrWriter) -> Result<(), Failure> {
        Ok(self.pool.install(|| writer.finish())?)
    }

    /// Returns the shard of a block of 8³ voxels, if it is one.
    fn shard_of(&self, block: BrickIndex) -> Option<ShardIndex> {
        let Extent { first, shard, .. } = self.described.meta.extent;
        let at = |a: usize| u64::try_from(i64::from(block[a]) * EDGE as i64 - first[a]).ok().map(|at| at / shard);
        let index = [at(2)?, at(1)?, at(0)?];
        self.described.meta.extent.shard_size(0, index).map(|_| index)
    }

    /// Returns the shards of a region, or all.
    fn shards(&self, region: Option<&BrickBox>) -> Vec<ShardIndex> {
        let extent = self.described.meta.extent;
        let is_inside = |index: &ShardIndex| {
            let first = extent.shard_first(*index).map(|voxel| voxel.div_euclid(EDGE as i64));
            region.is_none_or(|region| {
                (0..3).all(|a| (i64::from(region.low[a])..=i64::from(region.high[a])).contains(&first[a]))
            })
        };
        extent.shard_indices(0).filter(is_inside).collect()
    }

    fn write_shard(&self, writer: &ShardWriter, volume: &dyn Voxels, shard: ShardIndex) -> Result<(), OmeZarrError> {
        let Described { meta: Meta { extent, .. }, bounds, encoding } = self.described;
        let mut size = extent.shard_size(0, shard).unwrap_or_default();
        size.reverse();
        let (values, weights) = written_box(volume, extent.shard_first(shard), size, *bounds, encoding);
        writer.write_numbers(shard, &values, &weights)
    }
}
