//! The point-spread function within the slice. Across the beams it widens off the focus; along
//! them it is the same everywhere.
//!
//! Echoes are distributed to the raster's nodes in proportion to their nearness. This blurs by
//! a variance of a sixth of the squared node distance, which the kernels therefore omit. An
//! echo thus has the scanner's width wherever it lies between nodes.

use super::Scanner;
use super::layout::{Layout, MOST_SIDE_BEAMS, REACH};
use crate::elementary::exp;

/// Variance of distributing an echo to two nodes, in squared node distances.
const BETWEEN_NODES: f64 = 1.0 / 6.0;

/// Weights of one side, the middle's first; both sides sum to 1.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Kernel {
    pub(super) weights: Vec<f32>,
}

impl Kernel {
    /// Creates the kernel that yields a Gaussian of σ nodes together with the distribution to
    /// nodes.
    fn new(sigma: f64, most: usize) -> Self {
        // A Gaussian narrower than the node distance becomes a single weight.
        let variance = (sigma * sigma - BETWEEN_NODES).max(1e-6);
        let reach = ((REACH * variance.sqrt()).ceil() as usize).clamp(1, most);
        let mut weights: Vec<f64> = (0..=reach).map(|k| exp(-0.5 * (k * k) as f64 / variance)).collect();
        let sum = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
        weights.iter_mut().for_each(|w| *w /= sum);
        Self { weights: weights.iter().map(|w| *w as f32).collect() }
    }

    /// Returns the mean square of the weights over all positions of an echo between nodes.
    fn power(&self) -> f64 {
        let side = self.weights.iter().copied().map(f64::from);
        let all: Vec<f64> = side.clone().skip(1).collect::<Vec<_>>().into_iter().rev().chain(side).collect();
        let squares: f64 = all.iter().map(|w| w * w).sum();
        let neighbours: f64 = all.windows(2).map(|w| w[0] * w[1]).sum();
        // ∫(1−t)² = ∫t² = 1/3 and 2∫t(1−t) = 1/3 of a node distance.
        (2.0 * squares + neighbours) / 3.0
    }
}

/// Kernels of a scanner, and the factors that give echoes their stated strength.
#[derive(Debug, Clone)]
pub(super) struct Spread {
    /// Kernel across the beams, for each row.
    pub(super) lateral: Vec<Kernel>,
    /// Kernel along the beams.
    pub(super) axial: Kernel,
    /// Factor of scatterers, for each row: their mean echo power is 1 in the reference tissue.
    pub(super) of_scatterers: Vec<f32>,
    /// Factor of a surface across the beams: its echo has its own amplitude.
    pub(super) of_surfaces: f32,
    /// Factor of a point, for each row: its echo at the focus has its own amplitude, and less
    /// in wider parts of the beam.
    pub(super) of_points: Vec<f32>,
}

impl Spread {
    pub(super) fn new(scanner: &Scanner, layout: &Layout) -> Self {
        let axial_sigma = scanner.axial_sigma_mm() / layout.range_step;
        let axial = Kernel::new(axial_sigma, layout.above);
        let most = layout.side.min(MOST_SIDE_BEAMS);
        let ranges: Vec<f64> = (0..layout.rows).map(|row| layout.range(row).max(0.0)).collect();
        let lateral: Vec<Kernel> = ranges
            .iter()
            .map(|range| Kernel::new(scanner.lateral_sigma_mm(*range) / layout.beam_distance(*range), most))
            .collect();
        let density = scanner.scatterer_pitch_mm.powi(-3);
        let root_two_pi = std::f64::consts::TAU.sqrt();
        let of_scatterers = ranges.iter().zip(&lateral).map(|(range, kernel)| {
            // Scatterers of a raster's cell times their weights across the slice, ∫e^{−z²/σ²} =
            // σ√π.
            let thickness = scanner.elevation_sigma_mm(*range) * std::f64::consts::PI.sqrt();
            let cell = density * layout.range_step * layout.beam_distance(*range) * thickness;
            (1.0 / (cell * axial.power() * kernel.power()).sqrt()) as f32
        });
        let peak = root_two_pi * axial_sigma;
        let focal = scanner.lateral.focal_sigma_mm(scanner.wavelength_mm());
        let of_points = ranges.iter().map(|range| (peak * root_two_pi * focal / layout.beam_distance(*range)) as f32);
        Self {
            of_scatterers: of_scatterers.collect(),
            of_points: of_points.collect(),
            of_surfaces: peak as f32,
            lateral,
            axial,
        }
    }

    /// Returns the full width at half maximum of an echo within the slice, mm: across the beams
    /// and along them, at a depth.
    #[cfg(test)]
    pub(super) fn widths(scanner: &Scanner, depth: f64) -> [f64; 2] {
        [scanner.lateral_sigma_mm(depth), scanner.axial_sigma_mm()].map(|sigma| sigma * super::FWHM_PER_SIGMA)
    }
}

/// Blurs a row across the beams, into `to`. Both are a whole row; values beyond its ends are 0.
#[inline(always)]
pub(super) fn across(kernel: &Kernel, from: &[f32], to: &mut [f32]) {
    let n = from.len();
    let middle = kernel.weights[0];
    for (to, from) in to.iter_mut().zip(from) {
        *to = middle * *from;
    }
    for (k, weight) in kernel.weights.iter().enumerate().skip(1) {
        for (to, from) in to[..n - k].iter_mut().zip(&from[k..]) {
            *to += *weight * *from;
        }
        for (to, from) in to[k..].iter_mut().zip(&from[..n - k]) {
            *to += *weight * *from;
        }
    }
}

/// Blurs along the beams: row `row` of a raster of rows of `columns`, into `to`. The kernel
/// must stay within the raster.
#[inline(always)]
pub(super) fn along(kernel: &Kernel, raster: &[f32], columns: usize, row: usize, to: &mut [f32]) {
    let line = |r: usize| &raster[r * columns..][..columns];
    let middle = kernel.weights[0];
    for (to, from) in to.iter_mut().zip(line(row)) {
        *to = middle * *from;
    }
    for (k, weight) in kernel.weights.iter().enumerate().skip(1) {
        for ((to, before), behind) in to.iter_mut().zip(line(row - k)).zip(line(row + k)) {
            *to += *weight * (*before + *behind);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernel_width_is_independent_of_position_between_nodes() {
        for sigma in [0.8, 1.5, 3.0, 6.0] {
            let kernel = Kernel::new(sigma, 24);
            let (mut mean_power, n) = (0.0, 50);
            for step in 0..n {
                let t = (f64::from(step) + 0.5) / f64::from(n);
                let mut row = vec![0.0_f32; 81];
                (row[40], row[41]) = ((1.0 - t) as f32, t as f32);
                let mut out = vec![0.0_f32; 81];
                across(&kernel, &row, &mut out);
                let moment = |f: &dyn Fn(f64) -> f64| -> f64 {
                    out.iter().zip(0..).map(|(w, i)| f64::from(*w) * f(f64::from(i) - 40.0 - t)).sum()
                };
                assert!((moment(&|_| 1.0) - 1.0).abs() < 1e-5 && moment(&|x| x).abs() < 1e-5);
                mean_power += out.iter().map(|w| f64::from(*w).powi(2)).sum::<f64>() / f64::from(n);
                // The variance differs by t(1 − t) − 1/6 with the position between nodes;
                // truncation at 2.8 σ takes up to 4 %.
                let variance = moment(&|x| x * x);
                assert!(
                    (variance.sqrt() / sigma - 1.0).abs() < if sigma < 1.0 { 0.15 } else { 0.065 },
                    "{sigma}: {variance}"
                );
            }
            assert!((mean_power / kernel.power() - 1.0).abs() < 1e-3, "{sigma}");
        }
    }

    #[test]
    fn blur_along_equals_blur_across_transposed() {
        let kernel = Kernel::new(1.7, 24);
        let n = 40;
        let raster: Vec<f32> = (0..n * n).map(|i| ((i * 7919) % 251) as f32).collect();
        let turned: Vec<f32> = (0..n * n).map(|i| raster[i % n * n + i / n]).collect();
        let row = 20;
        let mut along_it = vec![0.0; n];
        along(&kernel, &raster, n, row, &mut along_it);
        for (column, found) in along_it.iter().enumerate() {
            let mut out = vec![0.0; n];
            across(&kernel, &turned[column * n..][..n], &mut out);
            assert!((out[row] - found).abs() < 1e-3);
        }
    }
}
