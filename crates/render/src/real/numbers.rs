//! f32, f64 and lanes of f32 as numbers of the formulas.

use simd::wide::{self, Set, Wide};
use simd::{LANES, portable};

use super::{Field, Number, Real, Single};
use crate::classify::transfer::knots::{Knot, Piecewise};
use crate::elementary;

macro_rules! real {
    ($kind:ident, $from:expr, $knots:ident, $log2_1p:path, $exp2_m1:path) => {
        impl Number for $kind {
            type Scalar = Self;
            type Mask = bool;

            #[inline(always)]
            fn splat(x: Self) -> Self {
                x
            }

            #[inline(always)]
            fn from_f64(x: f64) -> Self {
                $from(x)
            }

            #[inline(always)]
            fn lt(self, other: Self) -> bool {
                self < other
            }

            #[inline(always)]
            fn le(self, other: Self) -> bool {
                self <= other
            }

            #[inline(always)]
            fn both(a: bool, b: bool) -> bool {
                a && b
            }

            #[inline(always)]
            fn any(mask: bool) -> bool {
                mask
            }

            #[inline(always)]
            fn select(mask: bool, a: Self, b: Self) -> Self {
                if mask { a } else { b }
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

            #[inline(always)]
            fn log2_1p(self) -> Self {
                $log2_1p(self)
            }

            #[inline(always)]
            fn exp2_m1(self) -> Self {
                $exp2_m1(self)
            }

            #[inline(always)]
            fn light_at(at: [Self; 3], field: &impl Field) -> [Self; 4] {
                field.at(at)
            }
        }

        impl Real for $kind {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;

            #[inline(always)]
            fn is_nan(self) -> bool {
                <$kind>::is_nan(self)
            }

            #[inline(always)]
            fn whole(self) -> usize {
                self as usize
            }

            #[inline(always)]
            fn knots<const N: usize>(curve: &Piecewise<N>) -> &[Knot<Self, N>] {
                curve.$knots()
            }
        }
    };
}

real!(f32, |x| x as f32, single, elementary::log2_1p, elementary::exp2_m1);
real!(f64, std::convert::identity, double, log2_1p, exp2_m1);

fn log2_1p(x: f64) -> f64 {
    libm::log1p(x) * std::f64::consts::LOG2_E
}

fn exp2_m1(x: f64) -> f64 {
    libm::expm1(x * std::f64::consts::LN_2)
}

impl Single for f32 {
    #[inline(always)]
    fn round_ties_even(self) -> Self {
        f32::round_ties_even(self)
    }

    #[inline(always)]
    fn mantissa_and_exponent(self) -> (Self, Self) {
        portable::mantissa_and_exponent(self)
    }

    #[inline(always)]
    fn scale_by_power_of_two(self, n: Self) -> Self {
        portable::scale_by_power_of_two(self, n)
    }
}

impl<S: Set> Number for Wide<S> {
    type Scalar = f32;
    type Mask = wide::Mask<S>;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self::splat(x)
    }

    #[inline(always)]
    fn from_f64(x: f64) -> Self {
        Self::splat(x as f32)
    }

    #[inline(always)]
    fn lt(self, other: Self) -> Self::Mask {
        self.lt(other)
    }

    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        self.le(other)
    }

    #[inline(always)]
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        Self::both(a, b)
    }

    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        Self::bits(mask) != 0
    }

    #[inline(always)]
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self {
        Self::select(mask, a, b)
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, summand: Self) -> Self {
        self.mul_add(factor, summand)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }

    #[inline(always)]
    fn log2_1p(self) -> Self {
        elementary::log2_1p(self)
    }

    #[inline(always)]
    fn exp2_m1(self) -> Self {
        elementary::exp2_m1(self)
    }

    #[inline(always)]
    fn light_at(at: [Self; 3], field: &impl Field) -> [Self; 4] {
        let mut places = [[0.0; LANES]; 3];
        for (place, at) in places.iter_mut().zip(at) {
            at.store(place);
        }
        let mut light = [[0.0; LANES]; 4];
        for lane in 0..LANES {
            let of = field.at([places[0][lane], places[1][lane], places[2][lane]]);
            for (light, of) in light.iter_mut().zip(of) {
                light[lane] = of;
            }
        }
        [Self::load(&light[0]), Self::load(&light[1]), Self::load(&light[2]), Self::load(&light[3])]
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.min(other)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.max(other)
    }
}

impl<S: Set> Single for Wide<S> {
    #[inline(always)]
    fn round_ties_even(self) -> Self {
        self.round_ties_even()
    }

    #[inline(always)]
    fn mantissa_and_exponent(self) -> (Self, Self) {
        self.mantissa_and_exponent()
    }

    #[inline(always)]
    fn scale_by_power_of_two(self, n: Self) -> Self {
        self.scale_by_power_of_two(n)
    }
}
