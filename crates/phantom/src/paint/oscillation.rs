//! Oscillating scenes: waves, and zone plates on perpendicular axes, are products of one
//! complex factor along each axis of the sheet.

use std::f64::consts::TAU;

use super::sheet::Sheet;
use crate::complex::{Complex, exp};
use crate::scene::{Wave, ZonePlate};

/// One complex factor for each column and for each row.
#[derive(Debug, Clone)]
pub(super) struct Oscillation {
    pub(super) along_u: Vec<Complex>,
    pub(super) along_v: Vec<Complex>,
}

impl Oscillation {
    /// Returns a wave on any sheet. Its phase is computed for each column and row, not stepped
    /// along them: errors must not add up.
    pub(super) fn of_wave(wave: &Wave, sheet: &Sheet) -> Self {
        let phase = |angle: f64| exp(Complex::new(0.0, angle));
        let [first, u, v] = [sheet.origin, sheet.step_u, sheet.step_v].map(|step| TAU * wave.frequency.dot(step));
        Self {
            along_u: (0..sheet.width).map(|i| phase(u * i as f64)).collect(),
            along_v: (0..sheet.height)
                .map(|j| phase(first + wave.phase + v * j as f64).scale(wave.amplitude))
                .collect(),
        }
    }

    /// Returns a zone plate on a sheet with perpendicular axes.
    pub(super) fn of_zone_plate(plate: &ZonePlate, sheet: &Sheet) -> Self {
        let (pitch_u, pitch_v) = (sheet.step_u.length(), sheet.step_v.length());
        let start = sheet.origin - plate.centre;
        let (u, v) = (start.dot(sheet.step_u) / pitch_u, start.dot(sheet.step_v) / pitch_v);
        let normal = sheet.step_u.cross(sheet.step_v) / (pitch_u * pitch_v);
        let across = plate.along_axis(start.dot(normal)).scale(plate.amplitude);
        Self {
            along_u: (0..sheet.width).map(|i| plate.along_axis(u + pitch_u * i as f64)).collect(),
            along_v: (0..sheet.height).map(|j| plate.along_axis(v + pitch_v * j as f64) * across).collect(),
        }
    }

    /// Returns the product at a point.
    pub(super) fn at(&self, i: usize, j: usize) -> Complex {
        self.along_u[i] * self.along_v[j]
    }

    /// Adds the real part to row j.
    pub(super) fn add_to(&self, j: usize, row: &mut [f64]) {
        let v = self.along_v[j];
        for (value, u) in row.iter_mut().zip(&self.along_u) {
            *value += u.re * v.re - u.im * v.im;
        }
    }
}
