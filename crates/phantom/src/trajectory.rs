//! Trajectories: the pose of the image plane at each frame.
//!
//! All are centred, so that the middle of the sweep and of the image lies near the world's
//! origin. At rest u runs along world x, v along world y and the sweep along world z.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DMat3, DVec3};

use sonoweave_core::frames::{Transform, World};

mod hand;

pub(super) use hand::small_turn;

use super::PhantomError;
use super::elementary::sin_cos;
use super::random::{Draws, Purpose};

/// More frames than a day at 30 Hz would be useless for a phantom.
const MAX_FRAMES: u32 = 3_000_000;

/// The image plane, in mm: the origin at the image's middle, x along u, y along v, z the
/// direction of increasing plane distance.
///
/// Unlike [`sonoweave_core::frames::Image`] it has no pixels, so that maps from it to the world
/// are rigid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PictureMm;

impl sonoweave_core::frames::Frame for PictureMm {
    const NAME: &'static str = "PictureMm";
}

/// Motion of the probe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// Equal steps along the plane's normal.
    Parallel,
    /// Steps along the plane's normal, each the mean gap times a number drawn uniformly from
    /// [2/3, 4/3). This is the uneven sampling of Ohbuchi, Chen & Fuchs: gaps of σ(1 + U)/2,
    /// with a mean gap of 0.75 σ.
    Jittered,
    /// Equal tilts about an axis parallel to u, at the given distance (mm) above the image's
    /// middle.
    Fan {
        /// Distance from the axis to the image's middle, mm.
        axis_distance_mm: f64,
    },
    /// Equal turns about the image's own middle line along u. At the given distance (mm) from
    /// that line, neighbouring images lie the gap apart. Planar: every plane contains the
    /// direction of u.
    Rotation {
        /// Distance from the axis at which the gap is measured, mm; half of the image's height
        /// for its edge.
        radius_mm: f64,
    },
    /// By an arm of three joints that all turn about u. The sweep along the normal wanders
    /// along v and turns about u, with uneven speed. Nothing moves along u or tilts otherwise.
    Arm,
    /// Freehand: a smoothed random walk of position and tilt, with uneven speed.
    Freehand,
    /// Freehand, with corrections and tremor of the hand.
    Unsteady,
    /// Two parallel sweeps through the same place, the first along world z, the second along
    /// world x with u along −z. Each has half of the frames, the first one the odd frame.
    Crossing,
    /// Three unsteady sweeps through the same place: upright, turned by 90° about v, and tilted by
    /// 30° about u. Each has a third of the frames. Where they cross, they determine a probe's
    /// calibration.
    ThreeDirections,
    /// A parallel sweep that pauses in its middle for the given number of frames.
    Dwell {
        /// Frames of the pause, besides the one that arrives there.
        frames: u32,
    },
    /// A parallel sweep and the same way back: the last frame lies where the first one did.
    OutAndBack,
    /// Around a point of the world that stays in the image and moves all over its middle. The
    /// image is tilted to all sides and turned, as for calibrating a probe by this point. The
    /// gap is the distance of the probe's motion from frame to frame.
    About {
        /// The point, world mm.
        point: DVec3,
    },
}

/// Tilt and turn of an image around a point, rad.
const ABOUT_TILT: f64 = 0.3;
/// Largest distance of the point from the image's middle along u and v, mm.
const ABOUT_REACH_MM: [f64; 2] = [9.0, 9.0];

/// One pose per frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    poses: Vec<Transform<World, PictureMm>>,
}

impl Trajectory {
    /// Returns `frames` poses of a motion with neighbouring slices `gap_mm` apart on average
    /// (fan: along the arc through the image's middle).
    ///
    /// The gap is that of moving frames: a dwell's are not counted, and each sweep of two has
    /// its own. The seed affects only [`Motion::Jittered`], [`Motion::Arm`] and
    /// [`Motion::Freehand`].
    ///
    /// # Errors
    /// [`PhantomError`] without frames or with more than three million, or if a length is not
    /// positive and finite. The same if a fan would turn by more than π or a rotation by more than
    /// 2π, or if a dwell leaves no frame for the motion.
    pub fn new(motion: Motion, frames: u32, gap_mm: f64, seed: u64) -> Result<Self, PhantomError> {
        if frames == 0 || frames > MAX_FRAMES {
            return Err(PhantomError::Frames { frames, limit: MAX_FRAMES });
        }
        PhantomError::check_length("the gap between slices", gap_mm)?;
        let from_middle = |frame: u32| f64::from(frame) - 0.5 * f64::from(frames - 1);
        let poses = match motion {
            Motion::Parallel => parallel(frames, gap_mm),
            Motion::Jittered => jittered(frames, gap_mm, seed),
            Motion::Fan { axis_distance_mm } => {
                PhantomError::check_length("the distance of the fan's axis", axis_distance_mm)?;
                let step = gap_mm / axis_distance_mm;
                let opening = step * f64::from(frames - 1);
                if opening > PI {
                    return Err(PhantomError::FanTurnsOver { degrees: opening.to_degrees() });
                }
                (0..frames).map(|frame| fan_pose(from_middle(frame) * step, axis_distance_mm)).collect()
            }
            Motion::Rotation { radius_mm } => {
                PhantomError::check_length("the radius of the rotation", radius_mm)?;
                let step = gap_mm / radius_mm;
                let opening = step * f64::from(frames - 1);
                if opening > TAU {
                    return Err(PhantomError::TurnsOver { degrees: opening.to_degrees() });
                }
                (0..frames).map(|frame| DAffine3::from_mat3(turn_about_u(from_middle(frame) * step))).collect()
            }
            Motion::Arm => hand::arm(frames, gap_mm, seed),
            Motion::Freehand => hand::freehand(frames, gap_mm, seed),
            Motion::Unsteady => hand::unsteady(frames, gap_mm, seed),
            Motion::Crossing => {
                let second = frames / 2;
                let across = DMat3::from_cols(DVec3::NEG_Z, DVec3::Y, DVec3::X);
                let mut poses = parallel(frames - second, gap_mm);
                // A quarter turn about v is exact: z becomes x.
                let turned = |pose: DAffine3| DAffine3 { matrix3: across, translation: across * pose.translation };
                poses.extend(parallel(second, gap_mm).into_iter().map(turned));
                poses
            }
            Motion::ThreeDirections => {
                let across = DMat3::from_cols(DVec3::NEG_Z, DVec3::Y, DVec3::X);
                let [sine, cosine] = [0.5, 0.75_f64.sqrt()];
                let tilted = DMat3::from_cols(DVec3::X, DVec3::new(0.0, cosine, sine), DVec3::new(0.0, -sine, cosine));
                let sweep = |(number, turn): (u32, DMat3)| {
                    let count = (frames + number) / 3;
                    let seed = seed.wrapping_add(u64::from(number));
                    let sweep = if count > 0 { hand::unsteady(count, gap_mm, seed) } else { Vec::new() };
                    sweep.into_iter().map(move |pose| DAffine3::from_mat3(turn) * pose)
                };
                [(2, DMat3::IDENTITY), (1, across), (0, tilted)].into_iter().flat_map(sweep).collect()
            }
            Motion::Dwell { frames: dwell } => {
                if dwell >= frames {
                    return Err(PhantomError::Dwell { dwell, frames });
                }
                let mut poses = parallel(frames - dwell, gap_mm);
                let middle = poses.len() / 2;
                let stand = std::iter::repeat_n(poses[middle], dwell as usize);
                poses.splice(middle..middle, stand);
                poses
            }
            Motion::About { point } => (0..frames).map(|frame| about(point, f64::from(frame) * gap_mm)).collect(),
            Motion::OutAndBack => {
                let mut poses = parallel(frames.div_ceil(2), gap_mm);
                // The turning point appears twice if the number of frames is even.
                let back: Vec<DAffine3> = poses.iter().rev().skip(frames as usize % 2).copied().collect();
                poses.extend(back);
                poses
            }
        };
        Ok(Self { poses: poses.into_iter().map(Transform::from_affine).collect() })
    }

    /// Returns the number of poses, at least 1.
    pub fn frames(&self) -> u32 {
        // At most MAX_FRAMES by construction.
        self.poses.len() as u32
    }

    /// Returns the pose of the image plane at a frame: a rotation and a translation in mm.
    ///
    /// # Panics
    /// If there is no such frame.
    pub fn world_from_picture(&self, frame: u32) -> Transform<World, PictureMm> {
        self.poses[frame as usize]
    }
}

/// Returns equal steps along z.
fn parallel(frames: u32, gap_mm: f64) -> Vec<DAffine3> {
    let from_middle = |frame: u32| f64::from(frame) - 0.5 * (f64::from(frames) - 1.0);
    (0..frames).map(|frame| DAffine3::from_translation(DVec3::new(0.0, 0.0, from_middle(frame) * gap_mm))).collect()
}

/// Returns steps along z of the gap times a number drawn from [2/3, 4/3).
fn jittered(frames: u32, gap_mm: f64, seed: u64) -> Vec<DAffine3> {
    let mut draws = Draws::new(seed, Purpose::Trajectory, 0);
    let mut at = vec![0.0];
    for frame in 1..frames as usize {
        at.push(at[frame - 1] + gap_mm * draws.uniform(2.0 / 3.0, 4.0 / 3.0));
    }
    let middle = 0.5 * at[at.len() - 1];
    at.into_iter().map(|z| DAffine3::from_translation(DVec3::new(0.0, 0.0, z - middle))).collect()
}

/// Returns the pose around a point after the given distance of motion, mm.
fn about(point: DVec3, way_mm: f64) -> DAffine3 {
    // The lengths are nearly incommensurable: the image does not return to an earlier pose.
    let wave = |length_mm: f64, phase: f64| sin_cos((way_mm / length_mm + phase).fract() * TAU).0;
    let tilt = DVec3::new(ABOUT_TILT * wave(37.0, 0.1), ABOUT_TILT * wave(53.0, 0.3), ABOUT_TILT * wave(43.0, 0.7));
    let matrix3 = small_turn(tilt * 0.5);
    let at = DVec3::new(ABOUT_REACH_MM[0] * wave(61.0, 0.9), ABOUT_REACH_MM[1] * wave(29.0, 0.4), 0.0);
    DAffine3 { matrix3, translation: point - matrix3 * at }
}

/// Returns a rotation about x; a positive angle turns y towards z.
fn turn_about_u(angle: f64) -> DMat3 {
    let (sin, cos) = sin_cos(angle);
    DMat3::from_cols(DVec3::X, DVec3::new(0.0, cos, sin), DVec3::new(0.0, -sin, cos))
}

/// Returns a pose tilted by `angle` (rad) about an axis along x through y = −distance; a
/// positive angle sweeps towards +z.
fn fan_pose(angle: f64, distance: f64) -> DAffine3 {
    let (sin, cos) = sin_cos(angle);
    DAffine3 { matrix3: turn_about_u(angle), translation: DVec3::new(0.0, distance * (cos - 1.0), distance * sin) }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::hand::HAND_TILT;
    use super::*;

    fn all(motion: Motion, frames: u32, gap: f64, seed: u64) -> Vec<DAffine3> {
        let trajectory = Trajectory::new(motion, frames, gap, seed).unwrap();
        assert_eq!(trajectory.frames(), frames);
        (0..frames).map(|i| trajectory.world_from_picture(i).affine()).collect()
    }

    /// Motions that sweep along z from one end to the other.
    const MOTIONS: [Motion; 5] =
        [Motion::Parallel, Motion::Jittered, Motion::Fan { axis_distance_mm: 40.0 }, Motion::Arm, Motion::Freehand];

    #[test]
    fn mean_gap_is_as_requested_along_normal() {
        for motion in MOTIONS {
            for (frames, gap) in [(120, 0.35), (30, 1.5), (300, 0.1)] {
                let poses = all(motion, frames, gap, 5);
                // Distance of each middle from the plane before it.
                let gaps: Vec<f64> =
                    poses.windows(2).map(|w| (w[1].translation - w[0].translation).dot(w[0].matrix3.z_axis)).collect();
                let mean = gaps.iter().sum::<f64>() / gaps.len() as f64;
                // The jitter's mean over 29 gaps has a standard error of 3.6 %.
                let slack = if motion == Motion::Jittered { 0.11 } else { 0.03 };
                assert!((mean / gap - 1.0).abs() < slack, "{motion:?} {frames} {gap}: {mean}");
                assert!(gaps.iter().all(|g| *g > 0.0), "{motion:?}");
            }
        }
    }

    #[test]
    fn rotations_are_orthonormal_and_right_handed() {
        let others = [
            Motion::Rotation { radius_mm: 20.0 },
            Motion::Crossing,
            Motion::ThreeDirections,
            Motion::Dwell { frames: 30 },
            Motion::OutAndBack,
            Motion::About { point: DVec3::ONE },
        ];
        for motion in MOTIONS.into_iter().chain(others) {
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
                    // The jitter's length varies: five standard deviations.
                    let slack = if motion == Motion::Jittered { 0.5 * 5.0 * 0.19 * 0.35 * 11.0 } else { 1e-9 };
                    assert!(pose.translation.z.abs() <= half + slack, "{motion:?}");
                    // Five standard deviations of wobble; the fan's arc falls at most by its
                    // sagitta.
                    assert!(pose.translation.x.abs() < 4.0 && pose.translation.y.abs() < 6.0, "{motion:?}");
                }
            }
        }
    }

    #[test]
    fn fan_planes_contain_the_axis() {
        for pose in all(Motion::Fan { axis_distance_mm: 40.0 }, 80, 0.8, 0) {
            let axis = pose.transform_point3(DVec3::new(3.0, -40.0, 0.0));
            assert!(axis.distance(DVec3::new(3.0, -40.0, 0.0)) < 1e-12);
        }
    }

    #[test]
    fn motion_about_point_keeps_it_in_image() {
        let point = DVec3::new(3.0, -4.0, 7.0);
        let poses = all(Motion::About { point }, 300, 1.0, 0);
        let seen: Vec<DVec3> = poses.iter().map(|pose| pose.inverse().transform_point3(point)).collect();
        assert!(seen.iter().all(|at| at.z.abs() < 1e-12 && at.x.abs() < 9.1 && at.y.abs() < 9.1));
        for axis in 0..2 {
            let most = seen.iter().map(|at| at[axis]).fold(f64::NEG_INFINITY, f64::max);
            let least = seen.iter().map(|at| at[axis]).fold(f64::INFINITY, f64::min);
            assert!(most > 8.0 && least < -8.0, "{axis}");
        }
        for turned in
            [|p: &DAffine3| p.matrix3.z_axis.x, |p: &DAffine3| p.matrix3.z_axis.y, |p: &DAffine3| p.matrix3.x_axis.y]
        {
            let most = poses.iter().map(turned).fold(0.0, |most: f64, x| most.max(x.abs()));
            assert!(most > 0.2 && most < 0.4, "{most}");
        }
    }

    #[test]
    fn freehand_motion_is_smooth_and_seeded() {
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
    fn one_frame_is_a_sweep_and_zero_is_refused() {
        assert_eq!(all(Motion::Parallel, 1, 1.0, 0)[0], DAffine3::IDENTITY);
        assert_eq!(all(Motion::Freehand, 1, 1.0, 0)[0].translation.z, 0.0);
        for (motion, frames, gap) in [
            (Motion::Parallel, 0, 1.0),
            (Motion::Parallel, u32::MAX, 1.0),
            (Motion::Freehand, 10, 0.0),
            (Motion::Freehand, 10, f64::NAN),
            (Motion::Fan { axis_distance_mm: -1.0 }, 10, 1.0),
            (Motion::Rotation { radius_mm: 0.0 }, 10, 1.0),
            (Motion::Rotation { radius_mm: 10.0 }, 65, 1.0),
            (Motion::Dwell { frames: 10 }, 10, 1.0),
            (Motion::Fan { axis_distance_mm: 10.0 }, 100, 1.0),
        ] {
            let error = Trajectory::new(motion, frames, gap, 0).unwrap_err().to_string();
            assert!(error.len() > 30, "{error}");
        }
    }

    #[test]
    fn unsteady_hand_adds_corrections_and_tremor_to_freehand_sweep() {
        let [steady, unsteady] = [Motion::Freehand, Motion::Unsteady].map(|motion| all(motion, 4000, 0.05, 3));
        let shifts: Vec<DVec3> = steady.iter().zip(&unsteady).map(|(a, b)| b.translation - a.translation).collect();
        let turns: Vec<f64> = steady
            .iter()
            .zip(&unsteady)
            .map(|(a, b)| DQuat::from_mat3(&(b.matrix3 * a.matrix3.transpose())).to_scaled_axis().length_squared())
            .collect();
        let rms = |sum: f64| (sum / 4000.0).sqrt();
        let shift = rms(shifts.iter().map(|shift| shift.length_squared()).sum());
        let turn = rms(turns.iter().sum()).to_degrees();
        // Three axes of 0.055 mm and 0.10°.
        assert!((shift / 0.095 - 1.0).abs() < 0.25 && (turn / 0.181 - 1.0).abs() < 0.25, "{shift} {turn}");
        // Second differences over 0.05 mm are those of the tremor: (2 π 0.05 / 1.2)² of it.
        let bend = rms(shifts.windows(3).map(|w| (w[2] - 2.0 * w[1] + w[0]).length_squared()).sum());
        assert!((0.001..0.006).contains(&bend), "{bend}");
        // The corrections and the tremor do not depend on the gap.
        let coarse: Vec<DVec3> = [Motion::Freehand, Motion::Unsteady]
            .map(|motion| all(motion, 401, 0.5, 3))
            .map(|poses| poses[200].translation)
            .to_vec();
        let fine = [Motion::Freehand, Motion::Unsteady].map(|motion| all(motion, 4001, 0.05, 3)[2000].translation);
        assert!(((coarse[1] - coarse[0]) - (fine[1] - fine[0])).length() < 1e-9);
    }

    #[test]
    fn jittered_gaps_are_uniform_over_range() {
        let poses = all(Motion::Jittered, 3001, 0.3, 4);
        let gaps: Vec<f64> = poses.windows(2).map(|w| (w[1].translation.z - w[0].translation.z) / 0.3).collect();
        assert!(gaps.iter().all(|g| (2.0 / 3.0 - 1e-9..4.0 / 3.0 + 1e-9).contains(g)));
        let mean = gaps.iter().sum::<f64>() / 3000.0;
        let variance = gaps.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / 3000.0;
        // (2/3)²/12 for uniform numbers; standard errors 0.0035 and 1.6 %.
        assert!((mean - 1.0).abs() < 0.015 && (variance * 27.0 - 1.0).abs() < 0.08, "{mean} {variance}");
        assert_ne!(all(Motion::Jittered, 50, 0.3, 4), all(Motion::Jittered, 50, 0.3, 5));
    }

    #[test]
    fn arm_and_rotation_are_planar() {
        for seed in 0..5 {
            for motion in [Motion::Arm, Motion::Rotation { radius_mm: 24.0 }] {
                for pose in all(motion, 300, 0.35, seed) {
                    assert!((pose.matrix3.x_axis - DVec3::X).length() < 1e-12 && pose.translation.x.abs() < 1e-12);
                    assert!(pose.matrix3.y_axis.x.abs() < 1e-12 && pose.matrix3.z_axis.x.abs() < 1e-12);
                }
            }
        }
        // The arm does turn and wander, depending on the seed.
        let arm = all(Motion::Arm, 2000, 0.35, 1);
        let spread = |f: fn(&DAffine3) -> f64| (arm.iter().map(|p| f(p).powi(2)).sum::<f64>() / 2000.0).sqrt();
        assert!((0.06..0.15).contains(&spread(|p| p.matrix3.z_axis.y)) && spread(|p| p.translation.y) > 0.4);
        assert_ne!(all(Motion::Arm, 50, 0.35, 1), all(Motion::Arm, 50, 0.35, 2));
    }

    #[test]
    fn rotation_turns_about_image_middle_by_gap_at_radius() {
        let poses = all(Motion::Rotation { radius_mm: 24.0 }, 120, 0.35, 0);
        for pair in poses.windows(2) {
            let [a, b] = [&pair[0], &pair[1]].map(|p| p.transform_point3(DVec3::new(1.0, 24.0, 0.0)));
            assert!((a.distance(b) - 0.35).abs() < 1e-5 && pair[0].translation == DVec3::ZERO);
        }
        let opening = poses[0].matrix3.z_axis.angle_between(poses[119].matrix3.z_axis);
        assert!((opening - 119.0 * 0.35 / 24.0).abs() < 1e-9);
    }

    #[test]
    fn crossing_sweeps_cross_at_right_angle_in_origin() {
        for frames in [1, 2, 41, 60] {
            let poses = all(Motion::Crossing, frames, 0.5, 0);
            let (first, second) = poses.split_at(poses.len().div_ceil(2));
            assert_eq!(first, all(Motion::Parallel, first.len() as u32, 0.5, 0));
            for (k, pose) in second.iter().enumerate() {
                assert_eq!(pose.matrix3.z_axis, DVec3::X);
                let x = (k as f64 - 0.5 * (second.len() as f64 - 1.0)) * 0.5;
                assert_eq!(pose.translation, DVec3::new(x, 0.0, 0.0));
            }
        }
    }

    #[test]
    fn three_sweeps_have_three_directions() {
        for frames in [1, 2, 60, 61, 62] {
            let poses = all(Motion::ThreeDirections, frames, 0.5, 4);
            assert_eq!(poses.len(), frames as usize);
            if frames < 60 {
                continue;
            }
            let third = frames as usize / 3;
            let middles = [0.5, 1.5, 2.5].map(|sweep| poses[(sweep * third as f64) as usize].matrix3.z_axis);
            for (a, b, degrees) in [(0, 1, 90.0), (0, 2, 30.0), (1, 2, 90.0)] {
                let angle = middles[a].dot(middles[b]).acos().to_degrees();
                // The hand's own tilts.
                assert!((angle - degrees).abs() < 15.0, "{a} {b}: {angle}");
            }
        }
    }

    #[test]
    fn dwell_pauses_and_way_back_retraces_way_out() {
        for (frames, dwell) in [(50, 20), (31, 1), (2, 1), (40, 0)] {
            let poses = all(Motion::Dwell { frames: dwell }, frames, 0.4, 0);
            let still = poses.windows(2).filter(|w| w[0] == w[1]).count();
            assert_eq!(still, dwell as usize);
            let mut moving = poses.clone();
            moving.dedup();
            assert_eq!(moving, all(Motion::Parallel, frames - dwell, 0.4, 0));
        }
        for frames in [1, 2, 30, 31] {
            let poses = all(Motion::OutAndBack, frames, 0.4, 0);
            assert!(poses.iter().eq(poses.iter().rev()));
            let out = frames.div_ceil(2);
            assert_eq!(poses[..out as usize], all(Motion::Parallel, out, 0.4, 0));
        }
    }
}
