//! How far off the plane may be, by the covariance; and how far with further pictures.

use glam::{DMat3, DVec2, DVec3};

use super::problem::{Problem, whitening};
use super::{Refined, Unknown};
use crate::least_squares::{Certainty, rows, turned};
use crate::probe::layout::Layout;
use crate::probe::matching::Mark;
use crate::probe::sighting::Sighting;
use crate::probe::track::{Poses, Track};

/// Parameters of which something is known beforehand: the phantom's turn and shift, and the lag.
pub(super) const KNOWN: usize = 7;
/// A pixel's place, and these.
pub(super) const TOGETHER: usize = 3 + KNOWN;

/// The plane's numbers and their units: turns about the probe's axes, the place of a pixel ([`Refined::pivot_px`]), sizes of a pixel, the cosine between u and v.
pub const PLANE: [&str; 9] = [
    "turn about x (rad)",
    "turn about y (rad)",
    "turn about z (rad)",
    "place x (mm)",
    "place y (mm)",
    "place z (mm)",
    "pixel along u (relative)",
    "pixel along v (relative)",
    "skew",
];

impl Refined {
    /// Covariance of where a pixel lies in the probe's frame, mm²: by the scatter that was found, and as long as it lasts.
    pub fn covariance_mm2(&self, px: DVec2) -> [[f64; 3]; 3] {
        self.covariance_by(self.solution.certainty(), px)
    }

    fn covariance_by(&self, certainty: &Certainty, px: DVec2) -> [[f64; 3]; 3] {
        let all = self.together(certainty, px);
        std::array::from_fn(|i| std::array::from_fn(|j| self.lasted(&all, [i, j])))
    }

    /// Covariance of the plane's own numbers, as [`PLANE`] names them: by the scatter that was found, times as long as it lasts, which is more than enough where something was known
    /// beforehand. Of a skew that was not sought it is 0.
    pub fn covariance(&self) -> [[f64; PLANE.len()]; PLANE.len()] {
        let Unknown { turn, place, size, skew, .. } = self.unknown;
        let one = |row: usize, column: usize| if row == column { 1.0 } else { 0.0 };
        let all: [[f64; PLANE.len()]; PLANE.len()] = self.solution.certainty().propagated(|numbers| {
            numbers
                .by(turn, std::array::from_fn(|row| std::array::from_fn::<_, 3, _>(|k| one(row, k))))
                .by(place, std::array::from_fn(|row| std::array::from_fn::<_, 3, _>(|k| one(row, 3 + k))))
                .by(size, std::array::from_fn(|row| std::array::from_fn::<_, 2, _>(|k| one(row, 6 + k))))
                .by(skew, std::array::from_fn(|row| [one(row, 8)]))
        });
        all.map(|row| row.map(|entry| entry * self.lasting))
    }

    /// The pixel whose place the plane's place is.
    pub fn pivot_px(&self) -> DVec2 {
        self.pivot_px
    }

    /// A covariance of those together, where measurements repeat each other: were there only 1/n of them, H = H_data + H_known would be the information; the solution weighs them as if there
    /// were all, so that its covariance is H⁻¹(n·H_data + H_known)H⁻¹.
    pub(super) fn lasted(&self, all: &[[f64; TOGETHER]; TOGETHER], [i, j]: [usize; 2]) -> f64 {
        let known = |a: usize, b: usize| all[i][3 + a] * self.known[a][b] * all[j][3 + b];
        let of_known: f64 = (0..KNOWN).flat_map(|a| (0..KNOWN).map(move |b| (a, b))).map(|(a, b)| known(a, b)).sum();
        self.lasting * all[i][j] - (self.lasting - 1.0) * of_known
    }

    /// Covariance, as if no measurement repeated another, of where a pixel lies (mm), the phantom's turn (rad) and shift (mm), and the lag (s).
    pub(super) fn together(&self, certainty: &Certainty, px: DVec2) -> [[f64; TOGETHER]; TOGETHER] {
        let Unknown { turn, place, size, skew, phantom_turn, phantom_shift, lag } = self.unknown;
        let state = &self.solution.state;
        let from = px - self.pivot_px;
        let image_turn = state.rotation(turn);
        let ([size_u, size_v], [skewed]) = (state.scale(size), state.vector(skew));
        let own = DVec3::new(size_u * from.x + skewed * size_v * from.y, size_v * from.y, 0.0);
        let by_turn = rows(DMat3::from_quat(image_turn) * turned(own));
        let by_size = [
            image_turn * DVec3::new(size_u * from.x, 0.0, 0.0),
            image_turn * (DVec3::new(skewed, 1.0, 0.0) * (size_v * from.y)),
        ];
        let by_skew = image_turn * DVec3::new(size_v * from.y, 0.0, 0.0);
        let one = |row: usize, first: usize| -> [f64; 3] {
            std::array::from_fn(|i| if row == first + i { 1.0 } else { 0.0 })
        };
        let of_point = |row: usize| row < 3;
        certainty.propagated(|all| {
            all.by(turn, std::array::from_fn(|row| if of_point(row) { by_turn[row] } else { [0.0; 3] }))
                .by(place, std::array::from_fn(|row| one(row, 0)))
                .by(size, std::array::from_fn(|row| if of_point(row) { by_size.map(|by| by[row]) } else { [0.0; 2] }))
                .by(skew, std::array::from_fn(|row| if of_point(row) { [by_skew[row]] } else { [0.0] }))
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
            pivot_px: self.pivot_px,
            centre: self.centre,
            unknown: self.unknown,
        };
        let state = &self.solution.state;
        let seen = problem.pictures(state, &[vec![true; view.marks.len()]]);
        let whitenings: Vec<_> =
            seen.iter().map(|picture| whitening(&problem.scattered(state, picture), self.scatter)).collect();
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
