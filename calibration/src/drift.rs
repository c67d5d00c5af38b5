//! Corrects slow drift of poses, and finds a sensor that slips, by sweeps that cross.
//!
//! A tracker's slow error displaces neighbouring slices alike. Sweeps of other directions cross
//! them at other times, and show it: each slice moves on its own, by a rigid motion that changes
//! slowly within its sweep, until the slices agree along their lines. One rigid motion for each
//! whole sweep tells whether the sensor slipped between two of them.
//!
//! The first of the sweeps that cross is held. An error that all sweeps share moves no slice
//! against another: crossings do not show it.
//!
//! - `crossed`: sweeps that cross each other, and their lines.
//! - `knots`: motions of slices between a sweep's knots.
//! - `fit`: Gauss and Newton's method over all lines.
//! - `fitted`: the knots' motions, with their covariance.
//! - `found`: [the drift](Drift), and reasons not to correct it.
//! - `slip`: [a slip](Slip) between two sweeps.
//!
//! Poses should be smoothed before, as for [`crossings`](crate::crossings), and the calibration
//! [checked](Slices::checked): by a wrong one, sweeps of different directions disagree as by drift.

#![cfg_attr(test, allow(clippy::print_stdout, reason = "figures, for who asks with --nocapture"))]
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "a comparison with NaN must refuse, not pass")]

mod crossed;
mod fit;
mod fitted;
mod found;
mod knots;
mod slip;

pub use found::{Drift, SweepDrift};
pub use slip::Slip;

use crate::error::CalibrationError;
use crate::slices::Slices;
use fitted::Fitted;

impl Slices {
    /// Finds the slow drift of the poses by which sweeps agree best where they cross.
    ///
    /// # Errors
    /// [`DriftError`](crate::error::DriftError) if the sweeps do not cross enough, agree by no
    /// small drift, or need no correction.
    pub fn drift(&self) -> Result<Drift, CalibrationError> {
        let found = Drift::of(self, &Fitted::new(self, knots::PER_SWEEP)?);
        Ok(found.unfit().map_or(Ok(found), Err)?)
    }

    /// Finds the sweep before which the sensor slipped on the probe; none if it held.
    ///
    /// A body that moved between two sweeps, as a whole, looks the same.
    ///
    /// # Errors
    /// [`DriftError`](crate::error::DriftError) if the sweeps do not cross enough to tell, or if
    /// the calibration is off in all sweeps.
    pub fn slipped(&self) -> Result<Option<Slip>, CalibrationError> {
        Ok(Slip::of(self, &Fitted::new(self, 1)?)?)
    }
}

#[cfg(test)]
mod tests;
