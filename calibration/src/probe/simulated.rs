//! Simulated scans of a phantom with known truth, for tests.

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};

use sonoweave_core::frames::{Phantom, Reference, Transform};

use super::layout::Layout;
use super::matching::Mark;
use super::plane::{ImagePlane, NUMBERS};
use super::plane_covariance::PlaneCovariance;
use super::sighting::Sighting;
use super::track::{Poses, Track};
use crate::noise::{Noise, mahalanobis};
use crate::phantom::Geometry;
use crate::phantom::geometry::tests::three_ns;

/// Size of the images, pixels.
pub(super) const SIZE_PX: [u32; 2] = [820, 616];
/// Time between images, s.
const PERIOD_S: f64 = 0.08;

/// Counts of calibrations whose intervals hold the truth.
pub(super) struct Coverage {
    calibrations: u32,
    planes: u32,
    lengths: u32,
    noise: Noise,
}

/// Lengths that are measured with each calibration.
const LENGTHS: u32 = 25;

impl Coverage {
    pub(super) fn new() -> Self {
        Self { calibrations: 0, planes: 0, lengths: 0, noise: Noise::new(77) }
    }

    /// Adds a calibration: all eight numbers together, and lengths of 5 to 64 mm anywhere in the
    /// image.
    pub(super) fn add(&mut self, found: &ImagePlane, covariance: &PlaneCovariance, truth: &ImagePlane) {
        let pivot = covariance.pivot_px();
        let turn = DQuat::from_mat3(&(found.axes().transpose() * truth.axes())).to_scaled_axis();
        let shift = truth.point(pivot) - found.point(pivot);
        let [u, v] = [0, 1].map(|axis| (truth.pixel_mm()[axis] / found.pixel_mm()[axis]).ln());
        let entries: [[f64; 8]; 8] = std::array::from_fn(|i| std::array::from_fn(|j| covariance.entries()[i][j]));
        let error = [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z, u, v];
        // The 95 % quantile of χ² with 8 degrees of freedom.
        self.planes += u32::from(mahalanobis(error, &entries) <= 15.507);
        self.calibrations += 1;
        let mut count = 0;
        while count < LENGTHS {
            let [a, b] =
                [0; 2].map(|_| DVec2::from_array(SIZE_PX.map(|n| self.noise.between(0.0, f64::from(n) - 1.0))));
            let length = |plane: &ImagePlane| plane.point(a).distance(plane.point(b));
            if !(5.0..64.0).contains(&length(truth)) {
                continue;
            }
            count += 1;
            let along = (found.point(b) - found.point(a)).normalize();
            let [by_a, by_b] = [a, b].map(|px| found.changes(pivot, px));
            let slope = |one: &[f64; NUMBERS]| -> f64 {
                one.iter().zip(by_b.iter().zip(by_a)).map(|(x, (b, a))| along.dot(*b - a) * x).sum()
            };
            let sd = covariance.components().iter().map(|one| slope(one).powi(2)).sum::<f64>().sqrt();
            self.lengths += u32::from((length(found) - length(truth)).abs() <= 1.96 * sd);
        }
    }

    /// Asserts that intervals of 95 % hold the truth in 93 to 97 of 100 cases.
    pub(super) fn check(&self, of: &str) {
        let calibrations = f64::from(self.calibrations);
        let shares =
            [f64::from(self.planes) / calibrations, f64::from(self.lengths) / calibrations / f64::from(LENGTHS)];
        assert!(shares.iter().all(|share| (0.93..=0.97).contains(share)), "{of}: {shares:?}");
    }
}

/// Errors of a scan.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Imperfect {
    pub(super) position_mm: f64,
    pub(super) turn_deg: f64,
    pub(super) dot_px: f64,
    pub(super) lag_s: f64,
}

/// A scan, and its truth.
#[derive(Clone)]
pub(super) struct Scan {
    pub(super) layout: Layout,
    pub(super) plane: ImagePlane,
    pub(super) reference_from_phantom: Transform<Reference, Phantom>,
    pub(super) sightings: Vec<Sighting>,
    pub(super) track: Track,
}

/// Returns the true image plane in the probe's frame.
fn plane() -> ImagePlane {
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.1, -0.15, 1.6);
    ImagePlane { u: turn * DVec3::X * 0.0786, v: turn * DVec3::Y * 0.0741, origin: DVec3::new(11.0, 46.0, -7.0) }
}

/// The operator's motion: rotations about the phantom's axes, rad, and shifts along them, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hand {
    pub(super) turn: [f64; 3],
    pub(super) shift: [f64; 3],
}

impl Hand {
    /// Along the wires and back, tilting and turning on the way.
    pub(super) const FREE: Self = Self { turn: [0.3, 0.2, 0.25], shift: [3.0, 7.0, 2.0] };
}

impl Scan {
    /// Simulates a scan of this many images with a good motion.
    pub(super) fn new(pictures: usize, imperfect: Imperfect, noise: &mut Noise) -> Self {
        Self::by(Hand::FREE, pictures, imperfect, noise)
    }

    /// Simulates a scan of this many images.
    pub(super) fn by(hand: Hand, pictures: usize, imperfect: Imperfect, noise: &mut Noise) -> Self {
        Self::of(three_ns(), hand, pictures, imperfect, noise)
    }

    /// Simulates a scan of a phantom near the same place.
    pub(super) fn of(phantom: Geometry, hand: Hand, pictures: usize, imperfect: Imperfect, noise: &mut Noise) -> Self {
        let reference_from_phantom: Transform<Reference, Phantom> =
            Transform::from_affine(DAffine3::from_rotation_translation(
                DQuat::from_euler(glam::EulerRot::XYZ, 1.5, 0.1, -1.5),
                DVec3::new(9.6, 36.0, 87.9),
            ));
        let phases: [f64; 5] = std::array::from_fn(|_| noise.between(0.0, std::f64::consts::TAU));
        // The image plane in the phantom at a time: u to the left of the phantom, v down, the
        // dots near its centre.
        let phantom_from_image = |time: f64| {
            let wave = |period_s: f64, phase: usize| (std::f64::consts::TAU * time / period_s + phases[phase]).sin();
            let level = DMat3::from_cols(DVec3::NEG_X, DVec3::NEG_Z, DVec3::NEG_Y);
            let ([x, y, z], [along_x, along_y, along_z]) = (hand.turn, hand.shift);
            let tilt = DQuat::from_euler(glam::EulerRot::XYZ, x * wave(3.1, 0), y * wave(4.3, 1), z * wave(5.7, 2));
            let turn = DMat3::from_quat(tilt) * level;
            let shift = DVec3::new(along_x * wave(2.3, 3), along_y * wave(11.0, 4), along_z * wave(3.7, 1));
            let centre = DVec3::new(35.0, 20.0, 5.0) + shift;
            let [width, height] = SIZE_PX.map(f64::from);
            let (u, v) = (turn * DVec3::X * 0.0786, turn * DVec3::Y * 0.0741);
            ImagePlane { u, v, origin: centre - u * (0.5 * width) - v * (0.5 * height) }
        };
        let layout = Layout::new(phantom).unwrap();
        let mut scan = Self {
            layout,
            plane: plane(),
            reference_from_phantom,
            sightings: Vec::new(),
            track: Track::new(Vec::new()),
        };
        let mut track = Vec::new();
        for frame in 0..pictures {
            let time_s = 100.0 + PERIOD_S * frame as f64;
            track.push(scan.poses(time_s, &phantom_from_image(time_s - imperfect.lag_s), imperfect, noise));
            scan.see(time_s, &phantom_from_image(time_s), imperfect, noise);
        }
        scan.track = Track::new(track);
        scan
    }

    /// Adds images, after a while, of a probe that is held still.
    pub(super) fn hold(
        &mut self,
        phantom_from_image: &ImagePlane,
        pictures: usize,
        imperfect: Imperfect,
        noise: &mut Noise,
    ) {
        let mut track = self.track.poses().to_vec();
        let begin_s = track.last().map_or(0.0, |poses| poses.time_s) + 5.0;
        for picture in 0..pictures {
            let time_s = begin_s + PERIOD_S * picture as f64;
            track.push(self.poses(time_s, phantom_from_image, imperfect, noise));
            self.see(time_s, phantom_from_image, imperfect, noise);
        }
        self.track = Track::new(track);
    }

    /// Returns the sensors' poses at a time, from the image plane in the phantom.
    fn poses(&self, time_s: f64, phantom_from_image: &ImagePlane, imperfect: Imperfect, noise: &mut Noise) -> Poses {
        let phantom_from_probe = phantom_from_image.affine() * self.plane.affine().inverse();
        let drift = DQuat::from_euler(glam::EulerRot::XYZ, 0.05 * (0.5 * time_s).sin(), 0.3, -1.2);
        let reference =
            DAffine3::from_rotation_translation(drift, DVec3::new(250.0, 82.0 + 3.0 * (0.4 * time_s).cos(), -42.0));
        let probe = reference * self.reference_from_phantom.affine() * phantom_from_probe;
        let mut noisy = |pose: DAffine3| {
            let turn = DQuat::from_scaled_axis(noise.vector(imperfect.turn_deg.to_radians()));
            pose * DAffine3::from_rotation_translation(turn, noise.vector(imperfect.position_mm))
        };
        Poses {
            time_s,
            tracker_from_probe: Transform::from_affine(noisy(probe)),
            tracker_from_reference: Some(Transform::from_affine(noisy(reference))),
        }
    }

    /// Adds an image's dots.
    fn see(&mut self, time_s: f64, phantom_from_image: &ImagePlane, imperfect: Imperfect, noise: &mut Noise) {
        let seen = self.layout.geometry().wires().iter().enumerate().filter_map(|(wire, geometry)| {
            let (px, share) = phantom_from_image.cut(geometry)?;
            let at_px = px + DVec2::new(noise.normal(), noise.normal()) * imperfect.dot_px;
            (0.0..=1.0).contains(&share).then_some(Mark { wire, at_px, contrast: 100.0 })
        });
        let marks = seen.collect();
        self.sightings.push(Sighting { frame: self.sightings.len(), time_s, marks });
    }
}

/// Returns the image's corners and centre.
pub(super) fn places() -> [DVec2; 5] {
    let [u, v] = SIZE_PX.map(|n| f64::from(n) - 1.0);
    [[0.0, 0.0], [u, 0.0], [0.0, v], [u, v], [0.5 * u, 0.5 * v]].map(DVec2::from_array)
}
