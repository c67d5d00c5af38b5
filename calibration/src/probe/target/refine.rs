//! Fits the image plane and the target's position to all images.
//!
//! A residual is the distance of an observed point from the target, by the poses, in the
//! reference's frame. A point has residuals along three axes, a line's two points along the
//! plane's normal. The noise variances are fitted as well, as in [`crate::probe::scatter`]. A
//! point's dot is less accurate across the image than within it, because a beam is some mm
//! thick. So each of the image's three directions has its own scatter, which includes the
//! sensors' positions. For a line, sensor positions move both points together, and each point
//! has its own echo noise. Sensor rotations act through their levers. Images that the others
//! contradict are left out.

use glam::{DAffine3, DVec2, DVec3};
use nalgebra::{DMatrix, DVector};

use sonoweave_core::frames::{Image, Probe, Transform};

use super::detection::Detection;
use super::{Place, Target};
use crate::least_squares::loss::as_rare;
use crate::least_squares::{Blocks, Noise, Parameters, Settings, Solution, State, Unsolved, Vector, Whitening, solve};
use crate::probe::plane::{ImagePlane, NUMBERS};
use crate::probe::scatter::{Absorbed, SOURCES, Scattered, settled};
use crate::probe::track::Track;
use crate::probe::unknown::UnknownPlane;
use crate::statistics::correlation_length;

/// Scatter and plane are estimated in turn at most this often …
const ROUNDS: usize = 20;
/// … or until the lag changes by less than this, s, and the used images stay the same.
const SAME_LAG_S: f64 = 1e-6;
/// Number of rounds before outliers are left out: the scatter must be known first.
const TRUSTING: usize = 2;
/// Images are left out if their error is as rare as this many standard deviations of one
/// number: once in a million.
const REACH: f64 = 4.9;
/// Prior standard deviation of the lag, s: trackers filter, and lag by up to some tenths of a
/// second.
pub(super) const USUAL_LAG_S: f64 = 0.5;

/// Standard deviations of the noise sources.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scatter {
    /// For a point.
    Point {
        /// Sensors' orientations, about each axis, rad.
        turn_rad: f64,
        /// Along u, v and across the image, mm: the dot's and the sensors' positions.
        along_mm: [f64; 3],
    },
    /// For a plane.
    Plane {
        /// Sensors' orientations, about each axis, rad.
        turn_rad: f64,
        /// Sensors' positions, along each axis, mm.
        position_mm: f64,
        /// The line's points, perpendicular to it, pixels.
        line_px: f64,
    },
}

/// Result of the fit.
#[derive(Debug, Clone)]
pub struct Refined {
    /// The image plane in the probe's frame.
    pub plane: ImagePlane,
    /// Position of the target.
    pub place: Place,
    /// The fitted scatter.
    pub scatter: Scatter,
    /// Number of images over which the scatter is correlated; 1 if independent. The predicted
    /// errors account for it.
    pub lasting: f64,
    /// Lag of poses behind images, s.
    pub lag_s: f64,
    /// Its standard error; 0 if it was not fitted.
    pub lag_se_s: f64,
    /// For each detection, whether the fit used it.
    pub(super) used: Vec<bool>,
    pub(super) unknown: Unknown,
    pub(super) solution: Solution,
    /// Information of the priors: of the target's position, and of the lag.
    pub(super) known: [f64; KNOWN],
    /// Factor of the covariance for the scatter that the parameters absorbed.
    pub(super) excess: f64,
}

/// Count of numbers that may have a prior: the target's three, and the lag.
pub(super) const KNOWN: usize = 4;

/// The parameters.
#[derive(Debug, Clone, Copy)]
pub(super) struct Unknown {
    pub(super) plane: UnknownPlane,
    pub(super) target: Vector<3>,
    pub(super) lag: Vector<1>,
}

/// Meaning of the target's three numbers.
#[derive(Debug, Clone, Copy)]
enum Form {
    /// A point's position.
    Point,
    /// Two tilts of the plane from its start, as displacements of its points at a lever, and
    /// its distance from a point; mm.
    Plane { along: [DVec3; 2], normal: DVec3, centre: DVec3, lever_mm: f64 },
}

/// One residual of an image: its size, its direction, and its derivatives by the target's
/// numbers.
struct Off {
    mm: f64,
    along: DVec3,
    by_target: [f64; 3],
}

impl Form {
    fn place(&self, state: &State, target: Vector<3>) -> Place {
        let numbers = state.vector(target);
        match self {
            Self::Point => Place::Point(DVec3::from_array(numbers)),
            Self::Plane { along, normal, centre, lever_mm } => {
                let [a, b, off] = numbers;
                let normal = (*normal + (along[0] * a + along[1] * b) / *lever_mm).normalize();
                Place::Plane { normal, distance_mm: normal.dot(*centre) + off }
            }
        }
    }

    /// Returns the residuals of a point against the target.
    fn off(&self, place: &Place, point: DVec3) -> Vec<Off> {
        match (self, place) {
            (Self::Plane { along, normal: start, centre, lever_mm }, Place::Plane { normal, distance_mm }) => {
                // The normal is the start's plus a component along the plane, normalised;
                // `length` is its length before that.
                let length = 1.0 / normal.dot(*start);
                let from = point - *centre;
                let by = |along: DVec3| (along - *normal * normal.dot(along)).dot(from) / (length * lever_mm);
                let mm = normal.dot(point) - distance_mm;
                vec![Off { mm, along: *normal, by_target: [by(along[0]), by(along[1]), -1.0] }]
            }
            (_, Place::Point(place)) => {
                let off = (point - *place).to_array();
                let axis = |i: usize| {
                    let along = DVec3::AXES[i];
                    Off { mm: off[i], along, by_target: (-along).to_array() }
                };
                vec![axis(0), axis(1), axis(2)]
            }
            (Self::Point, Place::Plane { .. }) => Vec::new(),
        }
    }
}

/// Everything that does not change from step to step.
struct Problem<'a> {
    target: Target,
    detections: &'a [Detection],
    track: &'a Track,
    form: Form,
    unknown: Unknown,
    has_lag: bool,
}

/// An image in a round: the probe's pose at the round's lag, and its derivative.
struct Picture {
    detection: usize,
    lag_s: f64,
    /// Maps the probe's frame to the reference's.
    map: DAffine3,
    /// Its change per second.
    rate: DAffine3,
}

impl Picture {
    fn map(&self, lag_s: f64) -> DAffine3 {
        let later = lag_s - self.lag_s;
        DAffine3 {
            matrix3: self.map.matrix3 + self.rate.matrix3 * later,
            translation: self.map.translation + self.rate.translation * later,
        }
    }
}

/// Start of the fit.
#[derive(Debug, Clone)]
pub(super) struct Start {
    pub(super) plane: ImagePlane,
    pub(super) place: Place,
    pub(super) lag_s: f64,
    /// For each detection, whether it agrees.
    pub(super) agrees: Vec<bool>,
}

/// Refines a start.
///
/// # Errors
/// [`Unsolved`] names the parameters that the images do not determine.
pub(super) fn refine(
    target: Target,
    detections: &[Detection],
    track: &Track,
    initial: Start,
    lag: bool,
) -> Result<Refined, Unsolved> {
    let (problem, parameters) = Problem::new(target, detections, track, &initial, lag);
    problem.solve(parameters, initial.agrees)
}

impl<'a> Problem<'a> {
    fn new(
        target: Target,
        detections: &'a [Detection],
        track: &'a Track,
        Start { plane, place, lag_s, .. }: &Start,
        has_lag: bool,
    ) -> (Self, Parameters) {
        let marks: Vec<DVec2> = detections.iter().flat_map(|detection| detection.marks.iter().copied()).collect();
        let mut parameters = Parameters::new();
        let unknown_plane = UnknownPlane::new(&mut parameters, plane, &marks, false);
        let (form, target_numbers) = match place {
            Place::Point(at) => (Form::Point, parameters.point("the point's place", 1.0, *at)),
            Place::Plane { normal, distance_mm } => {
                let centre = middle(detections, track, plane, *lag_s);
                let (first, second) = normal.any_orthonormal_pair();
                let (along, lever_mm) = ([first, second], unknown_plane.lever_mm());
                let off = distance_mm - normal.dot(centre);
                let names = ["tilt", "other tilt", "distance"];
                let numbers = parameters.vector("the plane's", names, "mm", 1.0, [0.0, 0.0, off]);
                (Form::Plane { along, normal: *normal, centre, lever_mm }, numbers)
            }
        };
        let lag = parameters.vector("the lag", [""], "s", 0.1, [*lag_s]);
        if !has_lag {
            parameters.hold(lag);
        }
        let unknown = Unknown { plane: unknown_plane, target: target_numbers, lag };
        (Self { target, detections, track, form, unknown, has_lag }, parameters)
    }

    /// Returns the usual variances of the noise sources.
    fn usual(&self) -> [f64; SOURCES] {
        match self.form {
            Form::Point => [0.004, 0.3, 0.3, 0.5],
            Form::Plane { .. } => [0.004, 0.3, 1.0, 1.0],
        }
        .map(|sd| sd * sd)
    }

    fn solve(&self, mut parameters: Parameters, mut used: Vec<bool>) -> Result<Refined, Unsolved> {
        let settings = Settings { noise: Noise::Known, ..Settings::default() };
        let mut variances = self.usual();
        let mut round = 0;
        loop {
            let state = parameters.start();
            let all = self.pictures(&state);
            let has_part: Vec<&Picture> = all.iter().filter(|picture| used[picture.detection]).collect();
            let scattered: Vec<Scattered> = has_part.iter().map(|picture| self.scattered(&state, picture)).collect();
            variances = settled(&scattered, variances, self.usual());
            let whitenings: Vec<DMatrix<f64>> = scattered.iter().map(|picture| picture.whitening(variances)).collect();
            let solution = solve(&parameters, &settings, |state, blocks| {
                self.put(state, &has_part, &whitenings, blocks);
                self.put_priors(state, blocks);
            })?;
            let moved = solution.state.vector(self.unknown.lag)[0] - state.vector(self.unknown.lag)[0];
            round += 1;
            let mut agree = vec![false; used.len()];
            for picture in &all {
                let scattered = self.scattered(&solution.state, picture);
                let squares = (scattered.whitening(variances) * &scattered.residuals).norm_squared();
                agree[picture.detection] = squares <= as_rare(REACH, scattered.residuals.len()).powi(2);
            }
            let is_found = round > TRUSTING && agree == used && moved.abs() < SAME_LAG_S;
            if round == ROUNDS || is_found {
                let with = has_part.iter().map(|picture| picture.detection);
                let mut has = vec![false; used.len()];
                with.for_each(|detection| has[detection] = true);
                return Ok(self.result(&has_part, &whitenings, has, variances, solution));
            }
            if round > TRUSTING {
                used = agree;
            }
            parameters.begin_at(&solution.state);
        }
    }

    fn result(
        &self,
        pictures: &[&Picture],
        whitenings: &[DMatrix<f64>],
        used: Vec<bool>,
        variances: [f64; SOURCES],
        solution: Solution,
    ) -> Refined {
        let state = &solution.state;
        let mut absorbed = Absorbed::default();
        for (picture, whitening) in pictures.iter().zip(whitenings) {
            let of_picture = solution.certainty().absorbed(|blocks| {
                self.put(state, std::slice::from_ref(picture), std::slice::from_ref(whitening), blocks);
            });
            absorbed.add(&self.scattered(state, picture), whitening, &of_picture);
        }
        let mut known = [0.0; KNOWN];
        if let Target::Tip { error_mm, .. } = self.target {
            known[..3].fill(error_mm.powi(-2));
        }
        if self.has_lag {
            known[3] = USUAL_LAG_S.powi(-2);
        }
        let [turn_rad, first, second, third] = variances.map(f64::sqrt);
        let scatter = match self.form {
            Form::Point => Scatter::Point { turn_rad, along_mm: [first, second, third] },
            Form::Plane { .. } => Scatter::Plane { turn_rad, position_mm: first, line_px: second },
        };
        let refined = Refined {
            plane: self.unknown.plane.plane(state),
            place: self.form.place(state, self.unknown.target),
            scatter,
            lasting: self.lasting(state, pictures),
            lag_s: state.vector(self.unknown.lag)[0],
            lag_se_s: 0.0,
            used,
            unknown: self.unknown,
            known,
            excess: absorbed.factor(variances),
            solution,
        };
        let lag_se_s = refined.lag_variance().max(0.0).sqrt();
        Refined { lag_se_s, ..refined }
    }

    /// Returns the number of images after which their deviations are independent: the mean over
    /// an image's numbers. A point's are along the image's own directions.
    fn lasting(&self, state: &State, pictures: &[&Picture]) -> f64 {
        let plane = self.unknown.plane.plane(state);
        let axes = [plane.u, plane.v, plane.u.cross(plane.v)].map(DVec3::normalize);
        let numbers = |picture: &&Picture| -> Vec<f64> {
            let residuals = self.scattered(state, picture).residuals;
            match self.form {
                Form::Point => {
                    let off = DVec3::from_slice(residuals.as_slice());
                    axes.map(|axis| (picture.map.matrix3 * axis).dot(off)).to_vec()
                }
                Form::Plane { .. } => vec![residuals[0] + residuals[1], residuals[0] - residuals[1]],
            }
        };
        let rows: Vec<Vec<f64>> = pictures.iter().map(numbers).collect();
        let count = rows.first().map_or(0, Vec::len);
        let along = |i: usize| correlation_length(&rows.iter().map(|row| row[i]).collect::<Vec<_>>());
        (0..count).map(along).sum::<f64>() / count.max(1) as f64
    }

    /// Returns the images that have poses at the state's lag.
    fn pictures(&self, state: &State) -> Vec<Picture> {
        let [lag_s] = state.vector(self.unknown.lag);
        let picture = |(detection, about): (usize, &Detection)| {
            let map = about.reference_from_probe(self.track, lag_s)?;
            let rate = self.track.rate(about.time_s + lag_s)?;
            Some(Picture { detection, lag_s, map, rate })
        };
        self.detections.iter().enumerate().filter_map(picture).collect()
    }

    /// Returns an image's residuals and their noise sources.
    fn scattered(&self, state: &State, picture: &Picture) -> Scattered {
        let marks = &self.detections[picture.detection].marks;
        let has_reference = self.track.poses().first().is_some_and(|poses| poses.tracker_from_reference.is_some());
        let sensors = if has_reference { 2 } else { 1 };
        let plane = self.unknown.plane.plane(state);
        let map = picture.map(state.vector(self.unknown.lag)[0]);
        let place = self.form.place(state, self.unknown.target);
        let all: Vec<(DVec3, DVec3, Off)> = (marks.iter())
            .flat_map(|px| {
                let probe = plane.point(*px);
                let point = map.transform_point3(probe);
                self.form.off(&place, point).into_iter().map(move |off| (probe, point, off))
            })
            .collect();
        let n = all.len();
        let residuals = DVector::from_iterator(n, all.iter().map(|(.., off)| off.mm));
        let mut turns = DMatrix::zeros(n, 3 * sensors);
        let axes = [plane.u, plane.v, plane.u.cross(plane.v)].map(DVec3::normalize);
        for (row, (probe, point, off)) in all.iter().enumerate() {
            let in_probe = map.matrix3.transpose() * off.along;
            let of_probe = probe.cross(in_probe).to_array();
            (0..3).for_each(|axis| turns[(row, axis)] = of_probe[axis]);
            if has_reference {
                let of_reference = point.cross(off.along).to_array();
                (0..3).for_each(|axis| turns[(row, 3 + axis)] = of_reference[axis]);
            }
        }
        let in_probe = |row: usize| map.matrix3.transpose() * all[row].2.along;
        let by = match self.form {
            Form::Point => {
                let along = |axis: DVec3| DMatrix::from_fn(n, 1, |row, _| in_probe(row).dot(axis));
                let [u, v, across] = axes.map(along);
                [turns, u, v, across]
            }
            Form::Plane { .. } => {
                let both = |row: usize| [in_probe(row), all[row].2.along];
                let positions = DMatrix::from_fn(n, 3 * sensors, |row, at| both(row)[at / 3][at % 3]);
                let line = marks[1] - marks[0];
                let across = DVec2::new(-line.y, line.x).normalize_or(DVec2::Y);
                let pixel_mm = plane.u * across.x + plane.v * across.y;
                let own = DMatrix::from_fn(n, n, |row, at| if row == at { in_probe(row).dot(pixel_mm) } else { 0.0 });
                [turns, positions, own, DMatrix::zeros(n, 0)]
            }
        };
        Scattered { residuals, by }
    }

    /// Adds the whitened residuals of all images.
    fn put(&self, state: &State, pictures: &[&Picture], whitenings: &[DMatrix<f64>], blocks: &mut Blocks<'_>) {
        let Unknown { plane, target, lag } = self.unknown;
        let unit = Whitening::sd(1.0);
        let (own, place) = (plane.plane(state), self.form.place(state, target));
        for (picture, whitening) in pictures.iter().zip(whitenings) {
            let map = picture.map(state.vector(lag)[0]);
            let mut residuals = DVector::zeros(whitening.nrows());
            let mut derivatives = DMatrix::zeros(whitening.nrows(), COLUMNS);
            let mut row = 0;
            for px in &self.detections[picture.detection].marks {
                let probe = own.point(*px);
                let changes = plane.changes(state, *px).map(|change| map.matrix3 * change);
                let by_lag = picture.rate.transform_point3(probe);
                for off in self.form.off(&place, map.transform_point3(probe)) {
                    residuals[row] = off.mm;
                    let all = changes.map(|change| change.dot(off.along)).into_iter().chain(off.by_target);
                    all.chain([by_lag.dot(off.along)]).enumerate().for_each(|(i, x)| derivatives[(row, i)] = x);
                    row += 1;
                }
            }
            let (residuals, derivatives) = (whitening * residuals, whitening * derivatives);
            for row in 0..residuals.len() {
                let by = |i: usize| derivatives[(row, i)];
                plane
                    .add_to(blocks.add([residuals[row]], &unit), [std::array::from_fn(by)])
                    .by(target, [std::array::from_fn(|i| by(NUMBERS + i))])
                    .by(lag, [[by(COLUMNS - 1)]]);
            }
        }
    }

    /// Adds the priors of the tip's position and of the lag.
    fn put_priors(&self, state: &State, blocks: &mut Blocks<'_>) {
        let Unknown { target, lag, .. } = self.unknown;
        if let Target::Tip { place_mm, error_mm } = self.target {
            let unit = crate::least_squares::rows(glam::DMat3::IDENTITY);
            blocks.add((state.point(target) - place_mm).to_array(), &Whitening::sd(error_mm)).by(target, unit);
        }
        if self.has_lag {
            blocks.add(state.vector(lag), &Whitening::sd(USUAL_LAG_S)).by(lag, [[1.0]]);
        }
    }
}

/// Number of columns of all parameters: the plane's, the target's, the lag.
const COLUMNS: usize = NUMBERS + 4;

/// Returns the mean of all observed points, in the reference's frame.
fn middle(detections: &[Detection], track: &Track, plane: &ImagePlane, lag_s: f64) -> DVec3 {
    let point = |detection: &Detection| {
        let map = detection.reference_from_probe(track, lag_s)?;
        Some(
            detection.marks.iter().map(|px| map.transform_point3(plane.point(*px))).sum::<DVec3>()
                / detection.marks.len() as f64,
        )
    };
    let points: Vec<DVec3> = detections.iter().filter_map(point).collect();
    points.iter().sum::<DVec3>() / points.len().max(1) as f64
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
}

#[cfg(test)]
mod tests;
