//! The volume: its lattice and the bricks that hold it.
//!
//! - [`grid`]: lattice, spacing, direction; index ↔ world.
//! - [`brick`]: 8³ voxels that live together.
//! - [`sparse`]: the bricks that exist, wherever they lie.
//! - [`columns`]: voxels in columns, for slices that stay perpendicular to a plane.
//! - [`prism`]: a piece of it between planes.
//! - [`lattice`]: one form for all descriptions of a lattice.
//! - [`dense`]: a volume read from a file.
//! - [`difference`]: one volume less another, where both were seen.
//! - [`read`]: what both have in common for those who only look.
//! - `arena`: the memory of both.

pub(crate) mod arena;
pub mod brick;
pub mod columns;
pub mod dense;
pub mod difference;
pub mod grid;
pub mod lattice;
pub mod prism;
pub mod read;
pub mod sparse;

pub use brick::Brick;
pub use columns::ColumnVolume;
pub use dense::DenseVolume;
pub use grid::Grid;
pub use prism::Prism;
pub use read::{Values, Voxels};
pub use sparse::BrickVolume;
