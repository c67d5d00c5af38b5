//! The in-plane kernel as a cubic spline: filter taps that convert a row of pixels into spline
//! coefficients on a coarser lattice.
//!
//! A voxel's in-plane value is the kernel-weighted sum of the pixels around it: hundreds of
//! products if pixels are finer than voxels. Instead, the image is filtered once, separably, to
//! coefficients on nodes h apart, and a voxel is the sum of the 4×4 cubic B-splines that cover
//! it. The sum of both steps is again a kernel: Σ a·B₃, a cubic spline with knots at the nodes.
//! The coefficients a are fitted to the kernel by least squares. Nothing is thus blurred twice,
//! and the deviation is known before the first pixel: [`Taps::deviation`].
//!
//! (A linear spline, fitted likewise, deviates 30 times as much at h = σ/2.)

use super::kernel::{AxisKernel, cubic_b_spline};

/// Largest deviation of the sampled image from the exact sum, as a fraction of the image's
/// range, for the worst possible image, both axes together.
pub const DEVIATION_LIMIT: f64 = 2e-3;
/// Each axis' share of it; the rest is for rounding nodes and weights to 16 bits.
const AXIS_SHARE: f64 = 0.44;

/// Finest and coarsest node spacing tried: a quarter of a pixel, sixteen pixels.
const FINEST: u32 = 4;
const COARSEST: u32 = 16;
/// Points per node spacing at which the fit is made.
const FIT_POINTS: i32 = 32;
/// Points per pixel (or node, if finer) at which the deviation is measured.
const CHECK_POINTS: u32 = 16;

/// Distance between nodes, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// This many pixels from node to node: the image is decimated.
    Down(u32),
    /// This many nodes from pixel to pixel: the kernel is too narrow for a spline with knots at
    /// the pixels.
    Up(u32),
}

impl Step {
    /// Node spacing in pixels.
    pub fn pixels(self) -> f64 {
        match self {
            Self::Down(k) => f64::from(k),
            Self::Up(r) => 1.0 / f64::from(r),
        }
    }

    /// Number of different tap vectors: one when decimating, else one per node between pixels.
    fn phases(self) -> u32 {
        match self {
            Self::Down(_) => 1,
            Self::Up(r) => r,
        }
    }
}

/// Filter of one axis: node m lies at pixel m·h; its coefficient is Σ taps·pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Taps {
    /// Node spacing.
    pub step: Step,
    /// Taps by phase (m mod phases); each sums to 1.
    pub phases: Vec<PhaseTaps>,
    /// Half the sum of absolute differences between the actual and the nominal kernel at the
    /// worst position, for one axis. No image with values in a range can be off by more than
    /// this fraction of it.
    pub deviation: f64,
}

/// Taps of the nodes of one phase.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseTaps {
    /// Pixel of the first tap, relative to the pixel at or before the node.
    pub first: i32,
    /// Weights of consecutive pixels.
    pub weights: Vec<f32>,
}

/// Reason why an image cannot be filtered with a kernel.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SplineError {
    /// The kernel would fall between pixels.
    #[error(
        "the in-plane kernel's σ of {sigma_px:.3} pixels leaves gaps between pixels: at least {least} is needed, choose a larger σ"
    )]
    TooNarrow {
        /// σ in pixels.
        sigma_px: f64,
        /// Least σ in pixels.
        least: f64,
    },
    /// The kernel covers more pixels than any sensible filter.
    #[error(
        "the in-plane kernel reaches over {support_px:.0} pixels to each side; {most} are the most: choose a smaller σ or support"
    )]
    TooWide {
        /// Half width in pixels.
        support_px: f64,
        /// Largest half width in pixels.
        most: f64,
    },
}

const LEAST_SIGMA_PX: f64 = 0.5;
/// Pixels that a kernel may reach over to each side.
pub(super) const MOST_SUPPORT_PX: f64 = 512.0;

impl SplineError {
    /// # Errors
    /// When the kernel is narrower than half a pixel or absurdly wide: neither path can filter
    /// images with it.
    pub(super) fn check(kernel: &AxisKernel, pixel_mm: f64) -> Result<(), Self> {
        let sigma_px = kernel.sigma_mm / pixel_mm;
        let support_px = kernel.support_mm / pixel_mm;
        if sigma_px.is_nan() || sigma_px < LEAST_SIGMA_PX {
            return Err(Self::TooNarrow { sigma_px, least: LEAST_SIGMA_PX });
        }
        if support_px > MOST_SUPPORT_PX {
            return Err(Self::TooWide { support_px, most: MOST_SUPPORT_PX });
        }
        Ok(())
    }
}

impl Taps {
    /// Returns the coarsest filter whose deviation is within this axis' share of
    /// [`DEVIATION_LIMIT`], or the one that deviates least.
    ///
    /// # Errors
    /// [`SplineError`] when the kernel is narrower than half a pixel or absurdly wide.
    pub fn design(kernel: &AxisKernel, pixel_mm: f64) -> Result<Self, SplineError> {
        SplineError::check(kernel, pixel_mm)?;
        let sigma_px = kernel.sigma_mm / pixel_mm;
        // Beyond 0.8 σ no cubic spline is close to a Gaussian; starting there saves fits that
        // cannot pass.
        let coarsest = ((0.8 * sigma_px) as u32).clamp(1, COARSEST);
        let steps = (1..=coarsest).rev().map(Step::Down).chain((2..=FINEST).map(Step::Up));
        let mut best: Option<Self> = None;
        for step in steps {
            let taps = Self::fit(kernel, pixel_mm, step);
            if taps.deviation <= AXIS_SHARE * DEVIATION_LIMIT {
                return Ok(taps);
            }
            if best.as_ref().is_none_or(|b| taps.deviation < b.deviation) {
                best = Some(taps);
            }
        }
        Ok(best.unwrap_or_else(|| Self::fit(kernel, pixel_mm, Step::Up(FINEST))))
    }

    /// Returns taps with a node at each pixel that has its value: the basis of interpolation
    /// between pixels.
    pub fn identity() -> Self {
        Self { step: Step::Down(1), phases: vec![PhaseTaps { first: 0, weights: vec![1.0] }], deviation: 0.0 }
    }

    /// Fits the taps for a given step.
    pub fn fit(kernel: &AxisKernel, pixel_mm: f64, step: Step) -> Self {
        let knot_mm = pixel_mm * step.pixels();
        let phases = match step {
            Step::Down(k) => vec![decimating(kernel, knot_mm, k)],
            Step::Up(r) => (0..r).map(|phase| interpolating(kernel, knot_mm, r, phase)).collect(),
        };
        let mut taps = Self { step, phases, deviation: 0.0 };
        taps.deviation = taps.worst_deviation(kernel, pixel_mm);
        taps
    }

    /// Largest sum of the taps' magnitudes: the factor by which coefficients can exceed the
    /// pixels' range.
    pub fn gain(&self) -> f32 {
        self.phases.iter().map(|p| p.weights.iter().map(|w| w.abs()).sum()).fold(0.0, f32::max)
    }

    /// The actual weight of `pixel` at position `u` (both in pixels).
    fn realised(&self, pixel: i64, u: f64) -> f64 {
        let h = self.step.pixels();
        let node = (u / h).floor() as i64;
        (node - 1..=node + 2).map(|m| f64::from(self.weight(m, pixel)) * cubic_b_spline(u / h - m as f64)).sum()
    }

    /// The tap of node `m` on `pixel`.
    fn weight(&self, m: i64, pixel: i64) -> f32 {
        let (phase, anchor) = self.anchor(m);
        let taps = &self.phases[phase];
        usize::try_from(pixel - anchor - i64::from(taps.first))
            .ok()
            .and_then(|i| taps.weights.get(i))
            .copied()
            .unwrap_or(0.0)
    }

    /// Phase of node `m` and the pixel at or before it.
    pub fn anchor(&self, m: i64) -> (usize, i64) {
        match self.step {
            Step::Down(k) => (0, m * i64::from(k)),
            Step::Up(r) => (m.rem_euclid(i64::from(r)) as usize, m.div_euclid(i64::from(r))),
        }
    }

    fn worst_deviation(&self, kernel: &AxisKernel, pixel_mm: f64) -> f64 {
        let period = self.step.pixels().max(1.0);
        let points = (f64::from(CHECK_POINTS) * period.max(f64::from(self.step.phases()))) as u32;
        let reach = (kernel.support_mm / pixel_mm + 3.0 * self.step.pixels()).ceil() as i64 + 1;
        let mut worst = 0.0_f64;
        for i in 0..points {
            let u = period * f64::from(i) / f64::from(points);
            let pixels = u as i64 - reach..=u as i64 + reach;
            let nominal = |j: i64| kernel.weight((u - j as f64) * pixel_mm);
            let total: f64 = pixels.clone().map(nominal).sum();
            let difference: f64 = pixels.map(|j| (self.realised(j, u) - nominal(j) / total).abs()).sum();
            worst = worst.max(0.5 * difference);
        }
        worst
    }
}

/// Returns the coefficients αᵢ of B₃(x − i) that best fit a kernel by least squares: the first i,
/// and α. The kernel is centred at `centre`, in knots, 0 ≤ centre < 1.
fn fit_spline(kernel: &AxisKernel, knot_mm: f64, centre: f64) -> (i64, Vec<f64>) {
    let support = kernel.support_mm / knot_mm;
    let first = (centre - support).floor() as i64 - 1;
    let last = (centre + support).ceil() as i64 + 1;
    let n = (last - first + 1) as usize;
    // Normal equations; B₃ overlaps three neighbours, so the matrix has four diagonals.
    let mut diagonals = vec![[0.0_f64; 4]; n];
    let mut right = vec![0.0_f64; n];
    let from = (first - 2) as i32 * FIT_POINTS;
    let to = (last + 2) as i32 * FIT_POINTS;
    for point in from..=to {
        // Half a step off the knots, so that a kernel with a step at a knot is not sampled on it.
        let x = (f64::from(point) + 0.5) / f64::from(FIT_POINTS);
        let target = kernel.weight((x - centre) * knot_mm);
        let base = x.floor() as i64;
        for i in (base - 1).max(first)..=(base + 2).min(last) {
            let b = cubic_b_spline(x - i as f64);
            let row = (i - first) as usize;
            right[row] += b * target;
            for j in i..=(base + 2).min(last) {
                diagonals[row][(j - i) as usize] += b * cubic_b_spline(x - j as f64);
            }
        }
    }
    (first, solve_banded(diagonals, right))
}

/// Solves a symmetric positive definite system given by its diagonal and three upper diagonals
/// (Cholesky, in place).
fn solve_banded(mut a: Vec<[f64; 4]>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for i in 0..n {
        let pivot = a[i][0];
        for k in 1..4.min(n - i) {
            let factor = a[i][k] / pivot;
            for l in k..4 {
                a[i + k][l - k] -= factor * a[i][l];
            }
            b[i + k] -= factor * b[i];
        }
    }
    for i in (0..n).rev() {
        let known: f64 = (1..4.min(n - i)).map(|k| a[i][k] * b[i + k]).sum();
        b[i] = (b[i] - known) / a[i][0];
    }
    b
}

/// Taps for nodes every k pixels: the same for each node.
fn decimating(kernel: &AxisKernel, knot_mm: f64, k: u32) -> PhaseTaps {
    let k = i64::from(k);
    let mut weights = std::collections::BTreeMap::new();
    for phase in 0..k {
        let (first, coefficients) = fit_spline(kernel, knot_mm, phase as f64 / k as f64);
        // The pixel at phase/k knots contributes α[i] to node i; seen from a node, that pixel
        // lies at phase − k·i.
        for (i, alpha) in (first..).zip(coefficients) {
            weights.insert(phase - k * i, alpha);
        }
    }
    normalised(weights)
}

/// Taps for the nodes m ≡ phase (mod r), r nodes to the pixel.
fn interpolating(kernel: &AxisKernel, knot_mm: f64, r: u32, phase: u32) -> PhaseTaps {
    let (first, coefficients) = fit_spline(kernel, knot_mm, 0.0);
    let mut weights = std::collections::BTreeMap::new();
    for (i, alpha) in (first..).zip(coefficients) {
        // Pixel j = (m − i)/r; relative to the pixel at or before the node, (phase − i)/r.
        let distance = i64::from(phase) - i;
        if distance.rem_euclid(i64::from(r)) == 0 {
            weights.insert(distance.div_euclid(i64::from(r)), alpha);
        }
    }
    normalised(weights)
}

/// Scales to sum 1 and rounds, so that the chain of fused multiply-adds over ones ends in
/// exactly 1.
fn normalised(weights: std::collections::BTreeMap<i64, f64>) -> PhaseTaps {
    let total: f64 = weights.values().sum();
    let largest = weights.values().fold(0.0_f64, |a, x| a.max(x.abs()));
    // Tails of the fit far below f32's resolution of the sum would only cost time.
    let significant = |x: f64| x.abs() > 1e-7 * largest;
    let first = weights.iter().find(|(_, x)| significant(**x)).map_or(0, |(j, _)| *j);
    let last = weights.iter().rfind(|(_, x)| significant(**x)).map_or(0, |(j, _)| *j);
    let mut taps: Vec<f32> = (first..=last).map(|j| (weights.get(&j).copied().unwrap_or(0.0) / total) as f32).collect();
    // 1 − (sum so far) is exact near 1; in the outermost tap the change of weight is invisible.
    if let Some((outermost, others)) = taps.split_last_mut() {
        *outermost = 1.0 - others.iter().fold(0.0_f32, |sum, t| t.mul_add(1.0, sum));
    }
    PhaseTaps { first: first as i32, weights: taps }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::{Method, Support};

    fn kernel(sigma: f64, energy: f64) -> AxisKernel {
        AxisKernel::new(Method::Gaussian, sigma, Support::Energy(energy)).unwrap()
    }

    #[test]
    fn design_chooses_coarsest_step_within_limit() {
        for (sigma_px, expected) in
            [(0.75, Step::Up(3)), (1.5, Step::Down(1)), (4.6, Step::Down(3)), (10.0, Step::Down(7))]
        {
            let kernel = kernel(sigma_px, 1e-4);
            let taps = Taps::design(&kernel, 1.0).unwrap();
            assert!(taps.deviation <= AXIS_SHARE * DEVIATION_LIMIT, "{sigma_px}: {}", taps.deviation);
            assert_eq!(taps.step, expected, "σ = {sigma_px} pixels, deviation {}", taps.deviation);
            if let Step::Down(k) = taps.step {
                assert!(Taps::fit(&kernel, 1.0, Step::Down(k + 1)).deviation > AXIS_SHARE * DEVIATION_LIMIT);
            }
        }
    }

    #[test]
    fn taps_sum_to_exactly_one_in_filter_order() {
        for (sigma, energy) in [(0.6, 0.01), (0.75, 1e-4), (1.5, 1e-4), (3.7, 0.01), (20.0, 1e-3)] {
            for phase in &Taps::design(&kernel(sigma, energy), 1.0).unwrap().phases {
                assert_eq!(phase.weights.iter().fold(0.0_f32, |s, t| t.mul_add(1.0, s)), 1.0);
            }
        }
    }

    #[test]
    fn deviation_bounds_error_of_worst_image() {
        let kernel = kernel(4.6, 1e-4);
        let taps = Taps::design(&kernel, 1.0).unwrap();
        let mut worst = 0.0_f64;
        for step in 0..97 {
            let u = f64::from(step) * 0.031;
            let total: f64 = (-60..=60).map(|j| kernel.weight(u - f64::from(j))).sum();
            // Black where the actual kernel is too small, white where it is too large.
            let error: f64 = (-60..=60)
                .map(|j| taps.realised(i64::from(j), u) - kernel.weight(u - f64::from(j)) / total)
                .filter(|d| *d > 0.0)
                .sum();
            worst = worst.max(error);
        }
        assert!(worst > 0.0 && worst <= taps.deviation * 1.02, "{worst} against {}", taps.deviation);
    }

    #[test]
    fn actual_kernel_has_nominal_centre_and_width() {
        for sigma in [0.8, 1.5, 4.6] {
            let kernel = kernel(sigma, 1e-4);
            let taps = Taps::design(&kernel, 1.0).unwrap();
            for u in [0.0, 0.3, 0.5, 1.7] {
                let moments = (-60..=60).fold([0.0; 3], |[m0, m1, m2], j| {
                    let w = taps.realised(j, u);
                    let x = j as f64 - u;
                    [m0 + w, m1 + w * x, m2 + w * x * x]
                });
                assert!((moments[0] - 1.0).abs() < 1e-6, "{moments:?}");
                assert!((moments[1] / sigma).abs() < 2e-3, "{moments:?} at {u}");
                assert!((moments[2].sqrt() / kernel.sigma_effective_mm() - 1.0).abs() < 5e-3, "{moments:?} at {u}");
            }
        }
    }

    #[test]
    fn too_narrow_and_too_wide_kernels_refused() {
        assert!(matches!(Taps::design(&kernel(0.4, 0.01), 1.0), Err(SplineError::TooNarrow { .. })));
        assert!(matches!(Taps::design(&kernel(400.0, 0.01), 1.0), Err(SplineError::TooWide { .. })));
    }
}
