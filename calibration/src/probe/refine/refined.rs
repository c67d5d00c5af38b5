//! Result of the fit, and predicted errors of the plane from its covariance, at present and with
//! further images.

use glam::{DVec2, DVec3};
use sonoweave_core::frames::{Image, Probe, Transform};

use super::problem::{Problem, Unknown};
use crate::error::CovarianceError;
use crate::least_squares::{Certainty, Solution};
use crate::phantom::file::Registration;
use crate::probe::layout::Layout;
use crate::probe::matching::Mark;
use crate::probe::plane::{ImagePlane, NUMBERS};
use crate::probe::plane_covariance::PlaneCovariance;
use crate::probe::scatter::{Scatter, lasted};
use crate::probe::sighting::Sighting;
use crate::probe::track::{Poses, Track};
use crate::probe::unknown::own_numbers;

/// Count of parameters with a prior: the phantom's rotation and shift, and the lag.
pub(super) const KNOWN: usize = 7;
/// Count of a pixel's coordinates and these.
const TOGETHER: usize = 3 + KNOWN;
/// Count of the plane's numbers and these.
const OWN: usize = NUMBERS + KNOWN;

/// Result of the fit.
#[derive(Debug, Clone)]
pub struct Refined {
    /// The image plane in the probe's frame.
    pub plane: ImagePlane,
    /// The fitted registration.
    pub registration: Registration,
    /// The fitted scatter.
    pub scatter: Scatter,
    /// Number of images over which the scatter is correlated; 1 if independent. The predicted
    /// errors account for it.
    pub lasting: f64,
    /// Lag of poses behind images, s.
    pub lag_s: f64,
    /// Standard deviation of the lag; 0 if it was not fitted.
    pub lag_sd_s: f64,
    /// For each sighting and dot, whether the fit used it. A sighting without used dots had no
    /// pose at its time, or contradicted the others.
    pub used: Vec<Vec<bool>>,
    /// Squared lengths of images' whitened residuals, in the order of the sightings, and their
    /// numbers of components.
    pub pictures: Vec<(f64, usize)>,
    /// The given registration.
    pub(super) given: Registration,
    /// Centre of the phantom's rotation, mm.
    pub(super) centre: DVec3,
    pub(super) unknown: Unknown,
    pub(super) solution: Solution,
    /// Factor of the covariance for the scatter that the parameters absorbed.
    pub(super) excess: f64,
    /// Information of the priors: of the phantom's rotation and shift, and of the lag.
    pub(super) known: [[f64; KNOWN]; KNOWN],
}

impl Refined {
    /// Returns the plane as a transform.
    pub fn probe_from_image(&self) -> Transform<Probe, Image> {
        Transform::from_affine(self.plane.affine())
    }

    /// Returns the largest over the smallest singular value of the problem, by its parameters'
    /// typical sizes.
    pub fn condition(&self) -> f64 {
        self.solution.condition
    }

    /// Returns the solution with its parameters' covariance.
    pub fn solution(&self) -> &Solution {
        &self.solution
    }

    /// Returns the fitted rotation and shift of the phantom against its registration, deg and
    /// mm.
    pub fn registration_change(&self) -> (f64, f64) {
        let Unknown { phantom_turn, phantom_shift, .. } = self.unknown;
        let state = &self.solution.state;
        (state.rotation(phantom_turn).to_scaled_axis().length().to_degrees(), state.point(phantom_shift).length())
    }

    /// Returns the covariance of a pixel's position in the probe's frame, mm², from the fitted
    /// scatter and its correlation.
    pub fn covariance_mm2(&self, px: DVec2) -> [[f64; 3]; 3] {
        self.covariance_by(self.solution.certainty(), px)
    }

    fn covariance_by(&self, certainty: &Certainty, px: DVec2) -> [[f64; 3]; 3] {
        let all: [[f64; TOGETHER]; TOGETHER] =
            self.together(certainty, self.unknown.plane.first_of(&self.solution.state, px));
        std::array::from_fn(|i| std::array::from_fn(|j| lasted(&all, &self.known, self.lasting * self.excess, [i, j])))
    }

    /// Returns the covariance of the plane's own numbers, from the fitted scatter and its
    /// correlation; 0 for a skew that was not fitted.
    ///
    /// # Errors
    /// [`CovarianceError`] if the plane is so uncertain that its error is not linear.
    pub fn covariance(&self) -> Result<PlaneCovariance, CovarianceError> {
        let all: [[f64; OWN]; OWN] = self.together(self.solution.certainty(), own_numbers());
        let entries = std::array::from_fn(|i| {
            std::array::from_fn(|j| lasted(&all, &self.known, self.lasting * self.excess, [i, j]))
        });
        PlaneCovariance::of_fit(self.pivot_px(), entries)
    }

    /// Returns the pixel at which the plane's position is defined.
    pub fn pivot_px(&self) -> DVec2 {
        self.unknown.plane.pivot_px()
    }

    /// Returns the covariance, for independent measurements, of numbers with these derivatives by
    /// the plane, followed by the phantom's rotation (rad) and shift (mm), and the lag (s).
    fn together<const T: usize>(&self, certainty: &Certainty, by_plane: [[f64; NUMBERS]; T]) -> [[f64; T]; T] {
        let Unknown { plane, phantom_turn, phantom_shift, lag } = self.unknown;
        let one = |row: usize, first: usize| -> [f64; 3] {
            std::array::from_fn(|i| if row == T - KNOWN + first + i { 1.0 } else { 0.0 })
        };
        certainty.propagated(|all| {
            plane
                .add_to(all, by_plane)
                .by(phantom_turn, std::array::from_fn(|row| one(row, 0)))
                .by(phantom_shift, std::array::from_fn(|row| one(row, 3)))
                .by(lag, std::array::from_fn(|row| if row == T - 1 { [1.0] } else { [0.0] }))
        })
    }

    /// Returns the variance of the lag, s².
    pub(super) fn lag_variance(&self) -> f64 {
        let all: [[f64; OWN]; OWN] = self.together(self.solution.certainty(), own_numbers());
        lasted(&all, &self.known, self.lasting * self.excess, [OWN - 1; 2])
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
