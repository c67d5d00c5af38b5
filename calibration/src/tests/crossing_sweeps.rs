//! Simulated sweeps that cross, with errors of poses and calibration.

use std::f64::consts::TAU;

use glam::{DAffine3, DQuat, DVec3};

use super::crossing_scans::{Body, PIXEL_MM, SIZE, probe_from_image};
use super::noise::Noise as Random;
use crate::crossings::state::{Change, rigid};
use crate::slices::Slices;
use crate::trajectory::PoseSample;
use crate::trajectory::pose_spline::PoseSpline;

/// Duration of a sweep's images, s, and time from one sweep's begin to the next.
pub(crate) const SWEEP_S: f64 = 0.15 * 39.0;
pub(crate) const EACH_S: f64 = 7.0;

/// Upright, turned by 90° about v, and tilted by 30° about u.
pub(crate) fn directions() -> [DQuat; 3] {
    [DQuat::IDENTITY, DQuat::from_rotation_y(TAU / 4.0), DQuat::from_rotation_x(TAU / 12.0)]
}

/// Errors of poses on the image's side: a motion in mm and rad about the image's middle, times a
/// function of the time since the sweep's begin.
pub(crate) type Drifting = ([f64; 6], fn(f64) -> f64);

/// Sweeps of 40 images in 6 s, 7 s after each other, with a hand's tilts.
#[derive(Clone)]
pub(crate) struct Sweeps {
    pub(crate) directions: Vec<DQuat>,
    /// Displaces the body before each sweep.
    pub(crate) body: Vec<DVec3>,
    /// The calibration that is used less the true one.
    pub(crate) off: Change,
    /// Standard deviation of the images' noise, grey levels.
    pub(crate) noise: f64,
    /// Image scale in use by the true one.
    pub(crate) depth: f64,
    /// Errors of poses that change slowly: along and about each axis, standard deviations, mm and
    /// degrees.
    pub(crate) wander: [f64; 2],
    /// Errors of poses within each sweep. None of sweeps beyond the last.
    pub(crate) drift: Vec<Drifting>,
    /// Multiplies the hand's tilts.
    pub(crate) tilts: f64,
    /// Whether the last sweep goes back.
    pub(crate) goes_back: bool,
    /// From the tracker's frame to the one of the recorded poses.
    pub(crate) room: DAffine3,
}

/// Errors of poses at every 0.4 s.
struct Wander(Vec<[DVec3; 2]>);

impl Wander {
    fn new([mm, degrees]: [f64; 2], random: &mut Random) -> Self {
        // Between independent values, linear interpolation has two thirds of their variance.
        let mut vector = |sd: f64| DVec3::new(random.normal(), random.normal(), random.normal()) * sd * 1.5_f64.sqrt();
        Self((0..20).map(|_| [vector(mm), vector(degrees.to_radians())]).collect())
    }

    fn at(&self, time_s: f64) -> DAffine3 {
        let at = (time_s + 0.4) / 0.4;
        let [shift, turn] = [0, 1].map(|k| self.0[at as usize][k].lerp(self.0[at as usize + 1][k], at.fract()));
        DAffine3::from_rotation_translation(DQuat::from_scaled_axis(turn), shift)
    }
}

impl Sweeps {
    pub(crate) fn of(directions: &[DQuat]) -> Self {
        let body = vec![DVec3::ZERO; directions.len()];
        Self {
            directions: directions.to_vec(),
            body,
            off: Change::zeros(),
            noise: 3.0,
            depth: 1.0,
            wander: [0.0; 2],
            drift: Vec::new(),
            tilts: 1.0,
            goes_back: false,
            room: DAffine3::IDENTITY,
        }
    }

    pub(crate) fn pose(&self, sweep: usize, time_s: f64) -> DAffine3 {
        let seed = sweep as f64;
        let wave = |rate: f64, phase: f64| (TAU * rate * time_s + phase + 2.1 * seed).sin();
        let tilt = DQuat::from_euler(
            glam::EulerRot::XYZ,
            self.tilts * 0.06 * wave(0.31, 0.3),
            self.tilts * 0.08 * wave(0.23, 1.0),
            self.tilts * 0.05 * wave(0.4, 2.0),
        );
        let speed = if self.goes_back && sweep + 1 == self.directions.len() { -6.0 } else { 6.0 };
        let along =
            DVec3::new(1.5 * wave(0.37, 0.0), 1.2 * wave(0.29, 1.4), speed * (time_s - 3.0) + 0.8 * wave(0.5, 0.7));
        let turn = self.directions[sweep];
        DAffine3::from_rotation_translation(turn * tilt, turn * along)
    }

    /// Returns the error of a sweep's poses at a time since its begin, on the image's side.
    pub(crate) fn drifted(&self, sweep: usize, time_s: f64) -> DAffine3 {
        self.drift.get(sweep).map_or(DAffine3::IDENTITY, |(by, shape)| rigid(&by.map(|x| x * shape(time_s))))
    }

    pub(crate) fn scanned(&self, random: &mut Random) -> Slices {
        let body = Body::new(random);
        let (mut samples, mut images) = (Vec::new(), Vec::new());
        let truth = probe_from_image();
        for sweep in 0..self.directions.len() {
            let begin_s = EACH_S * sweep as f64;
            let wander = Wander::new(self.wander, random);
            for i in -30..750 {
                let time_s = f64::from(i) / 120.0;
                // The tracker's stamps are late by the lag.
                let pose = self.room
                    * self.pose(sweep, time_s - self.off[8])
                    * self.drifted(sweep, time_s)
                    * wander.at(time_s);
                let rotation = DQuat::from_mat3(&pose.matrix3).normalize();
                samples.push(PoseSample { time_s: begin_s + time_s, rotation, position_mm: pose.translation });
            }
            for i in 0..40 {
                let time_s = 0.15 * f64::from(i);
                let world = DAffine3::from_translation(-self.body[sweep]) * self.pose(sweep, time_s) * truth;
                let body = body.met_by(&world);
                let pixel = |at: u32| {
                    let p = DVec3::new(f64::from(at % SIZE), f64::from(at / SIZE), 0.0);
                    (body.grey(world.transform_point3(p)) + self.noise * random.normal()).round().clamp(0.0, 255.0)
                        as u8
                };
                images.push((begin_s + time_s, (0..SIZE * SIZE).map(pixel).collect::<Vec<u8>>()));
            }
        }
        let used = self.used(truth);
        let poses = PoseSpline::new(&samples).unwrap();
        let mut slices = Slices::new(SIZE, SIZE, &vec![true; (SIZE * SIZE) as usize], used, poses);
        images.iter().for_each(|(time_s, pixels)| slices.push(*time_s, pixels, SIZE, SIZE));
        slices
    }

    /// Returns the calibration in use: off by `off` in mm of the image about its middle.
    pub(crate) fn used(&self, truth: DAffine3) -> DAffine3 {
        let half = 0.5 * f64::from(SIZE - 1);
        let middle = DAffine3::from_translation(DVec3::new(half, half, 0.0));
        let unscaled = DAffine3::from_scale(DVec3::splat(PIXEL_MM));
        let picture = truth * middle * unscaled.inverse();
        let [r, t] = [3, 0].map(|k| DVec3::new(self.off[k], self.off[k + 1], self.off[k + 2]));
        let rigid = DAffine3::from_rotation_translation(DQuat::from_scaled_axis(r), t);
        let scale = DVec3::new(1.0 + self.off[6], 1.0 + self.off[7], 1.0) * DVec3::new(self.depth, self.depth, 1.0);
        picture * rigid * DAffine3::from_scale(scale) * unscaled * middle.inverse()
    }
}
