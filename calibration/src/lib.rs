//! Geometry, calibration and least squares. Independent of devices and volumes.
//!
//! - [`arm`]: the 3-DOF arm, from its joints' counts to poses and back.
//! - [`crossings`]: check and refinement of a calibration by crossing slices.
//! - [`drift`]: slow drift of poses, and a sensor that slips within a session, by crossing slices.
//! - [`error`]: errors by kind.
//! - [`jitter`]: correction of slices by the images of their neighbours.
//! - [`landmarks`]: registration of a phantom by landmarks that a stylus touched.
//! - [`least_squares`](mod@least_squares): parameters that explain measurements best, their
//!   covariance, and undetermined parameters.
//! - [`phantom`]: geometry of a phantom: wires and landmarks.
//! - [`pivot`]: pivot calibration of a stylus's tip.
//! - [`slices`]: slices of a scan with the probe's poses, and their crossings.
//! - [`statistics`]: spread, median and correlation of numbers.
//! - [`picture`]: a grey image in memory.
//! - [`pressure`]: compression of tissue by the probe, against a sweep with light contact.
//! - [`probe`]: calibration of the image plane, from dots of wires.
//! - [`file`](mod@file): the versioned calibration file.
//! - [`tracker`]: accuracy of a tracker in its room: noise, and field distortion by metal.
//! - [`trajectory`]: poses of the probe's sensor over time.
//! - [`latency`]: latency of the tracker against the video.

pub mod arm;
pub mod crossings;
pub mod drift;
pub mod error;
pub mod file;
pub mod jitter;
pub mod landmarks;
pub mod latency;
pub mod least_squares;
pub mod phantom;
pub mod picture;
pub mod pivot;
pub mod pressure;
pub mod probe;
mod rest;
pub mod slices;
pub mod statistics;
#[cfg(test)]
mod tests {
    pub(crate) mod coverage;
    pub(crate) mod crossing_scans;
    pub(crate) mod crossing_sweeps;
    pub(crate) mod draws;
    pub(crate) mod noise;
    pub(crate) mod speckle_scans;
    pub(crate) mod target_scans;
    pub(crate) mod wire_scans;
}
pub mod tracker;
pub mod trajectory;
