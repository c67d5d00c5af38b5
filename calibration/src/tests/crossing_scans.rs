//! Simulated scans of an analytic body, whose slices cross.

use std::f64::consts::TAU;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::slices::Slices;
use crate::tests::noise::Noise as Random;
use crate::trajectory::PoseSample;
use crate::trajectory::pose_spline::PoseSpline;

pub(crate) const SIZE: u32 = 96;
pub(crate) const PIXEL_MM: f64 = 0.5;

/// A body of Gaussian blobs, some bright and some dark.
pub(crate) struct Body {
    blobs: Vec<(DVec3, f64, f64)>,
}

impl Body {
    pub(crate) fn new(random: &mut Random) -> Self {
        let blob = |_| {
            let place = DVec3::from_array(std::array::from_fn(|_| 60.0 * (random.uniform() - 0.5)));
            (place, 2.0 + 3.0 * random.uniform(), if random.uniform() < 0.5 { -60.0 } else { 70.0 })
        };
        Self { blobs: (0..80).map(blob).collect() }
    }

    pub(crate) fn grey(&self, at: DVec3) -> f64 {
        let of = |(place, width, height): &(DVec3, f64, f64)| {
            let square = (at - place).length_squared() / (width * width);
            if square < 20.0 { height * (-0.5 * square).exp() } else { 0.0 }
        };
        100.0 + self.blobs.iter().map(of).sum::<f64>()
    }

    /// Returns the blobs that an image plane meets. The others add nothing to its pixels.
    pub(crate) fn met_by(&self, world_from_pixel: &DAffine3) -> Self {
        let normal = world_from_pixel.matrix3.z_axis.normalize();
        let meets = |(place, width, _): &&(DVec3, f64, f64)| {
            (*place - world_from_pixel.translation).dot(normal).powi(2) < 20.1 * width * width
        };
        Self { blobs: self.blobs.iter().filter(meets).copied().collect() }
    }
}

/// The path of a probe.
pub(crate) type Way = fn(f64) -> (DQuat, DVec3);

/// Moves back and forth along one direction, then along another, turning meanwhile.
pub(crate) fn both_ways(time: f64) -> (DQuat, DVec3) {
    let along = 15.0 * (TAU * 0.35 * time).sin() + 3.0 * (TAU * 0.13 * time).cos();
    // Changes direction within a second, smoothly, because the tracker's samples do not resolve
    // jerks.
    let share = (time - 6.0).clamp(0.0, 1.0);
    let heading = 1.4 * share * share * (3.0 - 2.0 * share);
    let turn = DQuat::from_rotation_y(heading + 0.1 * (TAU * 0.2 * time).sin());
    (turn, turn * DVec3::new(2.0 * (TAU * 0.31 * time).sin(), 1.0, along))
}

/// The sensor lies 50 mm above the image centre.
pub(crate) fn probe_from_image() -> DAffine3 {
    let half = 0.5 * f64::from(SIZE - 1) * PIXEL_MM;
    DAffine3 {
        matrix3: DMat3::from_diagonal(DVec3::new(PIXEL_MM, PIXEL_MM, PIXEL_MM)),
        translation: DVec3::new(-half, -half, 0.0),
    }
}

pub(crate) fn scan(way: Way, lag_s: f64, noise: f64, random: &mut Random) -> Slices {
    let body = Body::new(random);
    let samples: Vec<PoseSample> = (-30..630)
        .map(|i| {
            let time_s = 0.02 * f64::from(i);
            let (rotation, position_mm) = way(time_s - lag_s);
            let tremble = DVec3::from_array(std::array::from_fn(|_| 0.02 * noise * random.normal()));
            PoseSample { time_s, rotation, position_mm: position_mm + tremble }
        })
        .collect();
    let poses = PoseSpline::new(&samples).unwrap();
    let is_data: Vec<bool> = (0..SIZE * SIZE).map(|at| at % SIZE >= 8 && at / SIZE < SIZE - 8).collect();
    let mut slices = Slices::new(SIZE, SIZE, &is_data, probe_from_image(), poses);
    for i in 0..150 {
        let time = 0.08 * f64::from(i);
        let (rotation, place) = way(time);
        let world = DAffine3::from_rotation_translation(rotation, place) * probe_from_image();
        let body = body.met_by(&world);
        let pixel = |at: u32| {
            let grey = body.grey(world.transform_point3(DVec3::new(f64::from(at % SIZE), f64::from(at / SIZE), 0.0)));
            (grey + noise * random.normal()).round().clamp(0.0, 255.0) as u8
        };
        let pixels: Vec<u8> = (0..SIZE * SIZE).map(pixel).collect();
        slices.push(time, &pixels, SIZE, SIZE);
    }
    slices
}
