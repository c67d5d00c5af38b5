//! Readings to posed frames: the one place where units, frames and clocks change.
//!
//! - [`clock`]: computes measurement times from a device's ticks and the host's stamps.
//! - [`extent`]: the voxels that slices will reach.
//! - [`gating`]: leaves out the frames at which a body is displaced by breathing.
//! - [`graph`]: the chain of named transforms from the image to the world.
//! - [`history`]: a station's poses by time, with interpolation.
//! - [`ingest`]: readings to samples in mm, rad and host time.
//! - [`pairing`]: gives images their poses, by the transforms of their stamp or by poses around
//!   their time.
//! - [`smoothing`]: smoothed poses, where interpolation would pass the noise of two samples on.
//! - [`mod@survey`]: a pass over a recording's transforms before its images are read.

pub mod clock;
pub mod extent;
pub mod gating;
pub mod graph;
pub mod history;
pub mod ingest;
pub mod pairing;
pub mod smoothing;
pub mod survey;

pub use graph::{NoPath, Route};
pub use pairing::PairingOptions;
pub use pairing::stamped::{Paired, StampedPairing};
pub use pairing::timed::{TimedOptions, TimedPairing};
pub use survey::{FramePose, Survey, survey};
