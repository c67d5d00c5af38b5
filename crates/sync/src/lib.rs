//! Readings to posed frames: the one place where units, frames and clocks change.
//!
//! - [`bracket`]: frames wait for poses on both sides of their time, and get their pose.
//! - [`clock`]: computes measurement times from a device's ticks and the host's stamps.
//! - [`extent`]: the voxels that slices will reach.
//! - [`graph`]: the chain of named transforms from the image to the world.
//! - [`history`]: a station's poses by time, with interpolation.
//! - [`ingest`]: readings to samples in mm, rad and host time.
//! - [`pairing`]: combines images and transforms of one stamp into posed slices.
//! - [`mod@survey`]: a pass over a recording's transforms before its images are read.

pub mod bracket;
pub mod clock;
pub mod extent;
pub mod graph;
pub mod history;
pub mod ingest;
pub mod pairing;
pub mod survey;

pub use graph::{NoPath, Route};
pub use pairing::{Paired, Pairing, PairingOptions};
pub use survey::{FramePose, Survey, survey};
