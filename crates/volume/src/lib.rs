//! The volume: its lattice and the bricks that hold it.
//!
//! - [`grid`]: lattice, spacing, direction; index ↔ world.
//! - [`brick`]: 8³ voxels stored together.
//! - [`brick_volume`]: the bricks that exist, anywhere on the lattice.
//! - [`memory`]: data that these bricks keep besides sums.
//! - [`columns`]: voxels in columns, for slices that stay perpendicular to a plane.
//! - [`prism`]: a part of the volume between planes.
//! - [`lattice`]: one canonical form for all descriptions of a lattice.
//! - [`dense`]: a volume read from a file.
//! - [`placed`]: a file's header, and the place that it gives the voxels.
//! - [`difference`]: the difference of two volumes, where both were seen.
//! - [`read`]: read access, common to bricks and columns.
//! - `arena`: the memory of bricks and columns.

pub(crate) mod arena;
pub mod brick;
pub mod brick_volume;
pub mod columns;
pub mod dense;
pub mod difference;
pub mod grid;
pub mod lattice;
pub mod memory;
pub mod placed;
pub mod prism;
pub mod read;

pub use brick::Brick;
pub use brick_volume::BrickVolume;
pub use columns::ColumnVolume;
pub use dense::DenseVolume;
pub use grid::Grid;
pub use placed::PlacedHeader;
pub use prism::Prism;
pub use read::{Values, Voxels};
