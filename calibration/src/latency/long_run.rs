//! Variance of a sum of correlated values.

/// Returns the variance of a sum of values that correlate with their neighbours.
pub(super) fn variance_of_sum(values: &[f64]) -> f64 {
    let at = |lag: usize| values.iter().zip(&values[lag.min(values.len())..]).map(|(a, b)| a * b).sum::<f64>();
    let alone = at(0);
    if !(alone > 0.0) {
        return 0.0;
    }
    let n = values.len() as f64;
    // Corrects Kendall's bias of the estimated first autocorrelation.
    let first = (at(1) / alone).clamp(-0.95, 0.95);
    let first = (first + (1.0 + 3.0 * first) / n).clamp(-0.95, 0.95);
    let alpha = 4.0 * first * first / (1.0 - first).powi(4);
    let width = (2.6614 * (alpha * n).powf(0.2)).clamp(1.0, 0.25 * n);
    let parzen = |x: f64| match x {
        x if x <= 0.5 => 1.0 - 6.0 * x * x + 6.0 * x * x * x,
        x if x < 1.0 => 2.0 * (1.0 - x).powi(3),
        _ => 0.0,
    };
    let beside: f64 = (1..values.len())
        .map_while(|lag| {
            let share = parzen(lag as f64 / width);
            (share > 0.0).then(|| 2.0 * share * at(lag))
        })
        .sum();
    (alone + beside).max(0.1 * alone)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::noise::Noise as Random;

    /// Sums of 300 values with correlation a from one to the next have n·(1 + a)/(1 − a) times
    /// the variance of one value.
    #[test]
    fn correlated_values_have_larger_sum() {
        for (goes_on, expected) in [(0.0_f64, 1.0), (0.5, 3.0), (-0.4, 0.43)] {
            let mut mean = 0.0;
            for seed in 0..200 {
                let mut random = Random::new(seed);
                let mut value = random.normal();
                let values: Vec<f64> = (0..300)
                    .map(|_| {
                        value = goes_on * value + (1.0 - goes_on * goes_on).sqrt() * random.normal();
                        value
                    })
                    .collect();
                mean += variance_of_sum(&values) / (200.0 * 300.0);
            }
            assert!((mean / expected - 1.0).abs() < 0.2, "{goes_on}: {mean} for {expected}");
        }
        assert_eq!(variance_of_sum(&[0.0; 9]), 0.0);
    }
}
