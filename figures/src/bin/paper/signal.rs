//! The paper's one-dimensional experiment (figures 6 and 7): a sum of Gaussians, sampled at
//! irregular distances and reconstructed. Lengths are in σ.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use reconstruct::kernel::{AxisKernel, KernelError, Method, Support};

/// Samples drawn, and those in the middle that are shown and measured: 52 and 26 in the paper.
pub(crate) const SAMPLES: usize = 52;
pub(crate) const SHOWN: std::ops::Range<usize> = 13..39;
/// Distance over which slopes are taken. A step of height s adds s²/h to a squared slope's
/// integral: a smaller distance makes truncated kernels look worse.
pub(crate) const SLOPE_OVER: f64 = 0.05;

/// Centre, height and standard deviation of the signal's parts; the shown samples lie from about
/// 10 to 29.
const PARTS: [[f64; 3]; 6] =
    [[3.0, 0.6, 1.0], [12.0, 0.9, 0.9], [16.0, 0.6, 0.6], [20.5, 1.0, 1.1], [25.5, 0.8, 0.7], [32.0, 0.8, 1.2]];

/// Returns the signal after blurring with a Gaussian of standard deviation `blur`.
pub(crate) fn signal(x: f64, blur: f64) -> f64 {
    PARTS
        .iter()
        .map(|[centre, height, width]| {
            let wide = width.hypot(blur);
            height * width / wide * (-0.5 * ((x - centre) / wide).powi(2)).exp()
        })
        .sum()
}

/// Returns the sample positions: gaps of (1 + random)/2, like freehand motion.
pub(crate) fn positions(seed: u64) -> Vec<f64> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut at = 0.0;
    (0..SAMPLES)
        .map(|_| {
            let random = (generator.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
            at += 0.5 * (1.0 + random);
            at
        })
        .collect()
}

/// Returns a kernel of σ 1, truncated by `energy`; without it, as far as f64 resolves.
pub(crate) fn kernel(method: Method, energy: Option<f64>) -> Result<AxisKernel, KernelError> {
    AxisKernel::new(method, 1.0, Support::Energy(energy.unwrap_or(1e-15)))
}

/// Samples and the kernel that reconstructs the signal.
pub(crate) struct SampledSignal {
    pub(crate) at: Vec<f64>,
    pub(crate) kernel: AxisKernel,
}

impl SampledSignal {
    /// Returns Σ weight·value and Σ weight.
    pub(crate) fn sums(&self, x: f64) -> [f64; 2] {
        self.at.iter().fold([0.0; 2], |[r, w], at| {
            let g = self.kernel.weight(x - at);
            [r + g * signal(*at, 0.0), w + g]
        })
    }

    pub(crate) fn value(&self, x: f64) -> f64 {
        let [r, w] = self.sums(x);
        r / w
    }

    pub(crate) fn slope(&self, x: f64) -> f64 {
        (self.value(x + 0.5 * SLOPE_OVER) - self.value(x - 0.5 * SLOPE_OVER)) / SLOPE_OVER
    }

    /// Returns the range of the shown samples.
    pub(crate) fn stretch(&self) -> [f64; 2] {
        [self.at[SHOWN.start], self.at[SHOWN.end - 1]]
    }

    /// Returns the largest step of the result at which a sample enters or leaves the support.
    pub(crate) fn largest_step(&self) -> f64 {
        let [low, high] = self.stretch();
        let end = self.kernel.weight(self.kernel.support_mm);
        let mut largest = 0.0_f64;
        for (j, at) in self.at.iter().enumerate() {
            for x in [at - self.kernel.support_mm, at + self.kernel.support_mm] {
                if !(low..=high).contains(&x) {
                    continue;
                }
                let [mut r, mut w] = [0.0; 2];
                for (other, _) in self.at.iter().zip(0..).filter(|(_, k)| *k != j) {
                    let g = self.kernel.weight(x - other);
                    (r, w) = (r + g * signal(*other, 0.0), w + g);
                }
                largest = largest.max(((r + end * signal(*at, 0.0)) / (w + end) - r / w).abs());
            }
        }
        largest
    }

    /// Returns the errors relative to the signal blurred by the kernel's effective width.
    pub(crate) fn errors(&self) -> Errors {
        let blur = self.kernel.sigma_effective_mm();
        let [low, high] = self.stretch();
        let count = ((high - low) / (0.5 * SLOPE_OVER)).floor() as u32;
        let (mut value, mut slope) = (0.0, 0.0);
        for i in 0..=count {
            let x = low + f64::from(i) * 0.5 * SLOPE_OVER;
            let truth = (signal(x + 0.5 * SLOPE_OVER, blur) - signal(x - 0.5 * SLOPE_OVER, blur)) / SLOPE_OVER;
            value += (self.value(x) - signal(x, blur)).powi(2);
            slope += (self.slope(x) - truth).powi(2);
        }
        let mean = |sum: f64| (sum / f64::from(count + 1)).sqrt();
        Errors { value: mean(value), slope: mean(slope), step: self.largest_step() }
    }
}

/// Root mean square errors of value and slope, and the largest step; the signal's height is
/// about 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Errors {
    pub(crate) value: f64,
    pub(crate) slope: f64,
    pub(crate) step: f64,
}

/// Returns the median of an error over draws of positions.
pub(crate) fn median(draws: &[Errors], of: fn(&Errors) -> f64) -> f64 {
    let mut values: Vec<f64> = draws.iter().map(of).collect();
    values.sort_by(f64::total_cmp);
    let n = values.len();
    if n == 0 { f64::NAN } else { 0.5 * (values[(n - 1) / 2] + values[n / 2]) }
}

/// Returns the errors of a kernel over draws of positions.
pub(crate) fn over_draws(kernel: AxisKernel, draws: u64) -> Vec<Errors> {
    (0..draws).map(|seed| SampledSignal { at: positions(seed), kernel }.errors()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_between_half_and_one_and_reproducible() {
        let at = positions(3);
        assert_eq!(at.len(), SAMPLES);
        assert!(at.windows(2).all(|p| (0.5..1.0).contains(&(p[1] - p[0]))));
        assert_eq!(at, positions(3));
        assert_ne!(at, positions(4));
    }

    #[test]
    fn blurred_signal_equals_convolution() {
        for x in [9.0, 14.2, 23.0] {
            let h = 0.01;
            let sum: f64 = (-800..=800)
                .map(|i| f64::from(i) * h)
                .map(|t| signal(x - t, 0.0) * (-0.5 * t * t).exp() * h / (2.0 * std::f64::consts::PI).sqrt())
                .sum();
            assert!((sum - signal(x, 1.0)).abs() < 1e-10);
        }
    }

    #[test]
    fn largest_step_matches_values_and_vanishes_without_pedestal() {
        let cut = SampledSignal { at: positions(1), kernel: kernel(Method::GaussianTruncated, Some(0.1)).unwrap() };
        let seen = cut
            .at
            .iter()
            .flat_map(|at| [at - cut.kernel.support_mm, at + cut.kernel.support_mm])
            .filter(|x| (cut.stretch()[0]..=cut.stretch()[1]).contains(x))
            .map(|x| (cut.value(x + 1e-9) - cut.value(x - 1e-9)).abs())
            .fold(0.0, f64::max);
        assert!((seen - cut.largest_step()).abs() < 1e-6, "{seen} {}", cut.largest_step());
        let lowered = SampledSignal { at: positions(1), kernel: kernel(Method::Gaussian, Some(0.1)).unwrap() };
        assert!(lowered.largest_step() < 1e-15);
    }
}
