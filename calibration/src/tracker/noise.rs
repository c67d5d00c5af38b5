//! Noise of a static sensor.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::error::{CalibrationError, TrackerError};

/// Minimum number of poses: 30 give the standard deviation to 13 %.
pub const LEAST: usize = 30;
/// Minimum duration, s. A sensor on a breathing person rests between two breaths, so a shorter
/// rest proves nothing.
pub const LEAST_S: f64 = 5.0;
/// A sensor has moved if its poses spread by this multiple of the noise between successive
/// poses.
const WANDERS: f64 = 6.0;

/// Least share of the noise from one pose to the next in the whole noise of a sensor that is
/// smoothed: smoothing leaves the rest as it is. Noise with an autoregressive coefficient of 0.75
/// has this share.
pub const LEAST_FAST: f64 = 0.5;

/// Noise of a static sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// Number of poses.
    pub poses: usize,
    /// Mean position, mm.
    pub position_mm: DVec3,
    /// Standard deviation along the tracker's x, y, z, mm.
    pub position_sd_mm: DVec3,
    /// Root of the sum of their squares, mm.
    pub position_rms_mm: f64,
    /// Standard deviation of the rotation about the tracker's x, y, z, degrees.
    pub rotation_sd_deg: DVec3,
    /// Root of the sum of their squares, degrees.
    pub rotation_rms_deg: f64,
    /// Noise between successive poses, mm, which averaging removes. Less than the whole if the
    /// rest is slow.
    pub fast_rms_mm: f64,
    /// The same for the rotation, degrees.
    pub fast_rms_deg: f64,
    /// Largest distance of a pose from the mean, mm.
    pub farthest_mm: f64,
}

/// Noise of a sensor's pose, along and about each axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerNoise {
    /// Standard deviation of the position, mm.
    pub position_mm: f64,
    /// Standard deviation of the rotation, degrees.
    pub rotation_deg: f64,
}

/// Noise of a resting sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestNoise {
    /// The whole noise.
    pub whole: TrackerNoise,
    /// The part of it from one pose to the next, which averaging removes; `None` if unknown.
    pub fast: Option<TrackerNoise>,
}

impl RestNoise {
    /// Returns the fast part's share in position and rotation; 1 without noise or if unknown.
    pub fn fast_shares(&self) -> [f64; 2] {
        let Self { whole, fast } = self;
        let Some(fast) = fast else { return [1.0; 2] };
        let share = |fast: f64, whole: f64| if whole > 0.0 { fast / whole } else { 1.0 };
        [share(fast.position_mm, whole.position_mm), share(fast.rotation_deg, whole.rotation_deg)]
    }
}

impl Noise {
    /// Returns the mean standard deviations along and about an axis (root mean squares).
    pub fn per_axis(&self) -> RestNoise {
        let axes = 3.0_f64.sqrt();
        let per_axis = |mm: f64, deg: f64| TrackerNoise { position_mm: mm / axes, rotation_deg: deg / axes };
        RestNoise {
            whole: per_axis(self.position_rms_mm, self.rotation_rms_deg),
            fast: Some(per_axis(self.fast_rms_mm, self.fast_rms_deg)),
        }
    }
}

/// Estimates the noise of poses of a static sensor.
///
/// The mean rotation is the nearest rotation to the mean matrix (Moakher, SIAM J. Matrix Anal.
/// Appl. 24, 2002: the chordal mean).
///
/// `seconds` is the time from the first pose to the last.
///
/// # Errors
/// [`CalibrationError`]: too few poses, a moving sensor, or a time too short to exclude motion.
pub fn of(poses: &[DAffine3], seconds: f64) -> Result<Noise, CalibrationError> {
    if poses.len() < LEAST {
        return Err(TrackerError::FewPoses { poses: poses.len(), least: LEAST }.into());
    }
    let count = poses.len() as f64;
    let mean_mm = mean(poses.iter().map(|pose| pose.translation), count);
    let mean_rotation = mean_rotation(poses);
    let shifts: Vec<DVec3> = poses.iter().map(|pose| pose.translation - mean_mm).collect();
    let turns: Vec<DVec3> = poses
        .iter()
        .map(|pose| DQuat::from_mat3(&(pose.matrix3 * mean_rotation.transpose())).to_scaled_axis())
        .collect();
    let [position_sd_mm, rotation_sd] = [&shifts, &turns].map(|all| {
        let squares: DVec3 = all.iter().map(|v| *v * *v).sum();
        (squares / (count - 1.0)).map(f64::sqrt)
    });
    // Differences of independent noise have twice its variance (von Neumann 1941).
    let steps: f64 = shifts.windows(2).map(|pair| (pair[1] - pair[0]).length_squared()).sum();
    let fast_rms_mm = (steps / (2.0 * (count - 1.0))).sqrt();
    let farthest = |all: &[DVec3]| all.iter().map(|v| v.length()).fold(0.0, f64::max);
    let (farthest_mm, farthest_turn) = (farthest(&shifts), farthest(&turns));
    let turn_steps: f64 = turns.windows(2).map(|pair| (pair[1] - pair[0]).length_squared()).sum();
    let fast_turn = (turn_steps / (2.0 * (count - 1.0))).sqrt();
    let moved = |rms: f64, fast: f64, still: f64| rms > still.max(WANDERS * fast);
    if moved(position_sd_mm.length(), fast_rms_mm, STILL_MM) || moved(rotation_sd.length(), fast_turn, STILL_RAD) {
        return Err(
            TrackerError::Moved { farthest_mm, degrees: farthest_turn.to_degrees(), fast_mm: fast_rms_mm }.into()
        );
    }
    if seconds < LEAST_S {
        return Err(TrackerError::Short { seconds, least_s: LEAST_S }.into());
    }
    Ok(Noise {
        poses: poses.len(),
        position_mm: mean_mm,
        position_sd_mm,
        position_rms_mm: position_sd_mm.length(),
        rotation_sd_deg: rotation_sd.map(f64::to_degrees),
        rotation_rms_deg: rotation_sd.length().to_degrees(),
        fast_rms_mm,
        fast_rms_deg: fast_turn.to_degrees(),
        farthest_mm,
    })
}

/// A sensor with less spread counts as static, however small its steps, mm. Records with digits
/// of 0.01 inch repeat between two digits, and filtered ones step less than they drift.
const STILL_MM: f64 = 0.4;
/// The same for angles, with a coarsest digit of 0.01 degrees.
const STILL_RAD: f64 = 1.1e-3;

/// Returns the mean of vectors.
pub(super) fn mean(all: impl Iterator<Item = DVec3>, count: f64) -> DVec3 {
    all.sum::<DVec3>() / count
}

/// Returns the rotation nearest to the mean of the poses' matrices.
pub(super) fn mean_rotation(poses: &[DAffine3]) -> DMat3 {
    let sum = poses.iter().fold(DMat3::ZERO, |sum, pose| sum + pose.matrix3);
    let mean = DAffine3::from_mat3(sum * (1.0 / poses.len() as f64));
    // The mean of similar rotations is nearly a rotation.
    sonoweave_core::frames::nearest_rigid(&mean, 1.0).map_or(poses[0].matrix3, |(rigid, _)| rigid.matrix3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::noise::Noise as Random;

    fn lying(poses: usize, mm: f64, degrees: f64, drift_mm: f64) -> Vec<DAffine3> {
        let mut random = Random::new(5);
        let at = DAffine3::from_rotation_translation(
            DQuat::from_euler(glam::EulerRot::ZYX, 1.0, -0.4, 2.0),
            DVec3::new(210.0, -40.0, 130.0),
        );
        (0..poses)
            .map(|n| {
                let turn = DQuat::from_scaled_axis(random.vector(degrees.to_radians()));
                DAffine3 {
                    matrix3: DMat3::from_quat(turn) * at.matrix3,
                    translation: at.translation + random.vector(mm) + DVec3::X * (drift_mm * n as f64 / poses as f64),
                }
            })
            .collect()
    }

    #[test]
    fn noise_estimate_matches_simulation() {
        let found = of(&lying(20_000, 0.05, 0.03, 0.0), 400.0).unwrap();
        for k in 0..3 {
            assert!((found.position_sd_mm[k] / 0.05 - 1.0).abs() < 0.03, "{found:?}");
            assert!((found.rotation_sd_deg[k] / 0.03 - 1.0).abs() < 0.03, "{found:?}");
        }
        assert!((found.fast_rms_mm / (0.05 * 3_f64.sqrt()) - 1.0).abs() < 0.03, "{found:?}");
        assert!((found.fast_rms_deg / (0.03 * 3_f64.sqrt()) - 1.0).abs() < 0.03, "{found:?}");
        assert!(found.per_axis().fast_shares().iter().all(|share| (share - 1.0).abs() < 0.03), "{found:?}");
        assert!((found.position_mm - DVec3::new(210.0, -40.0, 130.0)).length() < 0.01);
        assert!(found.farthest_mm > 0.15 && found.farthest_mm < 0.4);
    }

    #[test]
    fn slow_drift_is_separated_from_noise() {
        let found = of(&lying(2000, 0.05, 0.03, 0.3), 40.0).unwrap();
        assert!(found.position_rms_mm > 0.12 && found.fast_rms_mm < 0.09, "{found:?}");
        let [position, rotation] = found.per_axis().fast_shares();
        assert!(position < 0.75 && (rotation - 1.0).abs() < 0.1, "{position} {rotation}");
        let whole = TrackerNoise { position_mm: 0.1, rotation_deg: 0.0 };
        assert_eq!(RestNoise { whole, fast: None }.fast_shares(), [1.0; 2]);
        assert_eq!(RestNoise { whole, fast: Some(whole) }.fast_shares(), [1.0; 2]);
    }

    #[test]
    fn repeated_last_digit_gives_zero_noise() {
        let found = of(&vec![DAffine3::from_translation(DVec3::X); 300], LEAST_S).unwrap();
        assert_eq!((found.position_rms_mm, found.rotation_rms_deg), (0.0, 0.0));
    }

    #[test]
    fn sensor_on_breathing_person_is_not_static() {
        // Sixty poses a second, a breath of four seconds.
        let sways = |mm: f64, from: u32, poses: u32| {
            let at = |n: u32| DVec3::Y * (mm * (f64::from(n) * std::f64::consts::TAU / 240.0).sin());
            let poses: Vec<_> = (from..from + poses).map(|n| DAffine3::from_translation(at(n))).collect();
            of(&poses, poses.len() as f64 / 60.0)
        };
        let refused = |from, poses| match sways(2.0, from, poses) {
            Err(CalibrationError::Tracker(error)) => error,
            other => panic!("{from}, {poses}: {other:?}"),
        };
        assert!(matches!(refused(0, 600), TrackerError::Moved { .. }));
        // Any start and any shorter duration are refused.
        for (from, poses) in (0..240).step_by(8).flat_map(|from| [(from, 40), (from, 80), (from, 299), (from, 300)]) {
            let error = refused(from, poses);
            assert!(
                matches!(error, TrackerError::Moved { .. } | TrackerError::Short { .. }),
                "{from}, {poses}: {error}"
            );
        }
        assert_eq!(refused(30, 60), TrackerError::Short { seconds: 1.0, least_s: LEAST_S });
        // Two adjacent digits of the coarsest record.
        let digit = |n: u32| DVec3::X * 0.254 * f64::from(n / 300);
        assert!(of(&(0..600).map(|n| DAffine3::from_translation(digit(n))).collect::<Vec<_>>(), 10.0).is_ok());
    }

    #[test]
    fn too_few_poses_or_moving_sensor_are_refused() {
        assert_eq!(
            of(&lying(29, 0.05, 0.03, 0.0), 10.0),
            Err(TrackerError::FewPoses { poses: 29, least: LEAST }.into())
        );
        let moved = of(&lying(500, 0.05, 0.03, 20.0), 10.0);
        let is_moved = |error: &_| matches!(error, CalibrationError::Tracker(TrackerError::Moved { .. }));
        assert!(moved.as_ref().is_err_and(is_moved), "{moved:?}");
    }
}
