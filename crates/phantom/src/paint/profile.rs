//! Tables of functions of the distance from a point or an axis.

use std::f64::consts::FRAC_PI_2;

use glam::DVec3;

use super::oscillation::Oscillation;
use super::sheet::{Sheet, indices_within, rows};
use crate::complex::{Complex, exp};
use crate::elementary::EDGE_REACH;
use crate::scene::{MarschnerLobb, Sphere};

/// Steps of the soft edge's table: over 16.6 σ, linear interpolation errs by less than 1e-6 of
/// the edge's height.
const PROFILE_STEPS: usize = 8192;

/// Steps of the rings' table between the axis and one unit. Linear interpolation errs by at
/// most (2π · 9.4)² / 8 / 16384² = 1.7e-6 of the rings' height at the published six rings.
const RING_STEPS: usize = 16384;

/// A sphere's grey level by distance from its centre, tabulated over the soft edge.
#[derive(Debug, Clone)]
pub(crate) struct SphereProfile {
    sphere: Sphere,
    /// Distance of the first table entry, mm; inside it the sphere has its inner grey level.
    inner: f64,
    /// Distance beyond which the sphere has its outer grey level, mm.
    outer: f64,
    /// Table entries per mm; 0 for a hard edge.
    per_mm: f64,
    table: Vec<f64>,
}

impl SphereProfile {
    pub(crate) fn new(sphere: Sphere) -> Self {
        if sphere.edge_sigma == 0.0 {
            return Self { sphere, inner: sphere.radius, outer: sphere.radius, per_mm: 0.0, table: Vec::new() };
        }
        let reach = EDGE_REACH * sphere.edge_sigma;
        let (inner, outer) = ((sphere.radius - reach).max(0.0), sphere.radius + reach);
        let step = (outer - inner) / PROFILE_STEPS as f64;
        let table = (0..=PROFILE_STEPS).map(|k| sphere.at_distance(inner + k as f64 * step)).collect();
        Self { sphere, inner, outer, per_mm: step.recip(), table }
    }

    pub(crate) fn value(&self, world: DVec3) -> f64 {
        self.at_squared_distance(world.distance_squared(self.sphere.centre))
    }

    fn at_squared_distance(&self, squared: f64) -> f64 {
        let r = squared.sqrt();
        if r > self.outer {
            return self.sphere.outside;
        }
        if self.table.is_empty() || (r < self.inner) {
            return self.sphere.inside;
        }
        let at = (r - self.inner) * self.per_mm;
        let k = (at as usize).min(PROFILE_STEPS - 1);
        self.table[k] + (at - k as f64) * (self.table[k + 1] - self.table[k])
    }

    /// Adds the sphere to row j; outside its radius only if it is not black there.
    pub(super) fn add_to(&self, sheet: &Sheet, j: usize, row: &mut [f64]) {
        let start = sheet.point(0, j) - self.sphere.centre;
        let pitch = sheet.step_u.length();
        let along = -start.dot(sheet.step_u) / pitch;
        let beside = (start + sheet.step_u * (along / pitch)).length_squared();
        let reach = self.outer * self.outer - beside;
        let span = if self.sphere.outside != 0.0 {
            0..row.len()
        } else if reach > 0.0 {
            indices_within(along, reach.sqrt(), pitch, row.len()).unwrap_or(0..0)
        } else {
            0..0
        };
        for i in span {
            let mm = i as f64 * pitch - along;
            row[i] += self.at_squared_distance(beside + mm * mm);
        }
    }
}

/// Marschner and Lobb's function: its rings from a table, its wave as a product of factors
/// along each axis of the sheet.
#[derive(Debug, Clone)]
pub(super) struct Rings {
    function: MarschnerLobb,
    table: Vec<f64>,
}

impl Rings {
    pub(super) fn new(function: MarschnerLobb) -> Self {
        let table = (0..=RING_STEPS).map(|k| function.ring(k as f64 / RING_STEPS as f64)).collect();
        Self { function, table }
    }

    pub(super) fn paint(&self, sheet: &Sheet, grey: &mut [f64]) {
        let MarschnerLobb { centre, unit_mm, .. } = self.function;
        let phase = |mm: f64| Complex::new(0.0, FRAC_PI_2 * mm / unit_mm);
        let wave = Oscillation {
            along_u: (0..sheet.width).map(|i| exp(phase(sheet.step_u.z * i as f64))).collect(),
            along_v: (0..sheet.height)
                .map(|j| exp(phase(sheet.origin.z - centre.z + sheet.step_v.z * j as f64)))
                .collect(),
        };
        for (j, row) in rows(sheet, grey) {
            for (i, value) in row.iter_mut().enumerate() {
                let p = (sheet.point(i, j) - centre) / unit_mm;
                let ring = self.ring((p.x * p.x + p.y * p.y).sqrt());
                *value = self.function.grey(wave.at(i, j).im, ring);
            }
        }
    }

    fn ring(&self, r: f64) -> f64 {
        // The function has period 2 and is symmetric about 1.
        let turn = r - 2.0 * (0.5 * r).floor();
        let at = turn.min(2.0 - turn) * RING_STEPS as f64;
        let k = (at as usize).min(RING_STEPS - 1);
        self.table[k] + (at - k as f64) * (self.table[k + 1] - self.table[k])
    }
}
