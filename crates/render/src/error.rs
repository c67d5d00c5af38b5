//! Reasons why no picture can be rendered.

use super::classify::soft::names;
use super::view::{self, View};

/// Reason why no picture can be rendered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// No pixels, or too many.
    #[error("a picture of {}×{} pixels cannot be made: each side must have 1 to {most} pixels", size[0], size[1], most = view::MOST_PIXELS)]
    Size {
        /// Pixels to the right and down.
        size: [u32; 2],
    },
    /// An invalid direction, or an impossible perspective angle.
    #[error(
        "the view is none: azimuth, elevation and roll must be numbers of degrees, not {}, {}, {}, and a perspective's angle more than 0 and at most 170 degrees",
        view.azimuth, view.elevation, view.roll
    )]
    View {
        /// The view.
        view: View,
    },
    /// An invalid step, or one so short that rays would have too many samples.
    #[error(
        "a step of {step} voxels is none, or would take {samples} samples a ray, of which there may be {most}: choose a longer step",
        most = view::MOST_SAMPLES
    )]
    Step {
        /// The step, voxels.
        step: f64,
        /// Samples along a ray.
        samples: f64,
    },
    /// No box, or one that is too large.
    #[error(
        "the box of voxels {} to {} cannot be looked at: it must have voxels, and not more than a table of its 8³ bricks can hold; crop the volume",
        low.map(|n| n.to_string()).join(","), high.map(|n| n.to_string()).join(",")
    )]
    Box {
        /// First voxel.
        low: [i64; 3],
        /// Last voxel.
        high: [i64; 3],
    },
    /// No soft light of this name.
    #[error("no soft light is called \"{name}\"; give one of {names}", names = names::names())]
    SoftName {
        /// The name.
        name: String,
    },
    /// A range of intensities for which no soft light can be made.
    #[error("no soft light for grey values from {} to {}: black must be a finite value below white", range[0], range[1])]
    SoftRange {
        /// Black and white.
        range: [f64; 2],
    },
    /// An operation of a crop that is impossible.
    #[error("operation {number} of the crop: {problem}")]
    Crop {
        /// Its number, from 1.
        number: usize,
        /// The numbers that it needs.
        problem: &'static str,
    },
    /// Blocks without samples.
    #[error("blocks of 0 samples hold none: the arity must be 1 or more")]
    Arity,
    /// An invalid isovalue.
    #[error("there is no surface of the intensity {value}: the isovalue must be a finite number of grey levels")]
    Isovalue {
        /// The isovalue.
        value: f64,
    },
    /// An invalid transmittance.
    #[error("rays cannot end at a transmittance of {stop}: it must lie between 0 and 1")]
    Stop {
        /// The transmittance.
        stop: f32,
    },
    /// An invalid pixel difference.
    #[error(
        "rays cannot be left out for differences of {epsilon}: the tolerance must lie between 0, which casts all, and 1"
    )]
    Adaptive {
        /// The difference.
        epsilon: f32,
    },
    /// Adaptive rays are not available in this mode.
    #[error(
        "rays can be left out where voxels are classified, in the modes shaded and opacity without shading by samples; for mode {mode} choose adaptive 0"
    )]
    AdaptiveMode {
        /// The mode.
        mode: &'static str,
    },
    /// An invalid part of the render region.
    #[error("part {part} of {parts} is none: give one from 0 on, of at most {layers} parts, one a layer of bricks")]
    Part {
        /// Number of the part.
        part: u32,
        /// Number of parts requested.
        parts: u32,
        /// Layers of bricks along the region's z axis.
        layers: u32,
    },
    /// Rows that a picture does not have.
    #[error("a picture of {height} rows has no rows {first} to before {end}: give some of its own")]
    Rows {
        /// The first row.
        first: u32,
        /// The one after the last.
        end: u32,
        /// Rows of the picture.
        height: u32,
    },
    /// More memory than allowed, however the picture is cut.
    #[error(
        "the smallest part of the picture would take {needed} MB of memory, of which {limit} may be taken: raise the memory limit, or ask for a smaller picture, a longer step or a coarser level",
        needed = needed_bytes.div_ceil(1_000_000), limit = limit_bytes / 1_000_000
    )]
    Memory {
        /// Memory needed, bytes.
        needed_bytes: u64,
        /// Memory allowed, bytes.
        limit_bytes: u64,
    },
    /// Adaptive rays in parts.
    #[error("a picture in {parts} parts casts every ray: choose adaptive 0, or leave out the parts")]
    AdaptiveParts {
        /// Number of parts requested.
        parts: u32,
    },
    /// Bytes that are not blocks of this picture.
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
        /// Number of threads.
        threads: usize,
        /// Cause.
        why: String,
    },
}
