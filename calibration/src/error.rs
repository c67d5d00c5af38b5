//! Errors of calibrations, by kind.
//!
//! The sentences say what failed and what to do. They begin without a subject of their own file,
//! which callers name. Other errors cross the crate's boundary in three places: files are refused
//! by [`FileError`](sonoweave_core::keys::FileError) with their lines, the choice of a preset by
//! [`PresetError`], whose names callers list, and [`least_squares`](mod@crate::least_squares)
//! alone returns its own [`Unsolved`]. [`Spline`](crate::trajectory::spline::Spline) and
//! [`align`](crate::latency::align::align), for other computations, return [`LatencyError`].

mod arm;
mod covariance;
mod crossings;
mod drift;
mod geometry;
mod jitter;
mod latency;
mod preset;
mod pressure;
mod probe;
mod stylus;
mod tracker;

pub use arm::ArmError;
pub use covariance::CovarianceError;
pub use crossings::{CrossingsError, Motion, Sides};
pub use drift::DriftError;
pub use geometry::GeometryError;
pub use jitter::JitterError;
pub use latency::LatencyError;
pub use preset::PresetError;
pub use pressure::PressureError;
pub use probe::{Axis, ProbeError, Units};
pub use stylus::{LandmarksError, PivotError};
pub use tracker::TrackerError;

use crate::least_squares::Unsolved;

/// Reasons why a calibration fails.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// An arm's numbers, poses or touches.
    #[error(transparent)]
    Arm(#[from] ArmError),
    /// An image plane's covariance.
    #[error(transparent)]
    Covariance(#[from] CovarianceError),
    /// A check by crossing slices.
    #[error(transparent)]
    Crossings(#[from] CrossingsError),
    /// Poses that drift, or a sensor that slips, between crossing sweeps.
    #[error(transparent)]
    Drift(#[from] DriftError),
    /// A phantom's wires, landmarks or registration.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// A correction of slices by their neighbours.
    #[error(transparent)]
    Jitter(#[from] JitterError),
    /// A phantom's landmarks, as touched.
    #[error(transparent)]
    Landmarks(#[from] LandmarksError),
    /// The latency of the tracker.
    #[error(transparent)]
    Latency(#[from] LatencyError),
    /// Bytes that do not make an image.
    #[error(
        "{bytes} bytes do not make an image of {width}×{height} pixels with {stride} bytes a row; give a whole image"
    )]
    Picture {
        /// Pixels along u.
        width: usize,
        /// Pixels along v.
        height: usize,
        /// Bytes from row to row.
        stride: usize,
        /// Bytes given.
        bytes: usize,
    },
    /// A stylus's tip.
    #[error(transparent)]
    Pivot(#[from] PivotError),
    /// A preset of a calibration file.
    #[error(transparent)]
    Preset(#[from] PresetError),
    /// A correction of pressure.
    #[error(transparent)]
    Pressure(#[from] PressureError),
    /// The image plane.
    #[error(transparent)]
    Probe(#[from] ProbeError),
    /// The solver.
    #[error(transparent)]
    Solver(#[from] Unsolved),
    /// A tracker's noise or field.
    #[error(transparent)]
    Tracker(#[from] TrackerError),
}
