//! Encodes and decodes the shards of one array.

use std::num::NonZeroU64;
use std::sync::Arc;

use zarrs::array::codec::api::{ArrayToBytesCodecTraits as _, CodecSpecificOptions};
use zarrs::array::codec::{ShardingCodecOptions, SubchunkWriteOrder};
use zarrs::array::{Array, ArrayBytes, ArrayMetadata, CodecOptions};
use zarrs::storage::store::MemoryStore;

use crate::meta::Meta;
use crate::metadata::{self, Kind};
use crate::scalar::Sample;

/// The codecs of an array. They work in the calling thread alone, and store chunks in order, so
/// that the same voxels give the same bytes.
pub(crate) struct ShardCodec {
    array: Array<MemoryStore>,
    shape: [NonZeroU64; 3],
    options: CodecOptions,
}

impl ShardCodec {
    /// Returns the codecs of an image; those of all levels are equal. The description must have
    /// been checked.
    pub(crate) fn new(meta: &Meta, kind: Kind) -> Result<Self, String> {
        let metadata: ArrayMetadata =
            serde_json::from_value(metadata::array(meta, kind, 0)).map_err(|error| error.to_string())?;
        let ordered = ShardingCodecOptions::default().with_subchunk_write_order(SubchunkWriteOrder::C);
        let array = Array::new_with_metadata(Arc::new(MemoryStore::new()), "/array", metadata)
            .map_err(|error| error.to_string())?
            .with_codec_specific_options(&CodecSpecificOptions::default().with_option(ordered));
        let edge = NonZeroU64::new(meta.extent.shard).ok_or("no voxels along a shard's edge")?;
        let options = CodecOptions::default().with_concurrent_target(1);
        Ok(Self { array, shape: [edge; 3], options })
    }

    /// Returns a shard's file; `None` if all voxels have the value of unseen ones.
    pub(crate) fn encode<T: Sample>(&self, voxels: &[T], unseen: T) -> Result<Option<Vec<u8>>, String> {
        if voxels.iter().all(|voxel| voxel.is_same(unseen)) {
            return Ok(None);
        }
        let bytes = ArrayBytes::new_flen(bytemuck::cast_slice::<T, u8>(voxels));
        let (data_type, fill) = (self.array.data_type(), self.array.fill_value());
        let file = self.array.codecs().encode(bytes, &self.shape, data_type, fill, &self.options);
        Ok(Some(file.map_err(|error| error.to_string())?.into_owned()))
    }

    /// Returns the voxels of a shard's file.
    pub(crate) fn decode<T: Sample>(&self, file: Vec<u8>) -> Result<Vec<T>, String> {
        let (data_type, fill) = (self.array.data_type(), self.array.fill_value());
        let bytes = self.array.codecs().decode(file.into(), &self.shape, data_type, fill, &self.options);
        let bytes = bytes.map_err(|error| error.to_string())?;
        let bytes = bytes.into_fixed().map_err(|error| error.to_string())?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }
}

/// Copies the voxels of a shard, of which the array's end has cut off some, into a whole one.
pub(crate) fn pad<T: Copy>(voxels: &[T], [_, ny, nx]: [usize; 3], edge: usize, whole: &mut [T]) {
    for (row, voxels) in voxels.chunks_exact(nx).enumerate() {
        let at = (row / ny * edge + row % ny) * edge;
        whole[at..at + nx].copy_from_slice(voxels);
    }
}
