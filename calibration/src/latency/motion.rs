//! Numbers of a tracker's poses that the line of a floor depends on linearly.
//!
//! A static floor is n·x = d. The probe carries an image point m to R m + p, at the distance
//! n·p + n·R·m − d from the floor. That is linear in the probe's position and in the row n·R of
//! its rotation, for any calibration m. The direction of the probe's main motion approximates
//! n. So six numbers of the pose fit the line's distance from an image point: its position
//! along and across that direction, and that row.

use glam::{DMat3, DVec3};

use crate::error::{CalibrationError, LatencyError};
use crate::trajectory::spline::Spline;
use crate::trajectory::{LONGEST_GAP_S, PoseSample};

/// Count of a pose's numbers that are fitted to the line's position.
pub const COLUMNS: usize = 9;
/// Lever arm that scales rotations to lengths, mm: about the distance of the image from the
/// sensor.
const LEVER_MM: f64 = 100.0;
/// A turn of the motion counts if it goes back by this share of the extent.
const TURN: f64 = 0.25;

/// A tracker's motion during a time.
#[derive(Debug, Clone)]
pub struct Motion {
    /// The pose's numbers: position along the axis and across it, the row of the rotation, each
    /// about its mean, and the row times the position along the axis; mm.
    pub track: Spline<COLUMNS>,
    /// Direction of the main motion, in the tracker's frame.
    pub axis: DVec3,
    /// Extent of the motion along the axis, mm.
    pub extent_mm: f64,
    /// Standard deviation of a sample's position along the axis from its neighbours', mm.
    pub noise_mm: f64,
    /// Number of turning points.
    pub turns: usize,
    /// Samples per second, from the median interval.
    pub rate_hz: f64,
}

impl Motion {
    /// Analyses the samples from one time to another (s, both inclusive); `None` for fewer than
    /// three.
    ///
    /// # Errors
    /// [`LatencyError::NotFinite`] with the index among all samples.
    pub fn new(samples: &[PoseSample], [from_s, until_s]: [f64; 2]) -> Result<Option<Self>, CalibrationError> {
        let is_finite = |s: &PoseSample| s.time_s.is_finite() && s.rotation.is_finite() && s.position_mm.is_finite();
        if let Some(index) = samples.iter().position(|sample| !is_finite(sample)) {
            return Err(LatencyError::NotFinite { index }.into());
        }
        let within: Vec<&PoseSample> =
            samples.iter().filter(|sample| (from_s..=until_s).contains(&sample.time_s)).collect();
        if within.len() < 3 {
            return Ok(None);
        }
        let count = within.len() as f64;
        let mean = within.iter().map(|sample| sample.position_mm).sum::<DVec3>() / count;
        let spread = within.iter().fold(DMat3::ZERO, |sum, sample| {
            let off = sample.position_mm - mean;
            sum + DMat3::from_cols(off * off.x, off * off.y, off * off.z)
        });
        let axes = principal_axes(spread);
        let row = |sample: &PoseSample| sample.rotation.conjugate() * axes.x_axis;
        let mean_row = within.iter().map(|sample| row(sample)).sum::<DVec3>() / count;
        let numbers = |sample: &&PoseSample| {
            let place = axes.transpose() * (sample.position_mm - mean);
            let turn = LEVER_MM * (row(sample) - mean_row);
            let both = turn * (place.x / LEVER_MM);
            (sample.time_s, [place.x, place.y, place.z, turn.x, turn.y, turn.z, both.x, both.y, both.z])
        };
        let track = Spline::new(within.iter().map(numbers).collect(), LONGEST_GAP_S)?;
        let along: Vec<f64> = track.samples().map(|(_, values)| values[0]).collect();
        let [low, high] = [along.iter().copied().reduce(f64::min), along.iter().copied().reduce(f64::max)];
        let extent_mm = high.zip(low).map_or(0.0, |(high, low)| high - low);
        let times: Vec<f64> = track.samples().map(|(time, _)| time).collect();
        let mut steps: Vec<f64> = times.windows(2).map(|two| two[1] - two[0]).collect();
        let step = crate::statistics::median(&mut steps);
        Ok(Some(Self {
            axis: axes.x_axis,
            extent_mm,
            noise_mm: track.noise()[0],
            turns: turns(&along, TURN * extent_mm),
            rate_hz: if step > 0.0 { 1.0 / step } else { 0.0 },
            track,
        }))
    }
}

/// Counts the turning points of at least this size.
fn turns(values: &[f64], least: f64) -> usize {
    let Some(first) = values.first() else { return 0 };
    let (mut low, mut high, mut rises, mut count) = (*first, *first, None, 0);
    for &value in values {
        (low, high) = (low.min(value), high.max(value));
        let turned = match rises {
            Some(true) => high - value > least,
            Some(false) => value - low > least,
            None => high - low > least,
        };
        if turned {
            count += usize::from(rises.is_some());
            rises = Some(rises.map_or(value > *first, |rises: bool| !rises));
            (low, high) = (value, value);
        }
    }
    count
}

/// Returns the eigenvectors of a symmetric matrix by Jacobi rotations, that of the largest
/// value first.
fn principal_axes(symmetric: DMat3) -> DMat3 {
    let (mut m, mut axes) = (symmetric, DMat3::IDENTITY);
    // Converges quadratically: six sweeps reach rounding, the others are a reserve.
    for _ in 0..12 {
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            let off = m.col(j)[i];
            if off == 0.0 {
                continue;
            }
            let angle = 0.5 * (2.0 * off).atan2(m.col(j)[j] - m.col(i)[i]);
            let (sin, cos) = angle.sin_cos();
            let mut columns = DMat3::IDENTITY.to_cols_array_2d();
            (columns[i][i], columns[j][j], columns[i][j], columns[j][i]) = (cos, cos, -sin, sin);
            let turn = DMat3::from_cols_array_2d(&columns);
            (m, axes) = (turn.transpose() * m * turn, axes * turn);
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| m.col(*b)[*b].total_cmp(&m.col(*a)[*a]));
    DMat3::from_cols(axes.col(order[0]), axes.col(order[1]), axes.col(order[2]))
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::tests::noise::Noise as Random;

    #[test]
    fn axes_match_turned_ellipsoid() {
        let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::ZYX, 0.4, 1.1, -0.7));
        let spread = turn * DMat3::from_diagonal(DVec3::new(2.0, 9.0, 0.5)) * turn.transpose();
        let axes = principal_axes(spread);
        for (axis, own) in [axes.x_axis, axes.y_axis, axes.z_axis].into_iter().zip([1, 0, 2]) {
            assert!((axis.dot(turn.col(own)).abs() - 1.0).abs() < 1e-14, "{axes} {turn}");
        }
        assert_eq!(principal_axes(DMat3::ZERO), DMat3::IDENTITY);
    }

    #[test]
    fn turns_are_counted_without_tremor() {
        let wave: Vec<f64> =
            (0..1000).map(|i| (f64::from(i) * 0.0314159).sin() + 0.1 * (f64::from(i) * 2.0).sin()).collect();
        assert_eq!(turns(&wave, 0.5), 10);
        assert_eq!(turns(&(0..100).map(f64::from).collect::<Vec<_>>(), 25.0), 0);
        assert_eq!((turns(&[], 1.0), turns(&[1.0; 9], 0.0)), (0, 0));
    }

    /// A floor below a probe that moves up and down and tilts: its distance from any point of
    /// the probe is linear in the six numbers.
    #[test]
    fn floor_distance_is_linear_in_numbers() {
        let mut random = Random::new(5);
        let normal = DVec3::new(0.1, -0.2, 1.0).normalize();
        let samples: Vec<PoseSample> = (0..300)
            .map(|i| {
                let time_s = 0.02 * f64::from(i);
                let turn =
                    DVec3::new(0.2 * (2.1 * time_s).sin(), 0.15 * (3.3 * time_s).cos(), 0.1 * (1.3 * time_s).sin());
                let aside = DVec3::new((1.7 * time_s).sin(), (2.9 * time_s).cos(), 0.0);
                let position_mm = DVec3::new(100.0, 20.0, -30.0) + normal * 20.0 * (5.0 * time_s).sin() + aside;
                PoseSample { time_s, rotation: DQuat::from_scaled_axis(turn), position_mm }
            })
            .collect();
        let motion = Motion::new(&samples, [0.0, 10.0]).unwrap().unwrap();
        assert!(motion.axis.dot(normal).abs() > 0.99 && (motion.extent_mm - 40.0).abs() < 2.0, "{motion:?}");
        assert!((motion.rate_hz - 50.0).abs() < 1e-6 && motion.turns == 9, "{}", motion.turns);
        let point = DVec3::new(10.0 * random.normal(), 60.0, 120.0);
        let distances: Vec<f64> = samples.iter().map(|s| motion.axis.dot(s.rotation * point + s.position_mm)).collect();
        let columns: Vec<[f64; COLUMNS]> = motion.track.samples().map(|(_, values)| *values).collect();
        // Along the axis itself the relation is exact: the coefficients are those of the
        // geometry.
        let row = [1.0, 0.0, 0.0, point.x / LEVER_MM, point.y / LEVER_MM, point.z / LEVER_MM, 0.0, 0.0, 0.0];
        let fitted: Vec<f64> = columns.iter().map(|c| c.iter().zip(row).map(|(x, b)| x * b).sum()).collect();
        let offset = distances[0] - fitted[0];
        assert!(distances.iter().zip(&fitted).all(|(d, f)| (d - f - offset).abs() < 1e-10));
    }
}
