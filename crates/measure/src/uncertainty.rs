//! Standard error of a figure: independent errors of its places, by cause, and their effect.
//!
//! A place is where the calibration and the tracker put the pixels of the slices that reach it.
//! Its error has these causes:
//!
//! | cause | errors | shared by |
//! |---|---|---|
//! | calibration | components of the covariance of the image plane's numbers | all places |
//! | tracker | position and rotation of each sensor, for each slice | the slice's places |
//! | sampling | kernel, gap between slices, voxel, depth of a pick | one place |
//! | clicks | the hand, and the screen's pixel | one place |
//! | noise | values of the volume, by which an edge is displaced | places within a kernel |
//!
//! Each error moves the places by a known amount for one standard deviation. Slices count by their
//! kernel's weight. A figure's variance is the sum over errors of (Σ g·shift)², with the figure's
//! gradient g (JCGM 100:2008, GUM, 5.1). Errors that places share are thus neither lost nor counted
//! twice: a wrong pixel size changes lengths, a wrong position of the plane does not.
//!
//! The reported error is a 95 % interval. It is 1.96 standard deviations if the sum is normal, less
//! if a few uniform errors dominate. For figures of few places, the mean effect of the curvature is
//! added to the variance.

use std::collections::BTreeMap;

use glam::{DAffine3, DVec3};

use calibration::probe::plane::{ImagePlane, NUMBERS};
use calibration::probe::plane_covariance::PlaneCovariance;
use calibration::tracker::noise::TrackerNoise;
use reconstruct::standard_error::Edge;

use crate::figure::Figure;
use crate::place::Place;
use crate::sources::{Reach, Slices};

/// Standard deviation of a click of the hand along each axis of the screen, pixels. Assumed: users
/// who point at a visible spot and look before they click.
pub const HAND_PX: f64 = 1.0;
/// Excess kurtosis of a uniform distribution.
const UNIFORM: f64 = -1.2;
/// Standard deviations of a 95 % interval of a normal distribution.
const NORMAL_95: f64 = 1.959_964;
/// Change of that number with the kurtosis κ: c·κ (Cornish & Fisher 1938), and c·κ⁴, which makes it
/// exact for one uniform error and gives 1.904 instead of 1.902 for two equal ones.
const BY_KURTOSIS: [f64; 2] = [0.068_718, -0.111_91];
/// Share of the standard deviation above which the effect of the curvature is noted.
const BENT: f64 = 0.4;

/// Known errors of places in a session's volume.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Uncertainty {
    /// The image's calibration: pixels to mm at the probe's sensor.
    pub probe_from_image: Option<DAffine3>,
    /// Its covariance; `None` if unknown.
    pub calibration: Option<PlaneCovariance>,
    /// Noise of a sensor's pose; `None` if unknown.
    pub sensors: Option<TrackerNoise>,
    /// Whether the world is a second sensor's frame.
    pub has_reference: bool,
    /// The longest distance between neighbouring voxels, mm.
    pub voxel_mm: f64,
    /// Half width at half maximum of the kernel along u, v and the normal of a slice, mm.
    pub hwhm_mm: [f64; 3],
}

/// Cause of an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cause {
    Calibration,
    Tracker,
    Sampling,
    Clicks,
    Noise,
}

/// Count of causes.
const CAUSES: usize = 5;

/// An independent error.
#[derive(Debug)]
struct Component {
    cause: Cause,
    /// Excess kurtosis of its distribution.
    kurtosis: f64,
    /// Displacement of places, by their number, for one standard deviation, mm.
    shifts: Vec<(usize, DVec3)>,
}

/// The errors of a figure's places.
#[derive(Debug)]
pub(crate) struct Errors {
    components: Vec<Component>,
    /// Reason why the calibration error is unknown.
    pub(crate) without_calibration: Option<String>,
    /// Whether the tracker's noise is unknown.
    pub(crate) without_tracker: bool,
    /// Number of places on edges of the volume, whose noise is known.
    pub(crate) on_edges: usize,
}

/// A figure's error: 95 % intervals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Interval {
    /// By all causes.
    pub(crate) error: f64,
    /// By each cause: the root of the sum of their squares is `error`.
    parts: [f64; CAUSES],
    /// Whether the places' errors are large against the figure.
    pub(crate) is_bent: bool,
}

impl Interval {
    /// Returns the part by a cause.
    pub(crate) fn of(&self, cause: Cause) -> f64 {
        self.parts[cause as usize]
    }
}

impl Uncertainty {
    /// Returns the errors of places that these slices reach.
    pub(crate) fn errors(&self, places: &[Place], slices: &Slices) -> Errors {
        let points: Vec<DVec3> = places.iter().map(|place| DVec3::from_array(place.point)).collect();
        let reached = slices.reaching_each(&points);
        let mut components = Vec::new();
        let unreached = reached.iter().position(|reach| reach.contributions.is_empty());
        let without_calibration = match (&self.calibration, self.probe_from_image, unreached) {
            (None, ..) | (_, None, _) => {
                Some("the calibration holds no covariance; `calibrate probe` writes it".to_owned())
            }
            (.., Some(place)) => Some(format!("no slice reaches point {}", place + 1)),
            (Some(covariance), Some(probe_from_image), None) => {
                components.extend(of_calibration(covariance, &probe_from_image, &reached));
                None
            }
        };
        let without_tracker = match (self.sensors, self.probe_from_image, unreached) {
            (Some(noise), Some(probe_from_image), None) => {
                components.extend(self.of_tracker(noise, &probe_from_image, &points, &reached));
                false
            }
            _ => true,
        };
        for (number, (place, reach)) in places.iter().zip(&reached).enumerate() {
            self.of_place(number, place, reach, &mut components);
        }
        let on_edges = self.of_noise(places, &mut components);
        components.retain(|component| component.shifts.iter().any(|(_, shift)| *shift != DVec3::ZERO));
        Errors { components, without_calibration, without_tracker, on_edges }
    }

    /// Returns the errors of the sensors at each slice.
    fn of_tracker(
        &self,
        noise: TrackerNoise,
        probe_from_image: &DAffine3,
        points: &[DVec3],
        reached: &[Reach],
    ) -> Vec<Component> {
        let image_from_probe = probe_from_image.inverse();
        let mut by_slice: BTreeMap<usize, (DVec3, Vec<(usize, f64)>)> = BTreeMap::new();
        for (place, reach) in reached.iter().enumerate() {
            for one in &reach.contributions {
                let sensor = || ((one.world_from_image * image_from_probe).translation, Vec::new());
                by_slice.entry(one.slice).or_insert_with(sensor).1.push((place, one.share));
            }
        }
        let sensors = if self.has_reference { 2.0_f64 } else { 1.0 };
        let (moved, turned) = (noise.position_mm * sensors.sqrt(), noise.rotation_deg.to_radians());
        let mut components = Vec::new();
        let mut add = |places: &[(usize, f64)], shift: &dyn Fn(usize) -> DVec3| {
            let shifts = places.iter().map(|(place, share)| (*place, shift(*place) * *share)).collect();
            components.push(Component { cause: Cause::Tracker, kurtosis: 0.0, shifts });
        };
        for (sensor, places) in by_slice.values() {
            for axis in DVec3::AXES {
                add(places, &|_| axis * moved);
                add(places, &|place| axis.cross(points[place] - *sensor) * turned);
                if self.has_reference {
                    // The second sensor is the world's origin.
                    add(places, &|place| axis.cross(points[place]) * turned);
                }
            }
        }
        components
    }

    /// Adds the errors of one place alone.
    fn of_place(&self, number: usize, place: &Place, reach: &Reach, components: &mut Vec<Component>) {
        let mut add = |cause, along: DVec3, variance: f64, kurtosis| {
            components.push(Component { cause, kurtosis, shifts: vec![(number, along * variance.sqrt())] });
        };
        let (axes, [u, v, across]) = match reach.contributions.first() {
            Some(nearest) => {
                let map = nearest.world_from_image.matrix3;
                let normal = map.x_axis.cross(map.y_axis).normalize_or_zero();
                let axes = [map.x_axis.normalize_or_zero(), map.y_axis.normalize_or_zero(), normal];
                let [u, v, across] = self.hwhm_mm;
                (axes, [u, v, across.max(reach.gap_mm)])
            }
            None => (DVec3::AXES, [self.hwhm_mm.into_iter().fold(0.0, f64::max); 3]),
        };
        for (axis, width) in axes.into_iter().zip([u, v, across]) {
            // Anywhere within the kernel, or between two slices, and anywhere within a voxel.
            let squares = [width, self.voxel_mm].map(|width| width * width / 12.0);
            let variance = squares[0] + squares[1];
            if variance > 0.0 {
                let kurtosis = UNIFORM * (squares[0].powi(2) + squares[1].powi(2)) / variance.powi(2);
                add(Cause::Sampling, axis, variance, kurtosis);
            }
        }
        let ray = place.along();
        add(Cause::Sampling, ray, place.depth_mm * place.depth_mm / 12.0, UNIFORM);
        let pixel_mm = place.pixel_mm.unwrap_or(0.0);
        let variance = pixel_mm * pixel_mm * (HAND_PX * HAND_PX + 1.0 / 12.0);
        // A click moves a place across the ray, if that is known.
        let screen = if ray == DVec3::ZERO {
            DVec3::AXES.to_vec()
        } else {
            let (right, down) = ray.any_orthonormal_pair();
            vec![right, down]
        };
        screen.into_iter().for_each(|axis| add(Cause::Clicks, axis, variance, 0.0));
    }

    /// Adds the errors by the volume's noise: it displaces an edge by error over gradient, along
    /// the gradient. Places nearer than a kernel share the noise. Returns how many places lie on
    /// edges: beyond half a kernel, the displaced edge would be another one.
    fn of_noise(&self, places: &[Place], components: &mut Vec<Component>) -> usize {
        let half_mm = self.hwhm_mm.into_iter().fold(0.0, f64::max);
        // The first place of each group, with all displacements.
        let mut groups: Vec<(DVec3, Vec<(usize, DVec3)>)> = Vec::new();
        for (number, place) in places.iter().enumerate() {
            let Some(Edge { standard_error, gradient }) = place.edge else { continue };
            let shift = gradient * (standard_error / gradient.length_squared());
            // Without a gradient, the displacement is no number.
            let is_on_edge = shift.length() <= half_mm;
            if !is_on_edge {
                continue;
            }
            let point = DVec3::from_array(place.point);
            match groups.iter_mut().find(|(first, _)| first.distance(point) < 2.0 * half_mm) {
                Some((_, shifts)) => shifts.push((number, shift)),
                None => groups.push((point, vec![(number, shift)])),
            }
        }
        let on_edges = groups.iter().map(|(_, shifts)| shifts.len()).sum();
        let component = |(_, shifts)| Component { cause: Cause::Noise, kurtosis: 0.0, shifts };
        components.extend(groups.into_iter().map(component));
        on_edges
    }
}

/// Returns the errors of the calibration, which all places share.
fn of_calibration(covariance: &PlaneCovariance, probe_from_image: &DAffine3, reached: &[Reach]) -> Vec<Component> {
    let plane = ImagePlane::of(probe_from_image);
    let image_from_probe = probe_from_image.matrix3.inverse();
    let by_numbers = |reach: &Reach| {
        let mut mean = [DVec3::ZERO; NUMBERS];
        for one in &reach.contributions {
            let to_world = one.world_from_image.matrix3 * image_from_probe;
            for (mean, change) in mean.iter_mut().zip(plane.changes(covariance.pivot_px(), one.pixel)) {
                *mean += to_world * change * one.share;
            }
        }
        mean
    };
    let changes: Vec<[DVec3; NUMBERS]> = reached.iter().map(by_numbers).collect();
    let component = |numbers: [f64; NUMBERS]| {
        let shift = |changes: &[DVec3; NUMBERS]| changes.iter().zip(numbers).map(|(by, x)| *by * x).sum();
        let shifts = changes.iter().map(shift).enumerate().collect();
        Component { cause: Cause::Calibration, kurtosis: 0.0, shifts }
    };
    covariance.components().into_iter().map(component).collect()
}

impl Errors {
    /// Returns the 95 % interval of a figure of these places.
    pub(crate) fn of(&self, figure: &Figure) -> Interval {
        let slopes = figure.slopes();
        let mut variances = [0.0; CAUSES];
        let mut fourth = 0.0;
        let mut add = |cause: Cause, slope: f64, kurtosis: f64| {
            variances[cause as usize] += slope * slope;
            fourth += slope.powi(4) * kurtosis;
        };
        for Component { cause, kurtosis, shifts } in &self.components {
            add(*cause, shifts.iter().map(|(place, shift)| slopes[*place].dot(*shift)).sum(), *kurtosis);
        }
        for slope in figure.unsampled() {
            add(Cause::Sampling, slope, UNIFORM);
        }
        let linear: f64 = variances.iter().sum();
        let bends = self.bends(figure);
        let bend: f64 = bends.iter().sum();
        // Each cause's part of the bend, as far as it has the sign of the whole.
        let same = bends.map(|of_cause| (of_cause * bend).max(0.0));
        let all: f64 = same.iter().sum();
        if all > 0.0 {
            variances.iter_mut().zip(same).for_each(|(variance, part)| *variance += bend * bend * part / all);
        }
        let kurtosis = if linear > 0.0 { fourth / (linear * linear) } else { 0.0 };
        let factor = coverage_factor(kurtosis);
        Interval {
            error: factor * variances.iter().sum::<f64>().sqrt(),
            parts: variances.map(|variance| factor * variance.sqrt()),
            is_bent: bend.abs() > BENT * linear.sqrt() && bend != 0.0,
        }
    }

    /// Returns the mean change of a figure by the second order of each cause's errors; 0 for
    /// figures of many places, whose values average it out.
    fn bends(&self, figure: &Figure) -> [f64; CAUSES] {
        let mut bends = [0.0; CAUSES];
        if !figure.is_of_few() {
            return bends;
        }
        let value = figure.value();
        for Component { cause, shifts, .. } in &self.components {
            let ends = [1.0, -1.0].map(|sign| figure.moved(shifts.iter().map(|(place, by)| (*place, *by * sign))));
            bends[*cause as usize] += 0.5 * (ends[0] + ends[1]) - value;
        }
        bends
    }
}

/// Returns the standard deviations of a 95 % interval of a sum of errors with this kurtosis, from
/// that of one uniform error to that of a normal one.
fn coverage_factor(kurtosis: f64) -> f64 {
    let kurtosis = kurtosis.clamp(UNIFORM, 0.0);
    NORMAL_95 + BY_KURTOSIS[0] * kurtosis + BY_KURTOSIS[1] * kurtosis.powi(4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coverage_factor_matches_closed_forms() {
        assert!((coverage_factor(0.0) - 1.96).abs() < 1e-4);
        // One uniform error, and two equal ones, whose sum has a triangular distribution.
        assert!((coverage_factor(-1.2) - 0.95 * 3.0_f64.sqrt()).abs() < 1e-4, "{}", coverage_factor(-1.2));
        assert!((coverage_factor(-0.6) - 6.0_f64.sqrt() * (1.0 - 0.05_f64.sqrt())).abs() < 3e-3);
    }
}
