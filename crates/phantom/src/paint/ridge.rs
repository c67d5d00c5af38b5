//! Ridges: Gaussians of the distance from a line or a plane, zero farther away.

use glam::{DMat3, DVec3};

use super::sheet::Sheet;
use crate::elementary::exp;
use crate::scene::{ThinSheet, Wire};

/// Ridges end this many σ from their middle, where they are below 1e-9 of their amplitude.
const RIDGE_REACH: f64 = 6.5;

/// A wire or a thin sheet on a flat lattice: amplitude · exp(−|q|²/2σ²), with q linear in the
/// lattice's indices.
pub(super) struct Ridge {
    /// q at point (0, 0): the relevant part of the offset from the ridge, mm.
    start: DVec3,
    /// Change of q between points along u and v, mm.
    step_u: DVec3,
    step_v: DVec3,
    sigma: f64,
    amplitude: f64,
}

impl Ridge {
    pub(super) fn of_wire(wire: &Wire, sheet: &Sheet) -> Self {
        // Projection that removes a vector's part along the wire.
        let d = wire.direction;
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        Self {
            start: across * (sheet.origin - wire.point),
            step_u: across * sheet.step_u,
            step_v: across * sheet.step_v,
            sigma: wire.sigma,
            amplitude: wire.amplitude,
        }
    }

    pub(super) fn of_thin_sheet(thin: &ThinSheet, sheet: &Sheet) -> Self {
        let n = thin.normal;
        Self {
            start: n * (n.dot(sheet.origin) - thin.offset),
            step_u: n * n.dot(sheet.step_u),
            step_v: n * n.dot(sheet.step_v),
            sigma: thin.sigma,
            amplitude: thin.amplitude,
        }
    }

    /// Adds the ridge to row j, near the ridge only.
    pub(super) fn add_to(&self, j: usize, row: &mut [f64]) {
        let start = self.start + self.step_v * j as f64;
        let reach = RIDGE_REACH * self.sigma;
        let squared = self.step_u.length_squared();
        let end = row.len() as f64;
        // A row along the ridge has a constant distance, except for rounding.
        let span = if squared * end * end <= 1e-24 * reach * reach {
            if start.length() <= reach { 0..row.len() } else { 0..0 }
        } else {
            let nearest = -start.dot(self.step_u) / squared;
            let left = reach * reach - (start + self.step_u * nearest).length_squared();
            if left < 0.0 {
                return;
            }
            let half = (left / squared).sqrt();
            let first = (nearest - half).ceil().clamp(0.0, end);
            let last = ((nearest + half).floor() + 1.0).clamp(first, end);
            first as usize..last as usize
        };
        let falloff = -0.5 / (self.sigma * self.sigma);
        for i in span {
            row[i] += self.amplitude * exp(falloff * (start + self.step_u * i as f64).length_squared());
        }
    }
}
