//! Lanes for machines without AVX2, and the reference for those with it.
#![allow(unsafe_code, reason = "implements `Lanes`, whose loads and stores are by pointer")]

use super::{LANES, Lanes};

/// Sixteen f32 in an array.
#[derive(Clone, Copy)]
pub(crate) struct Portable([f32; LANES]);

impl Portable {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|k| f(self.0[k], other.0[k])))
    }
}

// SAFETY: no instruction set is needed; pointers are used within the bounds that the trait demands of the caller.
unsafe impl Lanes for Portable {
    type Mask = u16;

    #[inline(always)]
    unsafe fn splat(x: f32) -> Self {
        Self([x; LANES])
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: the caller vouches for sixteen readable elements; alignment is not assumed.
        Self(unsafe { from.cast::<[f32; LANES]>().read_unaligned() })
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: the caller vouches for sixteen writable elements; alignment is not assumed.
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
    unsafe fn round_ties_even(self) -> Self {
        Self(self.0.map(f32::round_ties_even))
    }
    #[inline(always)]
    unsafe fn scale_by_power_of_two(self, n: Self) -> Self {
        self.zip(n, |x, n| f32::from_bits(x.to_bits().wrapping_add(((n as i32) << 23).cast_unsigned())))
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
        // SAFETY: the caller vouches for sixteen writable elements.
        unsafe { to.cast::<[u32; LANES]>().write_unaligned(self.0.map(|x| x as u32)) }
    }
    #[inline(always)]
    unsafe fn patch(at: *const f32, stride: usize, offset: *const u32, row: [Self; 4], column: [Self; 4]) -> Self {
        Self(std::array::from_fn(|k| {
            // SAFETY: the caller vouches for sixteen offsets and that each lane's 4×4 patch lies inside `at`.
            let value = |i: usize, j: usize| unsafe { *at.add(*offset.add(k) as usize + j * stride + i) };
            let sums: [f32; 4] = std::array::from_fn(|i| {
                (1..4).fold(value(i, 0) * row[0].0[k], |sum, j| value(i, j).mul_add(row[j].0[k], sum))
            });
            (1..4).fold(sums[0] * column[0].0[k], |sum, i| sums[i].mul_add(column[i].0[k], sum))
        }))
    }
    #[inline(always)]
    unsafe fn prefetch(_at: *const f32) {}
}
