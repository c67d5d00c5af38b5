//! Sixteen f32 lanes, the same operations in the same order on every instruction set.
//!
//! The hot loops are written once over `Lanes`. Each implementation fuses multiply-add where the trait says so, rounds as IEEE 754 says, and uses no
//! reciprocal estimates: AVX-512, AVX2 and portable give the same bits.
//!
//! Code over lanes is `#[inline(always)]` and free of closures: a closure is a function of its own without the caller's instruction set, and
//! where the compiler does not inline it, every vector in it goes through memory.

#[cfg(target_arch = "x86_64")]
pub(crate) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) mod avx512;
pub(crate) mod portable;
pub(crate) mod wide;

/// Lanes in a vector.
pub(crate) const LANES: usize = 16;

/// Taylor coefficients (ln 2)ᵏ/k! of 2ᶠ for k = 7 to 1; that of k = 0 is 1. At |f| ≤ ½ the first term left out is below 6e-9.
pub(crate) const POWER_OF_TWO: [f32; 7] =
    [1.525_273e-5, 1.540_353e-4, 1.333_355_8e-3, 9.618_129e-3, 5.550_411e-2, 2.402_265e-1, std::f32::consts::LN_2];
/// The bits of √½.
pub(crate) const SQRT_HALF_BITS: i32 = 0x3F35_04F3;

/// Instruction set of the hot loops.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Simd {
    /// AVX-512 F and BW, one register of 16 lanes.
    Avx512,
    /// AVX2 and FMA, two registers of 8 lanes.
    Avx2,
    /// Scalar code with fused multiply-add.
    Portable,
}

impl Simd {
    /// All, best first.
    pub const ALL: [Self; 3] = [Self::Avx512, Self::Avx2, Self::Portable];

    /// The best this machine has.
    pub fn detect() -> Self {
        Self::ALL.into_iter().find(|s| s.is_available()).unwrap_or(Self::Portable)
    }

    /// Whether this machine has it.
    pub fn is_available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                std::arch::is_x86_feature_detected!("avx512f") && std::arch::is_x86_feature_detected!("avx512bw")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma"),
            Self::Portable => true,
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// Runs scalar code compiled with the set's fused multiply-add, which is a library call without; the same bits either way.
    ///
    /// # Panics
    /// Where the machine lacks the set.
    #[allow(unsafe_code, reason = "calls code compiled for an instruction set after checking that the machine has it")]
    pub(crate) fn fused<J: Fused>(self, job: J) -> J::Output {
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2,fma")]
        fn avx2<J: Fused>(job: J) -> J::Output {
            job.run()
        }
        assert!(self.is_available(), "{} is not available on this machine", self.name());
        match self {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the assertion above detected the features (AVX-512 F implies AVX2 and FMA on every processor that has it).
            Self::Avx512 | Self::Avx2 => unsafe { avx2(job) },
            _ => job.run(),
        }
    }

    /// The name on the command line and in statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Avx512 => "avx512",
            Self::Avx2 => "avx2",
            Self::Portable => "portable",
        }
    }
}

/// Scalar code for [`Simd::fused`]. `run` is `#[inline(always)]`, and so is all that it calls down to the multiply-adds: a closure, or a function that the
/// compiler leaves by itself, has not the caller's instruction set.
pub(crate) trait Fused {
    /// What it gives.
    type Output;

    fn run(self) -> Self::Output;
}

/// Sixteen f32.
///
/// # Safety
/// Methods may only be called where the implementation's instruction set is available; the entry points that [`dispatch`] makes see to it. Pointers
/// must be valid for the sixteen (or stated) elements from them on.
#[allow(unsafe_code, reason = "the methods are intrinsics of an instruction set that the caller has detected")]
pub(crate) unsafe trait Lanes: Copy {
    /// A bit a lane, in the form the instruction set likes.
    type Mask: Copy;

    unsafe fn splat(x: f32) -> Self;
    unsafe fn load(from: *const f32) -> Self;
    unsafe fn store(self, to: *mut f32);
    unsafe fn add(self, other: Self) -> Self;
    unsafe fn sub(self, other: Self) -> Self;
    unsafe fn mul(self, other: Self) -> Self;
    unsafe fn div(self, other: Self) -> Self;
    /// self·a + b, rounded once.
    unsafe fn mul_add(self, a: Self, b: Self) -> Self;
    /// The smaller; `other` where either is NaN.
    unsafe fn min(self, other: Self) -> Self;
    /// The larger; `other` where either is NaN.
    unsafe fn max(self, other: Self) -> Self;
    unsafe fn floor(self) -> Self;
    unsafe fn abs(self) -> Self;
    /// Square root, correctly rounded.
    unsafe fn sqrt(self) -> Self;
    unsafe fn round_ties_even(self) -> Self;
    /// self·2ⁿ for integral n with |n| ≤ 126 and a normal result, by adding to the exponent.
    unsafe fn scale_by_power_of_two(self, n: Self) -> Self;
    /// m and n with self = m·2ⁿ, m from √½ to below √2 and n integral, of normal lanes above 0.
    unsafe fn mantissa_and_exponent(self) -> (Self, Self);
    /// Lanes where self < other; false where either is NaN.
    unsafe fn lt(self, other: Self) -> Self::Mask;
    /// Lanes where self ≤ other; false where either is NaN.
    unsafe fn le(self, other: Self) -> Self::Mask;
    unsafe fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Lane k in bit k.
    unsafe fn bits(mask: Self::Mask) -> u16;
    /// `a` where the mask is set, else `b`.
    unsafe fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// Writes the lanes, which are integral and not negative, as integers.
    unsafe fn store_integers(self, to: *mut u32);
    /// Writes the lanes of two vectors, rounded to the nearest integer (ties to even) and each within i16: `low` in the low half of each
    /// element, `high` in its high half.
    unsafe fn store_pairs(low: Self, high: Self, to: *mut u32);
    /// Lane k: `Σᵢ column[i][k]·(Σⱼ qⱼ[k]·node(offset[k] + j·stride + i))`, where qⱼ are the row weights in units of 2⁻¹⁵, rounded so that the four
    /// sum to 2¹⁵. The inner sums are of integers and exact; the outer begins with a product and continues in order by fused multiply-adds.
    ///
    /// An element of `at` holds a node in its low half and the node of the next row in its high half (as [`Self::store_pairs`] writes them).
    /// There are sixteen offsets; the elements (i, j), i < 4, j ∈ {0, 2}, of each lane's patch must lie inside `at`. Row weights must
    /// lie in 0..=1 and sum to about 1.
    unsafe fn patch(at: *const u32, stride: usize, offset: *const u32, row: [Self; 4], column: [Self; 4]) -> Self;
    /// Lane k: `Σᵢ column[i][k]·(Σⱼ qⱼ[k]·node(offset[k] + j·stride + i))` over i, j < 2, where q₀ is the first row weight in units of 2⁻¹⁴, rounded, and q₁
    /// the rest of 2¹⁴. Nodes, offsets and order as for [`Self::patch`]; elements (0, 0) and (1, 0) of each lane's patch must lie inside `at`.
    unsafe fn patch_of_two(at: *const u32, offset: *const u32, row: [Self; 2], column: [Self; 2]) -> Self;
    /// Sixteen 16-bit integers in memory, as numbers.
    unsafe fn load_halves(from: *const u16) -> Self;
    /// Writes a 16-bit integer where the mask is set.
    unsafe fn replace_halves_where(mask: Self::Mask, at: *mut u16, with: u16);
    /// Lanes whose integer in memory is at most `most`.
    unsafe fn not_above(at: *const u32, most: u32) -> Self::Mask;
    /// Writes an integer where the mask is set.
    unsafe fn replace_where(mask: Self::Mask, at: *mut u32, with: u32);
    /// Asks for the cache line at an address; nothing is read.
    unsafe fn prefetch(at: *const f32);
}

/// Makes `$name`, which runs `$generic::<L>` compiled for the instruction set that a [`Simd`] names.
macro_rules! dispatch {
    ($(#[$doc:meta])* $vis:vis fn $name:ident => $generic:ident($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)?) => {
        $(#[$doc])*
        #[allow(unsafe_code, reason = "calls code compiled for an instruction set after checking that the machine has it")]
        #[allow(clippy::too_many_arguments, reason = "the inner loop's inputs, one by one")]
        $vis fn $name(simd: $crate::simd::Simd, $($arg: $ty),*) $(-> $ret)? {
            use $crate::simd::{self, Simd};
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512bw,avx2,fma")]
            fn avx512($($arg: $ty),*) $(-> $ret)? {
                // SAFETY: compiled with the features that `Avx512` needs.
                unsafe { $generic::<simd::avx512::Avx512>($($arg),*) }
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2($($arg: $ty),*) $(-> $ret)? {
                // SAFETY: compiled with the features that `Avx2` needs.
                unsafe { $generic::<simd::avx2::Avx2>($($arg),*) }
            }
            assert!(simd.is_available(), "{} is not available on this machine", simd.name());
            match simd {
                #[cfg(target_arch = "x86_64")]
                // SAFETY: the assertion above detected the features (AVX-512 F implies AVX2 and FMA on every processor that has it).
                Simd::Avx512 => unsafe { avx512($($arg),*) },
                #[cfg(target_arch = "x86_64")]
                // SAFETY: the assertion above detected the features.
                Simd::Avx2 => unsafe { avx2($($arg),*) },
                // SAFETY: portable lanes need no feature.
                _ => unsafe { $generic::<simd::portable::Portable>($($arg),*) },
            }
        }
    };
}
pub(crate) use dispatch;

#[cfg(test)]
mod tests;
