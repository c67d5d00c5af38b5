//! The least squares problem: images' residuals at a state, their derivatives, their noise
//! sources, and priors.

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};
use nalgebra::{DMatrix, DVector};

use crate::least_squares::{Blocks, Parameters, Rotation, Side, State, Vector, Whitening, rows, turned};
use crate::phantom::file::Registration;
use crate::probe::layout::Layout;
use crate::probe::plane::ImagePlane;
use crate::probe::scatter::Scattered;
use crate::probe::sighting::{Sighting, off_wire};
use crate::probe::track::Track;
use crate::probe::unknown::UnknownPlane;

/// Prior standard deviation of the lag, s: trackers filter, and lag by up to some tenths of a
/// second.
pub(super) const USUAL_LAG_S: f64 = 0.5;
/// Error of a registration that does not state it, mm: typical for touching with a stylus by
/// hand.
const USUAL_ERROR_MM: f64 = 0.5;
/// Number of columns of all parameters.
const COLUMNS: usize = 16;

/// Optional unknowns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OptionalUnknowns {
    /// Fit the skew of u and v.
    pub skew: bool,
    /// Fit the registration's error, within its stated uncertainty.
    pub registration: bool,
    /// Fit the lag of poses behind images. Without times, or with the probe held still for
    /// every image, it is undetermined.
    pub lag: bool,
}

/// The parameters.
#[derive(Debug, Clone, Copy)]
pub(super) struct Unknown {
    pub(super) plane: UnknownPlane,
    pub(super) phantom_turn: Rotation,
    pub(super) phantom_shift: Vector<3>,
    pub(super) lag: Vector<1>,
}

/// Everything that does not change from step to step.
pub(super) struct Problem<'a> {
    pub(super) layout: &'a Layout,
    pub(super) sightings: &'a [Sighting],
    pub(super) track: &'a Track,
    pub(super) registration: Registration,
    /// Centre of the phantom's rotation, mm.
    pub(super) centre: DVec3,
    pub(super) unknown: Unknown,
}

/// An image in a round: the phantom's pose at the round's lag, and its derivative.
pub(super) struct Picture {
    pub(super) sighting: usize,
    pub(super) lag_s: f64,
    /// Maps the probe's frame to the registered phantom.
    pub(super) map: DAffine3,
    /// Its change per second.
    pub(super) rate: DAffine3,
    /// Indices of its dots in use.
    pub(super) dots: Vec<usize>,
}

/// A dot's positions at a state, in the probe's and the phantom's frame.
pub(super) struct Spot {
    pub(super) probe: DVec3,
    pub(super) phantom: DVec3,
    /// The phantom's point less the centre, rotated.
    pub(super) phantom_lever: DVec3,
}

impl<'a> Problem<'a> {
    pub(super) fn new(
        layout: &'a Layout,
        sightings: &'a [Sighting],
        track: &'a Track,
        registration: &Registration,
        start: &ImagePlane,
        optional: OptionalUnknowns,
    ) -> (Self, Parameters) {
        let marks: Vec<DVec2> = sightings.iter().flat_map(|s| s.marks.iter().map(|mark| mark.at_px)).collect();
        let mut parameters = Parameters::new();
        let plane = UnknownPlane::new(&mut parameters, start, &marks, optional.skew);
        let lever_mm = plane.lever_mm();
        let unknown = Unknown {
            plane,
            phantom_turn: parameters.rotation("the phantom's turn", Side::Left, 1.0 / lever_mm, DQuat::IDENTITY),
            phantom_shift: parameters.point("the phantom's place", 1.0, DVec3::ZERO),
            lag: parameters.vector("the lag", [""], "s", 0.1, [0.0]),
        };
        if !optional.lag {
            parameters.hold(unknown.lag);
        }
        if !optional.registration {
            parameters.hold(unknown.phantom_turn);
            parameters.hold(unknown.phantom_shift);
        }
        let wires = layout.geometry().wires();
        let centre = wires.iter().flat_map(|wire| wire.ends_mm).sum::<DVec3>() / (2 * wires.len()) as f64;
        let problem = Problem { layout, sightings, track, registration: *registration, centre, unknown };
        (problem, parameters)
    }

    /// Returns the images that have poses at the state's lag.
    pub(super) fn pictures(&self, state: &State, used: &[Vec<bool>]) -> Vec<Picture> {
        let [lag_s] = state.vector(self.unknown.lag);
        let back = self.registration.reference_from_phantom.affine().inverse();
        let picture = |(sighting, used): (usize, &Vec<bool>)| {
            let time_s = self.sightings[sighting].time_s + lag_s;
            let map = back * self.track.at(time_s)?.reference_from_probe().affine();
            let rate = self.track.rate(time_s)?;
            // For the derivative of a map, `back` does not shift the translation.
            let rate = DAffine3 { matrix3: back.matrix3 * rate.matrix3, translation: back.matrix3 * rate.translation };
            let dots: Vec<usize> = (0..used.len()).filter(|&dot| used[dot]).collect();
            (!dots.is_empty()).then_some(Picture { sighting, lag_s, map, rate, dots })
        };
        used.iter().enumerate().filter_map(picture).collect()
    }

    /// Returns the map from the phantom as registered to the phantom as fitted.
    pub(super) fn phantom_map(&self, state: &State) -> DAffine3 {
        let (turn, shift) = (state.rotation(self.unknown.phantom_turn), state.point(self.unknown.phantom_shift));
        DAffine3::from_rotation_translation(turn, self.centre + shift - turn * self.centre)
    }

    pub(super) fn plane(&self, state: &State) -> ImagePlane {
        self.unknown.plane.plane(state)
    }

    /// Returns the map from the probe to the registered phantom, at the state's lag.
    pub(super) fn map(&self, state: &State, picture: &Picture) -> DAffine3 {
        let later = state.vector(self.unknown.lag)[0] - picture.lag_s;
        DAffine3 {
            matrix3: picture.map.matrix3 + picture.rate.matrix3 * later,
            translation: picture.map.translation + picture.rate.translation * later,
        }
    }

    pub(super) fn spot(&self, state: &State, map: &DAffine3, px: DVec2) -> Spot {
        let probe = self.plane(state).point(px);
        let registered = map.transform_point3(probe);
        let phantom_lever = state.rotation(self.unknown.phantom_turn) * (registered - self.centre);
        let phantom = phantom_lever + self.centre + state.point(self.unknown.phantom_shift);
        Spot { probe, phantom, phantom_lever }
    }

    /// Returns an image's residuals and their noise sources.
    pub(super) fn scattered(&self, state: &State, picture: &Picture) -> Scattered {
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

    /// Adds the whitened residuals of all images.
    pub(super) fn put(
        &self,
        state: &State,
        pictures: &[Picture],
        whitenings: &[DMatrix<f64>],
        blocks: &mut Blocks<'_>,
    ) {
        let Unknown { plane, phantom_turn, phantom_shift, lag } = self.unknown;
        let wires = self.layout.geometry().wires();
        let unit = Whitening::sd(1.0);
        let about_phantom = DMat3::from_quat(state.rotation(phantom_turn));
        for (picture, whitening) in pictures.iter().zip(whitenings) {
            let marks = &self.sightings[picture.sighting].marks;
            let rows = 2 * picture.dots.len();
            let mut residuals = DVector::zeros(rows);
            let mut derivatives = DMatrix::zeros(rows, COLUMNS);
            let registered = self.map(state, picture);
            let map = about_phantom * registered.matrix3;
            for (number, mark) in picture.dots.iter().map(|&dot| &marks[dot]).enumerate() {
                let spot = self.spot(state, &registered, mark.at_px);
                // Derivatives of the point in the phantom's frame.
                let by_plane = plane.changes(state, mark.at_px).map(|change| map * change);
                let by_lag = about_phantom * picture.rate.transform_point3(spot.probe);
                let by_phantom = turned(spot.phantom_lever);
                let wire = &wires[mark.wire];
                for (side, (off, across)) in off_wire(wire, spot.phantom).into_iter().zip(wire.across()).enumerate() {
                    let row = 2 * number + side;
                    residuals[row] = off;
                    if blocks.wants_derivatives() {
                        let by_phantom = (by_phantom.transpose() * across).to_array();
                        let by_plane = by_plane.map(|change| change.dot(across));
                        let all = [&by_plane[..], &[by_lag.dot(across)], &by_phantom, &across.to_array()].concat();
                        all.into_iter().enumerate().for_each(|(column, x)| derivatives[(row, column)] = x);
                    }
                }
            }
            let (residuals, derivatives) = (whitening * residuals, whitening * derivatives);
            for row in 0..rows {
                let three = |first: usize| -> [f64; 3] { std::array::from_fn(|i| derivatives[(row, first + i)]) };
                let one = |column: usize| derivatives[(row, column)];
                let by_plane = [std::array::from_fn(one)];
                plane
                    .add_to(blocks.add([residuals[row]], &unit), by_plane)
                    .by(lag, [[one(9)]])
                    .by(phantom_turn, [three(10)])
                    .by(phantom_shift, [three(13)]);
            }
        }
    }

    /// Adds the priors of the registration and of the lag.
    pub(super) fn put_priors(
        &self,
        state: &State,
        registration: Option<&Whitening<6>>,
        lag: bool,
        blocks: &mut Blocks<'_>,
    ) {
        let Unknown { phantom_turn, phantom_shift, .. } = self.unknown;
        if let Some(registration) = registration {
            let (about, shift) = (state.rotation(phantom_turn).to_scaled_axis(), state.point(phantom_shift));
            let both = [about.x, about.y, about.z, shift.x, shift.y, shift.z];
            // Derivative of a rotation's logarithm by a step from the left, to the fourth order
            // of its angle.
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

    /// Returns the prior of the registration.
    pub(super) fn prior(&self) -> Whitening<6> {
        let covariance = self.information().try_inverse().unwrap_or_else(|| DMatrix::identity(6, 6) * 1e6);
        let entry = |i: usize, j: usize| 0.5 * (covariance[(i, j)] + covariance[(j, i)]);
        Whitening::covariance(&std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j))))
    }

    /// Returns the information on the phantom's rotation and shift from landmarks, each touched
    /// with the registration's stated error.
    pub(super) fn information(&self) -> DMatrix<f64> {
        let landmarks = self.layout.geometry().landmarks();
        // The mean length of three components of standard deviation 1 is 1.6.
        let sd = self.registration.error_mm.unwrap_or(USUAL_ERROR_MM) / 1.6;
        let ends = self.layout.geometry().wires().iter().flat_map(|wire| wire.ends_mm);
        let touched: Vec<DVec3> = match landmarks.len() {
            // Unknown touched points: assume the wires' ends.
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
