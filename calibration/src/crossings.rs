//! Checks and refines a probe's calibration by slices that cross, without a phantom.
//!
//! Two slices whose planes cross show the same line of the body. A wrong calibration displaces the
//! line in both, each along its own plane. Sweeps in three or more directions determine nine
//! numbers by that: the pose of the image plane at the sensor, its scale along u and v, and the
//! tracker's latency (Blackall et al., 2000; Wein & Khamene, 2008). If the calibration in use is
//! displaced by more than chance explains, the sensor has slipped, or a setting has changed.
//!
//! - [`directions`](Directions): sweeps of a scan, and directions of their planes.
//! - `pairs`: pairs of slices that are compared.
//! - `scales`: slices, blurred: coarse ones first, so that a large displacement is found.
//! - `state`: the nine numbers, and slices placed by them.
//! - `line`: grey values of two slices along their line, and derivatives.
//! - `fit`: Gauss and Newton's method over all lines.
//! - `certainty`: standard errors, and what the sweeps do not determine.
//! - `checked`: the result, and reasons not to use it.
//!
//! Poses should be smoothed before: a pose's noise displaces its slice as a calibration does.

#![cfg_attr(test, allow(clippy::print_stdout, reason = "figures, for who asks with --nocapture"))]
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "a comparison with NaN must refuse, not pass")]

pub(crate) mod certainty;
mod checked;
pub(crate) mod directions;
pub(crate) mod fit;
pub(crate) mod line;
pub(crate) mod pairs;
pub(crate) mod scales;
pub(crate) mod state;

pub use checked::Checked;
pub use directions::{Directions, LEAST_DIRECTIONS};

use crate::error::{CalibrationError, CrossingsError};
use crate::slices::Slices;
use certainty::Certainty;
use fit::Fit;
use line::Lines;
use state::State;

/// Blurs of the images, standard deviations, mm: coarse ones first.
pub(crate) const COARSE_MM: [f64; 2] = [1.6, 0.8];
pub(crate) const FINE_MM: f64 = 0.4;
/// Lags at which the search begins, s: at constant speed, a lag displaces slices as other numbers
/// do, so that a search from one lag may end at a wrong one.
const LAGS_S: [f64; 5] = [0.0, -0.04, 0.04, -0.08, 0.08];
/// Lines that suffice for coarse images.
const COARSE_LINES: usize = 400;
/// Lines that are needed for a check.
pub(crate) const LEAST_LINES: usize = 100;
/// Correlation along the lines, median: agreement above, none below.
pub(crate) const ALIKE: f64 = 0.5;

impl Slices {
    /// Checks the calibration of the slices: finds the one by which they agree best where they
    /// cross.
    ///
    /// # Errors
    /// [`CrossingsError`] if the slices do not cross enough, or agree by no calibration near this
    /// one.
    pub fn checked(&self) -> Result<Checked, CalibrationError> {
        let start = State::of(self);
        let directions = Directions::of(self, &start);
        let pairs = pairs::chosen(self, &start);
        if pairs.len() < LEAST_LINES {
            return Err(CrossingsError::FewLines {
                lines: pairs.len(),
                least: LEAST_LINES,
                directions: directions.count,
            }
            .into());
        }
        // A part of the lines brings the method near.
        let some = some(&pairs);
        let coarse = Lines::new(self, &some, COARSE_MM[0]);
        let scale = coarse.scale(&start);
        let starts = LAGS_S.map(|lag_s| {
            let mut fit = Fit::new(start, lag_s);
            fit.improve(&coarse);
            (coarse.cost(&fit.state, scale), fit)
        });
        let best = starts.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let mut fit = best.map_or(Fit::new(start, 0.0), |(_, fit)| fit);
        fit.improve(&Lines::new(self, &some, COARSE_MM[1]));
        let lines = Lines::new(self, &pairs, FINE_MM);
        fit.improve(&lines);
        let correlations = [start, fit.state].map(|state| lines.correlation(&state.placing(self)));
        if !(correlations[1] >= ALIKE) {
            return Err(CrossingsError::Unrelated { correlation: correlations[1], least: ALIKE }.into());
        }
        let certainty = Certainty::of(self, &lines, &fit);
        Ok(Checked::new(self, &directions, &lines, start, &fit, correlations, certainty))
    }
}

/// Returns a part of the lines, for coarse images.
pub(crate) fn some(pairs: &[[usize; 2]]) -> Vec<[usize; 2]> {
    pairs.iter().copied().step_by((pairs.len() / COARSE_LINES).max(1)).collect()
}

#[cfg(test)]
mod tests;
