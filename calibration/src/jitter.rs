//! Corrects slices within their planes by the images of their neighbours.
//!
//! A tracker's noise displaces each slice by itself. Where one pose was recorded for each image, no
//! average over time removes it. Slices of one sweep lie so close that each is known from those
//! before and after it: a slice is displaced within its plane, and turned, until it differs least
//! from what they predict.
//!
//! - `sequence`: slices in the order of time, with their neighbours.
//! - `prediction`: grey values of a slice by its neighbours, by a line across the plane.
//! - `points`: points of all slices, for the fit and outside of it, and how they differ from their
//!   predictions.
//! - `fit`: displacements of all slices, at once in each round.
//! - `corrected`: the result, and reasons not to use it.
//!
//! The prediction is symmetric: anatomy that slopes steadily through the sweep has a displacement
//! of 0. A chain of displacements from one slice to the next would make it upright. Errors that
//! many neighbours share remain, as no neighbour shows them. Errors across the plane remain, too:
//! in a sloping body they look like errors within it, and curved anatomy looks like both.

#![cfg_attr(test, allow(clippy::print_stdout, reason = "figures, for who asks with --nocapture"))]
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "a comparison with NaN must refuse, not pass")]

mod corrected;
mod fit;
mod points;
mod prediction;
mod sequence;

pub use corrected::Jitter;

use crate::crossings::state::State;
use crate::error::{CalibrationError, JitterError};
use crate::slices::Slices;
use crate::tracker::noise::TrackerNoise;
use fit::{Fit, Prior};
use points::Scan;

/// Slices that are needed.
const LEAST_SLICES: usize = 2 * sequence::REACH;

impl Slices {
    /// Finds the displacement of each slice within its plane by which it agrees best with its
    /// neighbours in the same sweep. `noise` is that of the pose of one slice.
    ///
    /// The result does not depend on the order in which slices were added, if their times differ.
    ///
    /// # Errors
    /// [`JitterError`] if the slices are too few or too far apart, show too little, or agree hardly
    /// better than by the poses as they are.
    pub fn jitter(&self, noise: TrackerNoise) -> Result<Jitter, CalibrationError> {
        let found = self.found_jitter(noise)?;
        match found.unfit() {
            Some(why) => Err(why.into()),
            None => Ok(found),
        }
    }

    /// Finds the displacements, though they may not be fit for use.
    fn found_jitter(&self, noise: TrackerNoise) -> Result<Jitter, JitterError> {
        let TrackerNoise { position_mm, rotation_deg } = noise;
        let is_noise = |x: f64| x > 0.0 && x.is_finite();
        if !(is_noise(position_mm) && is_noise(rotation_deg)) {
            return Err(JitterError::Noise { position_mm, rotation_deg });
        }
        let state = State::of(self);
        let prior = Prior::of(&state, noise);
        let members = sequence::members(self, &state, prior.across_mm);
        if members.len() < LEAST_SLICES {
            return Err(JitterError::FewSlices { slices: members.len(), least: LEAST_SLICES });
        }
        let scan = Scan::new(self, &state, members);
        let mut fit = Fit::new(&scan);
        fit.improve(&scan, &prior);
        Ok(Jitter::new(self, &state, &scan, &fit, &prior))
    }
}

#[cfg(test)]
mod tests;
