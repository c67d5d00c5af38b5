//! Lanes as two AVX2 registers.
#![allow(unsafe_code, reason = "intrinsics of an instruction set that the caller has detected")]

use std::arch::x86_64::*;

use super::lanes::{Lanes, SQRT_HALF_BITS};

/// Sixteen f32 in two registers: lanes 0–7 and 8–15.
#[derive(Clone, Copy)]
pub struct Avx2([__m256; 2]);

/// Applies an intrinsic of two operands to both registers.
macro_rules! both {
    ($intrinsic:expr, $a:expr, $b:expr) => {
        [$intrinsic($a[0], $b[0]), $intrinsic($a[1], $b[1])]
    };
}

/// Methods that are one intrinsic of two operands, applied to both registers.
macro_rules! of_two {
    ($($name:ident = $intrinsic:ident;)*) => {
        $(#[inline(always)]
        unsafe fn $name(self, other: Self) -> Self {
            // SAFETY: as for the trait.
            Self(unsafe { both!($intrinsic, self.0, other.0) })
        })*
    };
}

/// Lanes k of the sums of lanes k, k + 8, k + 4 and k + 12, in this order.
#[inline(always)]
unsafe fn folded(x: [__m256; 2]) -> __m128 {
    // SAFETY: the caller guarantees AVX2.
    unsafe {
        let half = _mm256_add_ps(x[0], x[1]);
        _mm_add_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps::<1>(half))
    }
}

/// Loads two patches' rows side by side, each `down` elements after its pointer.
#[inline(always)]
unsafe fn side_by_side(at: [*const u32; 2], down: usize) -> __m256i {
    // SAFETY: the caller guarantees four readable elements at each pointer, and AVX2.
    unsafe {
        let x = _mm256_castsi128_si256(_mm_loadu_si128(at[0].add(down).cast()));
        _mm256_inserti128_si256::<1>(x, _mm_loadu_si128(at[1].add(down).cast()))
    }
}

/// Transposes the two 4×4 blocks that four registers hold side by side.
#[inline(always)]
unsafe fn transpose_blocks(rows: [__m256; 4]) -> [__m256; 4] {
    // SAFETY: the caller guarantees AVX2.
    unsafe {
        let low01 = _mm256_castps_pd(_mm256_unpacklo_ps(rows[0], rows[1]));
        let high01 = _mm256_castps_pd(_mm256_unpackhi_ps(rows[0], rows[1]));
        let low23 = _mm256_castps_pd(_mm256_unpacklo_ps(rows[2], rows[3]));
        let high23 = _mm256_castps_pd(_mm256_unpackhi_ps(rows[2], rows[3]));
        [
            _mm256_castpd_ps(_mm256_unpacklo_pd(low01, low23)),
            _mm256_castpd_ps(_mm256_unpackhi_pd(low01, low23)),
            _mm256_castpd_ps(_mm256_unpacklo_pd(high01, high23)),
            _mm256_castpd_ps(_mm256_unpackhi_pd(high01, high23)),
        ]
    }
}

// SAFETY: every method needs AVX2 and FMA, which the trait requires of the caller, and uses
// pointers only within the bounds that the trait requires.
unsafe impl Lanes for Avx2 {
    type Mask = [__m256; 2];

    #[inline(always)]
    unsafe fn splat(x: f32) -> Self {
        // SAFETY: as for the trait.
        Self([unsafe { _mm256_set1_ps(x) }; 2])
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: as for the trait.
        unsafe { Self([_mm256_loadu_ps(from), _mm256_loadu_ps(from.add(8))]) }
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: as for the trait.
        unsafe {
            _mm256_storeu_ps(to, self.0[0]);
            _mm256_storeu_ps(to.add(8), self.0[1]);
        }
    }
    of_two! {
        add = _mm256_add_ps;
        sub = _mm256_sub_ps;
        mul = _mm256_mul_ps;
        div = _mm256_div_ps;
        min = _mm256_min_ps;
        max = _mm256_max_ps;
    }
    #[inline(always)]
    unsafe fn mul_add(self, a: Self, b: Self) -> Self {
        // SAFETY: as for the trait.
        unsafe { Self([_mm256_fmadd_ps(self.0[0], a.0[0], b.0[0]), _mm256_fmadd_ps(self.0[1], a.0[1], b.0[1])]) }
    }
    #[inline(always)]
    unsafe fn floor(self) -> Self {
        // SAFETY: as for the trait.
        Self(unsafe { [_mm256_floor_ps(self.0[0]), _mm256_floor_ps(self.0[1])] })
    }
    #[inline(always)]
    unsafe fn abs(self) -> Self {
        // SAFETY: as for the trait.
        unsafe {
            let sign = _mm256_set1_ps(-0.0);
            Self([_mm256_andnot_ps(sign, self.0[0]), _mm256_andnot_ps(sign, self.0[1])])
        }
    }
    #[inline(always)]
    unsafe fn sqrt(self) -> Self {
        // SAFETY: as for the trait.
        Self(unsafe { [_mm256_sqrt_ps(self.0[0]), _mm256_sqrt_ps(self.0[1])] })
    }
    #[inline(always)]
    unsafe fn round_ties_even(self) -> Self {
        // SAFETY: as for the trait.
        unsafe {
            const NEAREST: i32 = _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC;
            Self([_mm256_round_ps::<NEAREST>(self.0[0]), _mm256_round_ps::<NEAREST>(self.0[1])])
        }
    }
    #[inline(always)]
    unsafe fn scale_by_power_of_two(self, n: Self) -> Self {
        // SAFETY: as for the trait.
        unsafe {
            let mut scaled = self.0;
            for (x, n) in scaled.iter_mut().zip(n.0) {
                let exponent = _mm256_slli_epi32::<23>(_mm256_cvttps_epi32(n));
                *x = _mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(*x), exponent));
            }
            Self(scaled)
        }
    }
    #[inline(always)]
    unsafe fn mantissa_and_exponent(self) -> (Self, Self) {
        // SAFETY: as for the trait.
        unsafe {
            let (mut mantissa, mut exponent) = (self.0, self.0);
            for (mantissa, exponent) in mantissa.iter_mut().zip(&mut exponent) {
                let bits = _mm256_castps_si256(*mantissa);
                let n = _mm256_srai_epi32::<23>(_mm256_sub_epi32(bits, _mm256_set1_epi32(SQRT_HALF_BITS)));
                *mantissa = _mm256_castsi256_ps(_mm256_sub_epi32(bits, _mm256_slli_epi32::<23>(n)));
                *exponent = _mm256_cvtepi32_ps(n);
            }
            (Self(mantissa), Self(exponent))
        }
    }
    #[inline(always)]
    unsafe fn lt(self, other: Self) -> [__m256; 2] {
        // SAFETY: as for the trait.
        unsafe { both!(_mm256_cmp_ps::<_CMP_LT_OQ>, self.0, other.0) }
    }
    #[inline(always)]
    unsafe fn le(self, other: Self) -> [__m256; 2] {
        // SAFETY: as for the trait.
        unsafe { both!(_mm256_cmp_ps::<_CMP_LE_OQ>, self.0, other.0) }
    }
    #[inline(always)]
    unsafe fn and(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
        // SAFETY: as for the trait.
        unsafe { both!(_mm256_and_ps, a, b) }
    }
    #[inline(always)]
    unsafe fn bits(mask: [__m256; 2]) -> u16 {
        // SAFETY: as for the trait.
        unsafe { (_mm256_movemask_ps(mask[0]) | _mm256_movemask_ps(mask[1]) << 8) as u16 }
    }
    #[inline(always)]
    unsafe fn select(mask: [__m256; 2], a: Self, b: Self) -> Self {
        // SAFETY: as for the trait.
        unsafe { Self([_mm256_blendv_ps(b.0[0], a.0[0], mask[0]), _mm256_blendv_ps(b.0[1], a.0[1], mask[1])]) }
    }
    #[inline(always)]
    unsafe fn store_integers(self, to: *mut u32) {
        // SAFETY: as for the trait.
        unsafe {
            _mm256_storeu_si256(to.cast(), _mm256_cvttps_epi32(self.0[0]));
            _mm256_storeu_si256(to.add(8).cast(), _mm256_cvttps_epi32(self.0[1]));
        }
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
            for half in 0..2 {
                let low = _mm256_and_si256(_mm256_cvtps_epi32(low.0[half]), _mm256_set1_epi32(0xFFFF));
                let high = _mm256_slli_epi32::<16>(_mm256_cvtps_epi32(high.0[half]));
                _mm256_storeu_si256(to.add(8 * half).cast(), _mm256_or_si256(low, high));
            }
        }
    }
    #[inline(always)]
    unsafe fn patch(at: *const u32, stride: usize, offset: *const u32, row: [Self; 4], column: [Self; 4]) -> Self {
        // SAFETY: AVX2 and FMA as for the trait; the caller guarantees that each lane's patch
        // lies inside `at`.
        unsafe {
            let unit = _mm256_set1_ps(32768.0);
            let mut value = [_mm256_setzero_ps(); 2];
            #[allow(clippy::needless_range_loop, reason = "the half selects from many arrays at once")]
            for half in 0..2 {
                let q0 = _mm256_cvtps_epi32(_mm256_mul_ps(row[0].0[half], unit));
                let q1 = _mm256_cvtps_epi32(_mm256_mul_ps(row[1].0[half], unit));
                let q3 = _mm256_cvtps_epi32(_mm256_mul_ps(row[3].0[half], unit));
                let q2 = _mm256_sub_epi32(_mm256_set1_epi32(32768), _mm256_add_epi32(_mm256_add_epi32(q0, q1), q3));
                let upper = _mm256_or_si256(q0, _mm256_slli_epi32::<16>(q1));
                let lower = _mm256_or_si256(q2, _mm256_slli_epi32::<16>(q3));
                // Group g takes lanes g and g+4 of this half, so that the transposition leaves
                // the lanes in their natural order.
                let mut sums = [_mm256_setzero_ps(); 4];
                macro_rules! group {
                    ($g:literal, $spread:literal) => {
                        let p = [
                            at.add(*offset.add(8 * half + $g) as usize),
                            at.add(*offset.add(8 * half + $g + 4) as usize),
                        ];
                        let above = _mm256_madd_epi16(side_by_side(p, 0), _mm256_shuffle_epi32::<$spread>(upper));
                        let below =
                            _mm256_madd_epi16(side_by_side(p, 2 * stride), _mm256_shuffle_epi32::<$spread>(lower));
                        sums[$g] = _mm256_cvtepi32_ps(_mm256_add_epi32(above, below));
                    };
                }
                group!(0, 0x00);
                group!(1, 0x55);
                group!(2, 0xAA);
                group!(3, 0xFF);
                let sums = transpose_blocks(sums);
                let mut v = _mm256_mul_ps(sums[0], column[0].0[half]);
                v = _mm256_fmadd_ps(sums[1], column[1].0[half], v);
                v = _mm256_fmadd_ps(sums[2], column[2].0[half], v);
                value[half] = _mm256_fmadd_ps(sums[3], column[3].0[half], v);
            }
            Self(value)
        }
    }
    #[inline(always)]
    unsafe fn patch_of_two(at: *const u32, offset: *const u32, row: [Self; 2], column: [Self; 2]) -> Self {
        // SAFETY: AVX2 and FMA as for the trait; the caller guarantees that each lane's patch
        // lies inside `at`.
        unsafe {
            let mut value = [_mm256_setzero_ps(); 2];
            for (half, value) in value.iter_mut().enumerate() {
                let q0 = _mm256_cvtps_epi32(_mm256_mul_ps(row[0].0[half], _mm256_set1_ps(16384.0)));
                let q1 = _mm256_sub_epi32(_mm256_set1_epi32(16384), q0);
                let q = _mm256_or_si256(q0, _mm256_slli_epi32::<16>(q1));
                let offset = _mm256_loadu_si256(offset.add(8 * half).cast());
                let left = _mm256_i32gather_epi32::<4>(at.cast(), offset);
                let right = _mm256_i32gather_epi32::<4>(at.add(1).cast(), offset);
                let left = _mm256_cvtepi32_ps(_mm256_madd_epi16(left, q));
                let right = _mm256_cvtepi32_ps(_mm256_madd_epi16(right, q));
                *value = _mm256_fmadd_ps(right, column[1].0[half], _mm256_mul_ps(left, column[0].0[half]));
            }
            Self(value)
        }
    }
    #[inline(always)]
    unsafe fn not_above(at: *const u32, most: u32) -> [__m256; 2] {
        // SAFETY: as for the trait.
        unsafe {
            let most = _mm256_set1_epi32(most.cast_signed());
            let mut mask = [_mm256_setzero_ps(); 2];
            for (half, mask) in mask.iter_mut().enumerate() {
                let x = _mm256_loadu_si256(at.add(8 * half).cast());
                *mask = _mm256_castsi256_ps(_mm256_cmpeq_epi32(_mm256_max_epu32(x, most), most));
            }
            mask
        }
    }
    #[inline(always)]
    unsafe fn replace_where(mask: [__m256; 2], at: *mut u32, with: u32) {
        // SAFETY: as for the trait.
        unsafe {
            let with = _mm256_set1_epi32(with.cast_signed());
            for (half, mask) in mask.into_iter().enumerate() {
                _mm256_maskstore_epi32(at.add(8 * half).cast(), _mm256_castps_si256(mask), with);
            }
        }
    }
    #[inline(always)]
    unsafe fn load_halves(from: *const u16) -> Self {
        // SAFETY: as for the trait.
        unsafe {
            let low = _mm256_cvtepu16_epi32(_mm_loadu_si128(from.cast()));
            let high = _mm256_cvtepu16_epi32(_mm_loadu_si128(from.add(8).cast()));
            Self([_mm256_cvtepi32_ps(low), _mm256_cvtepi32_ps(high)])
        }
    }
    #[inline(always)]
    unsafe fn replace_halves_where(mask: [__m256; 2], at: *mut u16, with: u16) {
        // SAFETY: as for the trait.
        unsafe {
            // Packing interleaves the registers' halves; the permutation puts them in order.
            let packed = _mm256_packs_epi32(_mm256_castps_si256(mask[0]), _mm256_castps_si256(mask[1]));
            let mask = _mm256_permute4x64_epi64::<0b11_01_10_00>(packed);
            let old = _mm256_loadu_si256(at.cast());
            let new = _mm256_blendv_epi8(old, _mm256_set1_epi16(with.cast_signed()), mask);
            _mm256_storeu_si256(at.cast(), new);
        }
    }
}
