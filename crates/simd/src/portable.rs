//! Lanes for every processor, in arrays that the compiler turns into the vectors it knows.
//!
//! Nothing here calls a library: x86-64 without further sets has no instruction that rounds to an
//! integer or fuses a multiply-add, so that both are made of others, with the same bits.
#![allow(unsafe_code, reason = "implements `Lanes`, whose loads and stores are by pointer")]

use super::lanes::{LANES, Lanes, SQRT_HALF_BITS};

/// Whether the compiler's processor fuses a multiply-add and rounds to integers by instructions.
const IS_FUSED: bool = cfg!(any(target_feature = "fma", target_arch = "aarch64"));

/// An array of sixteen values, in a loop: closures in an array's functions are not always inlined.
macro_rules! lanes {
    ($k:ident => $value:expr) => {{
        let mut all = [Default::default(); LANES];
        let mut $k = 0;
        while $k < LANES {
            all[$k] = $value;
            $k += 1;
        }
        all
    }};
}

/// Methods whose lanes are an expression of one operand's or two operands' lanes.
macro_rules! of_lanes {
    ($($name:ident($x:ident $(, $y:ident)?) = $value:expr;)*) => {
        $(#[inline(always)]
        unsafe fn $name(self $(, $y: Self)?) -> Self {
            Self(lanes!(k => {
                let $x = self.0[k];
                $(let $y = $y.0[k];)?
                $value
            }))
        })*
    };
}

/// Sixteen f32 in an array.
#[derive(Clone, Copy)]
pub struct Portable([f32; LANES]);

/// `a·b + c`, rounded once.
///
/// The product is exact in f64. Its sum with `c` is rounded to odd there: of the two neighbours of
/// an inexact sum, that with an odd last bit. Rounding that to f32 gives what rounding the exact
/// sum would (Boldo and Melquiond, 2008).
#[inline(always)]
fn mul_add(a: f32, b: f32, c: f32) -> f32 {
    if IS_FUSED {
        return a.mul_add(b, c);
    }
    let (product, c) = (f64::from(a) * f64::from(b), f64::from(c));
    let sum = product + c;
    let added = sum - product;
    let error = (product - (sum - added)) + (c - added);
    let is_inexact = u64::from(error.abs() > 0.0);
    let is_beyond = (error.to_bits() ^ sum.to_bits()) >> 63;
    f64::from_bits((sum.to_bits() - (is_beyond & is_inexact)) | is_inexact) as f32
}

/// [`mul_add`] of all lanes, in any case.
#[cold]
#[inline(never)]
fn mul_add_all(a: &[f32; LANES], b: &[f32; LANES], c: &[f32; LANES]) -> [f32; LANES] {
    lanes!(k => mul_add(a[k], b[k], c[k]))
}

/// [`mul_add`] of all lanes, with the sum rounded to nearest in f64.
///
/// Rounding twice errs only where the first result lies midway between two f32: where its last 29
/// bits are 2²⁸, or the second result is subnormal. All lanes are then computed anew.
#[cfg(all(target_arch = "x86_64", not(target_feature = "fma")))]
#[inline(always)]
fn mul_adds(a: &[f32; LANES], b: &[f32; LANES], c: &[f32; LANES]) -> [f32; LANES] {
    use std::arch::x86_64::*;
    // SAFETY: every x86-64 processor has SSE2; four lanes are read and written at a time.
    unsafe {
        let mut all = [0.0; LANES];
        let mut unsure = _mm_setzero_si128();
        let mut k = 0;
        while k < LANES {
            let [a, b, c] = [a, b, c].map(|lanes| _mm_loadu_ps(lanes.as_ptr().add(k)));
            let low = _mm_add_pd(_mm_mul_pd(_mm_cvtps_pd(a), _mm_cvtps_pd(b)), _mm_cvtps_pd(c));
            let [a, b, c] = [_mm_movehl_ps(a, a), _mm_movehl_ps(b, b), _mm_movehl_ps(c, c)];
            let high = _mm_add_pd(_mm_mul_pd(_mm_cvtps_pd(a), _mm_cvtps_pd(b)), _mm_cvtps_pd(c));
            let last = _mm_shuffle_ps::<0b10_00_10_00>(_mm_castpd_ps(low), _mm_castpd_ps(high));
            let last = _mm_and_si128(_mm_castps_si128(last), _mm_set1_epi32(0x1FFF_FFFF));
            let is_midway = _mm_cmpeq_epi32(last, _mm_set1_epi32(0x1000_0000));
            let rounded = _mm_movelh_ps(_mm_cvtpd_ps(low), _mm_cvtpd_ps(high));
            // Twice the bits are those without the sign; less one, 0 becomes the largest integer.
            let bits = _mm_castps_si128(rounded);
            let size = _mm_add_epi32(_mm_add_epi32(bits, bits), _mm_set1_epi32(i32::MAX));
            let is_subnormal = _mm_cmpgt_epi32(_mm_set1_epi32(i32::MIN + (2 << 23)), size);
            unsure = _mm_or_si128(unsure, _mm_or_si128(is_midway, is_subnormal));
            _mm_storeu_ps(all.as_mut_ptr().add(k), rounded);
            k += 4;
        }
        if _mm_movemask_epi8(unsure) == 0 { all } else { mul_add_all(a, b, c) }
    }
}

/// [`mul_add`] of all lanes.
#[cfg(not(all(target_arch = "x86_64", not(target_feature = "fma"))))]
#[inline(always)]
fn mul_adds(a: &[f32; LANES], b: &[f32; LANES], c: &[f32; LANES]) -> [f32; LANES] {
    lanes!(k => mul_add(a[k], b[k], c[k]))
}

/// Nearest integer; ties go to even.
#[inline(always)]
fn round_ties_even(x: f32) -> f32 {
    if IS_FUSED {
        return x.round_ties_even();
    }
    // From 2²³ on, every f32 is an integer.
    const INTEGERS: f32 = 8_388_608.0;
    let far = INTEGERS.copysign(x);
    let is_near = if x.abs() < INTEGERS { u32::MAX } else { 0 };
    let nearest = ((x + far) - far).copysign(x);
    f32::from_bits((nearest.to_bits() & is_near) | (x.to_bits() & !is_near))
}

/// Largest integer that is not above `x`.
#[inline(always)]
fn floor(x: f32) -> f32 {
    let nearest = round_ties_even(x);
    nearest - if nearest > x { 1.0 } else { 0.0 }
}

/// Returns the integer that a small integral number is.
///
/// # Safety
/// `x` must lie within i32.
#[inline(always)]
unsafe fn integer(x: f32) -> i32 {
    // SAFETY: as above.
    unsafe { x.to_int_unchecked() }
}

/// Returns `low·q0 + high·q1` of an element's halves.
#[inline(always)]
fn pair_sum(pair: u32, q0: i32, q1: i32) -> i32 {
    i32::from((pair as u16).cast_signed()) * q0 + i32::from(((pair >> 16) as u16).cast_signed()) * q1
}

/// The four sums of a patch that are of integers, as [`Lanes::patch`] has them; `units` are q₀ and
/// q₁, then q₂ and q₃, as halves.
///
/// # Safety
/// Four elements must be readable at both pointers.
#[inline(always)]
unsafe fn row_sums(above: *const u32, below: *const u32, units: [i32; 2]) -> [f32; 4] {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::*;
        // SAFETY: four elements are readable, and every x86-64 processor has SSE2.
        unsafe {
            let above = _mm_madd_epi16(_mm_loadu_si128(above.cast()), _mm_set1_epi32(units[0]));
            let below = _mm_madd_epi16(_mm_loadu_si128(below.cast()), _mm_set1_epi32(units[1]));
            std::mem::transmute(_mm_cvtepi32_ps(_mm_add_epi32(above, below)))
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        // SAFETY: four elements are readable.
        let (above, below) =
            unsafe { (above.cast::<[u32; 4]>().read_unaligned(), below.cast::<[u32; 4]>().read_unaligned()) };
        let dot = |pair: u32, q: i32| pair_sum(pair, i32::from(q as i16), q >> 16);
        [0, 1, 2, 3].map(|i| (dot(above[i], units[0]) + dot(below[i], units[1])) as f32)
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
    type Mask = [u32; LANES];

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
    of_lanes! {
        add(a, b) = a + b;
        sub(a, b) = a - b;
        mul(a, b) = a * b;
        div(a, b) = a / b;
        min(a, b) = if a < b { a } else { b };
        max(a, b) = if a > b { a } else { b };
        floor(a) = floor(a);
        abs(a) = a.abs();
        sqrt(a) = a.sqrt();
        round_ties_even(a) = round_ties_even(a);
    }
    #[inline(always)]
    unsafe fn mul_add(self, a: Self, b: Self) -> Self {
        Self(mul_adds(&self.0, &a.0, &b.0))
    }
    #[inline(always)]
    unsafe fn scale_by_power_of_two(self, n: Self) -> Self {
        Self(lanes!(k => {
            // SAFETY: the caller guarantees |n| ≤ 126.
            let exponent = unsafe { integer(n.0[k]) } << 23;
            f32::from_bits(self.0[k].to_bits().wrapping_add(exponent.cast_unsigned()))
        }))
    }
    #[inline(always)]
    unsafe fn mantissa_and_exponent(self) -> (Self, Self) {
        let mantissa = lanes!(k => mantissa_and_exponent(self.0[k]).0);
        (Self(mantissa), Self(lanes!(k => mantissa_and_exponent(self.0[k]).1)))
    }
    #[inline(always)]
    unsafe fn lt(self, other: Self) -> [u32; LANES] {
        lanes!(k => if self.0[k] < other.0[k] { u32::MAX } else { 0 })
    }
    #[inline(always)]
    unsafe fn le(self, other: Self) -> [u32; LANES] {
        lanes!(k => if self.0[k] <= other.0[k] { u32::MAX } else { 0 })
    }
    #[inline(always)]
    unsafe fn and(a: [u32; LANES], b: [u32; LANES]) -> [u32; LANES] {
        lanes!(k => a[k] & b[k])
    }
    #[inline(always)]
    unsafe fn bits(mask: [u32; LANES]) -> u16 {
        let bits: [u32; LANES] = lanes!(k => mask[k] & 1 << k);
        let mut all = 0;
        for bit in bits {
            all |= bit;
        }
        all as u16
    }
    #[inline(always)]
    unsafe fn select(mask: [u32; LANES], a: Self, b: Self) -> Self {
        Self(lanes!(k => f32::from_bits((a.0[k].to_bits() & mask[k]) | (b.0[k].to_bits() & !mask[k]))))
    }
    #[inline(always)]
    unsafe fn store_integers(self, to: *mut u32) {
        // SAFETY: the caller guarantees sixteen writable elements, and lanes that fit.
        unsafe { to.cast::<[u32; LANES]>().write_unaligned(lanes!(k => integer(self.0[k]).cast_unsigned())) }
    }
    #[inline(always)]
    unsafe fn store_pairs(low: Self, high: Self, to: *mut u32) {
        // SAFETY: the caller guarantees sixteen writable elements, and lanes within i16.
        unsafe {
            let pairs: [u32; LANES] = lanes!(k => {
                let low = integer(round_ties_even(low.0[k])).cast_unsigned() & 0xFFFF;
                low | integer(round_ties_even(high.0[k])).cast_unsigned() << 16
            });
            to.cast::<[u32; LANES]>().write_unaligned(pairs);
        }
    }
    #[inline(always)]
    unsafe fn patch(at: *const u32, stride: usize, offset: *const u32, row: [Self; 4], column: [Self; 4]) -> Self {
        let mut sums = [[0.0; LANES]; 4];
        // SAFETY: the caller guarantees sixteen offsets, that each lane's patch lies inside `at`,
        // and weights in 0..=1.
        unsafe {
            let q0: [i32; LANES] = lanes!(k => integer(round_ties_even(row[0].0[k] * 32768.0)));
            let q1: [i32; LANES] = lanes!(k => integer(round_ties_even(row[1].0[k] * 32768.0)));
            let q3: [i32; LANES] = lanes!(k => integer(round_ties_even(row[3].0[k] * 32768.0)));
            let upper: [i32; LANES] = lanes!(k => q0[k] | q1[k] << 16);
            let lower: [i32; LANES] = lanes!(k => (32768 - (q0[k] + q1[k] + q3[k])) | q3[k] << 16);
            let mut k = 0;
            while k < LANES {
                let above = at.add(*offset.add(k) as usize);
                let rows = row_sums(above, above.add(2 * stride), [upper[k], lower[k]]);
                let mut i = 0;
                while i < 4 {
                    sums[i][k] = rows[i];
                    i += 1;
                }
                k += 1;
            }
            let mut sum = Self(sums[0]).mul(column[0]);
            sum = Self(sums[1]).mul_add(column[1], sum);
            sum = Self(sums[2]).mul_add(column[2], sum);
            Self(sums[3]).mul_add(column[3], sum)
        }
    }
    #[inline(always)]
    unsafe fn patch_of_two(at: *const u32, offset: *const u32, row: [Self; 2], column: [Self; 2]) -> Self {
        // SAFETY: the caller guarantees sixteen offsets, that each lane's patch lies inside `at`,
        // and weights in 0..=1.
        unsafe {
            let q: [i32; LANES] = lanes!(k => integer(round_ties_even(row[0].0[k] * 16384.0)));
            let left: [u32; LANES] = lanes!(k => *at.add(*offset.add(k) as usize));
            let right: [u32; LANES] = lanes!(k => *at.add(*offset.add(k) as usize + 1));
            let left = Self(lanes!(k => pair_sum(left[k], q[k], 16384 - q[k]) as f32));
            let right = Self(lanes!(k => pair_sum(right[k], q[k], 16384 - q[k]) as f32));
            right.mul_add(column[1], left.mul(column[0]))
        }
    }
    #[inline(always)]
    unsafe fn not_above(at: *const u32, most: u32) -> [u32; LANES] {
        // SAFETY: the caller guarantees sixteen readable elements.
        let all = unsafe { at.cast::<[u32; LANES]>().read_unaligned() };
        lanes!(k => if all[k] <= most { u32::MAX } else { 0 })
    }
    #[inline(always)]
    unsafe fn replace_where(mask: [u32; LANES], at: *mut u32, with: u32) {
        // SAFETY: the caller guarantees sixteen elements.
        unsafe {
            let at = at.cast::<[u32; LANES]>();
            let old = at.read_unaligned();
            at.write_unaligned(lanes!(k => (with & mask[k]) | (old[k] & !mask[k])));
        }
    }
    #[inline(always)]
    unsafe fn load_halves(from: *const u16) -> Self {
        // SAFETY: the caller guarantees sixteen readable elements.
        let halves = unsafe { from.cast::<[u16; LANES]>().read_unaligned() };
        Self(lanes!(k => f32::from(halves[k])))
    }
    #[inline(always)]
    unsafe fn replace_halves_where(mask: [u32; LANES], at: *mut u16, with: u16) {
        // SAFETY: the caller guarantees sixteen elements.
        unsafe {
            let at = at.cast::<[u16; LANES]>();
            let old = at.read_unaligned();
            at.write_unaligned(lanes!(k => (with & mask[k] as u16) | (old[k] & !mask[k] as u16)));
        }
    }
    #[inline(always)]
    unsafe fn add_halves(a: Self, b: Self, to: *mut f32) {
        let half = |x: &[f32; LANES], k: usize| (x[k] + x[k + 8]) + (x[k + 4] + x[k + 12]);
        let sums = [&a.0, &b.0].map(|x| [0, 2].map(|k| half(x, k) + half(x, k + 1)));
        // SAFETY: the caller guarantees four numbers there.
        unsafe {
            let at = to.cast::<[[f32; 2]; 2]>();
            let before = at.read_unaligned();
            at.write_unaligned([0, 1].map(|i| [0, 1].map(|j| before[i][j] + sums[i][j])));
        }
    }
    #[inline(always)]
    unsafe fn prefetch(_at: *const f32) {}
}
