//! A sphere with exactly known blurred radius and volume.

use std::f64::consts::{FRAC_2_PI, SQRT_2};

use glam::DVec3;

use crate::elementary::{EDGE_REACH, erf, exp};

/// A ball whose edge is a step convolved with an isotropic 3D Gaussian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// World mm.
    pub centre: DVec3,
    /// Radius, mm.
    pub radius: f64,
    /// Grey level deep inside.
    pub inside: f64,
    /// Grey level far outside.
    pub outside: f64,
    /// σ of the Gaussian that softens the edge, mm; 0 is a hard edge (10–90 % rise: 2.563 σ).
    pub edge_sigma: f64,
}

impl Sphere {
    pub(super) fn value(&self, world: DVec3) -> f64 {
        self.at_distance(world.distance(self.centre))
    }

    /// Returns the grey level at a distance r (mm) from the centre.
    ///
    /// R is the radius and σ the edge's: [erf((R+r)/√2σ) + erf((R−r)/√2σ)]/2 − σ/(√2π r)
    /// [e^{−(R−r)²/2σ²} − e^{−(R+r)²/2σ²}]. The level halfway between inside and outside lies
    /// at R − σ²/R: a blurred sphere looks smaller.
    pub(crate) fn at_distance(&self, r: f64) -> f64 {
        self.outside + (self.inside - self.outside) * self.part_inside(r)
    }

    fn part_inside(&self, r: f64) -> f64 {
        let (radius, sigma) = (self.radius, self.edge_sigma);
        if r - radius > EDGE_REACH * sigma {
            return 0.0;
        }
        if radius - r >= EDGE_REACH * sigma {
            return 1.0;
        }
        let variance = sigma * sigma;
        let inner = 0.5 * (erf((radius + r) / (SQRT_2 * sigma)) + erf((radius - r) / (SQRT_2 * sigma)));
        let y = radius * r / variance;
        // The bracket divided by r. It cancels near the centre, so the series of 2 sinh(y)/y is
        // used there.
        let shell = if y < 0.5 {
            let sinh_over_y = 1.0 + y * y / 6.0 * (1.0 + y * y / 20.0 * (1.0 + y * y / 42.0 * (1.0 + y * y / 72.0)));
            2.0 * radius / variance * exp(-(radius * radius + r * r) / (2.0 * variance)) * sinh_over_y
        } else {
            let at = |x: f64| exp(-x * x / (2.0 * variance));
            (at(radius - r) - at(radius + r)) / r
        };
        // 1/√2π = ½ √(2/π).
        inner - 0.5 * FRAC_2_PI.sqrt() * sigma * shell
    }

    pub(crate) fn softened(&self, variance: f64) -> Self {
        Self { edge_sigma: (self.edge_sigma * self.edge_sigma + variance).sqrt(), ..*self }
    }
}
