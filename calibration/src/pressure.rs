//! Corrects the compression of tissue by the probe's pressure, against a sweep with light contact.
//!
//! The probe moves the skin; deep tissue stands. An image shows tissue of depth v at v + d(v),
//! where d falls to 0 with depth. The tracker tells where the probe is, not where the skin was:
//! one slice alone does not tell d. A sweep of the same place in the same direction with light
//! contact does. Its slices are resampled into the plane of a pressed one, by the poses of both. d
//! is the displacement along v by which they differ (Treece, Prager, Gee & Berman, 2002).
//!
//! Slices are not compared with their neighbours in a chain: tissue that slopes along the sweep
//! moves from slice to slice as if pressed.
//!
//! - `reference`: light slices in the plane of a pressed one.
//! - `window`: displacements of windows, by correlation.
//! - `monotone`: numbers that fall to 0.
//! - `fit`: the compression of a slice.
//! - `compression`: displacement over depth, and images without it.
//! - `frames`: frames that repeat, or that the scanner averages.
//! - `found`: the result, and evidence for it.

#![cfg_attr(test, allow(clippy::print_stdout, reason = "figures, for who asks with --nocapture"))]
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "a comparison with NaN must refuse, not pass")]

mod compression;
mod fit;
mod found;
mod frames;
mod monotone;
mod reference;
mod window;

pub use compression::{Compression, Undone};
pub use found::{Evidence, Pressure};

use crate::error::{CalibrationError, PressureError};
use crate::slices::Slices;
use crate::statistics::median;
use reference::{Placed, Reference};
use window::{Found, Picture, Windows};

/// Usual limit of the distance between planes, mm: 0.8 of the standard deviation of a beam's
/// thickness.
pub const NEAR_MM: f64 = 0.5;

/// Slices near light ones: their number, and their share in the sweeps beside the light one; and
/// the share of them whose deepest third tells a displacement.
const LEAST_SLICES: usize = 10;
const LEAST_SHARE: f64 = 0.5;
/// Windows over depth.
const LEAST_WINDOWS: usize = 5;
/// Share of windows that resemble no light slice.
const MOST_UNRELATED: f64 = 0.3;
/// Share of slices with a window at the search's end, or with tissue that folds.
const MOST_FAR: f64 = 0.05;
const MOST_FOLDED: f64 = 0.05;
/// Displacement of the deepest third, mm.
const MOST_DEEP_MM: f64 = 0.3;
/// Displacement of the skin by which a light sweep may press more, mm.
const MOST_HEAVIER_MM: f64 = 0.3;

impl Slices {
    /// Finds the compressions of slices against those of a sweep with light contact. `light` is its
    /// number, from 1, among those of [`directions`](Slices::directions). Slices within `near_mm`
    /// of a light one, at the middle of the image, are corrected. [`NEAR_MM`] is the usual limit.
    ///
    /// # Errors
    /// [`PressureError`] if there is no such sweep, or if displacements are not those of pressure.
    pub fn pressure(&self, light: usize, near_mm: f64) -> Result<Pressure, CalibrationError> {
        let directions = self.directions();
        if !(1..=directions.sweeps_s.len()).contains(&light) {
            let begin_s = self.pixels.iter().map(|(time_s, _)| *time_s).fold(f64::INFINITY, f64::min);
            let sweeps_s = directions.sweeps_s.iter().map(|times| times.map(|time_s| time_s - begin_s)).collect();
            return Err(PressureError::NoSweep { sweeps_s }.into());
        }
        if !(near_mm > 0.0 && near_mm.is_finite()) {
            return Err(PressureError::Limit { near_mm }.into());
        }
        let windows = Windows::of(self);
        if windows.count() < LEAST_WINDOWS {
            return Err(PressureError::Shallow { windows: windows.count(), least: LEAST_WINDOWS }.into());
        }
        let runs = directions.runs(self);
        frames::repeats(self, &runs)?;
        let placed: Vec<Option<Placed>> = (0..self.pixels.len()).map(|slice| Placed::of(self, slice)).collect();
        let of_light = runs[light - 1].iter().filter_map(|slice| placed[*slice]).collect();
        let reference = Reference::new(self, of_light, near_mm);
        let (near, pressed) = near_slices(&reference, &runs, light, &placed);
        let least = LEAST_SLICES.max((LEAST_SHARE * pressed as f64).ceil() as usize);
        if near.len() < least {
            return Err(PressureError::Few { near: near.len(), all: pressed, light, near_mm, least }.into());
        }
        frames::persistence(self, &windows, &placed, &runs, near_mm)?;
        let mut compressions = vec![None; self.pixels.len()];
        let mut found: Vec<Vec<Found>> = Vec::new();
        let bottom_mm = windows.bottom_mm();
        for (slice, place) in &near {
            let seen = Picture::new(&reference.seen_from(place));
            let of_slice = windows.found(&seen, &Picture::of(self, *slice));
            compressions[*slice] = fit::compression(&of_slice, bottom_mm);
            found.push(of_slice);
        }
        let [correlation, unrelated, deep_mm] = evidence(&found, bottom_mm)?;
        let mut skin: Vec<f64> =
            compressions.iter().flatten().map(|compression: &Compression| compression.displacement_mm(0.0)).collect();
        let skin_rms_mm = rms(&skin);
        let skin_max_mm = skin.iter().fold(0.0, |most: f64, mm| most.max(mm.abs()));
        let skin_median_mm = median(&mut skin);
        if skin_median_mm < -MOST_HEAVIER_MM {
            return Err(PressureError::Heavier { light, mm: -skin_median_mm }.into());
        }
        let evidence = Evidence {
            pressed,
            corrected: skin.len(),
            skin_rms_mm,
            skin_max_mm,
            skin_median_mm,
            correlation,
            unrelated,
            deep_mm,
        };
        Ok(Pressure { directions, compressions, evidence })
    }
}

/// Returns the slices of other sweeps that lie near light ones, and how many slices their sweeps
/// have; all of them, if none lies near.
fn near_slices(
    reference: &Reference<'_>,
    runs: &[Vec<usize>],
    light: usize,
    placed: &[Option<Placed>],
) -> (Vec<(usize, Placed)>, usize) {
    let (mut near, mut pressed) = (Vec::new(), 0);
    for (_, run) in runs.iter().enumerate().filter(|(number, _)| number + 1 != light) {
        let before = near.len();
        let of_run = run.iter().filter_map(|slice| Some((*slice, placed[*slice]?)));
        near.extend(of_run.filter(|(_, place)| reference.is_near(place)));
        if near.len() > before {
            pressed += run.len();
        }
    }
    let all = runs.iter().enumerate().filter(|(number, _)| number + 1 != light).map(|(_, run)| run.len()).sum();
    (near, if pressed > 0 { pressed } else { all })
}

/// Returns the median correlation of windows, the share of those that tell nothing, and the
/// displacement of the deepest third.
///
/// # Errors
/// [`PressureError`] if these are not those of pressure.
fn evidence(found: &[Vec<Found>], bottom_mm: f64) -> Result<[f64; 3], PressureError> {
    let all = found.iter().flatten();
    let mut peaks: Vec<f64> = all.map(|window| window.peak).collect();
    let low = peaks.iter().filter(|peak| !(**peak >= fit::ALIKE)).count();
    let unrelated = if peaks.is_empty() { 1.0 } else { low as f64 / peaks.len() as f64 };
    if !(unrelated <= MOST_UNRELATED) {
        return Err(PressureError::Unrelated { share: unrelated, alike: fit::ALIKE });
    }
    let share =
        |of: &dyn Fn(&[Found]) -> bool| found.iter().filter(|windows| of(windows)).count() as f64 / found.len() as f64;
    let folded = share(&|windows| fit::folds(windows));
    if folded > MOST_FOLDED {
        return Err(PressureError::Folds { share: folded });
    }
    let far = share(&|windows| windows.iter().any(|window| window.at_end && window.peak >= fit::ALIKE));
    if far > MOST_FAR {
        return Err(PressureError::Far { share: far, most_mm: window::SEARCH_MM });
    }
    let deep: Vec<f64> = found.iter().filter_map(|windows| deep_mm(windows, bottom_mm)).collect();
    if !(deep.len() as f64 >= LEAST_SHARE * found.len() as f64) {
        return Err(PressureError::Deep { slices: deep.len(), all: found.len() });
    }
    let mm = rms(&deep);
    if !(mm <= MOST_DEEP_MM) {
        return Err(PressureError::Rigid { mm, most_mm: MOST_DEEP_MM });
    }
    Ok([median(&mut peaks), unrelated, mm])
}

/// Returns the mean displacement of a slice's deepest third, mm; `None` if no window there tells
/// it.
fn deep_mm(windows: &[Found], bottom_mm: f64) -> Option<f64> {
    let deep = windows.iter().filter(|w| fit::is_alike(w) && w.depth_mm > 2.0 / 3.0 * bottom_mm);
    let (sum, count) = deep.fold((0.0, 0.0), |(sum, count), window| (sum + window.shift_mm, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests;
