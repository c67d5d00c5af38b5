//! sonoweave turns an ordinary 2D ultrasound scanner into a 3D one: tracked slices are woven into a regular volume as they arrive.
//!
//! The way of a slice, module by module:
//!
//! - [`ingest`]: readings → samples: the one place where units, frames and clocks change.
//! - [`sync`]: pictures and their transforms → posed slices.
//! - [`config`]: the file as written → validated settings.
//! - [`mask`]: which pixels of the picture are data.
//! - [`ledger`], [`refusal`]: what became of every frame, and the reasons.
//! - [`slice`](mod@slice): a picture, when it was taken and where it lies: what the stages hand on.
//! - [`volume`]: the lattice, and the sparse bricks that hold the volume.

pub mod config;
pub mod ingest;
pub mod ledger;
pub mod mask;
pub mod refusal;
pub mod slice;
pub mod sync;
pub mod volume;
