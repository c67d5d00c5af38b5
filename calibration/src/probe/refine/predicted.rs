//! Predicted errors of the plane from the covariance, at present and with further images.

use glam::DVec2;

use super::problem::Problem;
use super::{Refined, Unknown};
use crate::least_squares::Certainty;
use crate::probe::layout::Layout;
use crate::probe::matching::Mark;
use crate::probe::scatter::lasted;
use crate::probe::sighting::Sighting;
use crate::probe::track::{Poses, Track};
use crate::probe::unknown::NUMBERS;

/// Count of parameters with a prior: the phantom's rotation and shift, and the lag.
pub(super) const KNOWN: usize = 7;
/// Count of a pixel's coordinates and these.
pub(super) const TOGETHER: usize = 3 + KNOWN;

impl Refined {
    /// Returns the covariance of a pixel's position in the probe's frame, mm², from the fitted
    /// scatter and its correlation.
    pub fn covariance_mm2(&self, px: DVec2) -> [[f64; 3]; 3] {
        self.covariance_by(self.solution.certainty(), px)
    }

    fn covariance_by(&self, certainty: &Certainty, px: DVec2) -> [[f64; 3]; 3] {
        let all = self.together(certainty, px);
        std::array::from_fn(|i| std::array::from_fn(|j| lasted(&all, &self.known, self.lasting, [i, j])))
    }

    /// Returns the covariance of the plane's own numbers, named in [`super::PLANE`]. It is
    /// computed from the fitted scatter and multiplied by its correlation, which is
    /// conservative for numbers with a prior. 0 for a skew that was not fitted.
    pub fn covariance(&self) -> [[f64; NUMBERS]; NUMBERS] {
        self.unknown.plane.covariance(self.solution.certainty()).map(|row| row.map(|entry| entry * self.lasting))
    }

    /// Returns the pixel at which the plane's position is defined.
    pub fn pivot_px(&self) -> DVec2 {
        self.unknown.plane.pivot_px()
    }

    /// Returns the covariance, for independent measurements, of a pixel's position (mm), the
    /// phantom's rotation (rad) and shift (mm), and the lag (s).
    pub(super) fn together(&self, certainty: &Certainty, px: DVec2) -> [[f64; TOGETHER]; TOGETHER] {
        let Unknown { plane, phantom_turn, phantom_shift, lag } = self.unknown;
        let one = |row: usize, first: usize| -> [f64; 3] {
            std::array::from_fn(|i| if row == first + i { 1.0 } else { 0.0 })
        };
        let by_plane = plane.first_of(&self.solution.state, px);
        certainty.propagated(|all| {
            plane
                .add_to(all, by_plane)
                .by(phantom_turn, std::array::from_fn(|row| one(row, 3)))
                .by(phantom_shift, std::array::from_fn(|row| one(row, 6)))
                .by(lag, std::array::from_fn(|row| if row == TOGETHER - 1 { [1.0] } else { [0.0] }))
        })
    }

    /// Returns the predicted error of a pixel's position, one standard deviation: the root of
    /// the sum of the three axes' variances, mm.
    pub fn predicted_mm(&self, px: DVec2) -> f64 {
        self.predicted_by(self.solution.certainty(), px)
    }

    fn predicted_by(&self, certainty: &Certainty, px: DVec2) -> f64 {
        let covariance = self.covariance_by(certainty, px);
        (0..3).map(|i| covariance[i][i]).sum::<f64>().sqrt()
    }

    /// Returns the largest predicted error at the corners and the centre of an image of this
    /// size, mm.
    pub fn largest_mm(&self, size_px: [u32; 2]) -> f64 {
        self.largest_by(self.solution.certainty(), size_px)
    }

    fn largest_by(&self, certainty: &Certainty, size_px: [u32; 2]) -> f64 {
        let [u, v] = size_px.map(|n| f64::from(n) - 1.0);
        let places = [[0.0, 0.0], [u, 0.0], [0.0, v], [u, v], [0.5 * u, 0.5 * v]];
        places.into_iter().map(|px| self.predicted_by(certainty, DVec2::from_array(px))).fold(0.0, f64::max)
    }

    /// Predicts [`Self::largest_mm`] with further images of one view, whose dots lie where the
    /// calibration predicts them. The poses there (of any time) and the dots define the
    /// measurements; the fitted scatter and its correlation define their noise. A static probe
    /// gives no information about the lag. `None` if the view gives invalid numbers.
    pub(in crate::probe) fn foreseen_mm(
        &self,
        layout: &Layout,
        view: &View,
        pictures: usize,
        size_px: [u32; 2],
    ) -> Option<f64> {
        // The images are at 0 s, the poses later by the lag.
        let sightings = [Sighting { frame: 0, time_s: 0.0, marks: view.marks.clone() }];
        let track = Track::new(vec![Poses { time_s: self.lag_s, ..view.poses }]);
        let problem = Problem {
            layout,
            sightings: &sightings,
            track: &track,
            registration: self.given,
            centre: self.centre,
            unknown: self.unknown,
        };
        let state = &self.solution.state;
        let seen = problem.pictures(state, &[vec![true; view.marks.len()]]);
        let whitenings: Vec<_> =
            seen.iter().map(|picture| problem.scattered(state, picture).whitening(self.scatter.variances())).collect();
        let certainty = self.solution.certainty();
        let more = certainty.with(pictures as f64, |blocks| problem.put(state, &seen, &whitenings, blocks))?;
        Some(self.largest_by(&more, size_px))
    }
}

/// A view of the phantom: poses of the sensors, and visible dots.
pub(in crate::probe) struct View {
    pub(in crate::probe) poses: Poses,
    pub(in crate::probe) marks: Vec<Mark>,
}
