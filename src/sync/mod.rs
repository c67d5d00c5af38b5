//! Which transforms belong to which picture, and where the picture therefore lies.
//!
//! - [`bracket`]: frames wait until poses lie about their time, and are placed.
//! - [`clock`]: from a device's ticks and the host's stamps to when something was measured.
//! - [`extent`]: the voxels that slices will reach.
//! - [`graph`]: the way from the image to the world through transforms that are known by name.
//! - [`history`]: a station's poses by their time, and where it was between them.
//! - [`pairing`]: pictures and transforms of one stamp → posed slices.
//! - [`mod@survey`]: a walk over a recording's transforms before its pictures are looked at.

pub mod bracket;
pub mod clock;
pub mod extent;
pub mod graph;
pub mod history;
pub mod pairing;
pub mod survey;

pub use graph::{NoPath, Route};
pub use pairing::{Paired, Pairing, PairingOptions};
pub use survey::{FramePose, Survey, survey};
