//! From the volume to its picture, redoing only what changed.
//!
//! In the order of the data:
//! - [`stage`]: the box that is looked at, on the volume's lattice; [`camera`]: the rays through it.
//! - `shown`: value and weight of each voxel as last seen, and which have changed.
//! - [`gradient`], [`transfer`], [`light`], `shade`: a voxel's colour and opacity, over the numbers of [`real`] and `elementary`; `steepness`: what is
//!   too flat to have any; `shaded`: those of all voxels.
//! - [`mode`]: ways to look; `voxels`: what voxels keep for them; `matter`: samples that are classified, or lie on a surface; `interval`: bricks in which no
//!   such sample can be seen; `law`: how samples make one.
//! - `run`: samples between voxels; `cast`: a ray's samples and their fold; `cache`: what is kept of them.
//! - `slab`: which samples of which rays a piece of space holds; `marks`: those that a change may have reached; `rows`: their rays anew; `layers`: a picture's
//!   voxels and rows.
//! - `adaptive`: fewer rays where the picture is even; `features`: what is too small for that. `preview`, `refine`: the first coarse picture of a new view, and its
//!   way to the exact one.
//! - [`partition`]: the same for workers that hold a part of the world each.
//! - [`section`]: planes through the volume, and through the slices themselves; `hidden`: what lies behind matter, for what is drawn over pictures;
//!   [`pick`]: the place that is seen at a pixel.
//! - [`renderer`]: all of it; [`picture`]: the result; [`work`]: what was done for it.
//! - [`mod@reference`]: the measure of it all, in f64.
//!
//! Everything kept is a function of the volume and the view alone, not of how they came about. So a picture that followed a volume slice by slice is, bit for
//! bit, the one that is made of the finished volume (Ohbuchi, Chen & Fuchs 1992, section 4.2, made exact).

use camera::View;

mod adaptive;
mod cache;
pub mod camera;
mod cast;
mod elementary;
mod features;
pub mod gradient;
mod hidden;
mod interval;
mod law;
mod layers;
pub mod light;
mod marks;
mod matter;
pub mod mode;
pub mod partition;
pub mod pick;
pub mod picture;
mod preview;
pub mod real;
pub mod reference;
mod refine;
pub mod renderer;
mod rows;
mod run;
pub mod section;
pub mod settings;
mod shade;
mod shaded;
mod shown;
mod slab;
pub mod stage;
mod steepness;
pub mod transfer;
mod voxels;
pub mod work;

#[cfg(test)]
mod tests;

pub use mode::{Mode, Shading};
pub use pick::Picked;
pub use picture::Picture;
pub use renderer::{Progress, RenderMemory, Renderer, Updated};
pub use settings::{Cache, RenderSettings};
pub use stage::Stage;
pub use work::RenderWork;

/// Why there can be no picture.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// No pixels, or too many.
    #[error("a picture of {}×{} pixels cannot be made: each side must have 1 to {most} pixels", size[0], size[1], most = camera::MOST_PIXELS)]
    Size {
        /// Pixels to the right and down.
        size: [u32; 2],
    },
    /// No direction, or an angle that no perspective has.
    #[error(
        "the view {view:?} is none: azimuth, elevation and roll must be numbers of degrees, and a perspective's angle more than 0 and at most 170 degrees"
    )]
    View {
        /// The view.
        view: View,
    },
    /// No step, or one so short that rays would have too many samples.
    #[error(
        "a step of {step} voxels is none, or would take {samples} samples a ray, of which there may be {most}: choose a longer --step",
        most = camera::MOST_SAMPLES
    )]
    Step {
        /// In voxels.
        step: f64,
        /// Samples along a ray.
        samples: f64,
    },
    /// No box, or one that is too large.
    #[error(
        "the box of voxels {low:?} to {high:?} cannot be looked at: it must have voxels, and not more than a table of its 8³ bricks can hold; crop the volume"
    )]
    Box {
        /// First voxel.
        low: [i64; 3],
        /// Last voxel.
        high: [i64; 3],
    },
    /// Blocks without samples.
    #[error("blocks of 0 samples hold none: --arity must be 1 or more")]
    Arity,
    /// No intensity.
    #[error("there is no surface of the intensity {value}: the isovalue must be a finite number of grey levels")]
    Isovalue {
        /// The isovalue.
        value: f64,
    },
    /// No transmittance.
    #[error("rays cannot end at a transmittance of {stop}: it must lie between 0 and 1")]
    Stop {
        /// The transmittance.
        stop: f32,
    },
    /// No difference of pixels.
    #[error(
        "rays cannot be left out for differences of {epsilon}: --adaptive must lie between 0, which casts all, and 1"
    )]
    Adaptive {
        /// The difference.
        epsilon: f32,
    },
    /// Rays cannot be left out.
    #[error(
        "--adaptive leaves rays out where voxels are classified, in the modes shaded and opacity without --shading sample; for mode {mode} give --adaptive 0"
    )]
    AdaptiveMode {
        /// The mode.
        mode: &'static str,
    },
    /// No such part of the world.
    #[error(
        "part {part} of {parts} is none: parts are counted from 0, and there may be one a layer of bricks, {layers} of them"
    )]
    Part {
        /// Its number.
        part: u32,
        /// How many there should be.
        parts: u32,
        /// Layers of bricks along the stage's z axis.
        layers: u32,
    },
    /// Bytes that are no blocks of the picture.
    #[error(
        "a message of {bytes} bytes is not from a part of this picture: give all parts and the compositor the same settings and stage"
    )]
    Message {
        /// Its length.
        bytes: usize,
    },
    /// Threads could not be started.
    #[error("{threads} threads could not be started: {why}")]
    Threads {
        /// How many.
        threads: usize,
        /// Why.
        why: String,
    },
}
