//! Elementary functions made of IEEE 754 additions, products, quotients and square roots only.
//!
//! The standard library uses the platform's `exp`, `ln` and `sin`, which differ in the last bit
//! between machines. A phantom drawn from a seed must have the same bits everywhere, so it uses
//! these functions. All are accurate to a few units in the last place of a double over the
//! ranges that phantoms need. The tests compare them with the platform's.

// Constants have the digits of their source, of which a double may keep fewer.
#![allow(clippy::excessive_precision)]

use std::f64::consts::{FRAC_2_SQRT_PI, LN_2, SQRT_2};

/// Beyond this many σ an error function is 0 or 1 to 16 digits.
pub(super) const EDGE_REACH: f64 = 8.3;

/// eˣ; 0 below −708 (where doubles become subnormal), infinite above 709.
pub(super) fn exp(x: f64) -> f64 {
    if x < -708.0 {
        return 0.0;
    }
    if x > 709.0 {
        return f64::INFINITY;
    }
    // ln 2 in two parts (Cody and Waite), so that the reduced argument keeps its low bits.
    const LN_2_HIGH: f64 = 6.931_471_803_691_238_164_90e-1;
    const LN_2_LOW: f64 = 1.908_214_929_270_587_700_02e-10;
    let k = (x / LN_2 + 0.5).floor();
    let r = (x - k * LN_2_HIGH) - k * LN_2_LOW;
    // Taylor: the first omitted term is r¹⁴/14! < 5e-18 for |r| ≤ ln 2 / 2.
    let mut sum = 1.0;
    for n in (1..=13).rev() {
        sum = 1.0 + sum * r / f64::from(n);
    }
    sum * power_of_two(k as i64)
}

/// 2ᵏ for −1022 ≤ k ≤ 1023.
fn power_of_two(k: i64) -> f64 {
    f64::from_bits(((k + 1023) as u64) << 52)
}

/// Natural logarithm of a normal positive double.
pub(super) fn ln(x: f64) -> f64 {
    debug_assert!(x.is_normal() && x > 0.0, "ln of {x}");
    let bits = x.to_bits();
    let mut exponent = ((bits >> 52) & 0x7ff) as i32 - 1023;
    let mut mantissa = f64::from_bits((bits & 0x000f_ffff_ffff_ffff) | 0x3ff0_0000_0000_0000);
    if mantissa > SQRT_2 {
        mantissa *= 0.5;
        exponent += 1;
    }
    // ln m = 2 artanh s; |s| ≤ 0.1716, so that s²⁴ is below 1e-18.
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let s2 = s * s;
    let mut sum = 0.0;
    for n in (0..=11).rev() {
        sum = sum * s2 + 1.0 / f64::from(2 * n + 1);
    }
    f64::from(exponent) * LN_2 + 2.0 * s * sum
}

/// Sine and cosine of an angle in radians, |angle| ≤ 2π.
pub(super) fn sin_cos(angle: f64) -> (f64, f64) {
    // An eighth of the angle is below 0.8, for which nine terms more than suffice; three
    // doublings restore it.
    let x = angle * 0.125;
    let x2 = x * x;
    let (mut s, mut c) = (1.0, 1.0);
    for n in (1..=9).rev() {
        let n = f64::from(2 * n);
        s = 1.0 - s * x2 / (n * (n + 1.0));
        c = 1.0 - c * x2 / ((n - 1.0) * n);
    }
    s *= x;
    for _ in 0..3 {
        (s, c) = (2.0 * s * c, (c - s) * (c + s));
    }
    // Doubling changes the length by a few rounding errors; a rotation should not.
    let length = (s * s + c * c).sqrt();
    (s / length, c / length)
}

/// Sine and cosine of an angle in radians, |angle| ≤ 3e6.
///
/// Whole turns are subtracted with 2π in three parts of 33 bits, so that the rest keeps its low
/// bits (Cody and Waite). The parts are four times those of π/2 in fdlibm's `e_rem_pio2.c`.
pub(super) fn sin_cos_of_any(angle: f64) -> (f64, f64) {
    debug_assert!(angle.abs() <= 3e6, "an angle of {angle}");
    const TURN: [f64; 3] = [
        4.0 * 1.570_796_326_734_125_614_17,
        4.0 * 6.077_100_506_303_965_976_60e-11,
        4.0 * 2.022_266_248_795_950_631_54e-21,
    ];
    let turns = (angle / std::f64::consts::TAU + 0.5).floor();
    sin_cos(((angle - turns * TURN[0]) - turns * TURN[1]) - turns * TURN[2])
}

/// The error function, to 1e-15 absolute.
pub(super) fn erf(x: f64) -> f64 {
    let a = x.abs();
    let value = if a > 6.0 {
        1.0
    } else if a < 2.5 {
        // 2/√π e^{−a²} Σ 2ⁿ a²ⁿ⁺¹ / (2n+1)!! (Abramowitz and Stegun 7.1.6): all terms are
        // positive, so nothing cancels.
        let mut term = a;
        let mut sum = a;
        let mut n = 0.0;
        while term > 1e-17 * sum {
            n += 1.0;
            term *= 2.0 * a * a / (2.0 * n + 1.0);
            sum += term;
        }
        FRAC_2_SQRT_PI * exp(-a * a) * sum
    } else {
        // Continued fraction of erfc (Abramowitz and Stegun 7.1.14), from its tail; 60 levels
        // suffice from 2.5 on.
        let mut tail = a;
        for n in (1..=60).rev() {
            tail = a + 0.5 * f64::from(n) / tail;
        }
        1.0 - 0.5 * FRAC_2_SQRT_PI * exp(-a * a) / tail
    };
    if x < 0.0 { -value } else { value }
}

/// The normal distribution's cumulative function Φ(x).
pub(super) fn normal_cdf(x: f64) -> f64 {
    0.5 * (1.0 + erf(x / SQRT_2))
}

/// The normal distribution's quantile, for 0 < p < 1; relative error about 1e-7.
///
/// Wichura, "Algorithm AS 241: the percentage points of the normal distribution", Applied
/// Statistics 37 (1988), routine PPND7.
pub(super) fn normal_quantile(p: f64) -> f64 {
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180625 - q * q;
        let top = ((59.109374720 * r + 159.29113202) * r + 50.434271938) * r + 3.3871327179;
        let bottom = ((67.187563600 * r + 78.757757664) * r + 17.895169469) * r + 1.0;
        return q * top / bottom;
    }
    let r = (-ln(if q < 0.0 { p } else { 1.0 - p })).sqrt();
    let size = if r <= 5.0 {
        let r = r - 1.6;
        let top = ((0.17023821103 * r + 1.3067284816) * r + 2.7568153900) * r + 1.4234372777;
        top / ((0.12021132975 * r + 0.73700164250) * r + 1.0)
    } else {
        let r = r - 5.0;
        let top = ((0.017337203997 * r + 0.42868294337) * r + 3.0812263860) * r + 6.6579051150;
        top / ((0.012258202635 * r + 0.24197894225) * r + 1.0)
    };
    if q < 0.0 { -size } else { size }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_ln_and_sin_cos_match_platform() {
        for k in -70_000..=70_000 {
            let x = f64::from(k) * 1e-2;
            assert!((exp(x) / x.exp() - 1.0).abs() < 2e-15, "exp {x}");
            let y = x.exp();
            assert!((ln(y) - y.ln()).abs() <= 1e-15 * y.ln().abs().max(1.0), "ln {y}");
            let angle = x / 700.0 * std::f64::consts::TAU;
            let (s, c) = sin_cos(angle);
            assert!((s - angle.sin()).abs() < 4e-15 && (c - angle.cos()).abs() < 4e-15, "sin_cos {angle}");
        }
        assert_eq!(exp(-1000.0), 0.0);
        assert_eq!(exp(0.0), 1.0);
    }

    #[test]
    fn sin_cos_of_many_turns_keeps_accuracy() {
        for k in -60_000..=60_000 {
            // Small angles, large ones, and ones next to whole turns.
            let k = f64::from(k);
            for angle in [k * 1e-3, k * 49.7, k * std::f64::consts::TAU] {
                let (s, c) = sin_cos_of_any(angle);
                assert!((s - angle.sin()).abs() < 4e-15 && (c - angle.cos()).abs() < 4e-15, "{angle}");
            }
        }
    }

    #[test]
    fn erf_matches_tabulated_values() {
        // Abramowitz and Stegun, table 7.1, and erfc(3), erfc(5) from table 7.3.
        for (x, expected) in [
            (0.0, 0.0),
            (0.1, 0.112_462_916_0),
            (0.5, 0.520_499_877_8),
            (1.0, 0.842_700_792_9),
            (2.0, 0.995_322_265_0),
            (3.0, 1.0 - 2.209_049_699_858_544e-5),
            (5.0, 1.0 - 1.537_459_794_428e-12),
        ] {
            assert!((erf(x) - expected).abs() < 6e-11, "erf {x} = {}", erf(x));
            assert_eq!(erf(-x), -erf(x));
        }
        // The two branches meet.
        assert!((erf(2.5 - 1e-9) - erf(2.5)).abs() < 1e-11);
    }

    #[test]
    fn quantile_inverts_the_cumulative_function() {
        for k in 1..20_000 {
            let p = f64::from(k) / 20_000.0;
            assert!((normal_cdf(normal_quantile(p)) - p).abs() < 1e-7, "{p}");
        }
        // The far tail: Φ(−6) = 9.8659e-10.
        assert!((normal_quantile(9.865_876_450_376_98e-10) + 6.0).abs() < 1e-5);
        assert_eq!(normal_quantile(0.0625), -normal_quantile(0.9375));
    }
}
