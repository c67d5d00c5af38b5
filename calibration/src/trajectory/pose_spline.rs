//! Pose and velocity of the probe at any time between a tracker's samples.

use glam::{DAffine3, DQuat, DVec3};

use super::spline::Spline;
use super::{LONGEST_GAP_S, PoseSample};
use crate::error::CalibrationError;

/// Poses as a smooth function of time.
#[derive(Debug, Clone)]
pub struct PoseSpline {
    /// The quaternion's four numbers, normalised after interpolation, and the position.
    track: Spline<7>,
}

impl PoseSpline {
    /// Interpolates samples in any order.
    ///
    /// # Errors
    /// [`CalibrationError`] for NaN or infinity.
    pub fn new(samples: &[PoseSample]) -> Result<Self, CalibrationError> {
        let mut sorted: Vec<&PoseSample> = samples.iter().collect();
        sorted.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let mut before = DQuat::IDENTITY;
        let numbers = sorted.into_iter().map(|sample| {
            // A quaternion and its opposite are the same orientation: take the nearer one.
            let turn = if sample.rotation.dot(before) < 0.0 { -sample.rotation } else { sample.rotation };
            before = turn;
            let p = sample.position_mm;
            (sample.time_s, [turn.x, turn.y, turn.z, turn.w, p.x, p.y, p.z])
        });
        Ok(Self { track: Spline::new(numbers.collect(), LONGEST_GAP_S)? })
    }

    /// Returns the first and last time, s.
    pub fn span_s(&self) -> Option<[f64; 2]> {
        self.track.span_s()
    }

    /// Returns the probe's pose; `None` without samples around the time.
    pub fn at(&self, time_s: f64) -> Option<DAffine3> {
        let ([x, y, z, w, px, py, pz], _) = self.track.at(time_s)?;
        Some(DAffine3::from_rotation_translation(DQuat::from_xyzw(x, y, z, w).normalize(), DVec3::new(px, py, pz)))
    }

    /// Returns the velocity of a point of the probe in the tracker's frame, mm/s.
    pub fn velocity(&self, time_s: f64, point_mm: DVec3) -> Option<DVec3> {
        let ([x, y, z, w, ..], [dx, dy, dz, dw, vx, vy, vz]) = self.track.at(time_s)?;
        let turn = DQuat::from_xyzw(x, y, z, w);
        let turning = DQuat::from_xyzw(dx, dy, dz, dw) * turn.conjugate() * (2.0 / turn.length_squared());
        let spin = DVec3::new(turning.x, turning.y, turning.z);
        Some(DVec3::new(vx, vy, vz) + spin.cross(turn.normalize() * point_mm))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(time_s: f64) -> PoseSample {
        let turn = DVec3::new(0.3 * time_s, (2.0 * time_s).sin(), 3.0);
        // Every other sample uses the opposite quaternion.
        let sign = if (time_s * 50.0).round() % 2.0 == 0.0 { 1.0 } else { -1.0 };
        let rotation = DQuat::from_scaled_axis(turn) * sign;
        PoseSample { time_s, rotation, position_mm: DVec3::new(10.0 * time_s, 5.0 * (3.0 * time_s).cos(), 0.0) }
    }

    #[test]
    fn interpolated_pose_and_velocity_match_motion() {
        let samples: Vec<PoseSample> = (0..100).map(|i| pose(0.02 * f64::from(i))).collect();
        let poses = PoseSpline::new(&samples).unwrap();
        let point = DVec3::new(3.0, -20.0, 80.0);
        let truth = |t: f64| pose(t).rotation * point + pose(t).position_mm;
        for at in (0..160).map(|i| 0.2 + 0.0101 * f64::from(i)) {
            assert!((poses.at(at).unwrap().transform_point3(point) - truth(at)).length() < 1e-3);
            let velocity = (truth(at + 1e-5) - truth(at - 1e-5)) / 2e-5;
            assert!((poses.velocity(at, point).unwrap() - velocity).length() < 0.1, "{at}");
        }
        assert!(poses.at(-0.01).is_none() && poses.at(2.0).is_none());
    }
}
