//! Logarithm and exponential in single precision, of one number or of sixteen lanes with the
//! same bits.
//!
//! The correction of opacity for the step length needs both. Near 0 their relative error is
//! small, not only the absolute one. [`Number`](super::real::Number) gives their domains.

use simd::POWER_OF_TWO;

use super::real::Single;

/// 2 / ((2k + 1) ln 2) for k = 4 to 0: log₂ m = Σ cₖ s²ᵏ⁺¹ for s = (m − 1)/(m + 1). At √½ ≤ m <
/// √2, |s| ≤ 0.172 and the first term left out is below 2e-9 of the sum.
const LOG2: [f32; 5] = [0.320_598_9, 0.412_198_57, 0.577_078, 0.961_796_7, 2.885_39];

/// Returns log₂(1 + x), relative error at most 3e-7.
#[inline(always)]
pub(super) fn log2_1p<T: Single>(x: T) -> T {
    let (mantissa, exponent) = (T::one() + x).mantissa_and_exponent();
    // If the exponent is 0, x itself is more accurate than (1 + x) − 1.
    let whole = T::select(exponent.abs().le(T::zero()), x, mantissa - T::one());
    let s = whole / (whole + T::splat(2.0));
    let square = s * s;
    let mut sum = T::splat(LOG2[0]);
    for c in &LOG2[1..] {
        sum = sum.mul_add(square, T::splat(*c));
    }
    sum.mul_add(s, exponent)
}

/// Returns 2ˣ − 1, relative error at most 3e-7.
#[inline(always)]
pub(super) fn exp2_m1<T: Single>(x: T) -> T {
    // 2ˣ is negligible compared with 1 long before x falls to this limit.
    let x = x.max(T::splat(-125.0));
    let n = x.round_ties_even();
    let f = x - n;
    let mut sum = T::splat(POWER_OF_TWO[0]);
    for c in &POWER_OF_TWO[1..] {
        sum = sum.mul_add(f, T::splat(*c));
    }
    // 2ⁿ (2ᶠ − 1) + (2ⁿ − 1): the first bracket is computed without cancellation.
    let scale = T::one().scale_by_power_of_two(n);
    scale.mul_add(sum * f, scale - T::one())
}

#[cfg(test)]
mod tests {
    use super::super::real::Number;
    use super::*;

    #[test]
    fn single_precision_log_exp_stays_near_double() {
        let (mut log, mut power) = (0.0_f64, 0.0_f64);
        for step in 0..4000_u16 {
            // From 1e-36 to the last number below 1.
            let x = -libm::pow(10.0, -36.0 + f64::from(step) * 0.009) as f32;
            let x = x.max(-1.0_f32.next_down());
            log = log.max((f64::from(log2_1p(x)) / Number::log2_1p(f64::from(x)) - 1.0).abs());
            // Down to the exponent at which all but 1e-38 is gone.
            for x in [x, 126.0 * x] {
                power = power.max((f64::from(exp2_m1(x)) / Number::exp2_m1(f64::from(x)) - 1.0).abs());
            }
        }
        assert!(log < 3e-7 && power < 3e-7, "{log} {power}");
    }

    #[test]
    fn domain_ends_are_exact() {
        assert_eq!(log2_1p(0.0_f32), 0.0);
        assert_eq!(log2_1p(-0.5_f32), -1.0);
        assert_eq!(log2_1p(-0.875_f32), -3.0);
        for (x, expected) in [(0.0_f32, 0.0), (-1.0, -0.5), (-3.0, -0.875), (-1e30, -1.0), (f32::NEG_INFINITY, -1.0)] {
            assert_eq!(exp2_m1(x), expected);
        }
    }

    #[test]
    fn double_precision_matches_series_in_base_two() {
        // x − x²/2 and x + x²/2 in base e; the next term is below 1e-24.
        let x = -1e-8;
        let log = (x - 0.5 * x * x) / std::f64::consts::LN_2;
        let y = x * std::f64::consts::LN_2;
        assert!((Number::log2_1p(x) / log - 1.0).abs() < 1e-15);
        assert!((Number::exp2_m1(x) / (y + 0.5 * y * y) - 1.0).abs() < 1e-15);
    }
}
