//! Checks for numbers that the probe's motion leaves undetermined.

use glam::{DMat3, DVec2, DVec3};

use super::detection::Detection;
use crate::error::{Axis, ProbeError};
use crate::pivot::Turning;
use crate::probe::plane::ImagePlane;
use crate::statistics::Spread;

/// Minimum rotation of the probe, degrees (root mean square). It is the same as for a stylus's
/// pivot calibration, because a tracker's own errors rotate it as well.
const LEAST_TURN_DEG: f64 = 3.0;
/// Minimum spread of a point's dots in every direction (standard deviation), as a share of the
/// image's larger side.
const LEAST_SPREAD: f64 = 0.03;

impl Axis {
    /// Returns the axis nearest to a direction in the probe's frame.
    fn of(direction: DVec3, plane: &ImagePlane) -> Self {
        let share = |axis: DVec3| direction.dot(axis.normalize_or_zero()).abs();
        let [u, v, normal] = [plane.u, plane.v, plane.u.cross(plane.v)].map(share);
        match () {
            () if u >= v && u >= normal => Self::U,
            () if v >= normal => Self::V,
            () => Self::Normal,
        }
    }
}

/// Checks that the probe turned enough for a point: `turns` map its frame to the reference's.
///
/// # Errors
/// [`ProbeError::NoTurn`] names the missing axes.
pub(super) fn turned_about_point(turns: &[DMat3], plane: &ImagePlane) -> Result<(), ProbeError> {
    let all = [Axis::U, Axis::V, Axis::Normal];
    let turning = turning(turns);
    // For a fixed axis the two directions perpendicular to it turn alike.
    if turning.deg[1] < LEAST_TURN_DEG {
        return refused(all.to_vec(), turning.deg[2]);
    }
    if turning.deg[0] < LEAST_TURN_DEG {
        let only = Axis::of(turning.axes[0], plane);
        return refused(all.into_iter().filter(|axis| *axis != only).collect(), turning.deg[0]);
    }
    Ok(())
}

/// Checks that the probe turned enough for a plane, as far as possible before the fit. The
/// lines themselves show the tilt from side to side.
///
/// # Errors
/// [`ProbeError::NoTurn`] names the missing axes.
pub(super) fn turned_over_plane(turns: &[DMat3], detections: &[Detection]) -> Result<(), ProbeError> {
    let turning = turning(turns);
    if turning.deg[1] < LEAST_TURN_DEG {
        return refused(vec![Axis::U, Axis::Normal], turning.deg[2]);
    }
    let angle = |detection: &Detection| {
        let along = detection.marks[1] - detection.marks[0];
        along.y.atan2(along.x).to_degrees()
    };
    let angles = Spread::of(detections.iter().map(angle));
    if angles.sd < LEAST_TURN_DEG {
        return refused(vec![Axis::Normal], angles.sd);
    }
    if turning.deg[0] < LEAST_TURN_DEG { refused(vec![Axis::U], turning.deg[0]) } else { Ok(()) }
}

/// Checks that a plane at a known position was seen from two directions. Rotation of the probe
/// about the plane's normal is irrelevant.
///
/// # Errors
/// [`ProbeError::NoTurn`] names the missing axis.
pub(super) fn saw_plane(turns: &[DMat3], plane: &ImagePlane, normal: DVec3) -> Result<(), ProbeError> {
    let seen: Vec<DVec3> = turns.iter().map(|turn| turn.transpose() * normal).collect();
    let (deg, axis) = weakest(&seen);
    if deg < LEAST_TURN_DEG { refused(vec![Axis::of(axis, plane)], deg) } else { Ok(()) }
}

fn turning(turns: &[DMat3]) -> Turning {
    Turning::of(&turns.iter().map(|turn| (*turn, DVec3::ZERO)).collect::<Vec<_>>())
}

fn refused(axes: Vec<Axis>, deg: f64) -> Result<(), ProbeError> {
    Err(ProbeError::NoTurn { axes, deg, least: LEAST_TURN_DEG })
}

/// Returns the smaller spread of the plane's normal in the probe's frame, degrees (root mean
/// square), and the rotation axis that it belongs to.
fn weakest(seen: &[DVec3]) -> (f64, DVec3) {
    let n = seen.len().max(1) as f64;
    let mean = seen.iter().sum::<DVec3>() / n;
    let mut spread = DMat3::ZERO;
    for normal in seen {
        let off = *normal - mean;
        spread += DMat3::from_cols(off * off.x, off * off.y, off * off.z) * (1.0 / n);
    }
    let (first, second) = mean.normalize_or(DVec3::Z).any_orthonormal_pair();
    // Components along the two directions perpendicular to the mean.
    let [a, b, d] = [(first, first), (first, second), (second, second)].map(|(x, y)| x.dot(spread * y));
    let angle = 0.5 * (2.0 * b).atan2(a - d) + std::f64::consts::FRAC_PI_2;
    let along = first * angle.cos() + second * angle.sin();
    let sd = along.dot(spread * along).max(0.0).sqrt();
    (sd.to_degrees(), mean.cross(along).normalize_or_zero())
}

/// Checks that the point was seen all over the image.
///
/// # Errors
/// [`ProbeError::OnePlace`] if the dots are not spread enough.
pub(super) fn spread(detections: &[Detection], used: &[bool], size_px: [u32; 2]) -> Result<(), ProbeError> {
    let seen: Vec<DVec2> = detections
        .iter()
        .zip(used)
        .filter(|(_, used)| **used)
        .flat_map(|(detection, _)| detection.marks.clone())
        .collect();
    let n = seen.len().max(1) as f64;
    let mean = seen.iter().sum::<DVec2>() / n;
    let sum = |of: fn(DVec2) -> f64| seen.iter().map(|px| of(*px - mean)).sum::<f64>() / n;
    let (xx, xy, yy) = (sum(|p| p.x * p.x), sum(|p| p.x * p.y), sum(|p| p.y * p.y));
    let (half, root) = (0.5 * (xx + yy), (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt());
    let [less, more] = [half - root, half + root].map(|variance| variance.max(0.0).sqrt());
    let least = LEAST_SPREAD * f64::from(size_px[0].max(size_px[1]));
    if less < least { Err(ProbeError::OnePlace { line: more >= least, px: less, least }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    fn plane() -> ImagePlane {
        ImagePlane { u: DVec3::X * 0.1, v: DVec3::Y * 0.1, origin: DVec3::ZERO }
    }

    /// Returns rotations about the given axes by waves of some degrees.
    fn turns(deg: [f64; 3]) -> Vec<DMat3> {
        let turn = |i: u32| {
            let wave = |period: f64| (f64::from(i) * std::f64::consts::TAU / period).sin();
            let about = DVec3::new(deg[0] * wave(11.0), deg[1] * wave(17.0), deg[2] * wave(23.0));
            let first = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0);
            DMat3::from_quat(first * DQuat::from_scaled_axis(about * (std::f64::consts::PI / 180.0)))
        };
        (0..391).map(turn).collect()
    }

    fn axes(result: Result<(), ProbeError>) -> Vec<Axis> {
        match result {
            Err(ProbeError::NoTurn { axes, .. }) => axes,
            other => panic!("{other:?}"),
        }
    }

    /// Returns lines of a floor below the image, from rotations of its normal.
    fn lines(turns: &[DMat3]) -> Vec<Detection> {
        let line = |turn: &DMat3| {
            let floor = turn.transpose() * turns[0] * DVec3::Y;
            let along = DVec2::new(floor.y, -floor.x) * 100.0;
            Detection { frame: 0, time_s: 0.0, candidates: Vec::new(), marks: vec![DVec2::ZERO, along] }
        };
        turns.iter().map(line).collect()
    }

    #[test]
    fn missing_rotation_axes_are_named() {
        let point = |deg: [f64; 3]| axes(turned_about_point(&turns(deg), &plane()));
        let over = |deg: [f64; 3]| axes(turned_over_plane(&turns(deg), &lines(&turns(deg))));
        for still in [0.0, 0.5] {
            assert_eq!(point([still; 3]), [Axis::U, Axis::V, Axis::Normal]);
            assert_eq!(point([20.0, still, still]), [Axis::V, Axis::Normal]);
            assert_eq!(point([still, 20.0, still]), [Axis::U, Axis::Normal]);
            assert_eq!(over([still; 3]), [Axis::U, Axis::Normal]);
            assert_eq!(over([20.0, still, still]), [Axis::Normal]);
            assert_eq!(over([20.0, 20.0, still]), [Axis::Normal]);
            assert_eq!(over([still, still, 20.0]), [Axis::U]);
            let turns = turns([still, 20.0, 20.0]);
            assert_eq!(axes(saw_plane(&turns, &plane(), turns[0] * DVec3::NEG_Y)), [Axis::U]);
        }
        for enough in [[15.0, 0.0, 12.0], [10.0, 10.0, 0.0], [9.0, 9.0, 9.0]] {
            assert_eq!(turned_about_point(&turns(enough), &plane()), Ok(()));
        }
        let turns = turns([15.0, 0.0, 12.0]);
        assert_eq!(turned_over_plane(&turns, &lines(&turns)), Ok(()));
        assert_eq!(saw_plane(&turns, &plane(), turns[0] * DVec3::NEG_Y), Ok(()));
    }

    #[test]
    fn dots_in_one_place_or_line_are_refused() {
        let detection = |at: DVec2| Detection { frame: 0, time_s: 0.0, candidates: vec![at], marks: vec![at] };
        let seen = |across: f64, along: f64| {
            let at = |i: u32| {
                DVec2::new(400.0, 300.0)
                    + DVec2::new(1.0, 1.0) * (along * f64::from(i % 5))
                    + DVec2::new(1.0, -1.0) * (across * f64::from(i % 7))
            };
            let all: Vec<Detection> = (0..70).map(at).map(detection).collect();
            spread(&all, &[true; 70], [820, 616])
        };
        assert!(matches!(seen(1.0, 1.0), Err(ProbeError::OnePlace { line: false, .. })));
        assert!(matches!(seen(1.0, 60.0), Err(ProbeError::OnePlace { line: true, .. })));
        assert_eq!(seen(40.0, 60.0), Ok(()));
    }
}
