//! Geometry and least squares. Knows nothing of devices or volumes.
//!
//! - [`frames`]: transforms that carry the names of the frames they map between; mismatched frames do not compile.
//! - [`arm`]: the 3-DOF arm, from its joints' counts to poses and back.
//! - [`landmarks`]: where a phantom is held, from landmarks that a stylus touched.
//! - [`least_squares`](mod@least_squares): what numbers explain measurements best, how sure they are, and what the measurements do not say.
//! - [`named`]: constant transforms between frames that are known by name, as files hold them.
//! - [`phantom`]: what a phantom consists of: wires and landmarks.
//! - [`pivot`]: where a stylus's tip is.
//! - [`statistics`]: numbers that say how others are spread.
//! - [`picture`]: a grey picture as it lies in memory.
//! - [`probe`]: where the image plane is, from dots of wires.
//! - [`region`]: the part of a picture that is data: rectangle and fan.
//! - [`file`](mod@file): the versioned calibration file.
//! - [`tracker`]: how good a tracker is where it stands: noise, and metal that bends its field.
//! - [`latency`]: how late the tracker is against the video.
//! - [`keys`]: TOML files read key by key, for every file of ours.

pub mod arm;
pub mod file;
pub mod frames;
pub mod keys;
pub mod landmarks;
pub mod latency;
pub mod least_squares;
pub mod named;
#[cfg(test)]
mod noise;
pub mod phantom;
pub mod picture;
pub mod pivot;
pub mod probe;
pub mod region;
mod rest;
pub mod statistics;
pub mod tracker;
