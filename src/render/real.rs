//! The number that a formula runs in.
//!
//! A formula of the renderer is written once over [`Real`]; the live picture runs it in f32, the reference in f64. Every operation has the same
//! bits on every machine: the elementary ones are IEEE 754's, the transcendental ones are computed in software, none is the platform's.

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// f32 or f64.
pub trait Real:
    sealed::Sealed
    + Copy
    + Debug
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;

    /// The nearest number of this kind.
    fn from_f64(x: f64) -> Self;

    /// Whether this is not a number.
    fn is_nan(self) -> bool;

    /// self · factor + summand, rounded once. Slow where the processor has no such instruction, with the same bits.
    fn mul_add(self, factor: Self, summand: Self) -> Self;

    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;

    /// Magnitude.
    fn abs(self) -> Self;

    /// ln(1 + self), accurate near 0.
    fn ln_1p(self) -> Self;

    /// exp(self) − 1, accurate near 0.
    fn exp_m1(self) -> Self;

    /// The smaller one; `other` where `self` is not a number. Unlike the standard's, it never leaves open which of two zeros it gives.
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }

    /// The larger one; `other` where `self` is not a number.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }

    /// Held between 0 and 1; 0 where it is not a number.
    #[inline(always)]
    fn unit(self) -> Self {
        self.max(Self::ZERO).min(Self::ONE)
    }

    /// A whole power, by repeated squaring.
    #[inline(always)]
    fn power(self, mut exponent: u32) -> Self {
        let (mut square, mut power) = (self, Self::ONE);
        while exponent > 0 {
            if exponent & 1 == 1 {
                power = power * square;
            }
            square = square * square;
            exponent >>= 1;
        }
        power
    }
}

mod sealed {
    /// Closes [`super::Real`]: the bounds on its errors hold for these two.
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

macro_rules! real {
    ($kind:ty, $from:expr, $ln_1p:path, $exp_m1:path) => {
        impl Real for $kind {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;

            #[inline(always)]
            fn from_f64(x: f64) -> Self {
                $from(x)
            }

            #[inline(always)]
            fn is_nan(self) -> bool {
                <$kind>::is_nan(self)
            }

            #[inline(always)]
            fn mul_add(self, factor: Self, summand: Self) -> Self {
                <$kind>::mul_add(self, factor, summand)
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                <$kind>::sqrt(self)
            }

            #[inline(always)]
            fn abs(self) -> Self {
                <$kind>::abs(self)
            }

            #[inline]
            fn ln_1p(self) -> Self {
                $ln_1p(self)
            }

            #[inline]
            fn exp_m1(self) -> Self {
                $exp_m1(self)
            }
        }
    };
}

real!(f32, |x| x as f32, libm::log1pf, libm::expm1f);
real!(f64, std::convert::identity, libm::log1p, libm::expm1);

/// Scalar product.
#[inline(always)]
pub fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_products() {
        for base in [-1.5_f64, 0.0, 0.3, 1.0, 2.0] {
            let mut product = 1.0;
            for exponent in 0..40 {
                assert!((base.power(exponent) - product).abs() <= 1e-14 * product.abs(), "{base}^{exponent}");
                product *= base;
            }
        }
        assert_eq!(2.0_f32.power(127), 2.0_f32.powi(127));
        assert_eq!(1.0_f32.power(u32::MAX), 1.0);
    }

    #[test]
    fn what_is_not_a_number_does_not_pass_the_unit_interval() {
        assert_eq!(Real::unit(f32::NAN), 0.0);
        assert_eq!(Real::unit(f64::INFINITY), 1.0);
        assert_eq!(Real::unit(-0.0_f64).to_bits(), 0.0_f64.to_bits());
        assert_eq!(Real::max(f64::NAN, 2.0), 2.0);
        assert_eq!(Real::min(f64::NAN, 2.0), 2.0);
    }

    #[test]
    fn logarithm_and_exponential_are_accurate_near_zero_in_both_kinds() {
        // x − x²/2 and x + x²/2; the next term is below 1e-24.
        let x = 1e-8;
        assert!((Real::ln_1p(x) / (x - 0.5 * x * x) - 1.0).abs() < 1e-15);
        assert!((Real::exp_m1(x) / (x + 0.5 * x * x) - 1.0).abs() < 1e-15);
        for x in [1e-8_f32, -1e-6, 0.01, -0.5] {
            assert!((f64::from(Real::ln_1p(x)) / Real::ln_1p(f64::from(x)) - 1.0).abs() < 2e-7, "ln_1p {x}");
            assert!((f64::from(Real::exp_m1(x)) / Real::exp_m1(f64::from(x)) - 1.0).abs() < 2e-7, "exp_m1 {x}");
        }
    }
}
