//! Elementary functions of f32, as exact as images need, for loops that the compiler
//! vectorises. They consist of additions, products, quotients and roots.

/// e^−x for 0 ≤ x ≤ 3.2, to 1e-3 relative.
#[inline(always)]
pub(super) fn exp_minus(x: f32) -> f32 {
    // Taylor's series of an eighth, squared three times.
    let t = x * 0.125;
    let eighth = 1.0 - t * (1.0 - t * (0.5 - t * (1.0 / 6.0 - t * (1.0 / 24.0))));
    let quarter = eighth * eighth;
    let half = quarter * quarter;
    half * half
}

/// Arc tangent for |x| ≤ 1.2, to 3e-6 rad.
#[inline(always)]
pub(super) fn atan(x: f32) -> f32 {
    // Halved once, atan x = 2 atan(x / (1 + √(1 + x²))), so that Taylor's series ends early:
    // |y| ≤ 0.47, y¹³/13 < 5e-6.
    let y = x / (1.0 + (1.0 + x * x).sqrt());
    let s = y * y;
    let series =
        1.0 - s * (1.0 / 3.0 - s * (0.2 - s * (1.0 / 7.0 - s * (1.0 / 9.0 - s * (1.0 / 11.0 - s * (1.0 / 13.0))))));
    2.0 * y * series
}

/// Logarithm to base 2 of a normal positive number, to 2e-5.
#[inline(always)]
pub(super) fn log2(x: f32) -> f32 {
    // The mantissa in [√½, √2): its exponent is that of x/√½.
    let bits = x.to_bits();
    let exponent = (bits.wrapping_sub(0x3f35_04f3) as i32) >> 23;
    let mantissa = f32::from_bits(bits.wrapping_sub((exponent << 23) as u32));
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let s2 = s * s;
    // 2/ln 2 artanh s, |s| ≤ 0.172.
    exponent as f32 + s * (2.885_39 + s2 * (0.961_797 + s2 * 0.577_078))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_keep_stated_accuracy() {
        for k in 0..=4000 {
            let x = f64::from(k) * 8e-4;
            assert!((f64::from(exp_minus(x as f32)) / (-x).exp() - 1.0).abs() < 1e-3, "exp {x}");
            let t = f64::from(k) * 6e-4 - 1.2;
            assert!((f64::from(atan(t as f32)) - t.atan()).abs() < 3e-6, "atan {t}");
            for y in [1e-12 * (1.0 + x), 0.4 + x, 1e6 * (1.0 + x)] {
                let found = f64::from(log2(y as f32));
                assert!((found - f64::from(y as f32).log2()).abs() < 2e-5, "log2 {y}: {found}");
            }
        }
    }
}
