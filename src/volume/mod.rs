//! The volume: its lattice and the bricks that hold it.
//!
//! - [`grid`]: lattice, spacing, direction; index ↔ world.
//! - [`brick`]: 8³ voxels that live together.
//! - `arena`: storage that grows by chunks and never moves.
//! - [`sparse`]: the bricks that exist, wherever they lie.

mod arena;
pub mod brick;
pub mod grid;
pub mod sparse;

pub use brick::Brick;
pub use grid::Grid;
pub use sparse::BrickVolume;
