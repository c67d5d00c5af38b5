//! Number types for the renderer's formulas.
//!
//! Each formula is written once over [`Number`]. The live picture runs it in f32, sixteen lanes
//! at a time if there are that many voxels; the reference runs it in f64. Formulas use
//! selections instead of branches that depend on a value; a branch may skip work that no lane
//! needs. Every operation has the same bits on every machine and in every lane. Elementary
//! operations follow IEEE 754. Transcendental functions are computed in software and never come
//! from the platform.

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

mod numbers;

use super::classify::transfer::knots::{Knot, Piecewise};

/// f32, f64, or lanes of f32.
pub trait Number:
    sealed::Sealed
    + Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// Type of one lane.
    type Scalar: Real;
    /// Result of a comparison, for each lane.
    type Mask: Copy;

    /// Returns `x` in all lanes.
    fn splat(x: Self::Scalar) -> Self;

    /// Returns the nearest number of this type, in all lanes.
    fn from_f64(x: f64) -> Self;

    /// Returns whether this is less than `other`; false if either is not a number.
    fn lt(self, other: Self) -> Self::Mask;

    /// Returns whether this is at most `other`; false if either is not a number.
    fn le(self, other: Self) -> Self::Mask;

    /// Returns whether both masks are set.
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask;

    /// Returns whether the mask is set in any lane.
    fn any(mask: Self::Mask) -> bool;

    /// Returns `a` where the mask is set, otherwise `b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;

    /// Returns self · factor + summand, rounded once. Without a processor instruction it is
    /// slow, but gives the same bits.
    fn mul_add(self, factor: Self, summand: Self) -> Self;

    /// Returns the square root, correctly rounded.
    fn sqrt(self) -> Self;

    /// Returns the magnitude.
    fn abs(self) -> Self;

    /// Returns log₂(1 + self) for −1 < self ≤ 0, accurate near 0.
    fn log2_1p(self) -> Self;

    /// Returns 2^self − 1 for self ≤ 0, accurate near 0.
    fn exp2_m1(self) -> Self;

    /// Returns the soft light at a region position.
    fn light_at(at: [Self; 3], field: &impl Field) -> [Self; 4];

    /// 0.
    #[inline(always)]
    fn zero() -> Self {
        Self::from_f64(0.0)
    }

    /// 1.
    #[inline(always)]
    fn one() -> Self {
        Self::from_f64(1.0)
    }

    /// Returns the smaller one; `other` if `self` is not a number. Unlike the standard library's
    /// function, it always defines which of two zeros it returns.
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self::select(self.lt(other), self, other)
    }

    /// Returns the larger one; `other` if `self` is not a number.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self::select(other.lt(self), self, other)
    }

    /// Clamps to 0 to 1; returns 0 if it is not a number.
    #[inline(always)]
    fn unit(self) -> Self {
        self.max(Self::zero()).min(Self::one())
    }

    /// Returns a whole power, by repeated squaring.
    #[inline(always)]
    fn power(self, mut exponent: u32) -> Self {
        let (mut square, mut power) = (self, Self::one());
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

/// Light at places of a volume.
pub trait Field {
    /// Returns the light in red, green and blue, and from all sides, at a region position.
    fn at<T: Real>(&self, at: [T; 3]) -> [T; 4];
}

/// f32 or f64.
pub trait Real: Number<Scalar = Self, Mask = bool> + Debug + PartialOrd + Send + Sync {
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;

    /// Returns whether this is not a number.
    fn is_nan(self) -> bool;

    /// Returns the whole part of a number that is not negative.
    fn whole(self) -> usize;

    /// Returns a curve's points in this type.
    fn knots<const N: usize>(curve: &Piecewise<N>) -> &[Knot<Self, N>];
}

/// f32 or lanes of it: the types that the polynomials of [`elementary`](super::elementary) are
/// made for.
pub(super) trait Single: Number<Scalar = f32> {
    /// Returns the nearest integer; rounds halves to even.
    fn round_ties_even(self) -> Self;

    /// Returns m and n for self = m·2ⁿ, √½ ≤ m < √2, for normal numbers above 0.
    fn mantissa_and_exponent(self) -> (Self, Self);

    /// Returns self·2ⁿ for integral n, |n| ≤ 126 and a normal result.
    fn scale_by_power_of_two(self, n: Self) -> Self;
}

mod sealed {
    use simd::wide::{Set, Wide};

    /// Closes [`super::Number`], because the error bounds hold only for these types.
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
    impl<S: Set> Sealed for Wide<S> {}
}

/// Scalar product.
#[inline(always)]
pub fn dot<T: Number>(a: [T; 3], b: [T; 3]) -> T {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_equal_repeated_products() {
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
    fn nan_is_clamped_to_unit_interval() {
        assert_eq!(Number::unit(f32::NAN), 0.0);
        assert_eq!(Number::unit(f64::INFINITY), 1.0);
        assert_eq!(Number::unit(-0.0_f64).to_bits(), 0.0_f64.to_bits());
        assert_eq!(Number::max(f64::NAN, 2.0), 2.0);
        assert_eq!(Number::min(f64::NAN, 2.0), 2.0);
    }
}
