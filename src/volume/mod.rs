//! The volume: its lattice and the bricks that hold it.
//!
//! - [`grid`]: lattice, spacing, direction; index ↔ world.

pub mod grid;

pub use grid::Grid;
