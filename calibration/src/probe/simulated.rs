//! Scans of a phantom whose truth is known, for tests.

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};

use super::layout::Layout;
use super::matching::Mark;
use super::plane::ImagePlane;
use super::sighting::Sighting;
use super::track::{Poses, Track};
use crate::frames::{Phantom, Reference, Transform};
use crate::noise::Noise;
use crate::phantom::tests::three_ns;

/// Pictures' size, pixels.
pub(super) const SIZE_PX: [u32; 2] = [820, 616];
/// Time between pictures, s.
const PERIOD_S: f64 = 0.08;

/// What makes a scan imperfect.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Imperfect {
    pub(super) position_mm: f64,
    pub(super) turn_deg: f64,
    pub(super) dot_px: f64,
    pub(super) lag_s: f64,
}

/// A scan, and its truth.
pub(super) struct Scan {
    pub(super) layout: Layout,
    pub(super) plane: ImagePlane,
    pub(super) reference_from_phantom: Transform<Reference, Phantom>,
    pub(super) sightings: Vec<Sighting>,
    pub(super) track: Track,
}

/// Where a picture lies in the probe's frame.
fn plane() -> ImagePlane {
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.1, -0.15, 1.6);
    ImagePlane { u: turn * DVec3::X * 0.0786, v: turn * DVec3::Y * 0.0741, origin: DVec3::new(11.0, 46.0, -7.0) }
}

impl Scan {
    /// Of so many pictures: along the wires and back, tilting and turning on the way, as a hand does.
    pub(super) fn new(pictures: usize, imperfect: Imperfect, noise: &mut Noise) -> Self {
        let layout = Layout::new(three_ns()).unwrap();
        let plane = plane();
        let reference_from_phantom: Transform<Reference, Phantom> =
            Transform::from_affine(DAffine3::from_rotation_translation(
                DQuat::from_euler(glam::EulerRot::XYZ, 1.5, 0.1, -1.5),
                DVec3::new(9.6, 36.0, 87.9),
            ));
        let phases: [f64; 5] = std::array::from_fn(|_| noise.between(0.0, std::f64::consts::TAU));
        // Where the picture is in the phantom at a time: u to the left of the phantom, v down, dots about its middle.
        let phantom_from_image = |time: f64| {
            let wave = |period_s: f64, phase: usize| (std::f64::consts::TAU * time / period_s + phases[phase]).sin();
            let level = DMat3::from_cols(DVec3::NEG_X, DVec3::NEG_Z, DVec3::NEG_Y);
            let tilt =
                DQuat::from_euler(glam::EulerRot::XYZ, 0.3 * wave(3.1, 0), 0.2 * wave(4.3, 1), 0.25 * wave(5.7, 2));
            let turn = DMat3::from_quat(tilt) * level;
            let centre = DVec3::new(35.0 + 3.0 * wave(2.3, 3), 20.0 + 7.0 * wave(11.0, 4), 5.0 + 2.0 * wave(3.7, 1));
            let [width, height] = SIZE_PX.map(f64::from);
            let (u, v) = (turn * DVec3::X * 0.0786, turn * DVec3::Y * 0.0741);
            ImagePlane { u, v, origin: centre - u * (0.5 * width) - v * (0.5 * height) }
        };
        let probe_from_image = plane.affine();
        let poses = |time_s: f64, noise: &mut Noise| {
            let image = phantom_from_image(time_s - imperfect.lag_s).affine();
            let phantom_from_probe = image * probe_from_image.inverse();
            let drift = DQuat::from_euler(glam::EulerRot::XYZ, 0.05 * (0.5 * time_s).sin(), 0.3, -1.2);
            let reference =
                DAffine3::from_rotation_translation(drift, DVec3::new(250.0, 82.0 + 3.0 * (0.4 * time_s).cos(), -42.0));
            let probe = reference * reference_from_phantom.affine() * phantom_from_probe;
            let mut noisy = |pose: DAffine3| {
                let turn = DQuat::from_scaled_axis(noise.vector(imperfect.turn_deg.to_radians()));
                pose * DAffine3::from_rotation_translation(turn, noise.vector(imperfect.position_mm))
            };
            Poses {
                time_s,
                tracker_from_probe: Transform::from_affine(noisy(probe)),
                tracker_from_reference: Some(Transform::from_affine(noisy(reference))),
            }
        };
        let (mut sightings, mut track) = (Vec::new(), Vec::new());
        for frame in 0..pictures {
            let time_s = 100.0 + PERIOD_S * frame as f64;
            track.push(poses(time_s, noise));
            let image = phantom_from_image(time_s);
            let seen = layout.geometry().wires().iter().enumerate().filter_map(|(wire, geometry)| {
                let (px, share) = image.cut(geometry)?;
                let at_px = px + DVec2::new(noise.normal(), noise.normal()) * imperfect.dot_px;
                (0.0..=1.0).contains(&share).then_some(Mark { wire, at_px, contrast: 100.0 })
            });
            sightings.push(Sighting { frame, time_s, marks: seen.collect() });
        }
        Self { layout, plane, reference_from_phantom, sightings, track: Track::new(track) }
    }
}

/// The picture's corners and centre.
pub(super) fn places() -> [DVec2; 5] {
    let [u, v] = SIZE_PX.map(|n| f64::from(n) - 1.0);
    [[0.0, 0.0], [u, 0.0], [0.0, v], [u, v], [0.5 * u, 0.5 * v]].map(DVec2::from_array)
}
