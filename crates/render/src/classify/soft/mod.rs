//! Soft light, and how voxels return it.
//!
//! - `presets`: lights by name. `field`: the light that reaches a place. `shade`: the colour
//!   of a voxel in it.

mod field;
pub(crate) mod names;
mod presets;
mod shade;

pub use field::LightField;
pub use presets::SoftLight;
pub use shade::SoftShade;
