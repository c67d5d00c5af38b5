//! Plane waves: a kernel only reduces their amplitude.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3};

use crate::elementary::{exp, sin_cos_of_any};

/// amplitude · cos(2π f·x + phase).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wave {
    /// Grey levels from the middle to a crest.
    pub amplitude: f64,
    /// Cycles per mm along world x, y, z.
    pub frequency: DVec3,
    /// Phase at the world's origin, rad.
    pub phase: f64,
}

/// The sum of a mean and plane waves.
#[derive(Debug, Clone, PartialEq)]
pub struct Waves {
    /// Mean grey level.
    pub mean: f64,
    /// The waves.
    pub waves: Vec<Wave>,
}

impl Waves {
    /// Returns three waves of ±30 about 128, with a period of 4 mm along each axis of the
    /// world. The loss of each is that of the kernel along its axis.
    pub fn standard() -> Self {
        let wave = |axis: DVec3| Wave { amplitude: 30.0, frequency: 0.25 * axis, phase: 0.0 };
        Self { mean: 128.0, waves: DVec3::AXES.map(wave).to_vec() }
    }

    /// Returns one wave of ±80 about 128.
    pub fn single(frequency: DVec3) -> Self {
        Self { mean: 128.0, waves: vec![Wave { amplitude: 80.0, frequency, phase: 0.0 }] }
    }

    pub(super) fn blurred(&self, world: DVec3, covariance: &DMat3) -> f64 {
        self.mean + self.waves.iter().map(|w| w.blurred(world, covariance)).sum::<f64>()
    }

    pub(super) fn softened(&self, variance: f64) -> Self {
        let covariance = DMat3::from_diagonal(DVec3::splat(variance));
        let waves = self.waves.iter().map(|w| Wave { amplitude: w.amplitude * w.loss(&covariance), ..*w }).collect();
        Self { mean: self.mean, waves }
    }
}

impl Wave {
    /// e^{−2π² fᵀCf}: the part of the amplitude left by a Gaussian of covariance C.
    fn loss(&self, covariance: &DMat3) -> f64 {
        exp(-2.0 * PI * PI * self.frequency.dot(*covariance * self.frequency))
    }

    fn blurred(&self, world: DVec3, covariance: &DMat3) -> f64 {
        let (_, cos) = sin_cos_of_any(TAU * self.frequency.dot(world) + self.phase);
        self.amplitude * self.loss(covariance) * cos
    }
}
