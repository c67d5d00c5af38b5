//! Statistics of spread, and of correlated numbers.

use serde::Serialize;

/// Spread of distances.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Spread {
    /// Number of values.
    pub count: usize,
    /// Their mean.
    pub mean: f64,
    /// Standard deviation about the mean.
    pub sd: f64,
    /// Root mean square.
    pub rms: f64,
    /// Median.
    pub median: f64,
    /// The largest.
    pub max: f64,
}

impl Spread {
    /// Summarises numbers of 0 or more; returns all 0 for none.
    pub fn of(numbers: impl IntoIterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = numbers.into_iter().collect();
        if sorted.is_empty() {
            return Self::default();
        }
        let count = sorted.len();
        let n = count as f64;
        let mean = sorted.iter().sum::<f64>() / n;
        let about = |centre: f64| (sorted.iter().map(|x| (x - centre) * (x - centre)).sum::<f64>() / n).sqrt();
        let (sd, rms) = (about(mean), about(0.0));
        sorted.sort_by(f64::total_cmp);
        let median = 0.5 * (sorted[(count - 1) / 2] + sorted[count / 2]);
        Self { count, mean, sd, rms, median, max: sorted[count - 1] }
    }
}

/// Returns the median; 0 for no values. Reorders the values.
pub fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let (middle, is_odd) = (values.len() / 2, values.len() % 2 == 1);
    let (low, at, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    let at = *at;
    if is_odd {
        return at;
    }
    let below = low.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    0.5 * (below + at)
}

/// Factor from the median distance to the standard deviation of a normal distribution.
const NORMAL: f64 = 1.482_602_218_505_602;

/// Returns the standard deviation about 0 of normally distributed values with a few outliers.
/// Replaces the values by their distances.
pub fn deviation_about_zero(values: &mut [f64]) -> f64 {
    values.iter_mut().for_each(|x| *x = x.abs());
    NORMAL * median(values)
}

/// Variance of grey values that are constant: that of rounding.
const CONSTANT: f64 = 0.1;

/// Returns the correlation of pairs of grey values; `None` if one of both is constant.
pub(crate) fn correlation(pairs: impl Iterator<Item = [f64; 2]> + Clone) -> Option<f64> {
    let count = pairs.clone().count() as f64;
    let mean = |of: &dyn Fn([f64; 2]) -> f64| pairs.clone().map(of).sum::<f64>() / count;
    let [x, y] = [mean(&|[a, _]| a), mean(&|[_, b]| b)];
    let [xx, yy] = [mean(&|[a, _]| (a - x) * (a - x)), mean(&|[_, b]| (b - y) * (b - y))];
    (xx > CONSTANT && yy > CONSTANT).then(|| mean(&|[a, b]| (a - x) * (b - y)) / (xx * yy).sqrt())
}

/// Returns the number of values after which the next one is independent: 1 + 2·Σ of the
/// autocorrelation, up to the first value that chance explains (Sokal, *Monte Carlo Methods in
/// Statistical Mechanics*, 1989). The mean of n such values is as accurate as that of n over
/// this many independent ones. At least 1.
pub fn correlation_length(numbers: &[f64]) -> f64 {
    let n = numbers.len();
    let mean = numbers.iter().sum::<f64>() / n.max(1) as f64;
    let product = |lag: usize| numbers.iter().zip(&numbers[lag..]).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>();
    let variance = product(0);
    if variance <= 0.0 {
        return 1.0;
    }
    let chance = 2.0 / (n as f64).sqrt();
    let lags = (1..n / 2).map(|lag| product(lag) / variance).take_while(|correlation| *correlation > chance);
    1.0 + 2.0 * lags.sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::noise::Noise;

    #[test]
    fn spread_matches_hand_computed_values() {
        let spread = Spread::of([3.0, 1.0, 2.0, 6.0]);
        assert_eq!((spread.count, spread.mean, spread.median, spread.max), (4, 3.0, 2.5, 6.0));
        assert!((spread.sd - 3.5_f64.sqrt()).abs() < 1e-15 && (spread.rms - 12.5_f64.sqrt()).abs() < 1e-15);
        assert_eq!(Spread::of([]), Spread::default());
    }

    #[test]
    fn median_handles_even_and_odd_counts() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), 2.5);
        assert_eq!(median(&mut []), 0.0);
    }

    #[test]
    fn correlation_needs_values_that_vary() {
        let line = [[1.0, 5.0], [2.0, 3.0], [3.0, 1.0]];
        assert!((correlation(line.into_iter()).unwrap() + 1.0).abs() < 1e-15);
        assert!((correlation([[0.0, 0.0], [1.0, 2.0], [2.0, 1.0]].into_iter()).unwrap() - 0.5).abs() < 1e-15);
        assert_eq!(correlation(line.into_iter().map(|[x, _]| [x, 7.0])), None);
        assert_eq!(correlation(std::iter::empty()), None);
    }

    #[test]
    fn outlier_does_not_move_deviation() {
        assert!((deviation_about_zero(&mut [-1.0, 1.0, 0.5, -0.5, 1e9]) - NORMAL).abs() < 1e-12);
    }

    /// An autoregressive series with factor a has (1 + a)/(1 − a).
    #[test]
    fn correlation_length_matches_process() {
        let mut random = Noise::new(1);
        for factor in [0.0, 0.5, 0.9] {
            let mut last = 0.0;
            let mut next = || {
                last = factor * last + random.normal();
                last
            };
            let row: Vec<f64> = (0..20_000).map(|_| next()).collect();
            let expected = (1.0 + factor) / (1.0 - factor);
            let found = correlation_length(&row);
            assert!((found / expected - 1.0).abs() < 0.15, "{factor}: {found} of {expected}");
        }
        assert_eq!(correlation_length(&[]), 1.0);
        assert_eq!(correlation_length(&[2.0; 50]), 1.0);
    }
}
