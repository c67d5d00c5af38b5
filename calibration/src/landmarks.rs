//! Registers a phantom from landmarks touched with a stylus of known tip.
//!
//! The tip rests at a landmark during a touch, whether the stylus is swung or not. Rests are
//! found by the tip's own motion. The tip's permitted motion in a rest follows from its own
//! uncertainty and from the tracker's noise, which is measured in the same readings. Rests are
//! assigned to landmarks by their mutual distances. A rest beside the phantom, a landmark left
//! out or touched twice, and the order therefore make no difference. The order counts only if
//! landmarks are symmetric.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use sonoweave_core::frames::{Phantom, Reference, Stylus, Transform};

use crate::error::{CalibrationError, LandmarksError};
use crate::least_squares::{
    Blocks, Parameters, Rotation, Settings as Solver, Side, State, Vector, Whitening, rows, solve, turned,
};
use crate::phantom::Landmark;
use crate::statistics::Spread;

mod matching;
#[cfg(test)]
mod tests;

pub use crate::rest::Rest;
use matching::{Found, MOST_RESTS, search};

/// One reading of the stylus.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Time, s of any clock.
    pub time_s: f64,
    /// Pose of the stylus; rigid.
    pub reference_from_stylus: Transform<Reference, Stylus>,
}

/// Criteria for rests and for accepting the result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Uncertainty of the tip's place on the stylus, mm. Swinging the stylus about a landmark
    /// moves the computed tip by up to twice this.
    pub tip_error_mm: f64,
    /// Minimum duration of a rest, s.
    pub least_s: f64,
    /// Largest distance of a rest from its landmark, mm: the tip's error, the hole's width, and
    /// the phantom's tolerances.
    pub near_mm: f64,
    /// Limit for the rests' distances from their landmarks (root mean square), and for each
    /// landmark's standard deviation, mm.
    pub limit_mm: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { tip_error_mm: 1.0, least_s: 1.0, near_mm: 3.0, limit_mm: 1.5 }
    }
}

/// A touched landmark.
#[derive(Debug, Clone, PartialEq)]
pub struct Touched {
    /// Its index in the list.
    pub landmark: usize,
    /// Position of the tip, in the reference's frame, mm; the mean of several touches.
    pub at_mm: DVec3,
    /// Distance from the registered landmark, mm.
    pub error_mm: f64,
    /// The rests.
    pub rests: Vec<Rest>,
}

/// A registered phantom.
#[derive(Debug, Clone, PartialEq)]
pub struct Registered {
    /// Pose of the phantom.
    pub reference_from_phantom: Transform<Reference, Phantom>,
    /// Touched landmarks, in the list's order.
    pub touched: Vec<Touched>,
    /// Landmarks that were not touched.
    pub missed: Vec<usize>,
    /// The landmarks are symmetric, and only their order decided.
    pub by_order: bool,
    /// Rests at no landmark.
    pub elsewhere: Vec<Rest>,
    /// Distances of rests from landmarks, mm. PLUS's registration error is their mean.
    pub error_mm: Spread,
    /// The tracker's noise at the tip, per axis, mm.
    pub noise_mm: f64,
    /// Radius within which a rest stays, mm.
    pub radius_mm: f64,
    /// Covariance of a small rotation (rad) of the mapped points about the reference's origin
    /// and axes, followed by a shift (mm).
    pub covariance: [[f64; 6]; 6],
    /// Condition number; see [`crate::least_squares::Solution::condition`].
    pub condition: f64,
}

impl Registered {
    /// Returns the covariance of a phantom point (mm) in the reference's frame, mm², due to the
    /// registration's uncertainty.
    pub fn covariance_at(&self, point_mm: DVec3) -> [[f64; 3]; 3] {
        let there = self.reference_from_phantom.point(point_mm);
        let by = [turned(there), DMat3::IDENTITY].map(rows);
        let row = |i: usize| -> [f64; 6] { std::array::from_fn(|k| by[k / 3][i][k % 3]) };
        let product = |a: [f64; 6], b: [f64; 6]| -> f64 {
            a.iter().zip(&self.covariance).map(|(a, row)| a * row.iter().zip(b).map(|(c, b)| c * b).sum::<f64>()).sum()
        };
        std::array::from_fn(|i| std::array::from_fn(|j| product(row(i), row(j))))
    }

    /// Returns the same as one number: the root of the sum of the variances along the axes, mm.
    pub fn sd_at(&self, point_mm: DVec3) -> f64 {
        let covariance = self.covariance_at(point_mm);
        (0..3).map(|i| covariance[i][i]).sum::<f64>().sqrt()
    }
}

/// Registers a phantom from readings of the stylus in the order of time.
///
/// # Errors
/// [`LandmarksError`] names the missing data or the problem.
pub fn register(
    readings: &[Reading],
    tip_mm: DVec3,
    landmarks: &[Landmark],
    settings: &Settings,
) -> Result<Registered, CalibrationError> {
    check(landmarks)?;
    let places = places(landmarks);
    let touch = Touch::of(readings, tip_mm, 1.0, spacing(&places), settings)?;
    let found = touch.search(&places);
    let count = |found: &Option<Found>| found.as_ref().map_or(0, |found| found.best.count);
    let matched = count(&found);
    // A mirrored phantom fits at most a few landmarks of one side; its mirror image fits more.
    let mirrored: Vec<DVec3> = places.iter().map(|p| DVec3::new(-p.x, p.y, p.z)).collect();
    let mirrored = count(&touch.search(&mirrored));
    let needed = least(places.len());
    if mirrored >= needed && mirrored > matched {
        return Err(LandmarksError::Mirrored { matched: mirrored, landmarks: places.len() }.into());
    }
    if matched < needed {
        if let Some(error) = in_other_units(readings, tip_mm, &places, settings) {
            return Err(error.into());
        }
        return Err(LandmarksError::NoMatch {
            rests: touch.rests.len(),
            matched,
            landmarks: places.len(),
            least: needed,
            radius_mm: touch.radius_mm,
        }
        .into());
    }
    match found {
        Some(found) if found.tied => Err(LandmarksError::Symmetric.into()),
        Some(found) => Ok(touch.refined(&found, &places, settings)?),
        // Fewer landmarks than required.
        None => Err(LandmarksError::TooFew { landmarks: places.len() }.into()),
    }
}

/// Returns the number of landmarks to be found. Any three rests may match three landmarks by
/// chance; a fourth match is significant.
fn least(landmarks: usize) -> usize {
    landmarks.min(4)
}

/// Returns the least distance between two landmarks, mm.
fn spacing(places: &[DVec3]) -> f64 {
    let pairs = places.iter().enumerate().flat_map(|(i, p)| places[i + 1..].iter().map(|q| p.distance(*q)));
    pairs.fold(f64::INFINITY, f64::min)
}

fn places(landmarks: &[Landmark]) -> Vec<DVec3> {
    landmarks.iter().map(|landmark| landmark.position_mm).collect()
}

/// Checks that landmarks can determine a phantom's pose.
///
/// # Errors
/// [`LandmarksError::TooFew`] or [`LandmarksError::OnALine`].
pub fn check(landmarks: &[Landmark]) -> Result<(), CalibrationError> {
    let places = places(landmarks);
    let [first, second, _, ..] = places.as_slice() else {
        return Err(LandmarksError::TooFew { landmarks: places.len() }.into());
    };
    let along = (*second - *first).normalize_or_zero();
    let aside = |p: &DVec3| (*p - *first).reject_from_normalized(along).length();
    if places.iter().map(aside).fold(0.0, f64::max) < 1.0 {
        return Err(LandmarksError::OnALine.into());
    }
    Ok(())
}

/// Returns the error for readings or landmarks that fit in other units, if they do.
fn in_other_units(readings: &[Reading], tip: DVec3, places: &[DVec3], settings: &Settings) -> Option<LandmarksError> {
    let fits = |touch: Result<Touch, LandmarksError>, places: &[DVec3]| {
        let found = touch.ok().and_then(|touch| touch.search(places));
        found.is_some_and(|found| found.best.count >= least(places.len()))
    };
    for factor in [10.0, 0.1, 25.4, 1.0 / 25.4] {
        let spacing_mm = spacing(places);
        if fits(Touch::of(readings, tip, factor, spacing_mm, settings), places) {
            return Some(LandmarksError::Units { what: "the tracker's positions", factor });
        }
        let scaled: Vec<DVec3> = places.iter().map(|p| *p / factor).collect();
        if fits(Touch::of(readings, tip, 1.0, spacing_mm / factor, settings), &scaled) {
            return Some(LandmarksError::Units { what: "the phantom's landmarks", factor });
        }
    }
    None
}

/// The rests of a recording.
struct Touch {
    rests: Vec<Rest>,
    noise_mm: f64,
    radius_mm: f64,
    near_mm: f64,
}

impl Touch {
    /// Finds rests in readings whose positions are `factor` times too large, for landmarks at
    /// least `spacing_mm` apart.
    fn of(
        readings: &[Reading],
        tip: DVec3,
        factor: f64,
        spacing_mm: f64,
        settings: &Settings,
    ) -> Result<Self, LandmarksError> {
        let place = |reading: &Reading| {
            let pose = reading.reference_from_stylus.affine();
            (reading.time_s, pose.matrix3 * tip + pose.translation / factor)
        };
        let positions: Vec<(f64, DVec3)> = readings.iter().map(place).collect();
        let noise_mm = crate::rest::noise(&positions).ok_or(LandmarksError::NoReadings { readings: readings.len() })?;
        // Keeps rests at two landmarks apart.
        let third = spacing_mm / 3.0;
        // A thousand readings of Gaussian noise lie within four standard deviations.
        let radius_mm = (2.0 * settings.tip_error_mm + 4.0 * noise_mm).min(third);
        let mut rests = crate::rest::find(&positions, radius_mm, settings.least_s);
        if rests.len() > MOST_RESTS {
            let length = |rest: &Rest| rest.time_s[1] - rest.time_s[0];
            rests.sort_by(|a, b| length(b).total_cmp(&length(a)).then(a.readings.cmp(&b.readings)));
            rests.truncate(MOST_RESTS);
            rests.sort_by_key(|rest| rest.readings);
        }
        Ok(Self { rests, noise_mm, radius_mm, near_mm: settings.near_mm.min(third) })
    }

    fn search(&self, places: &[DVec3]) -> Option<Found> {
        let rests: Vec<DVec3> = self.rests.iter().map(|rest| rest.at).collect();
        search(&rests, places, self.near_mm)
    }

    /// Refines the pose by least squares over the touched landmarks, each counted once.
    fn refined(&self, found: &Found, places: &[DVec3], settings: &Settings) -> Result<Registered, LandmarksError> {
        let mut touched = Vec::new();
        let mut missed = Vec::new();
        for landmark in 0..places.len() {
            let own = self.rests.iter().zip(&found.best.landmark).filter(|(_, index)| **index == Some(landmark));
            let rests: Vec<Rest> = own.map(|(rest, _)| *rest).collect();
            if rests.is_empty() {
                missed.push(landmark);
                continue;
            }
            let at_mm = rests.iter().map(|rest| rest.at).sum::<DVec3>() / rests.len() as f64;
            touched.push(Touched { landmark, at_mm, error_mm: 0.0, rests });
        }
        let elsewhere = self.rests.iter().zip(&found.best.landmark).filter(|(_, index)| index.is_none());
        let elsewhere = elsewhere.map(|(rest, _)| *rest).collect();

        let problem = Problem::new(&touched, places, &found.best.to_rests);
        let solution = solve(&problem.parameters, &Solver::default(), |s, b| problem.put(s, b))?;
        let turn = DMat3::from_quat(solution.state.rotation(problem.turn));
        let shift = solution.state.point(problem.shift);
        let reference_from_phantom = Transform::<Reference, Phantom>::from_affine(DAffine3 {
            matrix3: turn,
            translation: shift - turn * problem.centre,
        });
        for touched in &mut touched {
            touched.error_mm = reference_from_phantom.point(places[touched.landmark]).distance(touched.at_mm);
        }
        let error_mm = Spread::of(touched.iter().map(|touched| touched.error_mm));
        if error_mm.rms > settings.limit_mm {
            return Err(LandmarksError::Limit { rms_mm: error_mm.rms, limit_mm: settings.limit_mm });
        }
        // The rotation is about the landmarks' centre; a rotation about the origin also moves
        // the centre.
        let about_centre = rows(-turned(shift));
        let unit = |first: usize| -> [[f64; 3]; 6] {
            std::array::from_fn(|i| match i.checked_sub(3) {
                None if first == 0 => std::array::from_fn(|k| if i == k { 1.0 } else { 0.0 }),
                None => [0.0; 3],
                Some(i) if first == 0 => about_centre[i],
                Some(i) => std::array::from_fn(|k| if i == k { 1.0 } else { 0.0 }),
            })
        };
        let covariance =
            solution.certainty().propagated(|all| all.by(problem.turn, unit(0)).by(problem.shift, unit(3)));
        let registered = Registered {
            reference_from_phantom,
            touched,
            missed,
            by_order: found.by_order,
            elsewhere,
            error_mm,
            noise_mm: self.noise_mm,
            radius_mm: self.radius_mm,
            covariance,
            condition: solution.condition,
        };
        let sd_mm = places.iter().map(|place| registered.sd_at(*place)).fold(0.0, f64::max);
        if sd_mm > settings.limit_mm {
            return Err(LandmarksError::Uncertain {
                touched: registered.touched.len(),
                landmarks: places.len(),
                sd_mm,
                limit_mm: settings.limit_mm,
            });
        }
        Ok(registered)
    }
}

/// Residuals between touched and mapped landmarks. Parameters: a rotation about the landmarks'
/// centre, and the position of that centre.
struct Problem {
    pairs: Vec<(DVec3, DVec3)>,
    centre: DVec3,
    parameters: Parameters,
    turn: Rotation,
    shift: Vector<3>,
    unit: Whitening<3>,
}

impl Problem {
    fn new(touched: &[Touched], places: &[DVec3], start: &DAffine3) -> Self {
        let centre = touched.iter().map(|touched| places[touched.landmark]).sum::<DVec3>() / touched.len() as f64;
        let pairs: Vec<_> = touched.iter().map(|touched| (places[touched.landmark] - centre, touched.at_mm)).collect();
        let size = Spread::of(pairs.iter().map(|(p, _)| p.length())).rms;
        let mut parameters = Parameters::new();
        let turn = DQuat::from_mat3(&start.matrix3);
        let turn = parameters.rotation("rotation of the phantom", Side::Left, 1.0 / size, turn);
        let shift = parameters.point("place of the landmarks' centre", 1.0, start.transform_point3(centre));
        Self { pairs, centre, parameters, turn, shift, unit: Whitening::sd(1.0) }
    }

    fn put(&self, state: &State, blocks: &mut Blocks<'_>) {
        let (turn, shift) = (DMat3::from_quat(state.rotation(self.turn)), state.point(self.shift));
        for (from, to) in &self.pairs {
            let there = turn * *from;
            blocks
                .add((there + shift - *to).to_array(), &self.unit)
                .by(self.turn, rows(turned(there)))
                .by(self.shift, rows(DMat3::IDENTITY));
        }
    }
}
