//! A simulated sweep by hand, with one pose a slice.

use std::f64::consts::TAU;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::slices::Slices;
use crate::tests::crossing_scans::Body;
use crate::tests::noise::Noise as Random;
use crate::trajectory::PoseSample;
use crate::trajectory::pose_spline::PoseSpline;

const SIZE: u32 = 96;
const PIXEL_MM: f64 = 0.5;
/// Rate of the slices, and of poses that are smoothed, per s.
const RATE: f64 = 30.0;
const POSE_RATE: f64 = 120.0;
/// From the sensor to the image's middle, mm.
const LEVER: DVec3 = DVec3::new(0.0, 110.0, 0.0);

/// The settings of a sweep.
#[derive(Clone)]
pub(super) struct Scene {
    pub(super) slices: usize,
    pub(super) speed_mm_s: f64,
    /// The hand's motion, in its usual one.
    pub(super) wander: f64,
    /// Whether the images show a body, or a uniform one.
    pub(super) is_body: bool,
    /// Noise of the pixels, and of grains of 1.5 pixels, grey levels.
    pub(super) noise: f64,
    pub(super) speckle: f64,
    /// Whether 120 poses a second were recorded, and smoothed.
    pub(super) is_smooth: bool,
}

impl Default for Scene {
    fn default() -> Self {
        Self { slices: 120, speed_mm_s: 10.5, wander: 1.0, is_body: true, noise: 1.2, speckle: 0.0, is_smooth: false }
    }
}

/// Slices, with the maps from their pixels to the world.
pub(super) struct Sweep {
    pub(super) slices: Slices,
    pub(super) truth: Vec<DAffine3>,
    pub(super) measured: Vec<DAffine3>,
    samples: Vec<PoseSample>,
}

/// A sum of five sines of random frequencies.
struct Wave([(f64, f64, f64); 5]);

impl Wave {
    /// Frequencies lie between two limits, Hz; `rms` is the root mean square.
    fn new(random: &mut Random, [low, high]: [f64; 2], rms: f64) -> Self {
        let size = rms * 0.4_f64.sqrt();
        Self(std::array::from_fn(|_| (random.between(low, high), random.between(0.0, TAU), size)))
    }

    fn at(&self, time_s: f64) -> f64 {
        self.0.iter().map(|(rate, phase, size)| size * (TAU * rate * time_s + phase).sin()).sum()
    }
}

/// Motion along or about an axis: wander, corrections, and tremor, with these sizes.
struct Hand([Wave; 3]);

impl Hand {
    fn new(random: &mut Random, sizes: [f64; 3]) -> Self {
        let bands = [[0.05, 0.4], [0.5, 2.0], [7.0, 11.0]];
        Self(std::array::from_fn(|k| Wave::new(random, bands[k], sizes[k])))
    }

    fn at(&self, time_s: f64) -> f64 {
        self.0.iter().map(|wave| wave.at(time_s)).sum()
    }
}

pub(super) fn probe_from_image() -> DAffine3 {
    let half = 0.5 * f64::from(SIZE - 1) * PIXEL_MM;
    DAffine3 { matrix3: DMat3::from_diagonal(DVec3::splat(PIXEL_MM)), translation: LEVER - DVec3::new(half, half, 0.0) }
}

/// Returns slices of an analytic body, with one pose a slice, in the order of time.
pub(super) fn slices(samples: &[PoseSample], mut grey: impl FnMut(usize, DVec3) -> f64) -> Slices {
    let poses = PoseSpline::new(samples).unwrap();
    let mut slices = Slices::new(SIZE, SIZE, &vec![true; (SIZE * SIZE) as usize], probe_from_image(), poses);
    for (slice, sample) in samples.iter().enumerate() {
        let pixel = |at: u32| {
            let grey = grey(slice, DVec3::new(f64::from(at % SIZE), f64::from(at / SIZE), 0.0));
            (256.0 * grey).round().clamp(0.0, 65_535.0) as u16
        };
        slices.pixels.push((sample.time_s, (0..SIZE * SIZE).map(pixel).collect()));
    }
    slices
}

impl Sweep {
    /// `error` is the white noise of a pose along and about each axis, mm and degrees.
    pub(super) fn of(shown: &Scene, error: f64, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let body = Body::new(&mut random);
        let sizes = |sizes: [f64; 3]| sizes.map(|size| size * shown.wander);
        let along: [Hand; 3] = std::array::from_fn(|_| Hand::new(&mut random, sizes([1.2, 0.1, 0.04])));
        let about: [Hand; 3] = std::array::from_fn(|_| Hand::new(&mut random, sizes([2.0, 0.1, 0.05])));
        let middle_s = 0.5 * shown.slices as f64 / RATE;
        let pose = |time_s: f64| {
            let place = DVec3::from_array(std::array::from_fn(|k| along[k].at(time_s)));
            let turn = DVec3::from_array(std::array::from_fn(|k| about[k].at(time_s).to_radians()));
            let rotation = DQuat::from_scaled_axis(turn);
            (rotation, place + DVec3::Z * shown.speed_mm_s * (time_s - middle_s) - rotation * LEVER)
        };
        let times: Vec<f64> = (0..shown.slices).map(|slice| slice as f64 / RATE).collect();
        let mut sample = |time_s: f64| {
            let (rotation, position_mm) = pose(time_s);
            let rotation = (rotation * random.turn(error.to_radians())).normalize();
            PoseSample { time_s, rotation, position_mm: position_mm + random.vector(error) }
        };
        let samples: Vec<PoseSample> = if shown.is_smooth {
            let last = ((times[shown.slices - 1] + 0.5) * POSE_RATE) as i32;
            let dense: Vec<PoseSample> = (-60..=last).map(|i| sample(f64::from(i) / POSE_RATE)).collect();
            times.iter().map(|time_s| smoothed(&dense, *time_s)).collect()
        } else {
            times.iter().map(|time_s| sample(*time_s)).collect()
        };
        let poses = PoseSpline::new(&samples).unwrap();
        let mut slices = Slices::new(SIZE, SIZE, &vec![true; (SIZE * SIZE) as usize], probe_from_image(), poses);
        let of =
            |rotation: DQuat, place: DVec3| DAffine3::from_rotation_translation(rotation, place) * probe_from_image();
        let truth: Vec<DAffine3> = times.iter().map(|time_s| pose(*time_s)).map(|(q, p)| of(q, p)).collect();
        for (time_s, world) in times.iter().zip(&truth) {
            let met = body.met_by(world);
            let grains = grains(shown.speckle, &mut random);
            let pixel = |at: u32| {
                let place = world.transform_point3(DVec3::new(f64::from(at % SIZE), f64::from(at / SIZE), 0.0));
                let grey = if shown.is_body { met.grey(place) } else { 100.0 };
                (grey + grains[at as usize] + shown.noise * random.normal()).round().clamp(0.0, 255.0) as u8
            };
            slices.push(*time_s, &(0..SIZE * SIZE).map(pixel).collect::<Vec<u8>>(), SIZE, SIZE);
        }
        let measured = samples.iter().map(|sample| of(sample.rotation, sample.position_mm)).collect();
        Self { slices, truth, measured, samples }
    }

    /// Returns the slices with poses in another frame of the room.
    pub(super) fn moved(&self, room: DAffine3) -> Slices {
        let turn = DQuat::from_mat3(&room.matrix3);
        let moved = |sample: &PoseSample| PoseSample {
            time_s: sample.time_s,
            rotation: turn * sample.rotation,
            position_mm: room.transform_point3(sample.position_mm),
        };
        let samples: Vec<PoseSample> = self.samples.iter().map(moved).collect();
        Slices { poses: PoseSpline::new(&samples).unwrap(), ..self.slices.clone() }
    }
}

/// Returns the pose by a parabola through the samples within 0.3 s.
fn smoothed(samples: &[PoseSample], time_s: f64) -> PoseSample {
    const HALF_S: f64 = 0.3;
    let near: Vec<&PoseSample> = samples.iter().filter(|sample| (sample.time_s - time_s).abs() < HALF_S).collect();
    let about = near[near.len() / 2].rotation;
    let mut a = nalgebra::Matrix3::<f64>::zeros();
    let mut b = nalgebra::Matrix3x6::<f64>::zeros();
    for sample in near {
        let x = sample.time_s - time_s;
        let weight = (1.0 - (x.abs() / HALF_S).powi(3)).powi(3);
        let powers = nalgebra::Vector3::new(1.0, x, x * x);
        let (p, t) = (sample.position_mm, (about.conjugate() * sample.rotation).to_scaled_axis());
        a += powers * powers.transpose() * weight;
        b += powers * nalgebra::RowVector6::new(p.x, p.y, p.z, t.x, t.y, t.z) * weight;
    }
    let at = a.try_inverse().unwrap() * b;
    let vector = |first: usize| DVec3::new(at[(0, first)], at[(0, first + 1)], at[(0, first + 2)]);
    let rotation = (about * DQuat::from_scaled_axis(vector(3))).normalize();
    PoseSample { time_s, rotation, position_mm: vector(0) }
}

/// Returns random grains with a standard deviation of 1.5 pixels.
fn grains(size: f64, random: &mut Random) -> Vec<f64> {
    let side = SIZE as usize;
    if size == 0.0 {
        return vec![0.0; side * side];
    }
    const WIDTH: f64 = 1.5;
    let white: Vec<f64> = (0..side * side).map(|_| random.normal()).collect();
    let taps = -4_i32..=4;
    let kernel = |off: i32| (-0.5 * (f64::from(off) / WIDTH).powi(2)).exp();
    let near = |at: usize, off: i32| at.saturating_add_signed(off as isize).min(side - 1);
    let along = |values: &[f64], is_row: bool| -> Vec<f64> {
        let at = |k: usize, off: i32| {
            let (u, v) = (k % side, k / side);
            if is_row { v * side + near(u, off) } else { near(v, off) * side + u }
        };
        (0..values.len()).map(|k| taps.clone().map(|off| kernel(off) * values[at(k, off)]).sum()).collect()
    };
    let grains = along(&along(&white, true), false);
    let rms = (grains.iter().map(|x| x * x).sum::<f64>() / grains.len() as f64).sqrt();
    grains.iter().map(|x| size * x / rms).collect()
}
