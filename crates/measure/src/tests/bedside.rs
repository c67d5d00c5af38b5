//! A simulated session with errors of calibration, tracker, sampling and clicks.

use std::collections::BTreeMap;
use std::sync::Arc;

use calibration::probe::plane::{ImagePlane, NUMBERS};
use calibration::probe::plane_covariance::PlaneCovariance;
use calibration::tracker::noise::TrackerNoise;
use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use pipeline::Observer as _;
use reconstruct::kernel::{AxisKernel, Method, Support};
use sonoweave_core::frames::Transform;
use sonoweave_core::slice::{Image, Pixels, Slice};

use crate::sources::Reach;
use crate::uncertainty::HAND_PX;
use crate::{Slices, Uncertainty};

/// Size of the images, pixels: 64 mm by 46 mm.
pub(super) const SIZE_PX: [u32; 2] = [820, 616];
/// Width of a screen pixel, mm.
pub(super) const PIXEL_MM: f64 = 0.2;

/// Random numbers.
pub(super) struct Random(ChaCha8Rng);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.0.random::<f64>()).ln()).sqrt();
        radius * self.between(0.0, std::f64::consts::TAU).cos()
    }

    fn vector(&mut self, sd: f64) -> DVec3 {
        DVec3::new(self.normal(), self.normal(), self.normal()) * sd
    }

    pub(super) fn direction(&mut self) -> DVec3 {
        self.vector(1.0).normalize()
    }
}

/// A session: its slices, and what is known of its errors.
pub(super) struct Session {
    pub(super) slices: Slices,
    pub(super) uncertainty: Uncertainty,
    plane: ImagePlane,
    /// Poses of the images.
    world_from_image: Vec<DAffine3>,
}

/// Returns the image plane in the probe's frame.
fn plane() -> ImagePlane {
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.1, -0.15, 1.6);
    ImagePlane { u: turn * DVec3::X * 0.0786, v: turn * DVec3::Y * 0.0741, origin: DVec3::new(11.0, 46.0, -7.0) }
}

/// Returns a covariance with correlations, of a calibration by hand.
pub(super) fn covariance() -> PlaneCovariance {
    let sds = [2e-3, 2.5e-3, 1.5e-3, 0.15, 0.12, 0.2, 2e-3, 2.5e-3, 0.0];
    let mut random = Random::new(2);
    let factor: [[f64; NUMBERS]; NUMBERS] = std::array::from_fn(|i| {
        let row: [f64; NUMBERS] = std::array::from_fn(|_| random.normal());
        let length = row.iter().map(|x| x * x).sum::<f64>().sqrt();
        row.map(|x| x * sds[i] / length)
    });
    let entry = |i: usize, j: usize| factor[i].iter().zip(factor[j]).map(|(a, b)| a * b).sum();
    let entries = std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)));
    PlaneCovariance::of_fit(DVec2::new(430.0, 290.0), entries).unwrap()
}

/// Returns the kernel across slices.
pub(super) fn across() -> AxisKernel {
    AxisKernel::new(Method::GaussianTruncated, 1.0, Support::Energy(0.01)).unwrap()
}

impl Session {
    /// A sweep of 150 slices over 165 mm in the frame of a sensor on the patient, by a hand that
    /// tilts and turns the probe.
    pub(super) fn new() -> Self {
        let pixels: Arc<[u8]> = vec![0; (SIZE_PX[0] * SIZE_PX[1]) as usize].into();
        let slices = Slices::new(Some(across()));
        let plane = plane();
        let mut world_from_image = Vec::new();
        for n in 0..150_u32 {
            let time = f64::from(n);
            let tilt =
                DQuat::from_euler(glam::EulerRot::XYZ, 0.15 * (time / 23.0).sin(), 0.1 * (time / 31.0).cos(), 0.0);
            let turn = DMat3::from_quat(tilt) * DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
            let (u, v) = (turn * DVec3::X * 0.0786, turn * DVec3::Y * 0.0741);
            let origin = DVec3::new(60.0 + 2.0 * (time / 17.0).sin(), -40.0 + 1.1 * time, 130.0);
            let map = ImagePlane { u, v, origin }.affine();
            let image = Image::new(SIZE_PX[0], SIZE_PX[1], Pixels::U8(Arc::clone(&pixels)));
            let slice =
                Slice { image, time_ns: i64::from(n) * 33_000_000, world_from_image: Transform::from_affine(map) };
            slices.slice("Reference", u64::from(n), &slice);
            world_from_image.push(map);
        }
        let uncertainty = Uncertainty {
            probe_from_image: Some(plane.affine()),
            calibration: Some(covariance()),
            sensors: Some(TrackerNoise { position_mm: 0.15, rotation_deg: 0.1 }),
            has_reference: true,
            voxel_mm: 0.5,
            hwhm_mm: [0.4, 0.4, 1.18],
        };
        Self { slices, uncertainty, plane, world_from_image }
    }

    /// Returns the place of a pixel of a slice, and its image's axes.
    pub(super) fn pixel(&self, slice: usize, px: [f64; 2]) -> DVec3 {
        self.world_from_image[slice].transform_point3(DVec3::new(px[0], px[1], 0.0))
    }

    /// Returns any place within the sweep.
    pub(super) fn anywhere(&self, random: &mut Random) -> DVec3 {
        let slice = random.between(0.0, self.world_from_image.len() as f64) as usize;
        let [u, v] = SIZE_PX.map(|n| random.between(0.0, f64::from(n) - 1.0));
        self.pixel(slice, [u, v])
    }

    /// Whether slices reach all of these places.
    pub(super) fn reaches(&self, points: &[DVec3]) -> bool {
        self.slices.reaching_each(points).iter().all(|reach| !reach.contributions.is_empty())
    }

    /// Returns where a session with errors, drawn anew, shows these places.
    pub(super) fn shown(&self, points: &[DVec3], random: &mut Random) -> Vec<DVec3> {
        let believed = self.believed(random);
        let mut sensors = BTreeMap::new();
        let reached = self.slices.reaching_each(points);
        let mut shown = |(at, reach): (&DVec3, &Reach)| {
            let mut place = *at;
            for one in &reach.contributions {
                let [probe, reference] = *sensors.entry(one.slice).or_insert_with(|| self.sensors(random));
                let world_from_probe = one.world_from_image * self.plane.affine().inverse();
                let true_place = world_from_probe.transform_point3(self.plane.point(one.pixel));
                let measured = reference * world_from_probe * probe;
                place += (measured.transform_point3(believed.point(one.pixel)) - true_place) * one.share;
            }
            place + self.sampled(reach, random) + clicked(random)
        };
        points.iter().zip(&reached).map(&mut shown).collect()
    }

    /// Returns a plane with a random error of the calibration.
    fn believed(&self, random: &mut Random) -> ImagePlane {
        let covariance = self.uncertainty.calibration.as_ref().unwrap();
        let mut step = [0.0; NUMBERS];
        for component in covariance.components() {
            let size = random.normal();
            step.iter_mut().zip(component).for_each(|(sum, x)| *sum += x * size);
        }
        moved(&self.plane, covariance.pivot_px(), &step)
    }

    /// Returns the errors of both sensors' poses.
    fn sensors(&self, random: &mut Random) -> [DAffine3; 2] {
        let TrackerNoise { position_mm, rotation_deg } = self.uncertainty.sensors.unwrap();
        [0; 2].map(|_| {
            let turn = DQuat::from_scaled_axis(random.vector(rotation_deg.to_radians()));
            DAffine3::from_rotation_translation(turn, random.vector(position_mm))
        })
    }

    /// Returns an error of kernel, slices' distance and voxel.
    fn sampled(&self, reach: &Reach, random: &mut Random) -> DVec3 {
        let map = reach.contributions[0].world_from_image.matrix3;
        let axes = [map.x_axis, map.y_axis, map.x_axis.cross(map.y_axis)].map(DVec3::normalize);
        let [u, v, normal] = self.uncertainty.hwhm_mm;
        let widths = [u, v, normal.max(reach.gap_mm)];
        let mut uniform = |width: f64| random.between(-0.5, 0.5) * width;
        axes.into_iter()
            .zip(widths)
            .map(|(axis, width)| axis * (uniform(width) + uniform(self.uncertainty.voxel_mm)))
            .sum()
    }
}

/// Returns an error of a click, in any direction: the hand's, and within a screen pixel.
fn clicked(random: &mut Random) -> DVec3 {
    let hand = random.vector(HAND_PX);
    (hand + DVec3::from_array([0; 3].map(|_| random.between(-0.5, 0.5)))) * PIXEL_MM
}

/// Returns a plane whose numbers are changed by a step.
pub(super) fn moved(plane: &ImagePlane, pivot_px: DVec2, step: &[f64; NUMBERS]) -> ImagePlane {
    let [a, b, c, x, y, z, along_u, along_v, _] = *step;
    let axes = plane.axes() * DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(a, b, c)));
    let [size_u, size_v] = plane.pixel_mm();
    let (u, v) = (axes.x_axis * (size_u * along_u.exp()), axes.y_axis * (size_v * along_v.exp()));
    let at = plane.point(pivot_px) + DVec3::new(x, y, z);
    ImagePlane { u, v, origin: at - u * pivot_px.x - v * pivot_px.y }
}
