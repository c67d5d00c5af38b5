//! Counts how often the intervals of calibrations hold the truth.

use glam::{DQuat, DVec2};

use crate::probe::plane::{ImagePlane, NUMBERS};
use crate::probe::plane_covariance::PlaneCovariance;
use crate::tests::noise::{Noise, mahalanobis};
use crate::tests::wire_scans::SIZE_PX;

/// Counts of calibrations whose intervals hold the truth.
pub(crate) struct Coverage {
    calibrations: u32,
    planes: u32,
    lengths: u32,
    noise: Noise,
}

/// Lengths that are measured with each calibration.
const LENGTHS: u32 = 25;

impl Coverage {
    pub(crate) fn new() -> Self {
        Self { calibrations: 0, planes: 0, lengths: 0, noise: Noise::new(77) }
    }

    /// Adds a calibration: all eight numbers together, and lengths of 5 to 64 mm anywhere in the
    /// image.
    pub(crate) fn add(&mut self, found: &ImagePlane, covariance: &PlaneCovariance, truth: &ImagePlane) {
        let pivot = covariance.pivot_px();
        let turn = DQuat::from_mat3(&(found.axes().transpose() * truth.axes())).to_scaled_axis();
        let shift = truth.point(pivot) - found.point(pivot);
        let [u, v] = [0, 1].map(|axis| (truth.pixel_mm()[axis] / found.pixel_mm()[axis]).ln());
        let entries: [[f64; 8]; 8] = std::array::from_fn(|i| std::array::from_fn(|j| covariance.entries()[i][j]));
        let error = [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z, u, v];
        // The 95 % quantile of χ² with 8 degrees of freedom.
        self.planes += u32::from(mahalanobis(error, &entries) <= 15.507);
        self.calibrations += 1;
        let mut count = 0;
        while count < LENGTHS {
            let [a, b] =
                [0; 2].map(|_| DVec2::from_array(SIZE_PX.map(|n| self.noise.between(0.0, f64::from(n) - 1.0))));
            let length = |plane: &ImagePlane| plane.point(a).distance(plane.point(b));
            if !(5.0..64.0).contains(&length(truth)) {
                continue;
            }
            count += 1;
            let along = (found.point(b) - found.point(a)).normalize();
            let [by_a, by_b] = [a, b].map(|px| found.changes(pivot, px));
            let slope = |one: &[f64; NUMBERS]| -> f64 {
                one.iter().zip(by_b.iter().zip(by_a)).map(|(x, (b, a))| along.dot(*b - a) * x).sum()
            };
            let sd = covariance.components().iter().map(|one| slope(one).powi(2)).sum::<f64>().sqrt();
            self.lengths += u32::from((length(found) - length(truth)).abs() <= 1.96 * sd);
        }
    }

    /// Asserts that intervals of 95 % hold the truth in 93 to 97 of 100 cases, by 400 calibrations;
    /// by fewer, the limits are wider, as the shares scatter more.
    pub(crate) fn check(&self, of: &str) {
        let calibrations = f64::from(self.calibrations);
        let shares =
            [f64::from(self.planes) / calibrations, f64::from(self.lengths) / calibrations / f64::from(LENGTHS)];
        let limit = 0.02 * (400.0 / calibrations).sqrt().max(1.0);
        assert!(shares.iter().all(|share| (share - 0.95).abs() <= limit), "{of}: {shares:?}");
    }
}
