//! Numbers that fall to 0.

/// Returns the numbers of 0 or more, none of which exceeds the one before, that are nearest to
/// others by weighted squares (Ayer et al., 1955). Neighbours that rise become their mean.
pub(super) fn falling(values: &[f64], weights: &[f64]) -> Vec<f64> {
    // Mean, weight and number of each block.
    let mut blocks: Vec<(f64, f64, usize)> = Vec::new();
    for (value, weight) in values.iter().zip(weights) {
        let mut last = (*value, *weight, 1);
        while let Some((mean, sum, count)) = blocks.pop_if(|(mean, ..)| *mean < last.0) {
            let both = sum + last.1;
            last = ((mean * sum + last.0 * last.1) / both, both, count + last.2);
        }
        blocks.push(last);
    }
    blocks.iter().flat_map(|(mean, _, count)| std::iter::repeat_n(mean.max(0.0), *count)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::noise::Noise;

    #[test]
    fn rising_neighbours_become_their_weighted_mean() {
        assert_eq!(falling(&[3.0, 1.0, 2.0, 0.5], &[1.0; 4]), [3.0, 1.5, 1.5, 0.5]);
        assert_eq!(falling(&[3.0, 1.0, 2.0, 0.5], &[1.0, 3.0, 1.0, 1.0]), [3.0, 1.25, 1.25, 0.5]);
        assert_eq!(falling(&[1.0, 2.0, 6.0], &[1.0; 3]), [3.0; 3]);
        assert_eq!(falling(&[-1.0, -3.0], &[1.0; 2]), [0.0; 2]);
        assert_eq!(falling(&[], &[]), []);
    }

    /// No small change within the constraints comes nearer.
    #[test]
    fn no_other_falling_numbers_are_nearer() {
        let mut random = Noise::new(4);
        for _ in 0..50 {
            let values: Vec<f64> = (0..8).map(|k| 1.0 - 0.2 * f64::from(k) + 0.5 * random.normal()).collect();
            let weights: Vec<f64> = (0..8).map(|_| random.between(0.2, 2.0)).collect();
            let cost = |fit: &[f64]| -> f64 {
                fit.iter().zip(&values).zip(&weights).map(|((x, value), weight)| weight * (x - value).powi(2)).sum()
            };
            let best = falling(&values, &weights);
            assert!(best.windows(2).all(|pair| pair[0] >= pair[1]) && best[7] >= 0.0, "{best:?}");
            for _ in 0..200 {
                let mut other: Vec<f64> = best.iter().map(|x| (x + 0.05 * random.normal()).max(0.0)).collect();
                other.sort_by(|a, b| b.total_cmp(a));
                assert!(cost(&other) >= cost(&best) - 1e-12, "{other:?} {best:?}");
            }
        }
    }
}
