//! Simulated sweeps over a body of speckle, which the probe compresses.
//!
//! The body is a stack of planes of complex random fields, of independent values. A beam sums them
//! by a Gaussian, so that the fields of two slices correlate by exp(−x² / 4σ²) at a distance x.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::slices::Slices;
use crate::tests::noise::Noise as Random;
use crate::trajectory::PoseSample;
use crate::trajectory::pose_spline::PoseSpline;

pub(crate) const WIDTH: u32 = 88;
pub(crate) const HEIGHT: u32 = 104;
pub(crate) const PIXEL_MM: f64 = 0.4;

/// Lattice of the fields: step along x and y, mm; the least y; columns and rows.
const STEP_MM: [f64; 2] = [0.4, 0.1];
const TOP_MM: f64 = -6.0;
const COLUMNS: usize = 100;
const ROWS: usize = 540;
/// Standard deviations of the point spread along x and y, steps.
const SPREAD: [f64; 2] = [1.25, 2.5];
/// Where the fields end, along the sweep, mm.
const MARGIN_MM: f64 = 4.0;

/// A body of speckle in layers. Its skin is at y = 0, and y is the depth.
pub(crate) struct Speckle {
    beam_mm: f64,
    planes: Vec<Vec<[f32; 2]>>,
}

impl Speckle {
    /// Makes a body for sweeps along z from 0, whose layers slope by an angle.
    pub(crate) fn new(beam_mm: f64, length_mm: f64, slope_deg: f64, random: &mut Random) -> Self {
        let count = ((length_mm + 2.0 * MARGIN_MM) / beam_mm).ceil() as usize + 1;
        let slope = slope_deg.to_radians().tan();
        let layers: Vec<f64> = (0..40).map(|_| random.between(-1.0, 1.0)).collect();
        let plane = |k: usize| {
            let z = k as f64 * beam_mm - MARGIN_MM;
            let parts = [0, 1].map(|_| field(random));
            let value = |at: usize| {
                let y = TOP_MM + STEP_MM[1] * (at / COLUMNS) as f64 - slope * z;
                // Layers 3 mm thick, which differ by up to 12 dB, with a smooth transition.
                let place = (y + 30.0) / 3.0;
                let share = place.fract();
                let share = share * share * (3.0 - 2.0 * share);
                let layer = |k: usize| layers[(place as usize + k) % layers.len()];
                let gain = (0.7 * ((1.0 - share) * layer(0) + share * layer(1))).exp() as f32;
                parts.each_ref().map(|part| gain * part[at])
            };
            (0..COLUMNS * ROWS).map(value).collect()
        };
        Self { beam_mm, planes: (0..count).map(plane).collect() }
    }

    /// Returns the grey value at a place, of 37 grey levels a neper; 0 outside.
    pub(crate) fn grey(&self, at: DVec3) -> f64 {
        let [x, y] = [at.x / STEP_MM[0] + 0.5 * COLUMNS as f64, (at.y - TOP_MM) / STEP_MM[1]];
        if !(x >= 0.0 && y >= 0.0 && x < (COLUMNS - 1) as f64 && y < (ROWS - 1) as f64) {
            return 0.0;
        }
        let (a, b, first) = (x.fract() as f32, y.fract() as f32, y as usize * COLUMNS + x as usize);
        let weights = [(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b];
        let middle = (at.z + MARGIN_MM) / self.beam_mm;
        let near = (middle - 3.5).max(0.0).ceil() as usize..=(middle + 3.5).max(0.0) as usize;
        let mut sum = [0.0; 2];
        for k in near {
            let Some(plane) = self.planes.get(k) else { continue };
            let beam = (-0.5 * (k as f64 - middle).powi(2)).exp() as f32;
            for (place, weight) in [first, first + 1, first + COLUMNS, first + COLUMNS + 1].into_iter().zip(weights) {
                sum[0] += beam * weight * plane[place][0];
                sum[1] += beam * weight * plane[place][1];
            }
        }
        let power = f64::from(sum[0] * sum[0] + sum[1] * sum[1]);
        130.0 + 18.5 * power.max(1e-6).ln()
    }
}

/// Returns a field of variance 1, of independent values blurred by the point spread.
fn field(random: &mut Random) -> Vec<f32> {
    let white: Vec<f32> = (0..COLUMNS * ROWS).map(|_| random.uniform() as f32 - 0.5).collect();
    // The field is a ring: values beyond an end are those from the other one.
    let blurred = |values: &[f32], spread: f64, step: usize| -> Vec<f32> {
        let reach = (3.0 * spread) as i64;
        let mut sums = vec![0.0; values.len()];
        for k in -reach..=reach {
            let tap = (-0.5 * (k as f64 / spread).powi(2)).exp() as f32;
            let (end, begin) = values.split_at((k * step as i64).rem_euclid(values.len() as i64) as usize);
            let (first, last) = sums.split_at_mut(begin.len());
            first.iter_mut().zip(begin).for_each(|(sum, x)| *sum += tap * x);
            last.iter_mut().zip(end).for_each(|(sum, x)| *sum += tap * x);
        }
        sums
    };
    let rows = blurred(&white, SPREAD[0], 1);
    let both = blurred(&rows, SPREAD[1], COLUMNS);
    let power = both.iter().map(|x| x * x).sum::<f32>() / both.len() as f32;
    both.iter().map(|x| x / power.sqrt()).collect()
}

/// Depth at which the body stands, mm.
pub(crate) const STILL_MM: f64 = 42.0;

/// Returns the displacement of tissue at a depth, where the skin is pressed by `skin_mm`.
pub(crate) type Profile = fn(skin_mm: f64, y: f64) -> f64;

/// Compression that is less at depth. Its root mean square over depth is about half of the skin's.
pub(crate) fn soft(skin_mm: f64, y: f64) -> f64 {
    skin_mm * (1.0 - y / STILL_MM).clamp(0.0, 1.0).powf(1.5)
}

/// Uniform compression.
pub(crate) fn uniform(skin_mm: f64, y: f64) -> f64 {
    skin_mm * (1.0 - y / STILL_MM).clamp(0.0, 1.0)
}

/// One sweep.
#[derive(Clone)]
pub(crate) struct Sweep {
    /// Slices, and the mean distance between them, mm.
    pub(crate) slices: usize,
    pub(crate) gap_mm: f64,
    /// The first slice's place, mm.
    pub(crate) from_mm: f64,
    /// Change of gaps, as a part of the mean.
    pub(crate) uneven: f64,
    /// Displacement of the skin over time, mm.
    pub(crate) skin_mm: fn(f64) -> f64,
    pub(crate) profile: Profile,
    /// Error of the poses along v, mm.
    pub(crate) shift_mm: f64,
    /// Tilts by the hand, and a turn about v, rad.
    pub(crate) tilt: f64,
    pub(crate) turn: f64,
    /// Share of the last frame in the next one.
    pub(crate) persistence: f64,
}

/// Time from frame to frame and from sweep to sweep, s.
pub(crate) const FRAME_S: f64 = 0.1;
const SWEEP_S: f64 = 100.0;
/// Standard deviation of noise, grey levels.
const NOISE: f64 = 3.0;

impl Sweep {
    pub(crate) fn new(slices: usize, gap_mm: f64, skin_mm: fn(f64) -> f64) -> Self {
        Self {
            slices,
            gap_mm,
            from_mm: 0.0,
            uneven: 0.4,
            skin_mm,
            profile: soft,
            shift_mm: 0.0,
            tilt: 0.0,
            turn: 0.0,
            persistence: 0.0,
        }
    }

    /// Returns the probe's pose: its origin is at the middle of the image's first row of data.
    fn pose(&self, time_s: f64) -> DAffine3 {
        let frame = time_s / FRAME_S;
        let along = self.from_mm + self.gap_mm * (frame + self.uneven * (0.9 * frame).sin());
        let turn = DQuat::from_euler(
            glam::EulerRot::XYZ,
            self.tilt * (0.31 * frame).sin(),
            self.turn + self.tilt * (0.23 * frame + 1.0).cos(),
            0.0,
        );
        DAffine3::from_rotation_translation(turn, DVec3::new(0.0, (self.skin_mm)(time_s), along))
    }

    /// Returns the depth at which tissue lies without pressure, of a place where it is shown.
    fn undisplaced(&self, skin_mm: f64, y: f64) -> f64 {
        // The displacement changes by less than a fifth of the depth: each step divides the error.
        (0..12).fold(y, |v, _| y - (self.profile)(skin_mm, v))
    }
}

/// Rows of the image above the data.
pub(crate) const TOP_ROWS: u32 = 2;

pub(crate) fn probe_from_image() -> DAffine3 {
    let middle = 0.5 * f64::from(WIDTH - 1) * PIXEL_MM;
    DAffine3 {
        matrix3: DMat3::from_diagonal(DVec3::new(PIXEL_MM, PIXEL_MM, 1.0)),
        translation: DVec3::new(-middle, -f64::from(TOP_ROWS) * PIXEL_MM, 0.0),
    }
}

/// Marks the pixels with data: all but the first rows.
pub(crate) fn is_data() -> Vec<bool> {
    (0..WIDTH * HEIGHT).map(|at| at / WIDTH >= TOP_ROWS).collect()
}

/// Scans a body by sweeps, one after another.
pub(crate) fn scan(body: &Speckle, sweeps: &[Sweep], random: &mut Random) -> Slices {
    let mut samples = Vec::new();
    for (number, sweep) in sweeps.iter().enumerate() {
        for k in -10..5 * sweep.slices as i64 + 10 {
            let time_s = FRAME_S / 5.0 * k as f64;
            let pose = sweep.pose(time_s);
            let rotation = DQuat::from_mat3(&pose.matrix3).normalize();
            let position_mm = pose.translation + rotation * DVec3::new(0.0, sweep.shift_mm, 0.0);
            samples.push(PoseSample { time_s: SWEEP_S * number as f64 + time_s, rotation, position_mm });
        }
    }
    let poses = PoseSpline::new(&samples).unwrap();
    let mut slices = Slices::new(WIDTH, HEIGHT, &is_data(), probe_from_image(), poses);
    for (number, sweep) in sweeps.iter().enumerate() {
        let mut before: Option<Vec<f64>> = None;
        for frame in 0..sweep.slices {
            let time_s = FRAME_S * frame as f64;
            let (world, skin_mm) = (sweep.pose(time_s) * probe_from_image(), (sweep.skin_mm)(time_s));
            let pixel = |at: u32| {
                let mut place = world.transform_point3(DVec3::new(f64::from(at % WIDTH), f64::from(at / WIDTH), 0.0));
                place.y = sweep.undisplaced(skin_mm, place.y);
                body.grey(place) + NOISE * random.normal()
            };
            let mut greys: Vec<f64> = (0..WIDTH * HEIGHT).map(pixel).collect();
            if let Some(before) = &before {
                let share = sweep.persistence;
                greys.iter_mut().zip(before).for_each(|(grey, last)| *grey = (1.0 - share) * *grey + share * last);
            }
            let pixels: Vec<u8> = greys.iter().map(|grey| grey.round().clamp(0.0, 255.0) as u8).collect();
            slices.push(SWEEP_S * number as f64 + time_s, &pixels, WIDTH, HEIGHT);
            before = Some(greys);
        }
    }
    slices
}

/// Returns the time of a slice within its sweep, s.
pub(crate) fn within_sweep_s(time_s: f64) -> f64 {
    time_s % SWEEP_S
}
