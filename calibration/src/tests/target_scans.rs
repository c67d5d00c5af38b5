//! Simulated scans of a target with known truth, for tests.

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};

use sonoweave_core::frames::Transform;

use crate::probe::plane::ImagePlane;
use crate::probe::recording::{Observation, Recording};
use crate::probe::target::detection::Seen;
use crate::probe::target::{Place, Target};
use crate::probe::track::Poses;
use crate::tests::noise::Noise;

/// Size of the images, pixels.
pub(crate) const SIZE_PX: [u32; 2] = [820, 616];
/// Time between images, s.
const PERIOD_S: f64 = 0.08;

/// Motion of the probe: tilt about the image's axes, rad, and the share of the image over which
/// the target moves.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion {
    pub(crate) tilt: DVec3,
    pub(crate) part: f64,
}

/// The recommended motion.
pub(crate) const GOOD: Motion = Motion { tilt: DVec3::new(0.5, 0.5, 0.5), part: 0.4 };

/// Errors of a scan.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Imperfect {
    pub(crate) position_mm: f64,
    pub(crate) turn_deg: f64,
    pub(crate) seen_px: f64,
    /// Distance of the point from the image plane when seen.
    pub(crate) across_mm: f64,
    pub(crate) lag_s: f64,
    /// Share of the images whose brightest spot, or whose line, belongs to another object.
    pub(crate) wrong: f64,
}

/// A scan, and its truth.
pub(crate) struct Scan {
    pub(crate) target: Target,
    pub(crate) plane: ImagePlane,
    pub(crate) place: Place,
    pub(crate) observations: Vec<Observation<Seen>>,
}

impl Scan {
    /// Simulates a scan of this many images.
    pub(crate) fn new(
        target: Target,
        pictures: usize,
        motion: Motion,
        imperfect: Imperfect,
        noise: &mut Noise,
    ) -> Self {
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.1, -0.15, 1.6);
        let plane = ImagePlane {
            u: turn * DVec3::X * 0.0786,
            v: turn * DVec3::Y * 0.0741,
            origin: DVec3::new(11.0, 46.0, -7.0),
        };
        let normal = DVec3::new(0.15, -0.2, 1.0).normalize();
        let rest = DVec3::new(30.0, -42.0, 61.0);
        let place = match target {
            Target::Point => Place::Point(rest),
            Target::Tip { place_mm, .. } => Place::Point(place_mm),
            Target::Plane => Place::Plane { normal, distance_mm: normal.dot(rest) },
        };
        let at = match place {
            Place::Point(at) => at,
            Place::Plane { .. } => rest,
        };
        let phases: [f64; 6] = std::array::from_fn(|_| noise.between(0.0, std::f64::consts::TAU));
        let size = DVec2::from(SIZE_PX.map(f64::from));
        // The image plane at a time, and the pixel at the target.
        let reference_from_image = |time: f64| {
            let wave = |period_s: f64, phase: usize| (std::f64::consts::TAU * time / period_s + phases[phase]).sin();
            let px = size * (DVec2::splat(0.5) + DVec2::new(wave(2.9, 0), wave(4.7, 1)) * motion.part);
            let right = (DVec3::X - normal * normal.x).normalize();
            let upright = DMat3::from_cols(right, normal, right.cross(normal));
            let tilt = motion.tilt * DVec3::new(wave(3.7, 2), wave(5.3, 3), wave(6.1, 4));
            let turn = upright * DMat3::from_quat(DQuat::from_scaled_axis(tilt));
            let (u, v) = (turn * DVec3::X * 0.0786, turn * DVec3::Y * 0.0741);
            // Along a plane the position is arbitrary.
            let along = normal.any_orthonormal_pair().0 * (8.0 * wave(7.9, 5));
            let at = if target == Target::Plane { at + along } else { at };
            (ImagePlane { u, v, origin: at - u * px.x - v * px.y }, px)
        };
        let mut observation = |frame: usize| {
            let time_s = 100.0 + PERIOD_S * frame as f64;
            let (image, px) = reference_from_image(time_s);
            let seen = if target == Target::Plane {
                // The line at two of the image's columns.
                let mut point = |column: f64| {
                    let [u, v] = [image.u, image.v].map(|side| normal.dot(side));
                    let px = DVec2::new(column, (normal.dot(at) - normal.dot(image.origin) - u * column) / v);
                    let across = DVec2::new(u, v).normalize();
                    px + across * (noise.normal() * imperfect.seen_px)
                };
                Seen::Line([0.2, 0.8].map(|share| point(share * size.x)))
            } else {
                let other = DVec2::new(noise.between(0.0, size.x), noise.between(0.0, size.y));
                let dots = [px + DVec2::new(noise.normal(), noise.normal()) * imperfect.seen_px, other];
                Seen::Dots(if noise.uniform() < imperfect.wrong { vec![dots[1], dots[0]] } else { dots.to_vec() })
            };
            let seen = match seen {
                Seen::Line([a, b]) if noise.uniform() < imperfect.wrong => {
                    Seen::Line([a + DVec2::new(0.0, 90.0), b + DVec2::new(0.0, 60.0)])
                }
                seen => seen,
            };
            let (image, _) = reference_from_image(time_s - imperfect.lag_s);
            let normal = image.u.cross(image.v).normalize();
            let image = ImagePlane { origin: image.origin + normal * noise.normal() * imperfect.across_mm, ..image };
            let reference_from_probe = image.affine() * plane.affine().inverse();
            let drift = DQuat::from_euler(glam::EulerRot::XYZ, 0.05 * (0.5 * time_s).sin(), 0.3, -1.2);
            let reference =
                DAffine3::from_rotation_translation(drift, DVec3::new(250.0, 82.0 + 3.0 * (0.4 * time_s).cos(), -42.0));
            let mut noisy = |pose: DAffine3| {
                let turn = noise.turn(imperfect.turn_deg.to_radians());
                pose * DAffine3::from_rotation_translation(turn, noise.vector(imperfect.position_mm))
            };
            let poses = Poses {
                time_s,
                tracker_from_probe: Transform::from_affine(noisy(reference * reference_from_probe)),
                tracker_from_reference: Some(Transform::from_affine(noisy(reference))),
            };
            Observation { frame, time_s, seen, poses: Some(poses) }
        };
        let observations = (0..pictures).map(&mut observation).collect();
        Self { target, plane, place, observations }
    }

    pub(crate) fn recording(&self, timed: bool) -> Recording<'_, Seen> {
        Recording { observations: &self.observations, track: None, size_px: SIZE_PX, timed }
    }
}
