//! The image plane that explains all dots of all pictures best, and how sure that is.
//!
//! Sought are the picture's turn and place in the probe's frame and a pixel's size along u and v; if asked for, how much u and v are askew; and by how much the phantom is not where its registration says, as
//! far as that is known to be good; and how much later poses come than pictures, for a probe that moves is elsewhere by then. A dot's residual is how far its wire is from where the plane has it, across the wire. All dots of a picture share the tracker's noise, so a picture's residuals are
//! whitened together ([`super::scatter`]). A dot that the others of its picture contradict, and a picture that the others contradict, is left out.

mod outliers;
mod predicted;

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};
use nalgebra::{DMatrix, DVector};

use self::outliers::leave_out;
pub use self::predicted::PLANE;
use self::predicted::{KNOWN, TOGETHER};
use super::layout::Layout;
use super::linear::Start;
use super::plane::ImagePlane;
use super::scatter::{Scatter, Scattered, most_likely};
use super::sighting::{Sighting, off_wire};
use super::track::Track;
use crate::frames::{Image, Probe, Transform};
use crate::least_squares::{
    Blocks, Noise, Parameters, Rotation, Scale, Settings, Side, Solution, State, Unsolved, Vector, Whitening, rows,
    solve, turned,
};
use crate::phantom::file::Registration;
use crate::statistics::correlation_length;

/// How often scatter and plane are found in turn at most …
const ROUNDS: usize = 12;
/// … or until the lag changes by less than this, s, and nothing more is left out.
const SAME_LAG_S: f64 = 1e-6;
/// Rounds before anything is left out: the scatter has to be known.
const TRUSTING: usize = 2;
/// Trackers filter, and lag by up to some tenths of a second: a standard deviation that says no more, s.
const USUAL_LAG_S: f64 = 0.5;
/// Error of a registration that does not say it, mm: what a hand with a stylus attains.
const USUAL_ERROR_MM: f64 = 0.5;

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
    unknown: Unknown,
    pivot_px: DVec2,
    solution: Solution,
    /// What is known beforehand, by its information: of the phantom's turn and shift, and of the lag.
    known: [[f64; KNOWN]; KNOWN],
}

/// The parameters.
#[derive(Debug, Clone, Copy)]
struct Unknown {
    turn: Rotation,
    place: Vector<3>,
    size: Scale<2>,
    skew: Vector<1>,
    phantom_turn: Rotation,
    phantom_shift: Vector<3>,
    lag: Vector<1>,
}

/// All that does not change from step to step.
struct Problem<'a> {
    layout: &'a Layout,
    sightings: &'a [Sighting],
    track: &'a Track,
    registration: Registration,
    pivot_px: DVec2,
    /// About which the phantom is turned, mm.
    centre: DVec3,
    unknown: Unknown,
}

/// A picture in a round: where the phantom was at the lag of the round, and how that changes with it.
struct Picture {
    sighting: usize,
    lag_s: f64,
    /// From the probe to the phantom as registered.
    map: DAffine3,
    /// Its change a second.
    rate: DAffine3,
    /// Which of its dots have a part.
    dots: Vec<usize>,
}

/// A dot at a state: where it is in the probe's frame, and by what.
struct Spot {
    probe: DVec3,
    /// From the pivot, turned.
    lever: DVec3,
    phantom: DVec3,
    /// The phantom's point less the centre, turned.
    phantom_lever: DVec3,
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

impl<'a> Problem<'a> {
    fn new(
        layout: &'a Layout,
        sightings: &'a [Sighting],
        track: &'a Track,
        registration: &Registration,
        start: &ImagePlane,
        sought: Sought,
    ) -> (Self, Parameters) {
        let marks: Vec<DVec2> = sightings.iter().flat_map(|s| s.marks.iter().map(|mark| mark.at_px)).collect();
        let pivot_px = marks.iter().sum::<DVec2>() / marks.len().max(1) as f64;
        let reach = marks.iter().map(|px| px.distance(pivot_px)).fold(1.0, f64::max);

        let [size_u, size_v] = start.pixel_mm();
        let lever_mm = reach * size_u.max(size_v);
        let x = start.u / size_u;
        let y = (start.v - start.v.dot(x) * x).normalize();
        let turn = DQuat::from_mat3(&DMat3::from_cols(x, y, x.cross(y)));
        let mut parameters = Parameters::new();
        let unknown = Unknown {
            turn: parameters.rotation("the picture's turn", Side::Right, 1.0 / lever_mm, turn),
            place: parameters.point("the picture's place", 1.0, start.point(pivot_px)),
            size: parameters.scale("pixel size", ["along u", "along v"], 1.0 / lever_mm, [size_u, start.v.dot(y)]),
            skew: parameters.vector(
                "skew",
                [""],
                "",
                1.0 / lever_mm,
                [if sought.skew { start.v.dot(x) / start.v.dot(y) } else { 0.0 }],
            ),
            phantom_turn: parameters.rotation("the phantom's turn", Side::Left, 1.0 / lever_mm, DQuat::IDENTITY),
            phantom_shift: parameters.point("the phantom's place", 1.0, DVec3::ZERO),
            lag: parameters.vector("the lag", [""], "s", 0.1, [0.0]),
        };
        if !sought.lag {
            parameters.hold(unknown.lag);
        }
        if !sought.skew {
            parameters.hold(unknown.skew);
        }
        if !sought.registration {
            parameters.hold(unknown.phantom_turn);
            parameters.hold(unknown.phantom_shift);
        }
        let wires = layout.geometry().wires();
        let centre = wires.iter().flat_map(|wire| wire.ends_mm).sum::<DVec3>() / (2 * wires.len()) as f64;
        let problem = Problem { layout, sightings, track, registration: *registration, pivot_px, centre, unknown };
        (problem, parameters)
    }

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
            scatter = most_likely(&scattered, scatter);
            let whitenings: Vec<DMatrix<f64>> = scattered.iter().map(|picture| whitening(picture, scatter)).collect();
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
            let whitening = whitening(&scattered, scatter);
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
            unknown: self.unknown,
            pivot_px: self.pivot_px,
            solution,
        };
        let all = refined.together(self.pivot_px);
        refined.lag_sd_s = refined.lasted(&all, [TOGETHER - 1; 2]).max(0.0).sqrt();
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

    /// The pictures that have poses at the state's lag.
    fn pictures(&self, state: &State, used: &[Vec<bool>]) -> Vec<Picture> {
        let [lag_s] = state.vector(self.unknown.lag);
        let back = self.registration.reference_from_phantom.affine().inverse();
        let picture = |(sighting, used): (usize, &Vec<bool>)| {
            let time_s = self.sightings[sighting].time_s + lag_s;
            let map = back * self.track.at(time_s)?.reference_from_probe().affine();
            let rate = self.track.rate(time_s)?;
            // The change of a map: no point of it is shifted.
            let rate = DAffine3 { matrix3: back.matrix3 * rate.matrix3, translation: back.matrix3 * rate.translation };
            let dots: Vec<usize> = (0..used.len()).filter(|&dot| used[dot]).collect();
            (!dots.is_empty()).then_some(Picture { sighting, lag_s, map, rate, dots })
        };
        used.iter().enumerate().filter_map(picture).collect()
    }

    /// From the phantom as registered to the phantom as found.
    fn phantom_map(&self, state: &State) -> DAffine3 {
        let (turn, shift) = (state.rotation(self.unknown.phantom_turn), state.point(self.unknown.phantom_shift));
        DAffine3::from_rotation_translation(turn, self.centre + shift - turn * self.centre)
    }

    fn plane(&self, state: &State) -> ImagePlane {
        let turn = state.rotation(self.unknown.turn);
        let ([size_u, size_v], [skew]) = (state.scale(self.unknown.size), state.vector(self.unknown.skew));
        let (u, v) = (turn * (DVec3::X * size_u), turn * (DVec3::new(skew, 1.0, 0.0) * size_v));
        let origin = state.point(self.unknown.place) - u * self.pivot_px.x - v * self.pivot_px.y;
        ImagePlane { u, v, origin }
    }

    /// From the probe to the phantom as registered, at the state's lag.
    fn map(&self, state: &State, picture: &Picture) -> DAffine3 {
        let later = state.vector(self.unknown.lag)[0] - picture.lag_s;
        DAffine3 {
            matrix3: picture.map.matrix3 + picture.rate.matrix3 * later,
            translation: picture.map.translation + picture.rate.translation * later,
        }
    }

    fn spot(&self, state: &State, map: &DAffine3, px: DVec2) -> Spot {
        let plane = self.plane(state);
        let from = px - self.pivot_px;
        let lever = plane.u * from.x + plane.v * from.y;
        let probe = lever + state.point(self.unknown.place);
        let registered = map.transform_point3(probe);
        let phantom_lever = state.rotation(self.unknown.phantom_turn) * (registered - self.centre);
        let phantom = phantom_lever + self.centre + state.point(self.unknown.phantom_shift);
        Spot { probe, lever, phantom, phantom_lever }
    }

    /// A picture's residuals, and what scatters them.
    fn scattered(&self, state: &State, picture: &Picture) -> Scattered {
        let marks = &self.sightings[picture.sighting].marks;
        let has_reference = self.track.poses().first().is_some_and(|poses| poses.tracker_from_reference.is_some());
        let wires = self.layout.geometry().wires();
        let n = 2 * picture.dots.len();
        let sensors = if has_reference { 2 } else { 1 };
        let mut residuals = DVector::zeros(n);
        let dots = picture.dots.len();
        let mut by = [3 * sensors, 3 * sensors, dots, dots].map(|columns| DMatrix::zeros(n, columns));
        let plane = self.plane(state);
        let map = self.map(state, picture);
        let to_phantom = DMat3::from_quat(state.rotation(self.unknown.phantom_turn)) * map.matrix3;
        let reference_from_phantom =
            self.registration.reference_from_phantom.affine() * self.phantom_map(state).inverse();
        for (number, mark) in picture.dots.iter().map(|&dot| &marks[dot]).enumerate() {
            let spot = self.spot(state, &map, mark.at_px);
            let wire = &wires[mark.wire];
            for (side, (off, across)) in off_wire(wire, spot.phantom).into_iter().zip(wire.across()).enumerate() {
                let row = 2 * number + side;
                residuals[row] = off;
                let in_probe = to_phantom.transpose() * across;
                let mut sensor = |first: usize, direction: DVec3, place: DVec3| {
                    let turn = place.cross(direction);
                    for axis in 0..3 {
                        by[0][(row, first + axis)] = direction[axis];
                        by[1][(row, first + axis)] = turn[axis];
                    }
                };
                sensor(0, in_probe, spot.probe);
                if has_reference {
                    let in_reference = reference_from_phantom.matrix3 * across;
                    sensor(3, in_reference, reference_from_phantom.transform_point3(spot.phantom));
                }
                by[2][(row, number)] = in_probe.dot(plane.u);
                by[3][(row, number)] = in_probe.dot(plane.v);
            }
        }
        Scattered { residuals, by }
    }

    /// Puts down the whitened residuals of all pictures.
    fn put(&self, state: &State, pictures: &[Picture], whitenings: &[DMatrix<f64>], blocks: &mut Blocks<'_>) {
        let Unknown { turn, place, size, skew, phantom_turn, phantom_shift, lag } = self.unknown;
        let wires = self.layout.geometry().wires();
        let unit = Whitening::sd(1.0);
        let sizes = state.scale(size);
        let image_turn = state.rotation(turn);
        let about_phantom = DMat3::from_quat(state.rotation(phantom_turn));
        let [skewed] = state.vector(skew);
        for (picture, whitening) in pictures.iter().zip(whitenings) {
            let marks = &self.sightings[picture.sighting].marks;
            let rows = 2 * picture.dots.len();
            let mut residuals = DVector::zeros(rows);
            let mut derivatives = DMatrix::zeros(rows, COLUMNS);
            let registered = self.map(state, picture);
            let map = about_phantom * registered.matrix3;
            for (number, mark) in picture.dots.iter().map(|&dot| &marks[dot]).enumerate() {
                let spot = self.spot(state, &registered, mark.at_px);
                let from = mark.at_px - self.pivot_px;
                // How the point changes in the phantom's frame.
                let own = image_turn.inverse() * spot.lever;
                let by_turn = map * DMat3::from_quat(image_turn) * turned(own);
                let by_size = [
                    map * (image_turn * DVec3::new(sizes[0] * from.x, 0.0, 0.0)),
                    map * (image_turn * (DVec3::new(skewed, 1.0, 0.0) * (sizes[1] * from.y))),
                ];
                let by_skew = map * (image_turn * DVec3::new(sizes[1] * from.y, 0.0, 0.0));
                let by_lag = about_phantom * picture.rate.transform_point3(spot.probe);
                let by_phantom = turned(spot.phantom_lever);
                let wire = &wires[mark.wire];
                for (side, (off, across)) in off_wire(wire, spot.phantom).into_iter().zip(wire.across()).enumerate() {
                    let row = 2 * number + side;
                    residuals[row] = off;
                    if blocks.wants_derivatives() {
                        let groups = [by_turn, map, by_phantom].map(|m| (m.transpose() * across).to_array());
                        let [by_turn, by_place, by_phantom] = groups;
                        let single = [by_size[0], by_size[1], by_skew, by_lag].map(|column| column.dot(across));
                        let all = [&by_turn[..], &by_place, &single, &by_phantom, &across.to_array()].concat();
                        all.into_iter().enumerate().for_each(|(column, x)| derivatives[(row, column)] = x);
                    }
                }
            }
            let (residuals, derivatives) = (whitening * residuals, whitening * derivatives);
            for row in 0..rows {
                let three = |first: usize| -> [f64; 3] { std::array::from_fn(|i| derivatives[(row, first + i)]) };
                let one = |column: usize| derivatives[(row, column)];
                blocks
                    .add([residuals[row]], &unit)
                    .by(turn, [three(0)])
                    .by(place, [three(3)])
                    .by(size, [[one(6), one(7)]])
                    .by(skew, [[one(8)]])
                    .by(lag, [[one(9)]])
                    .by(phantom_turn, [three(10)])
                    .by(phantom_shift, [three(13)]);
            }
        }
    }

    /// What is known beforehand: of the registration, and of lags.
    fn put_priors(&self, state: &State, registration: Option<&Whitening<6>>, lag: bool, blocks: &mut Blocks<'_>) {
        let Unknown { phantom_turn, phantom_shift, .. } = self.unknown;
        if let Some(registration) = registration {
            let (about, shift) = (state.rotation(phantom_turn).to_scaled_axis(), state.point(phantom_shift));
            let both = [about.x, about.y, about.z, shift.x, shift.y, shift.z];
            // How the logarithm of a rotation changes with a step from the left, to the fourth order of its angle.
            let bend = turned(about);
            let by_turn = rows(DMat3::IDENTITY + bend * 0.5 + bend * bend * (1.0 / 12.0));
            let by_shift = rows(DMat3::IDENTITY);
            let none = [0.0; 3];
            blocks
                .add(both, registration)
                .by(phantom_turn, [by_turn[0], by_turn[1], by_turn[2], none, none, none])
                .by(phantom_shift, [none, none, none, by_shift[0], by_shift[1], by_shift[2]]);
        }
        if lag {
            blocks.add(state.vector(self.unknown.lag), &Whitening::sd(USUAL_LAG_S)).by(self.unknown.lag, [[1.0]]);
        }
    }

    /// How well the registration is known beforehand.
    fn prior(&self) -> Whitening<6> {
        let covariance = self.information().try_inverse().unwrap_or_else(|| DMatrix::identity(6, 6) * 1e6);
        let entry = |i: usize, j: usize| 0.5 * (covariance[(i, j)] + covariance[(j, i)]);
        Whitening::covariance(&std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j))))
    }

    /// What landmarks say of the phantom's turn and shift, each touched as well as the registration's error says.
    fn information(&self) -> DMatrix<f64> {
        let landmarks = self.layout.geometry().landmarks();
        // The mean length of three components of standard deviation 1 is 1.6.
        let sd = self.registration.error_mm.unwrap_or(USUAL_ERROR_MM) / 1.6;
        let ends = self.layout.geometry().wires().iter().flat_map(|wire| wire.ends_mm);
        let touched: Vec<DVec3> = match landmarks.len() {
            // Where it was touched is not known: as the wires' ends lie.
            0..3 => ends.collect(),
            _ => landmarks.iter().map(|landmark| landmark.position_mm).collect(),
        };
        let mut information = DMatrix::<f64>::zeros(6, 6);
        for at in touched {
            let turn = turned(at - self.centre);
            let mut by = DMatrix::<f64>::zeros(3, 6);
            for (row, (turn, unit)) in rows(turn).iter().zip(rows(DMat3::IDENTITY)).enumerate() {
                (0..3).for_each(|column| {
                    by[(row, column)] = turn[column];
                    by[(row, 3 + column)] = unit[column];
                });
            }
            information += by.transpose() * by / (sd * sd);
        }
        information
    }
}

/// Columns of all parameters.
const COLUMNS: usize = 16;

/// What makes a picture's residuals independent and of standard deviation 1.
fn whitening(picture: &Scattered, scatter: Scatter) -> DMatrix<f64> {
    let n = picture.residuals.len();
    let factor = picture.factor(scatter).map(|factor| factor.l());
    let inverse = factor.and_then(|l| l.solve_lower_triangular(&DMatrix::identity(n, n)));
    inverse.unwrap_or_else(|| DMatrix::identity(n, n))
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
