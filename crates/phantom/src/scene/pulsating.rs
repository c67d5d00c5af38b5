//! A pulsating sphere: a test of reconstructions with a fading memory.

use std::f64::consts::TAU;

use super::sphere::Sphere;
use crate::elementary::sin_cos;

/// A sphere whose radius oscillates about its mean: R + stroke · sin(2πt/period).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pulsating {
    /// The sphere at time 0, where it has its mean radius.
    pub sphere: Sphere,
    /// Largest deviation of the radius, mm; less than the mean radius.
    pub stroke_mm: f64,
    /// Duration of one beat, ns; more than 0.
    pub period_ns: i64,
}

impl Pulsating {
    /// Returns [`super::Scene::standard_sphere`] with a radius between 8 and 12 mm, 60 beats a
    /// minute.
    pub fn standard() -> Self {
        let sphere = Sphere { centre: glam::DVec3::ZERO, radius: 10.0, inside: 180.0, outside: 60.0, edge_sigma: 0.0 };
        Self { sphere, stroke_mm: 2.0, period_ns: 1_000_000_000 }
    }

    /// Returns the sphere at a time, ns. Whole beats are subtracted in integers, so that large
    /// times lose no accuracy.
    pub fn at_time(&self, time_ns: i64) -> Sphere {
        let phase = time_ns.rem_euclid(self.period_ns) as f64 / self.period_ns as f64;
        let (sin, _) = sin_cos(TAU * phase);
        Sphere { radius: self.sphere.radius + self.stroke_mm * sin, ..self.sphere }
    }
}
