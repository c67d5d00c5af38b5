//! Geometry and least squares. Knows nothing of devices or volumes.
//!
//! - [`frames`]: transforms that carry the names of the frames they map between; mismatched frames do not compile.
//! - [`arm`]: the 3-DOF arm, from its joints' counts to poses and back.
//! - [`named`]: constant transforms between frames that are known by name, as files hold them.
//! - [`region`]: the part of a picture that is data: rectangle and fan.
//! - [`file`](mod@file): the versioned calibration file.
//! - [`keys`]: TOML files read key by key, for every file of ours.

pub mod arm;
pub mod file;
pub mod frames;
pub mod keys;
pub mod named;
pub mod region;
