//! Predicted errors of the plane from the covariance.

use glam::DVec2;

use super::refine::{KNOWN, Refined, Unknown};
use crate::error::CovarianceError;
use crate::probe::plane::NUMBERS;
use crate::probe::plane_covariance::PlaneCovariance;
use crate::probe::scatter::lasted;
use crate::probe::unknown::own_numbers;

/// Count of a pixel's coordinates, the target's numbers, and the lag.
const TOGETHER: usize = 3 + KNOWN;
/// Count of the plane's numbers and these.
const OWN: usize = NUMBERS + KNOWN;

impl Refined {
    /// Returns the covariance of a pixel's position in the probe's frame, mm², from the fitted
    /// scatter and its correlation.
    pub fn covariance_mm2(&self, px: DVec2) -> [[f64; 3]; 3] {
        let all: [[f64; TOGETHER]; TOGETHER] = self.together(self.unknown.plane.first_of(&self.solution.state, px));
        std::array::from_fn(|i| std::array::from_fn(|j| self.entry(&all, [i, j])))
    }

    /// Returns the predicted error of a pixel's position, one standard deviation: the root of
    /// the sum of the three axes' variances, mm.
    pub fn predicted_mm(&self, px: DVec2) -> f64 {
        let covariance = self.covariance_mm2(px);
        (0..3).map(|i| covariance[i][i]).sum::<f64>().sqrt()
    }

    /// Returns the covariance of the plane's own numbers, from the fitted scatter and its
    /// correlation.
    ///
    /// # Errors
    /// [`CovarianceError`] if the plane is so uncertain that its error is not linear.
    pub fn covariance(&self) -> Result<PlaneCovariance, CovarianceError> {
        let all: [[f64; OWN]; OWN] = self.together(own_numbers());
        let entries = std::array::from_fn(|i| std::array::from_fn(|j| self.entry(&all, [i, j])));
        PlaneCovariance::of_fit(self.unknown.plane.pivot_px(), entries)
    }

    /// Returns the covariance of the target's three numbers; for a point of its position in the
    /// reference's frame, mm².
    pub fn target_covariance(&self) -> [[f64; 3]; 3] {
        let all: [[f64; OWN]; OWN] = self.together(own_numbers());
        std::array::from_fn(|i| std::array::from_fn(|j| self.entry(&all, [NUMBERS + i, NUMBERS + j])))
    }

    /// Returns the variance of the lag, s².
    pub(super) fn lag_variance(&self) -> f64 {
        let all: [[f64; OWN]; OWN] = self.together(own_numbers());
        self.entry(&all, [OWN - 1; 2])
    }

    fn entry<const T: usize>(&self, all: &[[f64; T]; T], at: [usize; 2]) -> f64 {
        let known = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { self.known[i] } else { 0.0 }));
        lasted::<T, KNOWN>(all, &known, self.lasting * self.excess, at)
    }

    /// Returns the covariance, for independent measurements, of numbers with these derivatives by
    /// the plane, followed by the target's numbers (mm) and the lag (s).
    fn together<const T: usize>(&self, by_plane: [[f64; NUMBERS]; T]) -> [[f64; T]; T] {
        let Unknown { plane, target, lag } = self.unknown;
        let one = |row: usize, column: usize| f64::from(u8::from(row == T - KNOWN + column));
        self.solution.certainty().propagated(|all| {
            plane
                .add_to(all, by_plane)
                .by(target, std::array::from_fn(|row| std::array::from_fn(|i| one(row, i))))
                .by(lag, std::array::from_fn(|row| [one(row, KNOWN - 1)]))
        })
    }
}
