//! Sixteen f32 as a number: formulas written over a number's operators run on [`Lanes`] without an unsafe block of their own.
#![allow(unsafe_code, reason = "runs on `Lanes`, of an instruction set that `Simd::wide` has detected")]

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::portable::Portable;
use super::{LANES, Lanes, Simd};
#[cfg(target_arch = "x86_64")]
use super::{avx2::Avx2, avx512::Avx512};

/// An instruction set that the machine has.
///
/// # Safety
/// Implemented for types of this file only, which are private and which [`Simd::wide`] alone names, after detecting the set: so there is no [`Wide`] without it.
pub(crate) unsafe trait Set: Copy {
    /// Its lanes.
    type Lanes: Lanes;
}

#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
struct OnAvx512;
// SAFETY: private, and named by `Simd::wide` behind its assertion only.
#[cfg(target_arch = "x86_64")]
unsafe impl Set for OnAvx512 {
    type Lanes = Avx512;
}

#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
struct OnAvx2;
// SAFETY: private, and named by `Simd::wide` behind its assertion only.
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

/// Code over [`Wide`] for [`Simd::wide`]. `run` is `#[inline(always)]`, and so is all that it calls with a [`Wide`]; none of it is a closure.
pub(crate) trait Job {
    /// What it gives.
    type Output;

    fn run<S: Set>(self) -> Self::Output;
}

impl Simd {
    /// Runs a job compiled for the set, over its lanes.
    ///
    /// # Panics
    /// Where the machine lacks the set.
    pub(crate) fn wide<J: Job>(self, job: J) -> J::Output {
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
            // SAFETY: the assertion above detected the features (AVX-512 F implies AVX2 and FMA on every processor that has it).
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
pub(crate) struct Wide<S: Set>(S::Lanes);

/// A bit a lane.
pub(crate) type Mask<S> = <<S as Set>::Lanes as Lanes>::Mask;

/// An operator of two operands.
macro_rules! operator {
    ($operator:ident, $method:ident) => {
        impl<S: Set> $operator for Wide<S> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: there is no `Wide` but in jobs of `Simd::wide`, which has detected the set.
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
        // Exact, with the signs of zeros.
        self * Self::splat(-1.0)
    }
}

/// The operations of [`Lanes`] that formulas need; what they do is said there.
impl<S: Set> Wide<S> {
    #[inline(always)]
    pub(crate) fn splat(x: f32) -> Self {
        // SAFETY: `S` can be named only in jobs of `Simd::wide`, which has detected the set; so below.
        Self(unsafe { S::Lanes::splat(x) })
    }

    #[inline(always)]
    pub(crate) fn load(from: &[f32; LANES]) -> Self {
        // SAFETY: as above; sixteen elements.
        Self(unsafe { S::Lanes::load(from.as_ptr()) })
    }

    #[inline(always)]
    pub(crate) fn store(self, to: &mut [f32; LANES]) {
        // SAFETY: as above; sixteen elements.
        unsafe { self.0.store(to.as_mut_ptr()) }
    }

    #[inline(always)]
    pub(crate) fn mul_add(self, factor: Self, summand: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { self.0.mul_add(factor.0, summand.0) })
    }

    #[inline(always)]
    pub(crate) fn min(self, other: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { self.0.min(other.0) })
    }

    #[inline(always)]
    pub(crate) fn max(self, other: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { self.0.max(other.0) })
    }

    #[inline(always)]
    pub(crate) fn abs(self) -> Self {
        // SAFETY: as above.
        Self(unsafe { self.0.abs() })
    }

    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        // SAFETY: as above.
        Self(unsafe { self.0.sqrt() })
    }

    #[inline(always)]
    pub(crate) fn round_ties_even(self) -> Self {
        // SAFETY: as above.
        Self(unsafe { self.0.round_ties_even() })
    }

    #[inline(always)]
    pub(crate) fn scale_by_power_of_two(self, n: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { self.0.scale_by_power_of_two(n.0) })
    }

    #[inline(always)]
    pub(crate) fn mantissa_and_exponent(self) -> (Self, Self) {
        // SAFETY: as above.
        let (mantissa, exponent) = unsafe { self.0.mantissa_and_exponent() };
        (Self(mantissa), Self(exponent))
    }

    #[inline(always)]
    pub(crate) fn lt(self, other: Self) -> Mask<S> {
        // SAFETY: as above.
        unsafe { self.0.lt(other.0) }
    }

    #[inline(always)]
    pub(crate) fn le(self, other: Self) -> Mask<S> {
        // SAFETY: as above.
        unsafe { self.0.le(other.0) }
    }

    #[inline(always)]
    pub(crate) fn both(a: Mask<S>, b: Mask<S>) -> Mask<S> {
        // SAFETY: as above.
        unsafe { S::Lanes::and(a, b) }
    }

    #[inline(always)]
    pub(crate) fn bits(mask: Mask<S>) -> u16 {
        // SAFETY: as above.
        unsafe { S::Lanes::bits(mask) }
    }

    #[inline(always)]
    pub(crate) fn select(mask: Mask<S>, a: Self, b: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { S::Lanes::select(mask, a.0, b.0) })
    }
}
