//! Fits the image plane to all dots of all images, with its covariance.
//!
//! The unknowns are the image's rotation and position in the probe's frame and the pixel size
//! along u and v. The skew of u and v is optional. Further unknowns are the phantom's deviation
//! from its registration, within the registration's uncertainty, and the lag of poses behind
//! images. A dot's residual is the distance of its wire from the predicted place, across the
//! wire. All dots of an image share the tracker's noise, so an image's residuals are whitened
//! together ([`super::scatter`]). A dot contradicted by the others of its image is left out,
//! and so is an image contradicted by the others.

mod outliers;
mod problem;
mod refined;

use glam::DVec3;
use nalgebra::DMatrix;

use self::outliers::leave_out;
pub use self::problem::OptionalUnknowns;
use self::problem::{Picture, Problem, USUAL_LAG_S};
use self::refined::KNOWN;
pub use self::refined::Refined;
pub(super) use self::refined::View;
use super::layout::Layout;
use super::linear::Start;
use super::scatter::{Absorbed, Scatter, Scattered};
use super::sighting::{Sighting, off_wire};
use super::track::Track;
use crate::least_squares::{Blocks, Noise, Parameters, Settings, Solution, State, Unsolved, solve};
use crate::phantom::file::Registration;
use crate::statistics::correlation_length;
use sonoweave_core::frames::Transform;

/// Scatter and plane are estimated in turn at most this often …
const ROUNDS: usize = 12;
/// … or until the lag changes by less than this, s, and no more outliers are found.
const SAME_LAG_S: f64 = 1e-6;
/// Number of rounds before outliers are left out: the scatter must be known first.
const TRUSTING: usize = 2;

/// Refines a start.
///
/// # Errors
/// [`Unsolved`] names the parameters that the dots do not determine.
pub fn refine(
    layout: &Layout,
    sightings: &[Sighting],
    track: &Track,
    registration: &Registration,
    start: &Start,
    optional: OptionalUnknowns,
) -> Result<Refined, Unsolved> {
    let (problem, parameters) = Problem::new(layout, sightings, track, registration, &start.plane, optional);
    problem.solve(parameters, optional, start.contradicted())
}

impl Problem<'_> {
    /// Solves the problem. Images that the start contradicts are left out at first and added at
    /// the end, if they agree.
    fn solve(
        &self,
        mut parameters: Parameters,
        optional: OptionalUnknowns,
        mut waits: Vec<bool>,
    ) -> Result<Refined, Unsolved> {
        let prior = optional.registration.then(|| self.prior());
        let settings = Settings { noise: Noise::Known, ..Settings::default() };
        let mut used: Vec<Vec<bool>> =
            self.sightings.iter().zip(&waits).map(|(s, waits)| vec![!waits; s.marks.len()]).collect();
        let mut scatter = Scatter::USUAL;
        let mut round = 0;
        loop {
            let state = parameters.start();
            let pictures = self.pictures(&state, &used);
            let scattered: Vec<Scattered> = pictures.iter().map(|picture| self.scattered(&state, picture)).collect();
            scatter = Scatter::most_likely(&scattered, scatter);
            let whitenings: Vec<DMatrix<f64>> =
                scattered.iter().map(|picture| picture.whitening(scatter.variances())).collect();
            let put = |state: &State, blocks: &mut Blocks<'_>| {
                self.put(state, &pictures, &whitenings, blocks);
                self.put_priors(state, prior.as_ref(), optional.lag, blocks);
            };
            let solution = solve(&parameters, &settings, put)?;
            let moved = solution.state.vector(self.unknown.lag)[0] - state.vector(self.unknown.lag)[0];
            round += 1;
            let mut same = true;
            if round > TRUSTING {
                let residuals = pictures.iter().map(|picture| self.scattered(&solution.state, picture).residuals);
                for ((picture, residuals), whitening) in pictures.iter().zip(residuals).zip(&whitenings) {
                    same &= !leave_out(&mut used[picture.sighting], &picture.dots, &residuals, whitening);
                }
            }
            let is_found = round > TRUSTING && same && moved.abs() < SAME_LAG_S;
            if round == ROUNDS || (is_found && !self.admit(&solution.state, scatter, &mut used, &mut waits)) {
                return Ok(self.result(&pictures, &whitenings, used, scatter, solution, optional));
            }
            parameters.begin_at(&solution.state);
        }
    }

    /// Adds the waiting images that agree with the result; returns whether any did.
    fn admit(&self, state: &State, scatter: Scatter, used: &mut [Vec<bool>], waits: &mut [bool]) -> bool {
        let mut whole: Vec<Vec<bool>> =
            self.sightings.iter().zip(waits.iter()).map(|(s, waits)| vec![*waits; s.marks.len()]).collect();
        waits.fill(false);
        let mut any = false;
        for picture in self.pictures(state, &whole.clone()) {
            let scattered = self.scattered(state, &picture);
            let whitening = scattered.whitening(scatter.variances());
            let own = &mut whole[picture.sighting];
            if !leave_out(own, &picture.dots, &scattered.residuals, &whitening) {
                used[picture.sighting].fill(true);
                any = true;
            }
        }
        any
    }

    fn result(
        &self,
        pictures: &[Picture],
        whitenings: &[DMatrix<f64>],
        mut used: Vec<Vec<bool>>,
        scatter: Scatter,
        solution: Solution,
        optional: OptionalUnknowns,
    ) -> Refined {
        let state = &solution.state;
        let mut squares = vec![(0.0, 0); self.sightings.len()];
        let mut absorbed = Absorbed::default();
        for (picture, whitening) in pictures.iter().zip(whitenings) {
            let scattered = self.scattered(state, picture);
            let residuals = &scattered.residuals;
            squares[picture.sighting] = ((whitening * residuals).norm_squared(), residuals.len());
            let of_picture = solution.certainty().absorbed(|blocks| {
                self.put(state, std::slice::from_ref(picture), std::slice::from_ref(whitening), blocks);
            });
            absorbed.add(&scattered, whitening, &of_picture);
        }
        for (used, (_, components)) in used.iter_mut().zip(&squares) {
            used.iter_mut().for_each(|used| *used &= *components > 0);
        }
        let phantom = Transform::from_affine(self.phantom_map(state).inverse());
        let reference_from_phantom = self.registration.reference_from_phantom * phantom;
        let mut known = [[0.0; KNOWN]; KNOWN];
        if optional.registration {
            let information = self.information();
            (0..6).for_each(|i| (0..6).for_each(|j| known[i][j] = information[(i, j)]));
        }
        if optional.lag {
            known[6][6] = USUAL_LAG_S.powi(-2);
        }
        let lasting = self.lasting(state, pictures);
        let mut refined = Refined {
            lasting,
            excess: absorbed.factor(scatter.variances()),
            known,
            plane: self.plane(state),
            registration: Registration { reference_from_phantom, ..self.registration },
            scatter,
            lag_s: state.vector(self.unknown.lag)[0],
            lag_sd_s: 0.0,
            used,
            pictures: squares,
            given: self.registration,
            centre: self.centre,
            unknown: self.unknown,
            solution,
        };
        refined.lag_sd_s = refined.lag_variance().max(0.0).sqrt();
        refined
    }

    /// Returns the number of images after which their deviations are independent: the mean over
    /// three directions.
    fn lasting(&self, state: &State, pictures: &[Picture]) -> f64 {
        let wires = self.layout.geometry().wires();
        let off = |picture: &Picture| {
            let map = self.map(state, picture);
            let marks = &self.sightings[picture.sighting].marks;
            let of_dot = |&dot: &usize| {
                let wire = &wires[marks[dot].wire];
                let point = self.spot(state, &map, marks[dot].at_px).phantom;
                off_wire(wire, point).into_iter().zip(wire.across()).map(|(off, across)| across * off).sum::<DVec3>()
            };
            picture.dots.iter().map(of_dot).sum::<DVec3>() / picture.dots.len() as f64
        };
        let off: Vec<DVec3> = pictures.iter().map(off).collect();
        let along = |axis: usize| correlation_length(&off.iter().map(|off| off[axis]).collect::<Vec<_>>());
        (0..3).map(along).sum::<f64>() / 3.0
    }
}

#[cfg(test)]
mod tests;
