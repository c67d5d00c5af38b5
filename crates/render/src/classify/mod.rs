//! Classification and lighting: from value, weight and gradient to colour and opacity.
//!
//! - [`transfer`]: transfer functions, their presets and files. [`light`]: light sources and
//!   reflection. [`gradient`]: surface normals. `shade`: colour and opacity of a voxel.
//! - [`soft`]: soft light, instead of that of `light`.
//! - `classifier`: samples that are classified themselves, or lie on a surface.
//! - `interval`, `steepness`: bounds by which bricks are skipped.

pub(crate) mod classifier;
pub mod gradient;
pub(crate) mod interval;
pub mod light;
pub(crate) mod shade;
pub mod soft;
pub(crate) mod steepness;
pub mod transfer;
