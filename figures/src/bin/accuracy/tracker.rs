//! Errors of a simulated tracker, which measures 120 times a second.

use glam::{DQuat, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use sync::clock::TimeFlags;
use sync::history::{PoseSample, Rigid};

use crate::sweep::{STEP_NS, Sweep};

/// Kind of errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Noise {
    /// Standard deviation along each axis, mm, and about each axis, degrees.
    pub(crate) sd: f64,
    /// Correlation of successive errors; 0 for white noise.
    pub(crate) correlation: f64,
    /// One pose in a hundred, on average, is off by 5 mm and 5° (standard deviations).
    pub(crate) outliers: bool,
}

impl Noise {
    pub(crate) const fn white(sd: f64) -> Self {
        Self { sd, correlation: 0.0, outliers: false }
    }

    /// Returns its name.
    pub(crate) fn name(&self) -> String {
        let kind = match (self.correlation, self.outliers) {
            (_, true) => ", 1 % outliers of 5 mm, 5°".to_owned(),
            (0.0, _) => String::new(),
            (correlation, _) => format!(", correlation {correlation}"),
        };
        format!("{} mm, {}°{kind}", self.sd, self.sd)
    }

    /// Measures a sweep.
    pub(crate) fn measured(&self, sweep: &Sweep, seed: u64) -> Vec<PoseSample> {
        let mut draws = Draws::new(seed);
        let (mut shift, mut turn) = (draws.vector(), draws.vector());
        let measured = (0..sweep.steps()).step_by(2).map(|step| {
            let fresh = (1.0 - self.correlation * self.correlation).sqrt();
            (shift, turn) =
                (shift * self.correlation + draws.vector() * fresh, turn * self.correlation + draws.vector() * fresh);
            let sd = if draws.unit() < 0.01 && self.outliers { 5.0 } else { self.sd };
            let truth = sweep.sensor(step);
            let turned = DQuat::from_scaled_axis(turn * sd.to_radians());
            let pose = Rigid {
                rotation: (turned * DQuat::from_mat3(&truth.matrix3)).normalize(),
                position_mm: truth.translation + shift * sd,
            };
            let time_ns = i64::from(step) * STEP_NS;
            PoseSample { time_ns, bound_ns: 0, flags: TimeFlags::NONE, pose, invalid: None }
        });
        measured.collect()
    }
}

/// Random numbers with the same bits on every machine.
pub(crate) struct Draws(ChaCha8Rng);

impl Draws {
    /// Begins the series of a seed.
    pub(crate) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// Uniform in (0, 1].
    pub(crate) fn unit(&mut self) -> f64 {
        ((self.0.next_u64() >> 11) + 1) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal along each axis, by Box and Muller.
    pub(crate) fn vector(&mut self) -> DVec3 {
        let mut normal = || {
            let radius = libm::sqrt(-2.0 * libm::log(self.unit()));
            radius * libm::cos(std::f64::consts::TAU * self.unit())
        };
        DVec3::new(normal(), normal(), normal())
    }

    /// Direction, uniform over the sphere.
    pub(crate) fn direction(&mut self) -> DVec3 {
        self.vector().normalize()
    }
}
