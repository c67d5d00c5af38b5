//! Predicted errors of the plane from the covariance.

use glam::DVec2;

use super::refine::{KNOWN, Refined, Unknown};
use crate::probe::scatter::lasted;
use crate::probe::unknown::NUMBERS;

/// Count of a pixel's coordinates, the target's numbers, and the lag.
const TOGETHER: usize = 3 + KNOWN;

impl Refined {
    /// Returns the covariance of a pixel's position in the probe's frame, mm², from the fitted
    /// scatter and its correlation.
    pub fn covariance_mm2(&self, px: DVec2) -> [[f64; 3]; 3] {
        let all = self.together(px);
        std::array::from_fn(|i| std::array::from_fn(|j| self.entry(&all, [i, j])))
    }

    /// Returns the predicted error of a pixel's position, one standard deviation: the root of
    /// the sum of the three axes' variances, mm.
    pub fn predicted_mm(&self, px: DVec2) -> f64 {
        let covariance = self.covariance_mm2(px);
        (0..3).map(|i| covariance[i][i]).sum::<f64>().sqrt()
    }

    /// Returns the covariance of the plane's own numbers, named in
    /// [`crate::probe::refine::PLANE`]. It is computed from the fitted scatter and multiplied
    /// by its correlation, which is conservative for numbers with a prior.
    pub fn covariance(&self) -> [[f64; NUMBERS]; NUMBERS] {
        let lasting = self.lasting * self.excess;
        self.unknown.plane.covariance(self.solution.certainty()).map(|row| row.map(|entry| entry * lasting))
    }

    /// Returns the covariance of the target's three numbers; for a point of its position in the
    /// reference's frame, mm².
    pub fn target_covariance(&self) -> [[f64; 3]; 3] {
        let all = self.together(self.unknown.plane.pivot_px());
        std::array::from_fn(|i| std::array::from_fn(|j| self.entry(&all, [3 + i, 3 + j])))
    }

    /// Returns the variance of the lag, s².
    pub(super) fn lag_variance(&self) -> f64 {
        self.entry(&self.together(self.unknown.plane.pivot_px()), [TOGETHER - 1; 2])
    }

    fn entry(&self, all: &[[f64; TOGETHER]; TOGETHER], at: [usize; 2]) -> f64 {
        let known = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { self.known[i] } else { 0.0 }));
        lasted::<TOGETHER, KNOWN>(all, &known, self.lasting * self.excess, at)
    }

    /// Returns the covariance, for independent measurements, of a pixel's position (mm), the
    /// target's numbers (mm), and the lag (s).
    fn together(&self, px: DVec2) -> [[f64; TOGETHER]; TOGETHER] {
        let Unknown { plane, target, lag } = self.unknown;
        let by_plane = plane.first_of(&self.solution.state, px);
        let one = |row: usize, column: usize| f64::from(u8::from(row == column));
        self.solution.certainty().propagated(|all| {
            plane
                .add_to(all, by_plane)
                .by(target, std::array::from_fn(|row| std::array::from_fn(|i| one(row, 3 + i))))
                .by(lag, std::array::from_fn(|row| [one(row, TOGETHER - 1)]))
        })
    }
}
