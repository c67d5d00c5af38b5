//! Sixteen f32 lanes, with the same operations in the same order on every instruction set.
//!
//! The hot loops are written once over `Lanes`. Each implementation fuses multiply-add exactly
//! where the trait requires it, rounds as IEEE 754 specifies, and uses no reciprocal estimates.
//! AVX-512, AVX2 and portable code thus give the same bits.
//!
//! Code over lanes is `#[inline(always)]` and free of closures. A closure is a separate
//! function without the caller's instruction set; if the compiler does not inline it, every
//! vector in it goes through memory.

#[cfg(target_arch = "x86_64")]
pub mod avx2;
#[cfg(target_arch = "x86_64")]
pub mod avx512;
pub mod portable;
pub mod sharing;
pub mod wide;

/// Lanes in a vector.
pub const LANES: usize = 16;

/// Taylor coefficients (ln 2)ᵏ/k! of 2ᶠ for k = 7 to 1; that of k = 0 is 1. At |f| ≤ ½ the
/// first omitted term is below 6e-9.
pub const POWER_OF_TWO: [f32; 7] =
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
    /// All instruction sets, best first.
    pub const ALL: [Self; 3] = [Self::Avx512, Self::Avx2, Self::Portable];

    /// Environment variable that names the set to use instead of the best one.
    pub const VARIABLE: &str = "SONOWEAVE_SIMD";

    /// Returns the best set that this machine has, or the one that [`Self::VARIABLE`] names if the
    /// machine has it.
    pub fn detect() -> Self {
        let named = std::env::var(Self::VARIABLE).unwrap_or_default();
        let named = Self::ALL.into_iter().find(|s| s.name() == named && s.is_available());
        named.or_else(|| Self::ALL.into_iter().find(|s| s.is_available())).unwrap_or(Self::Portable)
    }

    /// Whether this machine supports it.
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

    /// Runs scalar code compiled with the set's fused multiply-add, which otherwise is a
    /// library call; the bits are the same.
    ///
    /// # Panics
    /// If the machine lacks the set.
    #[allow(unsafe_code, reason = "calls code compiled for an instruction set after checking that the machine has it")]
    pub fn fused<J: Fused>(self, job: J) -> J::Output {
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2,fma")]
        fn avx2<J: Fused>(job: J) -> J::Output {
            job.run()
        }
        assert!(self.is_available(), "{} is not available on this machine", self.name());
        match self {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the assertion above detected the features (AVX-512 F implies AVX2 and FMA
            // on every existing processor).
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

/// Scalar code for [`Simd::fused`]. `run`, and every function that it calls down to the
/// multiply-adds, must be `#[inline(always)]`. A closure, or a function that the compiler does
/// not inline, lacks the caller's instruction set.
pub trait Fused {
    /// Result of the code.
    type Output;

    /// Runs the code.
    fn run(self) -> Self::Output;
}

/// Sixteen f32.
///
/// # Safety
/// Methods may only be called if the implementation's instruction set is available; the entry
/// points that [`dispatch`] makes ensure this. Pointers must be valid for the sixteen (or
/// stated) elements from them on.
#[allow(unsafe_code, reason = "the methods are intrinsics of an instruction set that the caller has detected")]
#[allow(clippy::missing_safety_doc, reason = "the conditions above hold for every method")]
pub unsafe trait Lanes: Copy {
    /// One bit per lane, in the form that the instruction set prefers.
    type Mask: Copy;

    /// Returns a vector with `x` in every lane.
    unsafe fn splat(x: f32) -> Self;
    /// Loads sixteen numbers.
    unsafe fn load(from: *const f32) -> Self;
    /// Stores sixteen numbers.
    unsafe fn store(self, to: *mut f32);
    /// Sums of the lanes.
    unsafe fn add(self, other: Self) -> Self;
    /// Differences of the lanes.
    unsafe fn sub(self, other: Self) -> Self;
    /// Products of the lanes.
    unsafe fn mul(self, other: Self) -> Self;
    /// Quotients of the lanes.
    unsafe fn div(self, other: Self) -> Self;
    /// self·a + b, rounded once.
    unsafe fn mul_add(self, a: Self, b: Self) -> Self;
    /// The smaller; `other` if either is NaN.
    unsafe fn min(self, other: Self) -> Self;
    /// The larger; `other` if either is NaN.
    unsafe fn max(self, other: Self) -> Self;
    /// Largest integers that are not above the lanes.
    unsafe fn floor(self) -> Self;
    /// Absolute values of the lanes.
    unsafe fn abs(self) -> Self;
    /// Square root, correctly rounded.
    unsafe fn sqrt(self) -> Self;
    /// Nearest integers; ties go to even.
    unsafe fn round_ties_even(self) -> Self;
    /// self·2ⁿ for integral n with |n| ≤ 126 and a normal result, by adding to the exponent.
    unsafe fn scale_by_power_of_two(self, n: Self) -> Self;
    /// Returns m and n with self = m·2ⁿ, m from √½ to below √2 and n integral, for normal lanes
    /// above 0.
    unsafe fn mantissa_and_exponent(self) -> (Self, Self);
    /// Lanes where self < other; false if either is NaN.
    unsafe fn lt(self, other: Self) -> Self::Mask;
    /// Lanes where self ≤ other; false if either is NaN.
    unsafe fn le(self, other: Self) -> Self::Mask;
    /// Lanes that are set in both masks.
    unsafe fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Lane k in bit k.
    unsafe fn bits(mask: Self::Mask) -> u16;
    /// `a` where the mask is set, else `b`.
    unsafe fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// Writes the lanes, which are integral and not negative, as integers.
    unsafe fn store_integers(self, to: *mut u32);
    /// Writes the lanes of two vectors, rounded to the nearest integer (ties to even) and each
    /// within i16: `low` in the low half of each element, `high` in its high half.
    unsafe fn store_pairs(low: Self, high: Self, to: *mut u32);
    /// Lane k: `Σᵢ column[i][k]·(Σⱼ qⱼ[k]·node(offset[k] + j·stride + i))`. The qⱼ are the row
    /// weights in units of 2⁻¹⁵, rounded so that the four sum to 2¹⁵. The inner sums are of
    /// integers and exact; the outer begins with a product and continues in order by fused
    /// multiply-adds.
    ///
    /// An element of `at` holds a node in its low half and the node of the next row in its high
    /// half (as [`Self::store_pairs`] writes them). There are sixteen offsets; the elements (i,
    /// j), i < 4, j ∈ {0, 2}, of each lane's patch must lie inside `at`. Row weights must lie
    /// in 0..=1 and sum to about 1.
    unsafe fn patch(at: *const u32, stride: usize, offset: *const u32, row: [Self; 4], column: [Self; 4]) -> Self;
    /// Lane k: `Σᵢ column[i][k]·(Σⱼ qⱼ[k]·node(offset[k] + j·stride + i))` over i, j < 2. q₀ is
    /// the first row weight in units of 2⁻¹⁴, rounded, and q₁ = 2¹⁴ − q₀. Nodes, offsets and
    /// order as for [`Self::patch`]; elements (0, 0) and (1, 0) of each lane's patch must lie
    /// inside `at`.
    unsafe fn patch_of_two(at: *const u32, offset: *const u32, row: [Self; 2], column: [Self; 2]) -> Self;
    /// Loads sixteen 16-bit integers as numbers.
    unsafe fn load_halves(from: *const u16) -> Self;
    /// Writes a 16-bit integer where the mask is set.
    unsafe fn replace_halves_where(mask: Self::Mask, at: *mut u16, with: u16);
    /// Lanes whose integer in memory is at most `most`.
    unsafe fn not_above(at: *const u32, most: u32) -> Self::Mask;
    /// Writes an integer where the mask is set.
    unsafe fn replace_where(mask: Self::Mask, at: *mut u32, with: u32);
    /// Prefetches the cache line at an address; nothing is read.
    unsafe fn prefetch(at: *const f32);
}

/// Defines `$name`, which runs `$generic::<L>` compiled for the instruction set that a [`Simd`]
/// names.
#[macro_export]
macro_rules! dispatch {
    ($(#[$doc:meta])* $vis:vis fn $name:ident => $generic:ident($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)?) => {
        $(#[$doc])*
        #[allow(unsafe_code, reason = "calls code compiled for an instruction set after checking that the machine has it")]
        #[allow(clippy::too_many_arguments, reason = "the inner loop's inputs, one by one")]
        $vis fn $name(simd: $crate::Simd, $($arg: $ty),*) $(-> $ret)? {
            use $crate::Simd;
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512bw,avx2,fma")]
            fn avx512($($arg: $ty),*) $(-> $ret)? {
                // SAFETY: compiled with the features that `Avx512` needs.
                unsafe { $generic::<$crate::avx512::Avx512>($($arg),*) }
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2($($arg: $ty),*) $(-> $ret)? {
                // SAFETY: compiled with the features that `Avx2` needs.
                unsafe { $generic::<$crate::avx2::Avx2>($($arg),*) }
            }
            assert!(simd.is_available(), "{} is not available on this machine", simd.name());
            match simd {
                #[cfg(target_arch = "x86_64")]
                // SAFETY: the assertion above detected the features (AVX-512 F implies AVX2 and
                // FMA on every existing processor).
                Simd::Avx512 => unsafe { avx512($($arg),*) },
                #[cfg(target_arch = "x86_64")]
                // SAFETY: the assertion above detected the features.
                Simd::Avx2 => unsafe { avx2($($arg),*) },
                // SAFETY: portable lanes need no feature.
                _ => unsafe { $generic::<$crate::portable::Portable>($($arg),*) },
            }
        }
    };
}
#[cfg(test)]
mod tests;
