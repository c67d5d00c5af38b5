//! Lanes as one AVX-512 register.
#![allow(unsafe_code, reason = "intrinsics of an instruction set that the caller has detected")]

use std::arch::x86_64::*;

use super::lanes::{Lanes, SQRT_HALF_BITS};

/// Sixteen f32 in a register.
#[derive(Clone, Copy)]
pub struct Avx512(__m512);

/// Methods that are one intrinsic of two operands.
macro_rules! of_two {
    ($($name:ident = $intrinsic:ident;)*) => {
        $(#[inline(always)]
        unsafe fn $name(self, other: Self) -> Self {
            // SAFETY: as for the trait.
            Self(unsafe { $intrinsic(self.0, other.0) })
        })*
    };
}

/// Lanes k of the sums of lanes k, k + 8, k + 4 and k + 12, in this order.
#[inline(always)]
unsafe fn folded(x: __m512) -> __m128 {
    // SAFETY: the caller guarantees AVX-512 F.
    unsafe {
        let high = _mm256_castpd_ps(_mm512_extractf64x4_pd::<1>(_mm512_castps_pd(x)));
        let half = _mm256_add_ps(_mm512_castps512_ps256(x), high);
        _mm_add_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps::<1>(half))
    }
}

/// Loads four patches' rows side by side, each `down` elements after its pointer: lanes 0–3
/// from the first, 4–7 from the second, and so on.
#[inline(always)]
unsafe fn side_by_side(at: [*const u32; 4], down: usize) -> __m512i {
    // SAFETY: the caller guarantees four readable elements at each pointer, and AVX-512 F.
    unsafe {
        let x = _mm512_castsi128_si512(_mm_loadu_si128(at[0].add(down).cast()));
        let x = _mm512_inserti32x4::<1>(x, _mm_loadu_si128(at[1].add(down).cast()));
        let x = _mm512_inserti32x4::<2>(x, _mm_loadu_si128(at[2].add(down).cast()));
        _mm512_inserti32x4::<3>(x, _mm_loadu_si128(at[3].add(down).cast()))
    }
}

/// Transposes the four 4×4 blocks that four registers hold side by side.
#[inline(always)]
unsafe fn transpose_blocks(rows: [__m512; 4]) -> [__m512; 4] {
    // SAFETY: the caller guarantees AVX-512 F.
    unsafe {
        let low01 = _mm512_castps_pd(_mm512_unpacklo_ps(rows[0], rows[1]));
        let high01 = _mm512_castps_pd(_mm512_unpackhi_ps(rows[0], rows[1]));
        let low23 = _mm512_castps_pd(_mm512_unpacklo_ps(rows[2], rows[3]));
        let high23 = _mm512_castps_pd(_mm512_unpackhi_ps(rows[2], rows[3]));
        [
            _mm512_castpd_ps(_mm512_unpacklo_pd(low01, low23)),
            _mm512_castpd_ps(_mm512_unpackhi_pd(low01, low23)),
            _mm512_castpd_ps(_mm512_unpacklo_pd(high01, high23)),
            _mm512_castpd_ps(_mm512_unpackhi_pd(high01, high23)),
        ]
    }
}

// SAFETY: every method needs AVX-512 F and BW, which the trait requires of the caller, and uses
// pointers only within the bounds that the trait requires.
unsafe impl Lanes for Avx512 {
    type Mask = __mmask16;

    #[inline(always)]
    unsafe fn splat(x: f32) -> Self {
        // SAFETY: as for the trait.
        Self(unsafe { _mm512_set1_ps(x) })
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: as for the trait.
        Self(unsafe { _mm512_loadu_ps(from) })
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: as for the trait.
        unsafe { _mm512_storeu_ps(to, self.0) }
    }
    of_two! {
        add = _mm512_add_ps;
        sub = _mm512_sub_ps;
        mul = _mm512_mul_ps;
        div = _mm512_div_ps;
        min = _mm512_min_ps;
        max = _mm512_max_ps;
    }
    #[inline(always)]
    unsafe fn mul_add(self, a: Self, b: Self) -> Self {
        // SAFETY: as for the trait.
        Self(unsafe { _mm512_fmadd_ps(self.0, a.0, b.0) })
    }
    #[inline(always)]
    unsafe fn floor(self) -> Self {
        // SAFETY: as for the trait.
        Self(unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(self.0) })
    }
    #[inline(always)]
    unsafe fn abs(self) -> Self {
        // SAFETY: as for the trait.
        Self(unsafe { _mm512_abs_ps(self.0) })
    }
    #[inline(always)]
    unsafe fn sqrt(self) -> Self {
        // SAFETY: as for the trait.
        Self(unsafe { _mm512_sqrt_ps(self.0) })
    }
    #[inline(always)]
    unsafe fn round_ties_even(self) -> Self {
        // SAFETY: as for the trait.
        Self(unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(self.0) })
    }
    #[inline(always)]
    unsafe fn scale_by_power_of_two(self, n: Self) -> Self {
        // SAFETY: as for the trait.
        unsafe {
            let exponent = _mm512_slli_epi32::<23>(_mm512_cvttps_epi32(n.0));
            Self(_mm512_castsi512_ps(_mm512_add_epi32(_mm512_castps_si512(self.0), exponent)))
        }
    }
    #[inline(always)]
    unsafe fn mantissa_and_exponent(self) -> (Self, Self) {
        // SAFETY: as for the trait.
        unsafe {
            let bits = _mm512_castps_si512(self.0);
            let n = _mm512_srai_epi32::<23>(_mm512_sub_epi32(bits, _mm512_set1_epi32(SQRT_HALF_BITS)));
            let mantissa = _mm512_sub_epi32(bits, _mm512_slli_epi32::<23>(n));
            (Self(_mm512_castsi512_ps(mantissa)), Self(_mm512_cvtepi32_ps(n)))
        }
    }
    #[inline(always)]
    unsafe fn lt(self, other: Self) -> __mmask16 {
        // SAFETY: as for the trait.
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0) }
    }
    #[inline(always)]
    unsafe fn le(self, other: Self) -> __mmask16 {
        // SAFETY: as for the trait.
        unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, other.0) }
    }
    #[inline(always)]
    unsafe fn and(a: __mmask16, b: __mmask16) -> __mmask16 {
        a & b
    }
    #[inline(always)]
    unsafe fn bits(mask: __mmask16) -> u16 {
        mask
    }
    #[inline(always)]
    unsafe fn select(mask: __mmask16, a: Self, b: Self) -> Self {
        // SAFETY: as for the trait.
        Self(unsafe { _mm512_mask_blend_ps(mask, b.0, a.0) })
    }
    #[inline(always)]
    unsafe fn store_integers(self, to: *mut u32) {
        // SAFETY: as for the trait.
        unsafe { _mm512_storeu_si512(to.cast(), _mm512_cvttps_epi32(self.0)) }
    }
    #[inline(always)]
    unsafe fn add_halves(a: Self, b: Self, to: *mut f32) {
        // SAFETY: the caller guarantees four numbers at `to`; the rest as for the trait.
        unsafe {
            let sums = _mm_hadd_ps(folded(a.0), folded(b.0));
            _mm_storeu_ps(to, _mm_add_ps(_mm_loadu_ps(to), sums));
        }
    }
    #[inline(always)]
    unsafe fn prefetch(at: *const f32) {
        // SAFETY: a prefetch reads nothing.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(at.cast()) }
    }
    #[inline(always)]
    unsafe fn store_pairs(low: Self, high: Self, to: *mut u32) {
        // SAFETY: as for the trait.
        unsafe {
            let low = _mm512_and_si512(_mm512_cvtps_epi32(low.0), _mm512_set1_epi32(0xFFFF));
            let high = _mm512_slli_epi32::<16>(_mm512_cvtps_epi32(high.0));
            _mm512_storeu_si512(to.cast(), _mm512_or_si512(low, high));
        }
    }
    #[inline(always)]
    unsafe fn patch(at: *const u32, stride: usize, offset: *const u32, row: [Self; 4], column: [Self; 4]) -> Self {
        // SAFETY: AVX-512 F and BW as for the trait; the caller guarantees that each lane's
        // patch lies inside `at`.
        unsafe {
            let unit = _mm512_set1_ps(32768.0);
            let q0 = _mm512_cvtps_epi32(_mm512_mul_ps(row[0].0, unit));
            let q1 = _mm512_cvtps_epi32(_mm512_mul_ps(row[1].0, unit));
            let q3 = _mm512_cvtps_epi32(_mm512_mul_ps(row[3].0, unit));
            let q2 = _mm512_sub_epi32(_mm512_set1_epi32(32768), _mm512_add_epi32(_mm512_add_epi32(q0, q1), q3));
            let upper = _mm512_or_si512(q0, _mm512_slli_epi32::<16>(q1));
            let lower = _mm512_or_si512(q2, _mm512_slli_epi32::<16>(q3));
            // Group g takes lanes g, g+4, g+8, g+12: after the transposition of 4×4 blocks the
            // lanes are in their natural order. A gather instruction would fetch each of the
            // 128 elements separately; here each load fetches four.
            let mut sums = [_mm512_setzero_ps(); 4];
            macro_rules! group {
                ($g:literal, $spread:ident) => {
                    let p = [
                        at.add(*offset.add($g) as usize),
                        at.add(*offset.add($g + 4) as usize),
                        at.add(*offset.add($g + 8) as usize),
                        at.add(*offset.add($g + 12) as usize),
                    ];
                    let above = _mm512_madd_epi16(side_by_side(p, 0), _mm512_shuffle_epi32::<$spread>(upper));
                    let below = _mm512_madd_epi16(side_by_side(p, 2 * stride), _mm512_shuffle_epi32::<$spread>(lower));
                    sums[$g] = _mm512_cvtepi32_ps(_mm512_add_epi32(above, below));
                };
            }
            group!(0, _MM_PERM_AAAA);
            group!(1, _MM_PERM_BBBB);
            group!(2, _MM_PERM_CCCC);
            group!(3, _MM_PERM_DDDD);
            let sums = transpose_blocks(sums);
            let mut value = _mm512_mul_ps(sums[0], column[0].0);
            value = _mm512_fmadd_ps(sums[1], column[1].0, value);
            value = _mm512_fmadd_ps(sums[2], column[2].0, value);
            Self(_mm512_fmadd_ps(sums[3], column[3].0, value))
        }
    }
    #[inline(always)]
    unsafe fn patch_of_two(at: *const u32, offset: *const u32, row: [Self; 2], column: [Self; 2]) -> Self {
        // SAFETY: AVX-512 F and BW as for the trait. A gathered element is two neighbouring
        // nodes, which the caller guarantees to lie inside `at`.
        unsafe {
            let q0 = _mm512_cvtps_epi32(_mm512_mul_ps(row[0].0, _mm512_set1_ps(16384.0)));
            let q1 = _mm512_sub_epi32(_mm512_set1_epi32(16384), q0);
            let q = _mm512_or_si512(q0, _mm512_slli_epi32::<16>(q1));
            let low = _mm512_i32gather_epi64::<4>(_mm256_loadu_si256(offset.cast()), at.cast());
            let high = _mm512_i32gather_epi64::<4>(_mm256_loadu_si256(offset.add(8).cast()), at.cast());
            let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
            let odd = _mm512_add_epi32(even, _mm512_set1_epi32(1));
            let left = _mm512_permutex2var_epi32(low, even, high);
            let right = _mm512_permutex2var_epi32(low, odd, high);
            let left = _mm512_cvtepi32_ps(_mm512_madd_epi16(left, q));
            let right = _mm512_cvtepi32_ps(_mm512_madd_epi16(right, q));
            Self(_mm512_fmadd_ps(right, column[1].0, _mm512_mul_ps(left, column[0].0)))
        }
    }
    #[inline(always)]
    unsafe fn not_above(at: *const u32, most: u32) -> __mmask16 {
        // SAFETY: as for the trait.
        unsafe { _mm512_cmple_epu32_mask(_mm512_loadu_si512(at.cast()), _mm512_set1_epi32(most.cast_signed())) }
    }
    #[inline(always)]
    unsafe fn replace_where(mask: __mmask16, at: *mut u32, with: u32) {
        // SAFETY: as for the trait.
        unsafe { _mm512_mask_storeu_epi32(at.cast(), mask, _mm512_set1_epi32(with.cast_signed())) }
    }
    #[inline(always)]
    unsafe fn load_halves(from: *const u16) -> Self {
        // SAFETY: as for the trait.
        unsafe { Self(_mm512_cvtepi32_ps(_mm512_cvtepu16_epi32(_mm256_loadu_si256(from.cast())))) }
    }
    #[inline(always)]
    unsafe fn replace_halves_where(mask: __mmask16, at: *mut u16, with: u16) {
        // SAFETY: AVX-512 BW as for the trait; only the first sixteen elements can be in the mask.
        unsafe {
            _mm512_mask_storeu_epi16(at.cast(), __mmask32::from(mask), _mm512_set1_epi16(with.cast_signed()));
        }
    }
}
