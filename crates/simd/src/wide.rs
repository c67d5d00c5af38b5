//! Sixteen f32 as a number type: formulas written with operators run on [`Lanes`] without
//! unsafe blocks of their own.
#![allow(unsafe_code, reason = "runs on `Lanes`, of an instruction set that `Simd::wide` has detected")]

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::portable::Portable;
use super::{LANES, Lanes, Simd};
#[cfg(target_arch = "x86_64")]
use super::{avx2::Avx2, avx512::Avx512};

/// An instruction set that the machine supports.
///
/// # Safety
/// Only types of this file implement it. They are private, and only [`Simd::wide`] names them,
/// after detecting the set. Hence no [`Wide`] exists without its instruction set.
pub unsafe trait Set: Copy {
    /// Its lanes.
    type Lanes: Lanes;
}

#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
struct OnAvx512;
// SAFETY: private, and named only by `Simd::wide` after its assertion.
#[cfg(target_arch = "x86_64")]
unsafe impl Set for OnAvx512 {
    type Lanes = Avx512;
}

#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
struct OnAvx2;
// SAFETY: private, and named only by `Simd::wide` after its assertion.
#[cfg(target_arch = "x86_64")]
unsafe impl Set for OnAvx2 {
    type Lanes = Avx2;
}

#[derive(Clone, Copy)]
struct OnAny;
// SAFETY: portable lanes need no instruction set.
unsafe impl Set for OnAny {
    type Lanes = Portable;
}

/// Code over [`Wide`] for [`Simd::wide`]. `run`, and every function that it calls with a
/// [`Wide`], must be `#[inline(always)]`; none may be a closure.
pub trait Job {
    /// Result of the job.
    type Output;

    /// Runs the job over the lanes of `S`.
    fn run<S: Set>(self) -> Self::Output;
}

impl Simd {
    /// Runs a job compiled for the set, over its lanes.
    ///
    /// # Panics
    /// If the machine lacks the set.
    pub fn wide<J: Job>(self, job: J) -> J::Output {
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx512f,avx512bw,avx2,fma")]
        fn avx512<J: Job>(job: J) -> J::Output {
            job.run::<OnAvx512>()
        }
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2,fma")]
        fn avx2<J: Job>(job: J) -> J::Output {
            job.run::<OnAvx2>()
        }
        assert!(self.is_available(), "{} is not available on this machine", self.name());
        match self {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the assertion above detected the features (AVX-512 F implies AVX2 and FMA
            // on every existing processor).
            Self::Avx512 => unsafe { avx512(job) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the assertion above detected the features.
            Self::Avx2 => unsafe { avx2(job) },
            _ => job.run::<OnAny>(),
        }
    }
}

/// Sixteen f32.
#[derive(Clone, Copy)]
pub struct Wide<S: Set>(S::Lanes);

/// One bit per lane.
pub type Mask<S> = <<S as Set>::Lanes as Lanes>::Mask;

/// Implements an operator of two operands.
macro_rules! operator {
    ($operator:ident, $method:ident) => {
        impl<S: Set> $operator for Wide<S> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: a `Wide` exists only in jobs of `Simd::wide`, which has detected the
                // set.
                Self(unsafe { self.0.$method(other.0) })
            }
        }
    };
}
operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);

impl<S: Set> Neg for Wide<S> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        // Exact, including the signs of zeros.
        self * Self::splat(-1.0)
    }
}

/// The operations of [`Lanes`] that formulas need, documented there.
impl<S: Set> Wide<S> {
    /// Returns a vector with `x` in every lane.
    #[inline(always)]
    pub fn splat(x: f32) -> Self {
        // SAFETY: `S` can be named only in jobs of `Simd::wide`, which has detected the set;
        // likewise below.
        Self(unsafe { S::Lanes::splat(x) })
    }

    /// Loads sixteen numbers.
    #[inline(always)]
    pub fn load(from: &[f32; LANES]) -> Self {
        // SAFETY: as above; sixteen elements.
        Self(unsafe { S::Lanes::load(from.as_ptr()) })
    }

    /// Stores sixteen numbers.
    #[inline(always)]
    pub fn store(self, to: &mut [f32; LANES]) {
        // SAFETY: as above; sixteen elements.
        unsafe { self.0.store(to.as_mut_ptr()) }
    }

    /// `self · factor + summand`, rounded once.
    #[inline(always)]
    pub fn mul_add(self, factor: Self, summand: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { self.0.mul_add(factor.0, summand.0) })
    }

    /// Smaller value of each lane.
    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { self.0.min(other.0) })
    }

    /// Larger value of each lane.
    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { self.0.max(other.0) })
    }

    /// Absolute values.
    #[inline(always)]
    pub fn abs(self) -> Self {
        // SAFETY: as above.
        Self(unsafe { self.0.abs() })
    }

    /// Square roots.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        // SAFETY: as above.
        Self(unsafe { self.0.sqrt() })
    }

    /// Nearest integers; ties go to even.
    #[inline(always)]
    pub fn round_ties_even(self) -> Self {
        // SAFETY: as above.
        Self(unsafe { self.0.round_ties_even() })
    }

    /// `self · 2ⁿ`.
    #[inline(always)]
    pub fn scale_by_power_of_two(self, n: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { self.0.scale_by_power_of_two(n.0) })
    }

    /// Mantissa in [√½, √2) and exponent of two of each lane.
    #[inline(always)]
    pub fn mantissa_and_exponent(self) -> (Self, Self) {
        // SAFETY: as above.
        let (mantissa, exponent) = unsafe { self.0.mantissa_and_exponent() };
        (Self(mantissa), Self(exponent))
    }

    /// Lanes below those of `other`.
    #[inline(always)]
    pub fn lt(self, other: Self) -> Mask<S> {
        // SAFETY: as above.
        unsafe { self.0.lt(other.0) }
    }

    /// Lanes at most those of `other`.
    #[inline(always)]
    pub fn le(self, other: Self) -> Mask<S> {
        // SAFETY: as above.
        unsafe { self.0.le(other.0) }
    }

    /// Lanes that are set in both masks.
    #[inline(always)]
    pub fn both(a: Mask<S>, b: Mask<S>) -> Mask<S> {
        // SAFETY: as above.
        unsafe { S::Lanes::and(a, b) }
    }

    /// Lane k in bit k.
    #[inline(always)]
    pub fn bits(mask: Mask<S>) -> u16 {
        // SAFETY: as above.
        unsafe { S::Lanes::bits(mask) }
    }

    /// `a` where the mask is set, else `b`.
    #[inline(always)]
    pub fn select(mask: Mask<S>, a: Self, b: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { S::Lanes::select(mask, a.0, b.0) })
    }
}
