//! Pivot calibration: finds a stylus's tip from poses of the stylus while its tip rests in one
//! place.
//!
//! Each pose puts the tip at the same place, R·tip + t = pivot, which is linear in the six
//! unknowns. The start is algebraic, from the sets of four poses that most others agree with.
//! Least squares with Tukey's loss follow. A tracker's noise at the tip is not isotropic:
//! orientation errors move the tip across the shaft and not along it, in proportion to the
//! shaft's length. Residuals along and across are therefore weighted each by its own spread.
//!
//! The calibration refuses poses that are too few or no rotation. It refuses a stylus that was
//! not turned or about one axis only, and a tip that did not rest. A tip farther or nearer than
//! on any stylus is refused as well, because it indicates wrong units.

use glam::{DMat3, DVec3};

use sonoweave_core::frames::{Stylus, StylusTip, Transform};

use crate::error::{CalibrationError, PivotError};
use crate::least_squares::{Blocks, Loss, Parameters, Settings as Solver, State, Vector, Whitening, rows, solve};
use crate::statistics::{Spread, correlation_length};

mod start;
#[cfg(test)]
mod tests;
mod turning;

pub use turning::Turning;

/// Tolerance for a pose's rotation: printed digits and drift.
const ROTATION_TOLERANCE: f64 = 1e-2;
/// Typical size of the unknowns, mm: a stylus's length.
const TYPICAL_MM: f64 = 100.0;
/// Largest ratio of the residuals' spreads along and across the shaft: a tracker with
/// orientation errors has position errors, too.
const MOST_UNEVEN: f64 = 30.0;
/// Least spread, mm: residuals of exact data are rounding errors.
const LEAST_SPREAD_MM: f64 = 1e-6;
/// Number of solutions, each with the spreads of the one before.
const ROUNDS: usize = 4;

/// Acceptance criteria.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Minimum number of poses: three determine a tip, more are needed to find outliers.
    pub least_poses: usize,
    /// Required spread of the stylus's directions about each of its axes, degrees (root mean
    /// square). Trackers err by up to half a degree, which spreads directions as well. At six
    /// times as much, this error is less than 3 %.
    pub least_turn_deg: f64,
    /// Range of distances of a tip from its sensor, mm.
    pub length_mm: [f64; 2],
    /// Largest share of poses that may disagree with the others.
    pub most_outliers: f64,
    /// Limit of the tip's distance from its place (root mean square), mm.
    pub limit_mm: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { least_poses: 10, least_turn_deg: 3.0, length_mm: [25.0, 500.0], most_outliers: 0.35, limit_mm: 2.0 }
    }
}

/// A calibrated stylus.
#[derive(Debug, Clone, PartialEq)]
pub struct Pivot {
    /// The tip's frame: origin at the tip, z along the shaft away from the sensor. y is
    /// perpendicular to z and to the sensor's x (its y, if x is within 20° of the shaft).
    /// PLUS's pivot calibration has the same frame.
    pub stylus_from_tip: Transform<Stylus, StylusTip>,
    /// Position of the tip in the sensor's frame, mm.
    pub tip_mm: DVec3,
    /// Its covariance, mm².
    pub tip_covariance_mm2: [[f64; 3]; 3],
    /// Position where the tip rested, in the frame of the poses, mm.
    pub pivot_mm: DVec3,
    /// Distances of the tip, pose by pose, from its resting place, mm; without outliers. PLUS's
    /// calibration error is their mean.
    pub residual_mm: Spread,
    /// Standard deviations of the tip along the shaft and across it (per axis), mm.
    pub noise_mm: [f64; 2],
    /// The same distances for all poses, mm.
    pub distances_mm: Vec<f64>,
    /// Indices of the poses that were left out.
    pub outliers: Vec<usize>,
    /// Extent of the stylus's rotation.
    pub turning: Turning,
    /// Number of readings after which the errors are independent: 1 if each is. The covariance
    /// accounts for it.
    pub correlation_length: f64,
    /// Condition number; see [`crate::least_squares::Solution::condition`].
    pub condition: f64,
}

/// Finds the tip from poses of the stylus, in the order of measurement, while its tip rested in
/// one place.
///
/// # Errors
/// [`PivotError`] names the missing data or the problem.
pub fn calibrate<W>(poses: &[Transform<W, Stylus>], settings: &Settings) -> Result<Pivot, CalibrationError> {
    if poses.len() < settings.least_poses {
        return Err(PivotError::TooFew { poses: poses.len(), least: settings.least_poses }.into());
    }
    let mut rigid = Vec::with_capacity(poses.len());
    for (index, pose) in poses.iter().enumerate() {
        let (pose, _) = pose
            .nearest_rigid(ROTATION_TOLERANCE)
            .map_err(|error| PivotError::NotRigid { index, problem: error.to_string() })?;
        if !pose.affine().translation.is_finite() {
            return Err(PivotError::NotRigid { index, problem: "its position is not a finite number".into() }.into());
        }
        rigid.push((pose.affine().matrix3, pose.affine().translation));
    }
    Turning::of(&rigid).check(&rigid, settings.least_turn_deg)?;
    let start = start::find(&rigid);
    let solved = Solved::of(&rigid, start)?;
    let (outliers, kept): (Vec<usize>, Vec<usize>) = (0..rigid.len()).partition(|&index| solved.weights[index] == 0.0);
    let kept_poses: Vec<_> = kept.iter().map(|&index| rigid[index]).collect();
    if outliers.len() as f64 > settings.most_outliers * rigid.len() as f64 {
        return Err(PivotError::Unsteady { outliers: outliers.len(), poses: rigid.len(), runs: runs(&outliers) }.into());
    }
    // The rotation may have been due to outliers only.
    let turning = Turning::of(&kept_poses);
    turning.check(&kept_poses, settings.least_turn_deg)?;
    let length = solved.tip.length();
    if !(length >= settings.length_mm[0] && length <= settings.length_mm[1]) {
        return Err(PivotError::Length { mm: length, plausible: settings.length_mm }.into());
    }
    let distance = |(turn, at): &(DMat3, DVec3)| (*turn * solved.tip + *at - solved.pivot).length();
    let residual_mm = Spread::of(kept_poses.iter().map(distance));
    if residual_mm.rms > settings.limit_mm {
        return Err(PivotError::Stray { rms_mm: residual_mm.rms, limit_mm: settings.limit_mm }.into());
    }
    Ok(Pivot {
        stylus_from_tip: tip_frame(solved.tip),
        tip_mm: solved.tip,
        tip_covariance_mm2: solved.covariance,
        pivot_mm: solved.pivot,
        residual_mm,
        noise_mm: solved.noise,
        distances_mm: rigid.iter().map(distance).collect(),
        outliers,
        turning,
        correlation_length: solved.correlation_length,
        condition: solved.condition,
    })
}

/// Returns the longest runs of consecutive numbers, at most three, in order.
fn runs(indices: &[usize]) -> Vec<[usize; 2]> {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for &index in indices {
        match runs.last_mut() {
            Some([_, last]) if *last + 1 == index => *last = index,
            _ => runs.push([index, index]),
        }
    }
    runs.sort_by_key(|[first, last]| (std::cmp::Reverse(last - first), *first));
    runs.truncate(3);
    runs.sort_unstable();
    runs
}

/// Returns the tip's frame; see [`Pivot::stylus_from_tip`].
fn tip_frame(tip: DVec3) -> Transform<Stylus, StylusTip> {
    let z = tip.normalize();
    let aside = if z.x.abs() < 20_f64.to_radians().cos() { DVec3::X } else { DVec3::Y };
    let y = z.cross(aside).normalize();
    let rotation = DMat3::from_cols(y.cross(z), y, z);
    Transform::from_affine(glam::DAffine3 { matrix3: rotation, translation: tip })
}

/// Result of least squares.
struct Solved {
    tip: DVec3,
    pivot: DVec3,
    covariance: [[f64; 3]; 3],
    /// Standard deviations along the shaft and across it.
    noise: [f64; 2],
    weights: Vec<f64>,
    correlation_length: f64,
    condition: f64,
}

/// The least squares problem; see the module documentation.
struct Problem<'a> {
    poses: &'a [(DMat3, DVec3)],
    parameters: Parameters,
    tip: Vector<3>,
    pivot: Vector<3>,
    /// Columns: the shaft and two directions across it, in the sensor's frame.
    shaft: DMat3,
    whitening: Whitening<3>,
}

impl Problem<'_> {
    /// Returns the tip's offset from the pivot, along the shaft and across it.
    fn residual(&self, state: &State, (turn, at): &(DMat3, DVec3)) -> DVec3 {
        let apart = *turn * state.point(self.tip) + *at - state.point(self.pivot);
        (*turn * self.shaft).transpose() * apart
    }

    fn put(&self, state: &State, blocks: &mut Blocks<'_>) {
        for pose in self.poses {
            blocks
                .add(self.residual(state, pose).to_array(), &self.whitening)
                .by(self.tip, rows(self.shaft.transpose()))
                .by(self.pivot, rows(-(pose.0 * self.shaft).transpose()));
        }
    }
}

impl Solved {
    fn of(poses: &[(DMat3, DVec3)], [tip, pivot]: [DVec3; 2]) -> Result<Self, PivotError> {
        let mut parameters = Parameters::new();
        let start = tip;
        let tip = parameters.point("stylus tip", TYPICAL_MM, tip);
        let pivot = parameters.point("pivot", TYPICAL_MM, pivot);
        let along = start.normalize_or(DVec3::Z);
        let (first, second) = along.any_orthonormal_pair();
        let shaft = DMat3::from_cols(along, first, second);
        let mut problem = Problem { poses, parameters, tip, pivot, shaft, whitening: Whitening::sd(1.0) };
        let mut noise = [1.0; 2];
        let mut solution = solve(&problem.parameters, &Solver::robust(Loss::Tukey), |s, b| problem.put(s, b))?;
        for _ in 0..ROUNDS {
            noise = spreads(&problem, &solution.state, &solution.weights);
            problem.whitening = Whitening::sds([noise[0], noise[1], noise[1]]);
            problem.parameters.begin_at(&solution.state);
            solution = solve(&problem.parameters, &Solver::robust(Loss::Tukey), |s, b| problem.put(s, b))?;
        }
        let kept = poses.iter().zip(&solution.weights).filter(|(_, weight)| **weight > 0.0);
        let residuals: Vec<DVec3> = kept.map(|(pose, _)| problem.residual(&solution.state, pose)).collect();
        let component = |i: usize| correlation_length(&residuals.iter().map(|r| r[i]).collect::<Vec<_>>());
        let correlation_length = (0..3).map(component).fold(1.0, f64::max);
        let covariance = solution.covariance(tip).map(|row| row.map(|entry| entry * correlation_length));
        Ok(Self {
            tip: solution.state.point(tip),
            pivot: solution.state.point(pivot),
            covariance,
            noise: noise.map(|sd| sd * solution.spread),
            weights: solution.weights,
            correlation_length,
            condition: solution.condition,
        })
    }
}

/// Returns the standard deviations of residuals along the shaft and across it, from their
/// medians.
fn spreads(problem: &Problem<'_>, state: &State, weights: &[f64]) -> [f64; 2] {
    let kept = problem.poses.iter().zip(weights).filter(|(_, weight)| **weight > 0.0);
    let (along, across): (Vec<_>, Vec<_>) = kept
        .map(|(pose, _)| {
            let residual = problem.residual(state, pose);
            ((1, residual.x.abs()), (2, residual.y.hypot(residual.z)))
        })
        .unzip();
    let [along, across] =
        [along, across].map(|lengths| crate::least_squares::loss::spread(&lengths).max(LEAST_SPREAD_MM));
    [along.max(across / MOST_UNEVEN), across.max(along / MOST_UNEVEN)]
}
