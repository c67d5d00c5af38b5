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
mod lanes;
pub mod portable;
pub mod sharing;
pub mod team;
pub mod wide;

pub use lanes::{LANES, Lanes};

/// Taylor coefficients (ln 2)ᵏ/k! of 2ᶠ for k = 7 to 1; that of k = 0 is 1. At |f| ≤ ½ the
/// first omitted term is below 6e-9.
pub const POWER_OF_TWO: [f32; 7] =
    [1.525_273e-5, 1.540_353e-4, 1.333_355_8e-3, 9.618_129e-3, 5.550_411e-2, 2.402_265e-1, std::f32::consts::LN_2];

/// Instruction set of the hot loops.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Simd {
    /// AVX-512 F and BW, one register of 16 lanes.
    Avx512,
    /// AVX2 and FMA, two registers of 8 lanes.
    Avx2,
    /// Vectors of the compiler's target: SSE2, or NEON on aarch64. Without an instruction for
    /// fused multiply-add, it is made of others.
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
    #[inline]
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

    /// Runs scalar code compiled with the set's fused multiply-add, which otherwise may be a
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
