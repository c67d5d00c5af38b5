//! Reconstruction: inserts slices into the volume as they arrive.
//!
//! In the order of the data:
//!
//! - [`settings`]: the requested lattice, kernel, compounding and resources.
//! - [`kernel`]: the weight of a sample at a distance, and its support.
//! - [`spline`]: the in-plane kernel as taps of a filter, with its deviation known in advance.
//! - [`compounding`]: combination of the slices that reach the same voxel.
//! - [`decay`]: fading of older values.
//! - `filter`: converts a slice's pixels and certainty into spline coefficients, once.
//! - `nodes`: the filtered image, in f32 as computed and in 16 bits as sampled.
//! - [`gap_weights`]: weights of slices by the gaps beside them.
//! - [`shadow_weights`]: weights of pixels by the shadows that they lie in.
//! - [`stream`]: the decisions about a slice that depend on the slices before it.
//! - `admission`: checks of every slice before insertion; `refusal`: their reasons.
//! - `slab`: the bricks that a slice meets.
//! - `task`: the part of a slice that falls on one brick.
//! - `plan`: the bricks that a slice will change, found before anything is changed.
//! - `sampling`: the filtered image between its nodes; `falloff`: the weight across the plane.
//! - `insert`: inserts one slice into one brick, the hot loop; `entry`: the update of the
//!   voxels.
//! - [`reconstructor`]: all of it behind `insert`.
//! - [`planar`]: the same for slices that stay perpendicular to a plane, in a fraction of the
//!   time.
//! - [`path_reconstructor`]: one of the two paths, with the upgrade from planar to general when a
//!   slice leaves the plane.
//! - [`first_moment`]: the correction of voxels whose slices lie beside them on average;
//!   `normals`: the slices' directions; `sample`: figures of a whole volume.
//! - [`standard_error`]: the error of each voxel's mean, from the spread of its slices.
//! - [`reference`](mod@reference): the same sums, pixel by pixel in f64, to test the fast path.

pub(crate) mod admission;
pub mod compounding;
pub mod decay;
pub(crate) mod entry;
pub(crate) mod falloff;
pub(crate) mod filter;
pub mod first_moment;
pub mod gap_weights;
pub(crate) mod insert;
pub mod kernel;
pub(crate) mod nodes;
mod normals;
pub mod path_choice;
pub mod path_reconstructor;
pub(crate) mod plan;
pub mod planar;
pub mod reconstructor;
pub mod reference;
mod refusal;
mod sample;
pub(crate) mod sampling;
pub mod settings;
pub mod shadow_weights;
pub(crate) mod slab;
pub mod spline;
pub mod standard_error;
pub mod stream;
pub(crate) mod task;

#[cfg(test)]
mod tests;

pub use compounding::Compounding;
pub use decay::Decay;
pub use filter::FilterWork;
pub use first_moment::FirstMoment;
pub use gap_weights::GapWeights;
pub use path_reconstructor::{Path, PathReconstructor};
pub use reconstructor::{Entered, Reconstructor, Refused, RepeatError, Touched, Work};
pub use settings::{Settings, SettingsError};
pub use shadow_weights::ShadowWeights;
pub use simd::Simd;
pub use standard_error::StandardErrors;
pub use stream::Decision;
