//! Volumes as OME-Zarr 0.5: written shard by shard, resumed after an interruption, and read region
//! by region.
//!
//! - [`Extent`]: the part of the lattice that a volume has, and its cut into shards.
//! - [`Meta`]: everything that is written beside the voxels.
//! - [`OmeZarrWriter`]: writes shards in any order and by several threads, then the pyramid.
//! - [`RegionWriter`]: writes the shards of a region, beside other processes.
//! - [`OmeZarr`]: reads this program's volumes and others'.
//! - [`LevelValues`]: a level of a volume for renderers.
//! - [`SliceReader`]: a level slice by slice, as other volume files are read.
//!
//! A volume is a folder, `NAME.ome.zarr`:
//!
//! | path | content |
//! |---|---|
//! | `zarr.json` | the image: axes, places of its levels, provenance; written last |
//! | `0`, `1`, … | values, an array a pyramid level |
//! | `weight/0`, … | weights of the same levels; 0 is unseen |
//! | `labels/seen/0`, … | on request: 1 where a voxel was seen |
//!
//! Shard indices are in the order of the arrays: z, y, x. Lattice indices and places in the world
//! are x, y, z, as everywhere.

mod array;
mod attributes;
mod cache;
mod chunks;
mod error;
mod extent;
mod folder;
mod frame;
mod gauge;
mod image;
mod level;
mod log;
mod meta;
mod metadata;
mod pyramid;
mod reader;
mod region;
mod scalar;
mod shard;
mod shards;
mod slices;
mod store;
mod verify;
mod writer;

pub use error::{BadMeta, BadShard, OmeZarrError};
pub use extent::{Extent, ShardIndex};
pub use level::{ChunkWork, LevelValues};
pub use meta::Meta;
pub use reader::OmeZarr;
pub use region::{RegionWriter, plan_path};
pub use scalar::{Samples, Scalar};
pub use shards::ShardWriter;
pub use slices::SliceReader;
pub use verify::Verified;
pub use writer::{Begun, OmeZarrWriter};
