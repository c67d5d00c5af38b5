//! Poses of the probe's sensor over time.
//!
//! - [`spline`]: interpolates numbers between samples at uneven times.
//! - [`pose_spline`]: the probe's pose at any time.

use glam::{DQuat, DVec3};

pub mod pose_spline;
pub mod spline;

/// Longest interval for interpolating between poses, s. At twice this, hand motions at 5 Hz
/// are lost.
pub const LONGEST_GAP_S: f64 = 0.1;

/// A pose of the probe's sensor in the tracker's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseSample {
    /// Time by the tracker's stamp, s.
    pub time_s: f64,
    /// Unit quaternion.
    pub rotation: DQuat,
    /// mm.
    pub position_mm: DVec3,
}
