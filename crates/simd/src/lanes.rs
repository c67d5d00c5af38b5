//! The operations of a vector, which every instruction set implements.

/// Lanes in a vector.
pub const LANES: usize = 16;

/// The bits of √½.
pub(crate) const SQRT_HALF_BITS: i32 = 0x3F35_04F3;

/// Sixteen f32.
///
/// # Safety
/// Methods may only be called if the implementation's instruction set is available; the entry
/// points that [`dispatch`](crate::dispatch) makes ensure this. Pointers must be valid for the
/// sixteen (or stated) elements from them on.
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
    /// Adds to four numbers: the sums of `a` over the two halves of its lanes, then those of `b`.
    /// If lanes are 4×2×2 voxels, a half is a cube: lanes k with k mod 4 below 2, and the others. A
    /// sum is ((x₀ + x₈) + (x₄ + x₁₂)) + ((x₁ + x₉) + (x₅ + x₁₃)), and the same for lanes 2 and 3.
    unsafe fn add_halves(a: Self, b: Self, to: *mut f32);
    /// Prefetches the cache line at an address; nothing is read.
    unsafe fn prefetch(at: *const f32);
}
