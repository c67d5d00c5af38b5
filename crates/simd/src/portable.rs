//! Lanes for machines without AVX2, and the reference for machines with it.
#![allow(unsafe_code, reason = "implements `Lanes`, whose loads and stores are by pointer")]

use super::lanes::{LANES, Lanes, SQRT_HALF_BITS};

/// Sixteen f32 in an array.
#[derive(Clone, Copy)]
pub struct Portable([f32; LANES]);

impl Portable {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|k| f(self.0[k], other.0[k])))
    }
}

/// One lane of [`Lanes::mantissa_and_exponent`].
#[inline(always)]
pub fn mantissa_and_exponent(x: f32) -> (f32, f32) {
    let bits = x.to_bits().cast_signed();
    let n = bits.wrapping_sub(SQRT_HALF_BITS) >> 23;
    (f32::from_bits(bits.wrapping_sub(n << 23).cast_unsigned()), n as f32)
}

/// One lane of [`Lanes::scale_by_power_of_two`].
#[inline(always)]
pub fn scale_by_power_of_two(x: f32, n: f32) -> f32 {
    f32::from_bits(x.to_bits().wrapping_add(((n as i32) << 23).cast_unsigned()))
}

// SAFETY: no instruction set is needed; pointers are used only within the bounds that the trait
// requires of the caller.
unsafe impl Lanes for Portable {
    type Mask = u16;

    #[inline(always)]
    unsafe fn splat(x: f32) -> Self {
        Self([x; LANES])
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: the caller guarantees sixteen readable elements; alignment is not assumed.
        Self(unsafe { from.cast::<[f32; LANES]>().read_unaligned() })
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: the caller guarantees sixteen writable elements; alignment is not assumed.
        unsafe { to.cast::<[f32; LANES]>().write_unaligned(self.0) }
    }
    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
    #[inline(always)]
    unsafe fn div(self, other: Self) -> Self {
        self.zip(other, |a, b| a / b)
    }
    #[inline(always)]
    unsafe fn mul_add(self, a: Self, b: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k].mul_add(a.0[k], b.0[k])))
    }
    #[inline(always)]
    unsafe fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    unsafe fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    unsafe fn floor(self) -> Self {
        Self(self.0.map(f32::floor))
    }
    #[inline(always)]
    unsafe fn abs(self) -> Self {
        Self(self.0.map(f32::abs))
    }
    #[inline(always)]
    unsafe fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }
    #[inline(always)]
    unsafe fn round_ties_even(self) -> Self {
        Self(self.0.map(f32::round_ties_even))
    }
    #[inline(always)]
    unsafe fn scale_by_power_of_two(self, n: Self) -> Self {
        self.zip(n, scale_by_power_of_two)
    }
    #[inline(always)]
    unsafe fn mantissa_and_exponent(self) -> (Self, Self) {
        let pairs = self.0.map(mantissa_and_exponent);
        (Self(pairs.map(|pair| pair.0)), Self(pairs.map(|pair| pair.1)))
    }
    #[inline(always)]
    unsafe fn lt(self, other: Self) -> u16 {
        (0..LANES).fold(0, |mask, k| mask | (u16::from(self.0[k] < other.0[k]) << k))
    }
    #[inline(always)]
    unsafe fn le(self, other: Self) -> u16 {
        (0..LANES).fold(0, |mask, k| mask | (u16::from(self.0[k] <= other.0[k]) << k))
    }
    #[inline(always)]
    unsafe fn and(a: u16, b: u16) -> u16 {
        a & b
    }
    #[inline(always)]
    unsafe fn bits(mask: u16) -> u16 {
        mask
    }
    #[inline(always)]
    unsafe fn select(mask: u16, a: Self, b: Self) -> Self {
        Self(std::array::from_fn(|k| if mask >> k & 1 == 1 { a.0[k] } else { b.0[k] }))
    }
    #[inline(always)]
    unsafe fn store_integers(self, to: *mut u32) {
        // SAFETY: the caller guarantees sixteen writable elements.
        unsafe { to.cast::<[u32; LANES]>().write_unaligned(self.0.map(|x| x as u32)) }
    }
    #[inline(always)]
    unsafe fn store_pairs(low: Self, high: Self, to: *mut u32) {
        let half = |x: f32| u32::from((x.round_ties_even() as i16).cast_unsigned());
        let pairs: [u32; LANES] = std::array::from_fn(|k| half(low.0[k]) | half(high.0[k]) << 16);
        // SAFETY: the caller guarantees sixteen writable elements.
        unsafe { to.cast::<[u32; LANES]>().write_unaligned(pairs) }
    }
    #[inline(always)]
    unsafe fn patch(at: *const u32, stride: usize, offset: *const u32, row: [Self; 4], column: [Self; 4]) -> Self {
        Self(std::array::from_fn(|k| {
            let units = |j: usize| (row[j].0[k] * 32768.0).round_ties_even() as i32;
            let (q0, q1, q3) = (units(0), units(1), units(3));
            let q = [q0, q1, 32768 - (q0 + q1 + q3), q3];
            let sums: [f32; 4] = std::array::from_fn(|i| {
                let pair = |j: usize| {
                    // SAFETY: the caller guarantees sixteen offsets, and that each lane's patch
                    // lies inside `at`.
                    let pair = unsafe { *at.add(*offset.add(k) as usize + j * stride + i) };
                    [(pair as u16).cast_signed(), ((pair >> 16) as u16).cast_signed()].map(i32::from)
                };
                let ([a, b], [c, d]) = (pair(0), pair(2));
                (a * q[0] + b * q[1] + (c * q[2] + d * q[3])) as f32
            });
            (1..4).fold(sums[0] * column[0].0[k], |sum, i| sums[i].mul_add(column[i].0[k], sum))
        }))
    }
    #[inline(always)]
    unsafe fn patch_of_two(at: *const u32, offset: *const u32, row: [Self; 2], column: [Self; 2]) -> Self {
        Self(std::array::from_fn(|k| {
            let q = (row[0].0[k] * 16384.0).round_ties_even() as i32;
            let sums: [f32; 2] = std::array::from_fn(|i| {
                // SAFETY: the caller guarantees sixteen offsets, and that each lane's patch
                // lies inside `at`.
                let pair = unsafe { *at.add(*offset.add(k) as usize + i) };
                let [a, b] = [pair as u16, (pair >> 16) as u16].map(|half| i32::from(half.cast_signed()));
                (a * q + b * (16384 - q)) as f32
            });
            sums[1].mul_add(column[1].0[k], sums[0] * column[0].0[k])
        }))
    }
    #[inline(always)]
    unsafe fn not_above(at: *const u32, most: u32) -> u16 {
        // SAFETY: the caller guarantees sixteen readable elements.
        (0..LANES).fold(0, |mask, k| mask | (u16::from(unsafe { *at.add(k) } <= most) << k))
    }
    #[inline(always)]
    unsafe fn replace_where(mask: u16, at: *mut u32, with: u32) {
        for k in (0..LANES).filter(|k| mask >> k & 1 == 1) {
            // SAFETY: the caller guarantees sixteen writable elements.
            unsafe { *at.add(k) = with }
        }
    }
    #[inline(always)]
    unsafe fn load_halves(from: *const u16) -> Self {
        // SAFETY: the caller guarantees sixteen readable elements.
        Self(unsafe { from.cast::<[u16; LANES]>().read_unaligned() }.map(f32::from))
    }
    #[inline(always)]
    unsafe fn replace_halves_where(mask: u16, at: *mut u16, with: u16) {
        for k in (0..LANES).filter(|k| mask >> k & 1 == 1) {
            // SAFETY: the caller guarantees sixteen writable elements.
            unsafe { *at.add(k) = with }
        }
    }
    #[inline(always)]
    unsafe fn prefetch(_at: *const f32) {}
}
