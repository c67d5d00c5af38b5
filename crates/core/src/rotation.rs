//! Turns and directions with the same bits on every machine.
//!
//! The C library's sine and arc cosine, which the standard library and glam call, differ in the
//! last bit from one library to another. Those here are rounded correctly. A recorded session thus
//! replays to the same poses with every build of the program.

use glam::{DQuat, DVec2, DVec3};

/// Returns sine and cosine of an angle in radians.
pub fn sin_cos(angle_rad: f64) -> [f64; 2] {
    let (sine, cosine) = pxfm::f_sincos(angle_rad);
    [sine, cosine]
}

/// Returns the unit vector at an angle to the x axis, in radians, positive from x to y.
pub fn direction(angle_rad: f64) -> DVec2 {
    let [sine, cosine] = sin_cos(angle_rad);
    DVec2::new(cosine, sine)
}

/// Interpolates between unit quaternions by the shorter rotation, at constant speed (slerp).
/// `share` is from 0 to 1.
pub fn slerp(from: DQuat, to: DQuat, share: f64) -> DQuat {
    let dot = from.dot(to);
    let (to, dot) = if dot < 0.0 { (-to, -dot) } else { (to, dot) };
    if dot > 1.0 - f64::EPSILON {
        // The sine of the angle would be 0.
        return (from * (1.0 - share) + to * share).normalize();
    }
    let angle = pxfm::f_acos(dot.min(1.0));
    let [before, behind] = [1.0 - share, share].map(|part| pxfm::f_sin(angle * part));
    (from * before + to * behind) * (1.0 / pxfm::f_sin(angle))
}

/// Returns a unit quaternion's rotation vector: its axis times its angle, which is from 0 to π.
pub fn rotation_vector(turn: DQuat) -> DVec3 {
    let turn = if turn.w < 0.0 { -turn } else { turn };
    let sine = turn.xyz().length();
    if sine == 0.0 {
        return DVec3::ZERO;
    }
    turn.xyz() * (2.0 * pxfm::f_atan2(sine, turn.w) / sine)
}

/// Returns the rotation about a vector by its length in radians, as a unit quaternion.
pub fn of_rotation_vector(vector: DVec3) -> DQuat {
    let angle = vector.length();
    if angle == 0.0 {
        return DQuat::IDENTITY;
    }
    let [sine, cosine] = sin_cos(0.5 * angle);
    let axis = vector * (sine / angle);
    DQuat::from_xyzw(axis.x, axis.y, axis.z, cosine)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn functions_match_the_standard_library(angle in -20.0..20.0_f64) {
            let [sine, cosine] = sin_cos(angle);
            prop_assert!((sine - angle.sin()).abs() <= 2e-16 && (cosine - angle.cos()).abs() <= 2e-16);
            prop_assert!(direction(angle).distance(DVec2::from_angle(angle)) <= 4e-16);
        }

        #[test]
        fn rotation_vectors_are_axis_times_angle(
            axis in prop::array::uniform3(-1.0..1.0_f64),
            angle in 0.0..3.1_f64,
            is_negated: bool,
        ) {
            let axis = DVec3::from_array(axis);
            prop_assume!(axis.length() > 1e-3);
            let vector = axis.normalize() * angle;
            let turn = of_rotation_vector(vector);
            prop_assert!(turn.dot(DQuat::from_scaled_axis(vector)) > 1.0 - 1e-15);
            let back = rotation_vector(if is_negated { -turn } else { turn });
            prop_assert!((back - vector).length() < 1e-14, "{back} {vector}");
        }

        #[test]
        fn slerp_turns_by_a_share_the_short_way(
            axis in prop::array::uniform3(-1.0..1.0_f64),
            angle in 1e-9..3.1_f64,
            share in 0.0..=1.0_f64,
            is_negated: bool,
        ) {
            let axis = DVec3::from_array(axis);
            prop_assume!(axis.length() > 1e-3);
            let turn = |angle: f64| DQuat::from_axis_angle(axis.normalize(), angle);
            let first = DQuat::from_xyzw(0.1, -0.7, 0.5, 0.5).normalize();
            let last = turn(angle) * first;
            let found = slerp(first, if is_negated { -last } else { last }, share);
            let want = turn(angle * share) * first;
            prop_assert!(found.dot(want).abs() > 1.0 - 1e-12 && (found.length() - 1.0).abs() < 1e-8, "{found} {want}");
            let off = found.angle_between(if found.dot(want) < 0.0 { -want } else { want });
            prop_assert!(off < 1e-7);
        }
    }

    #[test]
    fn sines_have_the_same_bits_everywhere() {
        let mut state = 1_u64;
        let mut bits = 0_u64;
        for _ in 0..20_000 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let angle = (state >> 11) as f64 / (1_u64 << 50) as f64 - 4.0;
            for value in [sin_cos(angle)[0], sin_cos(angle)[1], pxfm::f_acos(angle / 4.0)] {
                bits = bits.rotate_left(7).wrapping_mul(31) ^ value.to_bits();
            }
        }
        assert_eq!(bits, 0xCC3C_26F2_933D_EF48, "the functions' bits have changed");
    }
}
