//! Trajectories: where the image plane lies at each frame.
//!
//! All are centred, so that the middle of the sweep and of the picture lies near the world's origin. At rest u runs along world x, v along world y and
//! the sweep along world z.

use calibration::frames::{Transform, World};
use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::PhantomError;
use super::elementary::{exp, sin_cos};
use super::random::{Draws, Purpose};

/// More frames than a day at 30 Hz holds need no phantom.
const MAX_FRAMES: u32 = 3_000_000;

/// Length along the sweep over which the hand forgets its deviation, mm (σ of the smoothing).
const HAND_MEMORY_MM: f64 = 4.2;
/// Standard deviation of the hand's sideways wobble along world x and y, mm.
const HAND_WOBBLE_MM: f64 = 0.8;
/// Standard deviation of the hand's tilt about each world axis, rad (3°).
const HAND_TILT: f64 = 0.052;
/// Relative standard deviation of the hand's speed.
const HAND_SPEED: f64 = 0.35;

/// The picture's plane, in mm: the origin at the picture's middle, x along u, y along v, z the direction of increasing plane distance.
///
/// Unlike [`calibration::frames::Image`] it has no pixels, so that maps from it to the world are rigid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PictureMm;

impl calibration::frames::Frame for PictureMm {
    const NAME: &'static str = "PictureMm";
}

/// How the probe moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// Equal steps along the plane's normal.
    Parallel,
    /// Equal tilts about an axis parallel to u, which lies the given distance (mm) above the picture's middle.
    Fan {
        /// From the axis to the picture's middle, mm.
        axis_distance_mm: f64,
    },
    /// By hand: a smoothed random walk of position and tilt, with uneven speed.
    Freehand,
}

/// One pose a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    poses: Vec<Transform<World, PictureMm>>,
}

impl Trajectory {
    /// `frames` poses of a motion whose neighbouring slices lie `gap_mm` apart on average (fan: along the arc through the picture's middle).
    ///
    /// The seed matters to [`Motion::Freehand`] only.
    ///
    /// # Errors
    /// [`PhantomError`] without frames or with more than three million, when a length is not positive and finite, and when a fan would turn by more than π.
    pub fn new(motion: Motion, frames: u32, gap_mm: f64, seed: u64) -> Result<Self, PhantomError> {
        if frames == 0 || frames > MAX_FRAMES {
            return Err(PhantomError::Frames { frames, limit: MAX_FRAMES });
        }
        PhantomError::check_length("the gap between slices", gap_mm)?;
        let from_middle = |frame: u32| f64::from(frame) - 0.5 * f64::from(frames - 1);
        let poses = match motion {
            Motion::Parallel => (0..frames)
                .map(|frame| DAffine3::from_translation(DVec3::new(0.0, 0.0, from_middle(frame) * gap_mm)))
                .collect(),
            Motion::Fan { axis_distance_mm } => {
                PhantomError::check_length("the distance of the fan's axis", axis_distance_mm)?;
                let step = gap_mm / axis_distance_mm;
                let opening = step * f64::from(frames - 1);
                if opening > std::f64::consts::PI {
                    return Err(PhantomError::FanTurnsOver { degrees: opening.to_degrees() });
                }
                (0..frames).map(|frame| fan_pose(from_middle(frame) * step, axis_distance_mm)).collect()
            }
            Motion::Freehand => freehand(frames, gap_mm, seed),
        };
        Ok(Self { poses: poses.into_iter().map(Transform::from_affine).collect() })
    }

    /// Number of poses, at least 1.
    pub fn frames(&self) -> u32 {
        // At most MAX_FRAMES by construction.
        self.poses.len() as u32
    }

    /// Where the picture lies at a frame: a rotation and a translation in mm.
    ///
    /// # Panics
    /// When there is no such frame.
    pub fn world_from_picture(&self, frame: u32) -> Transform<World, PictureMm> {
        self.poses[frame as usize]
    }
}

/// Tilted by `angle` (rad) about an axis along x through y = −distance; a positive angle sweeps towards +z.
fn fan_pose(angle: f64, distance: f64) -> DAffine3 {
    let (sin, cos) = sin_cos(angle);
    DAffine3 {
        matrix3: DMat3::from_cols(DVec3::X, DVec3::new(0.0, cos, sin), DVec3::new(0.0, -sin, cos)),
        translation: DVec3::new(0.0, distance * (cos - 1.0), distance * sin),
    }
}

/// A hand's sweep along z: its mean speed is exact, wobble, tilt and speed wander smoothly about their means.
fn freehand(frames: u32, gap_mm: f64, seed: u64) -> Vec<DAffine3> {
    let mut draws = Draws::new(seed, Purpose::Trajectory, 0);
    let count = frames as usize;
    let [x, y, pitch, yaw, roll, speed] =
        std::array::from_fn(|_| smooth_noise(&mut draws, count, HAND_MEMORY_MM / gap_mm));
    // The hand never stops or turns back: that is another trajectory.
    let steps: Vec<f64> = speed.iter().skip(1).map(|s| (1.0 + HAND_SPEED * s).max(0.2)).collect();
    let length = gap_mm * f64::from(frames - 1);
    let scale = if steps.is_empty() { 0.0 } else { length / steps.iter().sum::<f64>() };
    let mut travelled = 0.0;
    (0..count)
        .map(|i| {
            if i > 0 {
                travelled += steps[i - 1] * scale;
            }
            // (1, v/2) normalised turns by 2 atan(|v|/2): a rotation by square roots alone, the same bits everywhere.
            let half = DVec3::new(pitch[i], yaw[i], roll[i]) * (0.5 * HAND_TILT);
            let norm = (1.0 + half.length_squared()).sqrt();
            let turn = DQuat::from_xyzw(half.x / norm, half.y / norm, half.z / norm, 1.0 / norm);
            DAffine3 {
                matrix3: DMat3::from_quat(turn),
                translation: DVec3::new(HAND_WOBBLE_MM * x[i], HAND_WOBBLE_MM * y[i], travelled - 0.5 * length),
            }
        })
        .collect()
}

/// White noise smoothed by a Gaussian of `memory` samples, of variance 1 at every sample.
fn smooth_noise(draws: &mut Draws, count: usize, memory: f64) -> Vec<f64> {
    // Very fine sweeps would smooth over thousands of samples to no visible end.
    let memory = memory.clamp(0.25, 400.0);
    let reach = (4.0 * memory).ceil() as usize;
    let weights: Vec<f64> = (0..=2 * reach)
        .map(|k| {
            let distance = (k as f64 - reach as f64) / memory;
            exp(-0.5 * distance * distance)
        })
        .collect();
    let norm = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
    let white: Vec<f64> = (0..count + 2 * reach).map(|_| draws.normal()).collect();
    white
        .windows(weights.len())
        .map(|window| window.iter().zip(&weights).map(|(x, w)| x * w).sum::<f64>() / norm)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(motion: Motion, frames: u32, gap: f64, seed: u64) -> Vec<DAffine3> {
        let trajectory = Trajectory::new(motion, frames, gap, seed).unwrap();
        assert_eq!(trajectory.frames(), frames);
        (0..frames).map(|i| trajectory.world_from_picture(i).affine()).collect()
    }

    const MOTIONS: [Motion; 3] = [Motion::Parallel, Motion::Fan { axis_distance_mm: 40.0 }, Motion::Freehand];

    #[test]
    fn mean_gap_is_as_asked_and_slices_advance_along_their_normal() {
        for motion in MOTIONS {
            for (frames, gap) in [(120, 0.35), (30, 1.5), (300, 0.1)] {
                let poses = all(motion, frames, gap, 5);
                // Distance of each middle from the plane before it.
                let gaps: Vec<f64> =
                    poses.windows(2).map(|w| (w[1].translation - w[0].translation).dot(w[0].matrix3.z_axis)).collect();
                let mean = gaps.iter().sum::<f64>() / gaps.len() as f64;
                assert!((mean / gap - 1.0).abs() < 0.03, "{motion:?} {frames} {gap}: {mean}");
                assert!(gaps.iter().all(|g| *g > 0.0), "{motion:?}");
            }
        }
    }

    #[test]
    fn rotations_are_orthonormal_and_right_handed() {
        for motion in MOTIONS {
            for pose in all(motion, 200, 0.3, 9) {
                let gram = pose.matrix3.transpose() * pose.matrix3 - DMat3::IDENTITY;
                assert!(gram.to_cols_array().iter().all(|x| x.abs() < 1e-14), "{motion:?}");
                assert!((pose.matrix3.determinant() - 1.0).abs() < 1e-14, "{motion:?}");
            }
        }
    }

    #[test]
    fn sweeps_are_centred_and_bounded() {
        for motion in MOTIONS {
            for seed in 0..10 {
                let poses = all(motion, 120, 0.35, seed);
                let half = 0.5 * 119.0 * 0.35;
                assert!((poses[0].translation.z + poses[119].translation.z).abs() < 1e-9, "{motion:?}");
                for pose in poses {
                    assert!(pose.translation.z.abs() <= half + 1e-9, "{motion:?}");
                    // Five standard deviations of wobble; the fan's arc falls by its sagitta at most.
                    assert!(pose.translation.x.abs() < 4.0 && pose.translation.y.abs() < 6.0, "{motion:?}");
                }
            }
        }
    }

    #[test]
    fn a_fan_keeps_its_axis_in_every_plane() {
        for pose in all(Motion::Fan { axis_distance_mm: 40.0 }, 80, 0.8, 0) {
            let axis = pose.transform_point3(DVec3::new(3.0, -40.0, 0.0));
            assert!(axis.distance(DVec3::new(3.0, -40.0, 0.0)) < 1e-12);
        }
    }

    #[test]
    fn the_hand_wanders_smoothly_and_by_its_seed() {
        let poses = all(Motion::Freehand, 2000, 0.35, 1);
        let tilt = |p: &DAffine3| p.matrix3.z_axis.x.asin();
        let variance = poses.iter().map(|p| tilt(p).powi(2)).sum::<f64>() / 2000.0;
        assert!((0.6..1.4).contains(&(variance.sqrt() / HAND_TILT)), "{}", variance.sqrt());
        for pair in poses.windows(2) {
            // Standard deviation of a step: σ √(2 − 2 e^{−1/4·12²}) = 0.059 σ; six of them.
            assert!((tilt(&pair[1]) - tilt(&pair[0])).abs() < 0.36 * HAND_TILT);
        }
        assert_eq!(all(Motion::Freehand, 50, 0.35, 1), all(Motion::Freehand, 50, 0.35, 1));
        assert_ne!(all(Motion::Freehand, 50, 0.35, 1), all(Motion::Freehand, 50, 0.35, 2));
    }

    #[test]
    fn one_frame_is_a_sweep_and_none_is_refused_with_a_sentence() {
        assert_eq!(all(Motion::Parallel, 1, 1.0, 0)[0], DAffine3::IDENTITY);
        assert_eq!(all(Motion::Freehand, 1, 1.0, 0)[0].translation.z, 0.0);
        for (motion, frames, gap) in [
            (Motion::Parallel, 0, 1.0),
            (Motion::Parallel, u32::MAX, 1.0),
            (Motion::Freehand, 10, 0.0),
            (Motion::Freehand, 10, f64::NAN),
            (Motion::Fan { axis_distance_mm: -1.0 }, 10, 1.0),
            (Motion::Fan { axis_distance_mm: 10.0 }, 100, 1.0),
        ] {
            let error = Trajectory::new(motion, frames, gap, 0).unwrap_err().to_string();
            assert!(error.len() > 30, "{error}");
        }
    }
}
