//! The result of a check, and reasons not to use its calibration.

use glam::{DAffine3, DQuat};

use super::certainty::{Certainty, places};
use super::directions::{Directions, LEAST_DIRECTIONS};
use super::fit::Fit;
use super::line::Lines;
use super::state::State;
use crate::error::{CrossingsError, Motion, Sides};
use crate::slices::Slices;
use crate::statistics::median;

/// Displacement of the image beyond which the calibration no longer holds, mm, and in its standard
/// errors.
const SLIPPED_MM: f64 = 0.3;
const SLIPPED_ERRORS: f64 = 3.0;
/// Error of the latency beyond which it no longer holds, s.
const LATE_S: f64 = 0.005;
/// Standard error of any point of the image, mm.
const MOST_ERROR_MM: f64 = 0.3;
/// Largest changes: mm, degrees, and part of the scale. A phantom determines larger ones better.
const MOST_MM: f64 = 3.0;
const MOST_DEG: f64 = 3.0;
const MOST_SCALE: f64 = 0.05;
/// Differences of two sweeps' slices beyond those of others: the body has moved.
const MOVED: f64 = 2.0;
/// Lines of two sweeps that are compared with others.
const LEAST_LINES: usize = 10;

/// A calibration checked by crossing slices.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    /// Number of compared lines.
    pub lines: usize,
    /// Number of slices in these.
    pub slices: usize,
    /// Sweeps and directions.
    pub directions: Directions,
    /// Medians of the correlations along the lines, before and after.
    pub correlations: [f64; 2],
    /// Displacement of the image by the calibration found, root mean square of nine points, mm.
    pub shift_mm: f64,
    /// Its standard error, mm.
    pub shift_se_mm: f64,
    /// Largest standard error of the nine points, mm.
    pub worst_se_mm: f64,
    /// Displacement of the image's middle along u, v and the normal, mm, with standard errors.
    pub translation_mm: [[f64; 3]; 2],
    /// Turn about these axes, degrees, with standard errors.
    pub rotation_deg: [[f64; 3]; 2],
    /// Change of the scale along u and v, with standard errors.
    pub scale: [[f64; 2]; 2],
    /// The tracker's lag beyond the one in use, s, with its standard error.
    pub lag_s: [f64; 2],
    /// Motion of the probe that would determine the least determined number.
    pub motion: Motion,
    /// Sweeps between which the body seems to have moved, with the ratio of their differences to
    /// the others'.
    pub moved: Option<(Sides, f64)>,
    /// From the probe by the calibration in use to the probe by the one found.
    correction: DAffine3,
}

impl Checked {
    pub(super) fn new(
        slices: &Slices,
        directions: &Directions,
        lines: &Lines<'_>,
        start: State,
        fit: &Fit,
        correlations: [f64; 2],
        certainty: Certainty,
    ) -> Self {
        let state = fit.state;
        let [before, after] = [start, state].map(|state| state.probe_from_pixel());
        let shifts =
            State::points(slices).map(|p| after.transform_point3(p).distance_squared(before.transform_point3(p)));
        let variances = places(slices, &state).map(|p| certainty.variance_mm2(p));
        let mean = |of: &[f64; 9]| (of.iter().sum::<f64>() / 9.0).sqrt();
        let rigid = start.probe_from_picture.inverse() * state.probe_from_picture;
        let turn = DQuat::from_mat3(&rigid.matrix3).to_scaled_axis();
        let scaled = state.picture_from_pixel * start.picture_from_pixel.inverse();
        let errors = certainty.errors();
        let mut taking_part: Vec<usize> = lines.pairs.iter().flatten().copied().collect();
        taking_part.sort_unstable();
        taking_part.dedup();
        Self {
            lines: lines.pairs.len(),
            slices: taking_part.len(),
            correlations,
            shift_mm: mean(&shifts),
            shift_se_mm: mean(&variances),
            worst_se_mm: variances.iter().copied().fold(0.0, f64::max).sqrt(),
            translation_mm: [rigid.translation.to_array(), [errors[0], errors[1], errors[2]]],
            rotation_deg: [turn.to_array(), [errors[3], errors[4], errors[5]]].map(|rad| rad.map(f64::to_degrees)),
            scale: [[scaled.matrix3.x_axis.x - 1.0, scaled.matrix3.y_axis.y - 1.0], [errors[6], errors[7]]],
            lag_s: [state.lag_s, errors[8]],
            motion: certainty.motion(directions.count),
            moved: moved(directions, lines, &state),
            directions: directions.clone(),
            correction: after * before.inverse(),
        }
    }

    /// Returns the transform from image to probe by the calibration found, from the one in use.
    pub fn corrected(&self, probe_from_image: DAffine3) -> DAffine3 {
        self.correction * probe_from_image
    }

    /// Whether the image is displaced by more than chance explains. A calibration by which the
    /// slices agree no better is displaced by the method: coarse pixels falsify the scale.
    fn is_displaced(&self) -> bool {
        let [before, after] = self.correlations;
        self.shift_mm > SLIPPED_MM && self.shift_mm > SLIPPED_ERRORS * self.shift_se_mm && after > before
    }

    /// Returns the reason why the sweeps do not tell whether the calibration in use holds, if there
    /// is one. A displacement that exceeds its standard error by far is certain though the
    /// calibration found is not.
    pub fn undecided(&self) -> Option<CrossingsError> {
        let Self { motion, worst_se_mm: mm, .. } = *self;
        if self.directions.count < LEAST_DIRECTIONS {
            return Some(CrossingsError::Directions { count: self.directions.count, least: LEAST_DIRECTIONS, motion });
        }
        if let Some((sides, ratio)) = self.moved {
            return Some(CrossingsError::Moved { sides, ratio });
        }
        let is_certain = mm <= MOST_ERROR_MM || self.is_displaced();
        (!is_certain).then_some(CrossingsError::Uncertain { mm, most_mm: MOST_ERROR_MM, motion })
    }

    /// Whether the calibration in use no longer holds: it displaces the image by more than chance
    /// explains.
    pub fn has_slipped(&self) -> bool {
        self.undecided().is_none() && self.is_displaced()
    }

    /// Whether the latency in use is off by more than chance explains.
    pub fn is_late(&self) -> bool {
        let [lag_s, se_s] = self.lag_s;
        self.undecided().is_none() && lag_s.abs() > LATE_S && lag_s.abs() > SLIPPED_ERRORS * se_s
    }

    /// Returns the reason why the calibration found is not to be used, if there is one.
    pub fn unfit(&self) -> Option<CrossingsError> {
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let [before, after] = self.correlations;
        let too_much =
            [(largest(&self.translation_mm[0]), MOST_MM, "mm"), (largest(&self.rotation_deg[0]), MOST_DEG, "degrees")];
        if let Some(why) = self.undecided() {
            return Some(why);
        }
        if largest(&self.scale[0]) > MOST_SCALE {
            return Some(CrossingsError::Scale { factor: 1.0 + 0.5 * (self.scale[0][0] + self.scale[0][1]) });
        }
        if !(self.worst_se_mm <= MOST_ERROR_MM) {
            let (mm, most_mm) = (self.worst_se_mm, MOST_ERROR_MM);
            return Some(CrossingsError::Uncertain { mm, most_mm, motion: self.motion });
        }
        if let Some((by, most, unit)) = too_much.into_iter().find(|(by, most, _)| by > most) {
            return Some(CrossingsError::Large { by, most, unit });
        }
        if !(self.shift_mm > SLIPPED_ERRORS * self.shift_se_mm || self.is_late()) {
            return Some(CrossingsError::Holds { shift_mm: self.shift_mm, se_mm: self.shift_se_mm });
        }
        (after <= before).then_some(CrossingsError::NoBetter { before, after })
    }
}

/// Returns the sweeps whose slices differ by much more than those of others.
fn moved(directions: &Directions, lines: &Lines<'_>, state: &State) -> Option<(Sides, f64)> {
    let mut by_pair: std::collections::BTreeMap<Sides, Vec<f64>> = std::collections::BTreeMap::new();
    for (pair, points) in lines.pairs.iter().zip(lines.points(state)) {
        let [Some(a), Some(b)] = pair.map(|slice| directions.sweep[slice]) else { continue };
        if a != b && !points.is_empty() {
            let square = points.iter().map(|(difference, _)| difference * difference).sum::<f64>();
            by_pair.entry([a.min(b), a.max(b)]).or_default().push((square / points.len() as f64).sqrt());
        }
    }
    let typical = |(sides, mut all): (Sides, Vec<f64>)| (all.len() >= LEAST_LINES).then(|| (sides, median(&mut all)));
    let each: Vec<(Sides, f64)> = by_pair.into_iter().filter_map(typical).collect();
    let (sides, worst) = each.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let mut others: Vec<f64> = each.iter().filter(|(other, _)| *other != sides).map(|(_, of)| *of).collect();
    let ratio = worst / median(&mut others);
    (others.len() >= 2 && ratio > MOVED).then_some((sides, ratio))
}
