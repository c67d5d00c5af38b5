//! sonoweave turns an ordinary 2D ultrasound scanner into a 3D one: tracked slices are woven into a regular volume as they arrive.
//!
//! The way of a slice, module by module:
//!
//! - [`slice`](mod@slice): a picture, when it was taken and where it lies: what the stages hand on.
//! - [`reconstruct`]: slices into the volume.
//! - [`volume`]: the lattice, and the sparse bricks that hold the volume.
//! - [`export`]: volumes and pictures to files.
//! - [`phantom`]: scans of scenes whose truth is known, for demonstration, tests and benches.

pub mod export;
pub mod phantom;
pub mod reconstruct;
pub mod slice;
pub mod volume;
