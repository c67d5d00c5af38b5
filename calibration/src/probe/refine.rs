//! The image plane that explains all dots of all pictures best, and how sure that is.
//!
//! Sought are the picture's turn and place in the probe's frame and a pixel's size along u and v; if asked for, how much u and v are askew; and by how much the phantom is not where its registration says, as
//! far as that is known to be good; and how much later poses come than pictures, for a probe that moves is elsewhere by then. A dot's residual is how far its wire is from where the plane has it, across the wire. All dots of a picture share the tracker's noise, so a picture's residuals are
//! whitened together ([`super::scatter`]). A dot that the others of its picture contradict, and a picture that the others contradict, is left out.

mod outliers;
mod predicted;
mod problem;

use glam::DVec3;
use nalgebra::DMatrix;

use self::outliers::leave_out;
pub(super) use self::predicted::View;
use self::predicted::{KNOWN, TOGETHER};
use self::problem::{Picture, Problem, USUAL_LAG_S, Unknown};
use super::layout::Layout;
use super::linear::Start;
use super::plane::ImagePlane;
use super::scatter::{Scatter, Scattered, lasted};
use super::sighting::{Sighting, off_wire};
use super::track::Track;
pub use super::unknown::PLANE;
use crate::frames::{Image, Probe, Transform};
use crate::least_squares::{Blocks, Noise, Parameters, Settings, Solution, State, Unsolved, solve};
use crate::phantom::file::Registration;
use crate::statistics::correlation_length;

/// How often scatter and plane are found in turn at most …
const ROUNDS: usize = 12;
/// … or until the lag changes by less than this, s, and nothing more is left out.
const SAME_LAG_S: f64 = 1e-6;
/// Rounds before anything is left out: the scatter has to be known.
const TRUSTING: usize = 2;

/// What is sought besides the plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sought {
    /// Whether u and v may be askew.
    pub skew: bool,
    /// Whether the registration may be off, as far as its error says.
    pub registration: bool,
    /// Whether poses may come later than pictures, or earlier. Without times, or with the probe held still whenever a picture was taken, there is nothing to be found.
    pub lag: bool,
}

/// What was found.
#[derive(Debug, Clone)]
pub struct Refined {
    /// Where the picture lies in the probe's frame.
    pub plane: ImagePlane,
    /// Where the phantom is held, as it fits best.
    pub registration: Registration,
    /// What scattered the dots.
    pub scatter: Scatter,
    /// For how many pictures what scatters them lasts; 1 where each has its own. The errors that are predicted take it into account.
    pub lasting: f64,
    /// How much later poses come than pictures, s.
    pub lag_s: f64,
    /// Its standard deviation; 0 where it was not sought.
    pub lag_sd_s: f64,
    /// By sighting and dot: whether it had a part. A sighting without any had no pose at its time, or contradicted the others.
    pub used: Vec<Vec<bool>>,
    /// Squared lengths of pictures' whitened residuals, in the order of the sightings, and their components.
    pub pictures: Vec<(f64, usize)>,
    /// Where the phantom was said to be held.
    given: Registration,
    /// About which it was turned.
    centre: DVec3,
    unknown: Unknown,
    solution: Solution,
    /// What is known beforehand, by its information: of the phantom's turn and shift, and of the lag.
    known: [[f64; KNOWN]; KNOWN],
}

/// Refines a start.
///
/// # Errors
/// [`Unsolved`]: the dots do not determine something, which it names.
pub fn refine(
    layout: &Layout,
    sightings: &[Sighting],
    track: &Track,
    registration: &Registration,
    start: &Start,
    sought: Sought,
) -> Result<Refined, Unsolved> {
    let (problem, parameters) = Problem::new(layout, sightings, track, registration, &start.plane, sought);
    problem.solve(parameters, sought, start.contradicted())
}

impl Problem<'_> {
    /// Pictures that the start contradicts have no part until all else is found; then they have, if they agree.
    fn solve(&self, mut parameters: Parameters, sought: Sought, mut waits: Vec<bool>) -> Result<Refined, Unsolved> {
        let prior = sought.registration.then(|| self.prior());
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
                self.put_priors(state, prior.as_ref(), sought.lag, blocks);
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
                return Ok(self.result(&pictures, &whitenings, used, scatter, solution, sought));
            }
            parameters.begin_at(&solution.state);
        }
    }

    /// Gives those that wait a part where they agree with what was found; whether any did.
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
        sought: Sought,
    ) -> Refined {
        let state = &solution.state;
        let mut squares = vec![(0.0, 0); self.sightings.len()];
        for (picture, whitening) in pictures.iter().zip(whitenings) {
            let residuals = self.scattered(state, picture).residuals;
            squares[picture.sighting] = ((whitening * &residuals).norm_squared(), residuals.len());
        }
        for (used, (_, components)) in used.iter_mut().zip(&squares) {
            used.iter_mut().for_each(|used| *used &= *components > 0);
        }
        let phantom = Transform::from_affine(self.phantom_map(state).inverse());
        let reference_from_phantom = self.registration.reference_from_phantom * phantom;
        let mut known = [[0.0; KNOWN]; KNOWN];
        if sought.registration {
            let information = self.information();
            (0..6).for_each(|i| (0..6).for_each(|j| known[i][j] = information[(i, j)]));
        }
        if sought.lag {
            known[6][6] = USUAL_LAG_S.powi(-2);
        }
        let lasting = self.lasting(state, pictures);
        let mut refined = Refined {
            lasting,
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
        let all = refined.together(refined.solution.certainty(), refined.pivot_px());
        refined.lag_sd_s = lasted(&all, &refined.known, lasting, [TOGETHER - 1; 2]).max(0.0).sqrt();
        refined
    }

    /// After how many pictures what they are off by is another: the mean over three directions.
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

impl Refined {
    /// The plane as a transform.
    pub fn probe_from_image(&self) -> Transform<Probe, Image> {
        Transform::from_affine(self.plane.affine())
    }

    /// Largest over smallest singular value of the problem, by its parameters' typical sizes.
    pub fn condition(&self) -> f64 {
        self.solution.condition
    }

    /// The solution with its parameters' covariance.
    pub fn solution(&self) -> &Solution {
        &self.solution
    }

    /// Where the phantom was turned and shifted to against its registration, deg and mm.
    pub fn registration_change(&self) -> (f64, f64) {
        let Unknown { phantom_turn, phantom_shift, .. } = self.unknown;
        let state = &self.solution.state;
        (state.rotation(phantom_turn).to_scaled_axis().length().to_degrees(), state.point(phantom_shift).length())
    }
}

#[cfg(test)]
mod tests;
