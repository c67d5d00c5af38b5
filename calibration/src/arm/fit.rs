//! Fits an arm's parameters to touches: the user sets the tip down at known places, each from
//! as many sides as possible.
//!
//! The places may be known in three ways: divots on a plate that lies anywhere, one divot for
//! all touches, or the distances of pairs of places. The fit finds link lengths and encoder
//! zeros, and the position of the plate. On request it also finds counts per turn or mm and the
//! directions of prismatic joints. Parameters that the touches do not determine are refused by
//! name. The first joint's zero only sets the direction of the base's x axis, which is equivalent
//! to a turn of the plate. It is kept as it was.

mod model;
mod number;
mod options;
mod refusal;
mod touches;

use glam::DVec2;

use super::{Arm, JOINTS, Values};
use crate::error::{ArmError, CalibrationError};
use crate::least_squares::{Loss, Noise, Solution};
use model::Model;
pub use number::{Found, Number};
pub use options::Options;
pub use touches::{Known, Touch};

/// An arm fitted to touches.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// The fitted arm.
    pub arm: Arm,
    /// Position of the tip in the last link's frame, mm.
    pub tip_mm: DVec2,
    /// The fitted numbers, joint by joint.
    pub found: Vec<Found>,
    /// Distance of each touch from its divot, or error of each pair's distance, mm.
    pub residuals_mm: Vec<f64>,
    /// Root mean square of the residuals without the outliers, mm.
    pub rms_mm: f64,
    /// Largest residual without the outliers, mm.
    pub most_mm: f64,
    /// Standard deviation of the residuals along an axis over [`Options::tip_sd_mm`]: about 1 if
    /// the model fits.
    pub spread: f64,
    /// Condition number of the parameters, in steps that move the tip alike.
    pub condition: f64,
    /// Indices of the residuals that were left out because they lie far from all others.
    pub outliers: Vec<usize>,
    /// Range of each joint's values among the touches, rad or mm.
    pub ranges: [[f64; 2]; JOINTS],
    /// Covariance of the fitted numbers, row by row.
    covariance: Vec<Vec<f64>>,
}

impl Fitted {
    /// Returns the standard deviation of the tip's position at these values, due to the fitted
    /// numbers, mm: the root of the sum of the variances along both axes. It is in the base's
    /// frame, whose x axis follows from the first joint's zero.
    pub fn sd_at(&self, values: &Values) -> f64 {
        let moved: Vec<DVec2> = self
            .found
            .iter()
            .map(|found| model::moved(&self.arm, values, self.tip_mm, found.joint - 1, found.what))
            .collect();
        let mut variance = 0.0;
        for (row, one) in self.covariance.iter().zip(&moved) {
            variance += row.iter().zip(&moved).map(|(between, other)| between * one.dot(*other)).sum::<f64>();
        }
        // Rounding may make the variance slightly negative.
        variance.max(0.0).sqrt()
    }
}

/// Fits an arm to touches, starting from approximate numbers: lengths to a tenth, zeros to some
/// degrees.
///
/// A loss that is linear for large residuals finds the start. A loss that leaves out outliers
/// gives the result. Outliers are judged by the residuals' own spread or, if these are too few
/// to estimate it, by [`Options::tip_sd_mm`].
///
/// # Errors
/// [`ArmError`] names the invalid touch or plate, or the undetermined parameters and the touches
/// to add.
pub fn fit(start: &Arm, known: &Known<'_>, touches: &[Touch], options: &Options) -> Result<Fitted, CalibrationError> {
    refusal::check(start, known, touches, options)?;
    let mut model = Model::new(start, known, touches, options);
    if model.parameters.steps() == 0 {
        let residuals_mm = model.residuals_mm(&model.parameters.start());
        return Ok(fitted(*start, &model, residuals_mm, Vec::new(), None));
    }
    let near = solved(&model, Loss::Huber, Noise::Compared)?;
    refusal::check_scale(&near, &model, start)?;
    model.parameters.begin_at(&near.state);
    let solution = solved(&model, Loss::Tukey, model.noise())?;
    if let Some(direction) = solution.directions().first().filter(|direction| direction.sd > LEAST_KNOWN_MM) {
        return Err(refusal::unseen(&model, std::slice::from_ref(direction)).into());
    }
    let arm = Arm::new(model.joints(&solution.state)).map_err(|bad| ArmError::Senseless(bad.to_string()))?;
    let mut found = Vec::new();
    for (index, number, place) in &model.numbers {
        let mut before = start.joints()[*index];
        let ([value], [sd]) = (solution.state.vector(*place), solution.sds(*place));
        let before = number.of(&mut before).map_or(value, |before| *before);
        found.push(Found { joint: index + 1, what: *number, before, value, sd });
    }
    Ok(fitted(arm, &model, model.residuals_mm(&solution.state), found, Some(&solution)))
}

/// Solves the model, or names the reason why it has no solution.
fn solved(model: &Model<'_>, loss: Loss, noise: Noise) -> Result<Solution, ArmError> {
    model.solve(loss, noise).map_err(|unsolved| refusal::of(model, unsolved))
}

/// A combination of parameters counts as undetermined if its standard deviation moves the tip
/// by more than this, mm: only noise determined it.
const LEAST_KNOWN_MM: f64 = 10.0;

/// Assembles the result; without a solution nothing was fitted.
fn fitted(
    arm: Arm,
    model: &Model<'_>,
    residuals_mm: Vec<f64>,
    found: Vec<Found>,
    solution: Option<&Solution>,
) -> Fitted {
    let is_out = |at: usize| solution.is_some_and(|solution| solution.weights[at] == 0.0);
    let outliers: Vec<usize> = (0..residuals_mm.len()).filter(|at| is_out(*at)).collect();
    let kept = || residuals_mm.iter().enumerate().filter(|(at, _)| !is_out(*at)).map(|(_, mm)| *mm);
    let count = (residuals_mm.len() - outliers.len()).max(1) as f64;
    let rms_mm = (kept().map(|mm| mm * mm).sum::<f64>() / count).sqrt();
    let between = |one: &model::FittedNumber, other: &model::FittedNumber| {
        solution.map_or(0.0, |solution| {
            let [[covariance]] = solution.certainty().between(one.2, other.2);
            covariance
        })
    };
    let covariance =
        model.numbers.iter().map(|one| model.numbers.iter().map(|other| between(one, other)).collect()).collect();
    Fitted {
        arm,
        tip_mm: model.options.tip_mm,
        found,
        rms_mm,
        most_mm: kept().fold(0.0, f64::max),
        spread: solution.map_or(rms_mm / model.sd_of_residual_mm(), |solution| solution.spread),
        condition: solution.map_or(1.0, |solution| solution.condition),
        residuals_mm,
        outliers,
        ranges: model::ranges(&arm, model.touches),
        covariance,
    }
}

#[cfg(test)]
mod tests;
