//! Renders pictures of the volume and redoes only the changed parts.
//!
//! In the order of the data:
//! - [`region`]: the render region, on the volume's lattice. [`camera`]: the rays through it.
//!   [`mode`]: render modes. [`settings`]: all settings.
//! - [`crop`]: parts of the volume that are hidden.
//! - `snapshot`: value and weight, at their last reading, of the voxels in bricks that have shown
//!   anything and beside them; and which have changed.
//!   `voxels`: the voxel data that a mode keeps. `shaded`: colour and opacity of all voxels.
//! - [`classify`]: from value and weight to colour and opacity, over the numbers of [`real`]
//!   and `elementary`.
//! - `rays`: samples of rays, their composition, kept samples, and the D-buffer. `layers`: a
//!   picture's voxels and rows.
//! - [`soft`]: smoothed volumes with soft shadows, for views at rest.
//! - `refine`: the first coarse picture of a new view, its refinement to the exact one, and
//!   fewer rays where the picture is even.
//! - [`partition`]: the same for workers that each hold a part of the volume.
//! - [`section`]: planes through the volume, and through the slices themselves. `hidden`:
//!   occlusion of overlays. [`pick`]: the place that is visible at a pixel.
//! - [`renderer`]: combines all of it. [`picture`]: the result. [`work`]: counters of the work
//!   done.
//! - [`mod@reference`]: the reference for all of it, in f64.
//!
//! All kept data depend only on the volume and the view, not on the order of changes. A picture
//! that followed a volume slice by slice is therefore bit for bit the one rendered from the
//! finished volume (Ohbuchi, Chen & Fuchs 1992, section 4.2, made exact).

pub mod camera;
pub mod classify;
pub mod crop;
mod elementary;
mod error;
mod hidden;
mod layers;
pub mod mode;
pub mod partition;
pub mod pick;
pub mod picture;
mod rays;
pub mod real;
pub mod reference;
mod refine;
pub mod region;
pub mod renderer;
pub mod section;
pub mod settings;
mod shaded;
mod snapshot;
pub mod soft;
mod stock;
mod view;
mod voxels;
pub mod work;

#[cfg(test)]
mod tests;

pub use crop::Crop;
pub use error::RenderError;
pub use mode::{Mode, Shading};
pub use partition::{Compositor, Part, Plan};
pub use pick::Picked;
pub use picture::{OpaquePixels, Picture};
pub use region::RenderRegion;
pub use renderer::{Progress, Renderer, Updated};
pub use settings::{Cache, RenderSettings};
pub use work::{RenderMemory, RenderWork};
