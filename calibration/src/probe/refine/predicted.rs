//! How far off the plane may be, by the covariance; and how far with further pictures.

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

/// Parameters of which something is known beforehand: the phantom's turn and shift, and the lag.
pub(super) const KNOWN: usize = 7;
/// A pixel's place, and these.
pub(super) const TOGETHER: usize = 3 + KNOWN;

impl Refined {
    /// Covariance of where a pixel lies in the probe's frame, mm²: by the scatter that was found, and as long as it lasts.
    pub fn covariance_mm2(&self, px: DVec2) -> [[f64; 3]; 3] {
        self.covariance_by(self.solution.certainty(), px)
    }

    fn covariance_by(&self, certainty: &Certainty, px: DVec2) -> [[f64; 3]; 3] {
        let all = self.together(certainty, px);
        std::array::from_fn(|i| std::array::from_fn(|j| lasted(&all, &self.known, self.lasting, [i, j])))
    }

    /// Covariance of the plane's own numbers, as [`super::PLANE`] names them: by the scatter that was found, times as long as it lasts, which is more than enough where something was known
    /// beforehand. Of a skew that was not sought it is 0.
    pub fn covariance(&self) -> [[f64; NUMBERS]; NUMBERS] {
        self.unknown.plane.covariance(self.solution.certainty()).map(|row| row.map(|entry| entry * self.lasting))
    }

    /// The pixel whose place the plane's place is.
    pub fn pivot_px(&self) -> DVec2 {
        self.unknown.plane.pivot_px()
    }

    /// Covariance, as if no measurement repeated another, of where a pixel lies (mm), the phantom's turn (rad) and shift (mm), and the lag (s).
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

    /// Predicted error of where a pixel lies, one standard deviation: the root of the sum of the three axes' variances, mm.
    pub fn predicted_mm(&self, px: DVec2) -> f64 {
        self.predicted_by(self.solution.certainty(), px)
    }

    fn predicted_by(&self, certainty: &Certainty, px: DVec2) -> f64 {
        let covariance = self.covariance_by(certainty, px);
        (0..3).map(|i| covariance[i][i]).sum::<f64>().sqrt()
    }

    /// The largest predicted error at the corners and in the middle of a picture of that size, mm.
    pub fn largest_mm(&self, size_px: [u32; 2]) -> f64 {
        self.largest_by(self.solution.certainty(), size_px)
    }

    fn largest_by(&self, certainty: &Certainty, size_px: [u32; 2]) -> f64 {
        let [u, v] = size_px.map(|n| f64::from(n) - 1.0);
        let places = [[0.0, 0.0], [u, 0.0], [0.0, v], [u, v], [0.5 * u, 0.5 * v]];
        places.into_iter().map(|px| self.predicted_by(certainty, DVec2::from_array(px))).fold(0.0, f64::max)
    }

    /// What [`Self::largest_mm`] would be with so many more pictures of one view, in which dots are where the calibration has them: the poses there (of any time) and the dots say what they would tell, the scatter that was
    /// found how well, as long as it lasts. A probe that is held still tells nothing of the lag. `None` where the view tells no number.
    pub(in crate::probe) fn foreseen_mm(
        &self,
        layout: &Layout,
        view: &View,
        pictures: usize,
        size_px: [u32; 2],
    ) -> Option<f64> {
        // Pictures at 0 s by poses that come later.
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

/// A view of the phantom: where the sensors are, and what is seen.
pub(in crate::probe) struct View {
    pub(in crate::probe) poses: Poses,
    pub(in crate::probe) marks: Vec<Mark>,
}
