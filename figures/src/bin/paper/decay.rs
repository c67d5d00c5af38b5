//! Four decay rules for old data, on a line of voxels in f64: what each shows of a moving
//! object, and where. Lengths are in σ.
//!
//! A rule is applied when a slice reaches a voxel, and to no other voxel; the age of a voxel is
//! the time since a slice last reached it. For the reconstructor's result of the same slices,
//! see [`decay_reconstructed`](crate::decay_reconstructed).

use reconstruct::kernel::{AxisKernel, KernelError, Method, Support};

/// Distance of slices.
pub(crate) const GAP: f64 = 0.75;
/// Slices per second.
pub(crate) const RATE_HZ: f64 = 30.0;
/// Speed of a sweep, σ/s.
pub(crate) const SPEED: f64 = GAP * RATE_HZ;

/// Update of a voxel's sums r and w when a slice adds S and W.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Rule {
    /// r + S: nothing fades.
    None,
    /// d·r + S with d = exp(−a·age).
    Exponential { rate: f64 },
    /// The same with d = 1 until the wait is over.
    DeadTime { rate: f64, wait: f64 },
    /// d·r + (1 − d)·S as the paper prints it, with d = 0 for unseen voxels.
    Printed { rate: f64, wait: f64 },
}

impl Rule {
    /// Returns the factors of the old and of the new sums for an age in seconds; `None` is an
    /// unseen voxel.
    pub(crate) fn factors(self, age: Option<f64>) -> [f64; 2] {
        let fade = |rate: f64, wait: f64| age.map_or(0.0, |age| (-rate * (age - wait).max(0.0)).exp());
        match self {
            Self::None => [1.0, 1.0],
            Self::Exponential { rate } => [fade(rate, 0.0), 1.0],
            Self::DeadTime { rate, wait } => [fade(rate, wait), 1.0],
            Self::Printed { rate, wait } => [fade(rate, wait), 1.0 - fade(rate, wait)],
        }
    }
}

/// A slice: its position, time (seconds) and value.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) at: f64,
    pub(crate) time: f64,
    pub(crate) value: f64,
}

/// Voxels on a line.
pub(crate) struct Voxels {
    pub(crate) at: Vec<f64>,
    r: Vec<f64>,
    w: Vec<f64>,
    touched: Vec<Option<f64>>,
    kernel: AxisKernel,
}

/// Returns the paper's kernel: σ 1, truncated at E_e = .01.
pub(crate) fn kernel() -> Result<AxisKernel, KernelError> {
    AxisKernel::new(Method::GaussianTruncated, 1.0, Support::Energy(0.01))
}

/// Returns a wait after which a sweep has passed every voxel that it reaches.
pub(crate) fn long_wait(kernel: &AxisKernel) -> f64 {
    2.0 * kernel.support_mm / SPEED
}

impl Voxels {
    pub(crate) fn new(at: Vec<f64>, kernel: AxisKernel) -> Self {
        let n = at.len();
        Self { at, r: vec![0.0; n], w: vec![0.0; n], touched: vec![None; n], kernel }
    }

    pub(crate) fn insert(&mut self, sample: Sample, rule: Rule) {
        for (i, at) in self.at.iter().enumerate() {
            let g = self.kernel.weight(sample.at - at);
            if g <= 0.0 {
                continue;
            }
            // Clocks that step back must not amplify.
            let [old, new] = rule.factors(self.touched[i].map(|t| (sample.time - t).max(0.0)));
            self.r[i] = old * self.r[i] + new * g * sample.value;
            self.w[i] = old * self.w[i] + new * g;
            self.touched[i] = Some(sample.time);
        }
    }

    /// Returns the weighted mean at each voxel; `None` without weight.
    pub(crate) fn values(&self) -> Vec<Option<f64>> {
        self.r.iter().zip(&self.w).map(|(r, w)| (*w > 0.0).then(|| r / w)).collect()
    }
}

/// Returns slices from `from` to `to`, the first at `start` seconds; `object` is a function of
/// position and time.
pub(crate) fn sweep(from: f64, to: f64, start: f64, object: impl Fn(f64, f64) -> f64) -> Vec<Sample> {
    let count = ((to - from).abs() / GAP).round() as u32;
    (0..=count)
        .map(|i| {
            let at = from + (to - from) * f64::from(i) / f64::from(count);
            let time = start + f64::from(i) / RATE_HZ;
            Sample { at, time, value: object(at, time) }
        })
        .collect()
}

/// Returns the voxels in the middle of a sweep, and its slices. The object's value is its
/// position, so that a voxel shows the position of its data.
pub(crate) fn ramp() -> (Vec<f64>, Vec<Sample>) {
    let voxels = (0..60).map(|i| 12.0 + GAP * (f64::from(i) + 0.5) / 10.0).collect();
    (voxels, sweep(0.0, 30.0, 0.0, |at, _| at))
}

/// Returns the mean displacement of the data that voxels show, along the sweep of [`ramp`]:
/// positive is later in it.
pub(crate) fn mean_shift(at: &[f64], values: &[Option<f64>]) -> f64 {
    let shifts: Vec<f64> = values.iter().zip(at).filter_map(|(v, at)| Some((*v)? - at)).collect();
    shifts.iter().sum::<f64>() / shifts.len() as f64
}

/// Returns [`mean_shift`] of a rule.
pub(crate) fn shift(rule: Rule, kernel: AxisKernel) -> f64 {
    let (voxels, samples) = ramp();
    let mut line = Voxels::new(voxels, kernel);
    samples.into_iter().for_each(|sample| line.insert(sample, rule));
    mean_shift(&line.at, &line.values())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_decay_and_long_wait_have_no_shift() {
        let kernel = kernel().unwrap();
        assert!(shift(Rule::None, kernel).abs() < 1e-3);
        for rate in [1.0, 10.0, 1000.0] {
            let waiting = shift(Rule::DeadTime { rate, wait: long_wait(&kernel) }, kernel);
            assert_eq!(waiting, shift(Rule::None, kernel), "{rate}");
        }
    }

    #[test]
    fn slow_decay_shifts_by_rate_times_variance_over_speed() {
        let kernel = kernel().unwrap();
        for rate in [0.1, 1.0, 3.0] {
            let expected = rate * kernel.sigma_effective_mm().powi(2) / SPEED;
            let found = shift(Rule::Exponential { rate }, kernel);
            assert!((found / expected - 1.0).abs() < 0.1, "{rate}: {found} for {expected}");
        }
    }

    #[test]
    fn printed_formula_shows_earlier_positions() {
        let kernel = kernel().unwrap();
        for rate in [0.01, 1.0] {
            assert!(shift(Rule::Printed { rate, wait: 0.0 }, kernel) < -0.5);
        }
        assert!(
            shift(Rule::Printed { rate: 1.0, wait: long_wait(&kernel) }, kernel) < -1.9,
            "only the first sample stays"
        );
    }

    #[test]
    fn unreached_voxel_is_empty_and_equal_times_do_not_decay() {
        let mut line = Voxels::new(vec![0.0, 50.0], kernel().unwrap());
        let sample = Sample { at: 0.2, time: 1.0, value: 7.0 };
        let rule = Rule::Exponential { rate: 5.0 };
        line.insert(sample, rule);
        line.insert(sample, rule);
        line.insert(Sample { time: 0.5, ..sample }, rule);
        assert_eq!(line.values()[1], None);
        assert!((line.values()[0].unwrap() - 7.0).abs() < 1e-12);
        assert!((line.w[0] - 3.0 * line.kernel.weight(0.2)).abs() < 1e-12);
    }
}
