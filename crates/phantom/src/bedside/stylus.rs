//! The stylus of the virtual bedside: it swings about its resting tip, or touches landmarks in
//! turn.

use clap::ValueEnum;
use glam::{DAffine3, DQuat, DVec3};
use libm::{cos, sin};

use sonoweave_core::frames::{Stylus, Transform, World};

/// Tip in the frame of the stylus's sensor, mm.
pub const TIP_MM: DVec3 = DVec3::new(1.5, -0.8, 140.0);
/// Hole beside the scanned object in which the tip rests, world mm.
const HOLE_MM: DVec3 = DVec3::new(70.0, 0.0, 40.0);

/// Amplitudes of a swing about the axes of the world, rad; y points along the resting shaft.
const SWING: DVec3 = DVec3::new(0.65, 0.5, 0.6);
/// Their frequencies, Hz; no two have a short common period.
const SWING_HZ: DVec3 = DVec3::new(0.53, 0.23, 0.37);
/// Amplitudes of the swing during a touch, as a share of [`SWING`].
const STEADY: f64 = 0.2;
/// Duration of a touch, and of the way to the next landmark, s.
const TOUCH_S: f64 = 2.0;
const WAY_S: f64 = 0.8;
/// Height of the way above the landmarks, mm.
const RAISED_MM: f64 = 25.0;

/// The movement of the stylus.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum StylusMotion {
    /// Swings to all sides about its tip, which rests in a hole
    #[default]
    Pivot,
    /// Touches the landmarks of the scene in turn, each for two seconds
    Landmarks,
}

impl StylusMotion {
    /// Returns the pose of the stylus's sensor `after_s` seconds from the begin. Without landmarks
    /// (world mm), it swings in its hole.
    pub(super) fn world_from_stylus(self, after_s: f64, landmarks: &[DVec3]) -> Transform<World, Stylus> {
        let (tip, swing) = match self {
            Self::Landmarks if !landmarks.is_empty() => (touching(after_s, landmarks), SWING * STEADY),
            _ => (HOLE_MM, SWING),
        };
        let phases = SWING_HZ * (std::f64::consts::TAU * after_s);
        let angles = swing * DVec3::from_array(phases.to_array().map(sin));
        // At rest, the shaft points downwards, from the sensor to the tip.
        let down = DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
        let turned = DQuat::from_scaled_axis(angles) * down;
        Transform::from_affine(DAffine3::from_rotation_translation(turned, tip - turned * TIP_MM))
    }
}

/// Returns the position of a tip that touches landmarks in turn, world mm.
fn touching(after_s: f64, landmarks: &[DVec3]) -> DVec3 {
    let each_s = TOUCH_S + WAY_S;
    let round = (after_s / each_s).rem_euclid(landmarks.len() as f64);
    // Rounding may give the length itself.
    let now = (round as usize).min(landmarks.len() - 1);
    let (from, to) = (landmarks[now], landmarks[(now + 1) % landmarks.len()]);
    let share = (((round - now as f64) * each_s - TOUCH_S) / WAY_S).clamp(0.0, 1.0);
    let turn = cos(std::f64::consts::PI * share);
    from.lerp(to, 0.5 - 0.5 * turn) - DVec3::Y * (RAISED_MM * (1.0 - turn * turn))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tip(motion: StylusMotion, after_s: f64, landmarks: &[DVec3]) -> DVec3 {
        motion.world_from_stylus(after_s, landmarks).affine().transform_point3(TIP_MM)
    }

    #[test]
    fn swung_tip_rests_while_shaft_turns() {
        let shaft = |after_s| StylusMotion::Pivot.world_from_stylus(after_s, &[]).affine().matrix3.z_axis;
        let times = (0..600).map(|i| 0.05 * f64::from(i));
        let most = times.clone().map(|s| shaft(s).angle_between(shaft(0.0)).to_degrees()).fold(0.0, f64::max);
        assert!((30.0..60.0).contains(&most) && shaft(0.0).distance(DVec3::Y) < 1e-12, "{most}");
        assert!(times.map(|s| tip(StylusMotion::Pivot, s, &[]).distance(HOLE_MM)).fold(0.0, f64::max) < 1e-9);
    }

    #[test]
    fn tip_touches_every_landmark_and_is_raised_between() {
        let landmarks = [DVec3::ZERO, DVec3::new(40.0, 0.0, 0.0), DVec3::new(0.0, 10.0, 50.0)];
        let at = |after_s| tip(StylusMotion::Landmarks, after_s, &landmarks);
        for (touch, landmark) in (0..6).map(|touch| (touch, landmarks[touch % 3])) {
            let begin = touch as f64 * (TOUCH_S + WAY_S);
            for after_s in [begin + 1e-6, begin + 0.5 * TOUCH_S, begin + TOUCH_S] {
                assert!(at(after_s).distance(landmark) < 1e-3, "{touch} {}", at(after_s));
            }
            let way = at(begin + TOUCH_S + 0.5 * WAY_S);
            let middle = landmark.midpoint(landmarks[(touch + 1) % 3]) - DVec3::Y * RAISED_MM;
            assert!(way.distance(middle) < 1e-9, "{touch} {way}");
        }
    }
}
