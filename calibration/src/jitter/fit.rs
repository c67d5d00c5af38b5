//! Displacements of all slices by their differences from the predictions.
//!
//! A slice that is displaced by (u, v) and turned by w about the normal, about the middle of its
//! image, meets another prediction. Let a and b be the slopes along u and v. At a point (x, y) the
//! prediction changes by a·u + b·v + (b·x − a·y)·w. The image's own slopes are nearly those of the
//! prediction. Each round solves for every slice from the same poses, so that the order of
//! slices does not count. It takes a part of the step, as neighbours move towards each other.

use glam::{DAffine3, DMat2, DQuat, DVec2, DVec3};
use nalgebra::{Matrix3, Vector3};

use super::points::{FIT, Own, Scan};
use super::sequence::Member;
use crate::crossings::state::State;
use crate::statistics::median;
use crate::tracker::noise::TrackerNoise;

/// Rounds, and the part of a step that is taken.
const ROUNDS: usize = 8;
const DAMPING: f64 = 0.6;
/// Cauchy's scale, in medians of the differences' amounts.
const SCALE: f64 = 2.0;
/// Smallest standard deviation of differences, grey levels: that of rounding.
const ROUNDING: f64 = 0.3;
/// Points that determine a displacement.
const LEAST_POINTS: usize = 20;
/// Slices over which displacements average to 0: standard deviation of the weights. Neighbours do
/// not show a displacement that they share, but curved anatomy displaces them all alike, and more
/// with each round.
const SLOW: f64 = 10.0;

/// Noise of a slice's pose, as it moves the image within its plane.
pub(super) struct Prior {
    /// The inverse covariance of u and v, mm, and the turn, rad.
    pub(super) inverse: Matrix3<f64>,
    /// Standard deviation of the image's middle along the normal, mm.
    pub(super) across_mm: f64,
}

impl Prior {
    /// Noise of a sensor's rotation displaces the image by its distance from the sensor as well.
    pub(super) fn of(state: &State, noise: TrackerNoise) -> Self {
        let [mm2, rad2] = [noise.position_mm, noise.rotation_deg.to_radians()].map(|sd| sd * sd);
        let lever = state.probe_from_picture.matrix3.transpose() * state.probe_from_picture.translation;
        let DVec3 { x, y, z } = lever;
        let both = -x * y * rad2;
        let covariance = Matrix3::new(
            mm2 + (y * y + z * z) * rad2,
            both,
            -y * rad2,
            both,
            mm2 + (x * x + z * z) * rad2,
            x * rad2,
            -y * rad2,
            x * rad2,
            rad2,
        );
        // Positive definite, as both variances are above 0.
        let inverse = covariance.cholesky().map_or_else(Matrix3::zeros, |factor| factor.inverse());
        Self { inverse, across_mm: (mm2 + (x * x + y * y) * rad2).sqrt() }
    }

    /// Returns the square of a displacement by the noise, per degree of freedom.
    pub(super) fn chi2(&self, within: &Within) -> f64 {
        let by = within.numbers();
        by.dot(&(self.inverse * by)) / 3.0
    }
}

/// A displacement of a slice within its plane.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Within {
    pub(super) shift_mm: DVec2,
    /// About the normal, rad.
    pub(super) turn: f64,
}

impl Within {
    /// Returns the map of mm of the image, about its middle.
    pub(super) fn rigid(&self) -> DAffine3 {
        DAffine3::from_rotation_translation(DQuat::from_rotation_z(self.turn), self.shift_mm.extend(0.0))
    }

    fn numbers(&self) -> Vector3<f64> {
        Vector3::new(self.shift_mm.x, self.shift_mm.y, self.turn)
    }

    /// Returns the displacement after a part of a step, which is given in the displaced image.
    fn after(&self, step: &Vector3<f64>, part: f64) -> Self {
        let shift = DMat2::from_angle(self.turn) * DVec2::new(step.x, step.y);
        Self { shift_mm: self.shift_mm + part * shift, turn: self.turn + part * step.z }
    }

    /// Returns the largest displacement of some points of the image, mm, and the mean square.
    pub(super) fn displaced_mm(&self, points: &[DVec3]) -> [f64; 2] {
        let rigid = self.rigid();
        let squares = points.iter().map(|point| rigid.transform_point3(*point).distance_squared(*point));
        let (most, sum) = squares.fold((0.0_f64, 0.0), |(most, sum), square| (most.max(square), sum + square));
        [most.sqrt(), sum / points.len() as f64]
    }
}

/// The method's state.
pub(super) struct Fit {
    /// Displacement of each member; none of those with too few predicted points.
    pub(super) within: Vec<Option<Within>>,
}

impl Fit {
    pub(super) fn new(scan: &Scan<'_>) -> Self {
        Self { within: vec![None; scan.members.len()] }
    }

    /// Returns the pose of each member: from mm of its image to the world.
    pub(super) fn poses(&self, scan: &Scan<'_>) -> Vec<DAffine3> {
        let moved = |(within, member): (&Option<Within>, &Member)| {
            within.map_or(member.world_from_picture, |within| member.world_from_picture * within.rigid())
        };
        self.within.iter().zip(&scan.members).map(moved).collect()
    }

    /// Displaces all slices towards their predictions.
    pub(super) fn improve(&mut self, scan: &Scan<'_>, prior: &Prior) {
        for _ in 0..ROUNDS {
            let differences = differences(scan, &self.poses(scan), FIT);
            let mut amounts: Vec<f64> = differences.iter().flatten().flatten().map(|x| x.abs()).collect();
            let scale = (SCALE * median(&mut amounts)).max(ROUNDING);
            for (member, within) in self.within.iter_mut().enumerate() {
                let at = within.unwrap_or_default();
                let points = scan.points[FIT].iter().zip(&scan.own[FIT][member]).zip(&differences[member]);
                let rows =
                    points.filter_map(|((point, own), difference)| Some((derivatives(*point, own), (*difference)?)));
                if let Some(step) = solved(rows, scale, &at, prior) {
                    *within = Some(at.after(&step, DAMPING));
                }
            }
            self.keep_fast(scan);
        }
    }

    /// Subtracts the mean over many slices from each displacement.
    fn keep_fast(&mut self, scan: &Scan<'_>) {
        let kernel: Vec<f64> =
            (0..=(3.0 * SLOW) as usize).map(|off| (-0.5 * (off as f64 / SLOW).powi(2)).exp()).collect();
        let reach = kernel.len() - 1;
        let fast = |at: usize, own: &Within| {
            let sweep = &scan.members[at].sweep;
            let near = at.saturating_sub(reach).max(sweep.start)..(at + reach + 1).min(sweep.end);
            let others = near.filter_map(|other| Some((kernel[other.abs_diff(at)], self.within[other]?)));
            let (sum, shift_mm, turn) = others.fold((0.0, DVec2::ZERO, 0.0), |(sum, shift, turn), (weight, of)| {
                (sum + weight, shift + weight * of.shift_mm, turn + weight * of.turn)
            });
            Within { shift_mm: own.shift_mm - shift_mm / sum, turn: own.turn - turn / sum }
        };
        self.within = self.within.iter().enumerate().map(|(at, own)| own.as_ref().map(|own| fast(at, own))).collect();
    }
}

/// Returns each member's grey values less their predictions; none of points without one.
pub(super) fn differences(scan: &Scan<'_>, poses: &[DAffine3], set: usize) -> Vec<Vec<Option<f64>>> {
    let predictions = scan.predictions(poses, set);
    let of = |(own, predicted): (&Own, &Option<f64>)| Some(own.grey - (*predicted)?);
    let each = scan.own[set].iter().zip(&predictions);
    each.map(|(own, predicted)| own.iter().zip(predicted).map(of).collect()).collect()
}

/// Returns the change of a point's prediction by a displacement along u and v, mm, and by a turn,
/// rad.
pub(super) fn derivatives(point: DVec2, own: &Own) -> Vector3<f64> {
    let DVec2 { x: u, y: v } = own.slope;
    Vector3::new(u, v, v * point.x - u * point.y)
}

/// Returns the step that the points of a slice ask for; `None` if they are too few.
fn solved(
    rows: impl Iterator<Item = (Vector3<f64>, f64)>,
    scale: f64,
    at: &Within,
    prior: &Prior,
) -> Option<Vector3<f64>> {
    let start = (prior.inverse, -(prior.inverse * at.numbers()), 0);
    let (a, b, count) = rows.fold(start, |(a, b, count), (by, difference)| {
        let weight = 1.0 / (scale * scale + difference * difference);
        (a + by * by.transpose() * weight, b + by * (difference * weight), count + 1)
    });
    let factor = (count >= LEAST_POINTS).then(|| a.cholesky())??;
    Some(factor.solve(&b))
}
