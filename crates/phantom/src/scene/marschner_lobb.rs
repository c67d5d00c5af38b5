//! The test function of Marschner and Lobb (An evaluation of reconstruction filters for volume
//! rendering, Visualization '94).

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::DVec3;

use crate::elementary::sin_cos_of_any;

/// f(x, y, z) = (1 − sin(πz/2) + α(1 + cos(2πf cos(πr/2)))) / (2(1 + α)) with r = √(x² + y²).
/// It is scaled from [−1, 1]³ to mm and from [0, 1] to grey levels.
///
/// The rings' frequency grows with r to πf/2 cycles per unit, 9.4 as published. That is
/// slightly less than the 10 that the original grid of 40 points between −1 and 1 can
/// represent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarschnerLobb {
    /// World mm.
    pub centre: DVec3,
    /// Length of the unit, mm.
    pub unit_mm: f64,
    /// f: crests of the rings between the axis and r = 1.
    pub rings: f64,
    /// α: height of the rings relative to that of the wave along z.
    pub ring_height: f64,
    /// Grey level where the function is 0.
    pub low: f64,
    /// Grey level where the function is 1.
    pub high: f64,
}

impl MarschnerLobb {
    /// Returns the published function with f = 6 and α = 0.25, a unit of 20 mm about the origin
    /// (rings down to 2.1 mm), from 40 to 216.
    pub fn standard() -> Self {
        Self { centre: DVec3::ZERO, unit_mm: 20.0, rings: 6.0, ring_height: 0.25, low: 40.0, high: 216.0 }
    }

    pub(super) fn value(&self, world: DVec3) -> f64 {
        let p = (world - self.centre) / self.unit_mm;
        let (sin, _) = sin_cos_of_any(FRAC_PI_2 * p.z);
        self.grey(sin, self.ring((p.x * p.x + p.y * p.y).sqrt()))
    }

    /// Returns the rings' part at r units from the axis. It is even about 0 and about 1, with
    /// period 2.
    pub(crate) fn ring(&self, r: f64) -> f64 {
        let (_, cos) = sin_cos_of_any(FRAC_PI_2 * r);
        sin_cos_of_any(TAU * self.rings * cos).1
    }

    /// Returns the grey level for the wave's sin(πz/2) and the rings' part.
    pub(crate) fn grey(&self, sin: f64, ring: f64) -> f64 {
        let part = (1.0 - sin + self.ring_height * (1.0 + ring)) / (2.0 * (1.0 + self.ring_height));
        self.low + (self.high - self.low) * part
    }
}
