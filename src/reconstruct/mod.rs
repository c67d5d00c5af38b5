//! Reconstruction: slices into the volume, as they arrive.
//!
//! In the order of the data:
//!
//! - [`settings`]: what is asked for.
//! - [`kernel`]: the weight of a sample at a distance, and where it ends.
//! - [`spline`]: the in-plane kernel as taps of a filter, with its deviation known in advance.
//! - [`compounding`]: what becomes of the slices that reach the same voxel.
//! - [`decay`]: how the past fades.
//! - `filter`: a slice's pixels and certainty become spline coefficients, once.
//! - `nodes`: the filtered picture, in f32 as computed and in 16 bits as sampled.
//! - `admission`: what is asked of every slice before it enters.
//! - `slab`: which bricks a slice meets.
//! - `plan`: the bricks that a slice will change, found before anything is changed.
//! - `sampling`: the filtered picture between its nodes; `falloff`: the weight across the plane.
//! - `weave`: one slice into one brick, the hot loop; `entry`: how its values enter the voxels.
//! - [`reconstructor`]: all of it behind `insert`.
//! - [`planar`]: the same for slices that stay perpendicular to a plane, in a fraction of the time.
//! - [`path`]: one or the other, and from the second to the first when a slice leaves the plane.
//! - [`reference`](mod@reference): the same sums, pixel by pixel in f64, against which the fast path is tested.

pub(crate) mod admission;
pub mod compounding;
pub mod decay;
pub(crate) mod entry;
pub(crate) mod falloff;
pub(crate) mod filter;
pub mod kernel;
pub(crate) mod nodes;
pub mod path;
pub(crate) mod plan;
pub mod planar;
pub mod reconstructor;
pub mod reference;
pub(crate) mod sampling;
pub mod settings;
pub(crate) mod slab;
pub mod spline;
pub(crate) mod weave;

#[cfg(test)]
mod tests;

pub use crate::simd::Simd;
pub use compounding::Compounding;
pub use decay::Decay;
pub use filter::FilterWork;
pub use path::{Path, Weaver};
pub use reconstructor::{Reconstructor, Refused, Touched, Work};
pub use settings::{Settings, SettingsError};
