//! Samples the filtered image between its nodes, sixteen positions at a time.
#![allow(unsafe_code, reason = "runs on `Lanes`, by pointer")]

use simd::Lanes;

use super::kernel::Method;
use super::nodes::Nodes;

/// Interpolation between nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sampling {
    /// The sum of the 4×4 cubic B-splines around a position.
    Spline,
    /// Bilinear between the 2×2 nodes around a position.
    Linear,
    /// The nearest node.
    Nearest,
}

impl Sampling {
    pub(crate) fn of(method: Method) -> Self {
        match method {
            Method::Gaussian | Method::GaussianTruncated | Method::Gaussian4 | Method::BSpline3 => Self::Spline,
            Method::Linear => Self::Linear,
            Method::Nearest => Self::Nearest,
        }
    }

    /// Number of nodes from the first of a position's patch to the one at or before the
    /// position, along each axis.
    pub(crate) fn back(self) -> usize {
        usize::from(self == Self::Spline)
    }

    /// Row weights are integers in units of 2 to the power of minus this.
    pub(crate) fn weight_bits(self) -> i32 {
        match self {
            Self::Spline => 15,
            Self::Linear | Self::Nearest => 14,
        }
    }
}

/// The code of a [`Sampling`]. `t` ∈ [0, 1) is the distance of a position from its node.
///
/// # Safety
/// The instruction set of `L` must be available; patches must lie inside the nodes.
#[allow(unsafe_code, reason = "methods over `Lanes`")]
pub(crate) unsafe trait Sampler {
    type Weights<L: Lanes>: Copy;
    unsafe fn weights<L: Lanes>(t: L) -> Self::Weights<L>;
    /// Returns the result of [`Self::patch`], to the bit, if every node is 1 (a row's weights
    /// sum to 1 exactly).
    ///
    /// It is 1 except for rounding. Used as certainty, the rounding of the weights cancels in
    /// numerator over weight, and a constant stays constant.
    unsafe fn ones<L: Lanes>(column: Self::Weights<L>) -> L;
    unsafe fn patch<L: Lanes>(nodes: &Nodes, offset: *const u32, row: Self::Weights<L>, column: Self::Weights<L>) -> L;
}

/// [`Sampling::Spline`].
pub(crate) struct Spline;

// SAFETY: passes the caller's guarantees on.
unsafe impl Sampler for Spline {
    type Weights<L: Lanes> = [L; 4];

    /// Weights of the four cubic B-splines that reach the position.
    #[inline(always)]
    unsafe fn weights<L: Lanes>(t: L) -> [L; 4] {
        // SAFETY: as for this function.
        unsafe {
            let sixth = L::splat(1.0 / 6.0);
            let s = L::splat(1.0).sub(t);
            let t2 = t.mul(t);
            let first = s.mul(s).mul(s.mul(sixth));
            let last = t2.mul(t.mul(sixth));
            let second = t.mul_add(L::splat(0.5), L::splat(-1.0)).mul_add(t2, L::splat(2.0 / 3.0));
            // The remainder to 1: a constant image stays constant.
            let third = L::splat(1.0).sub(first).sub(last).sub(second);
            [first, second, third, last]
        }
    }

    #[inline(always)]
    unsafe fn ones<L: Lanes>(column: [L; 4]) -> L {
        // SAFETY: as for this function.
        unsafe { column[3].add(column[2].add(column[1].add(column[0]))) }
    }

    #[inline(always)]
    unsafe fn patch<L: Lanes>(nodes: &Nodes, offset: *const u32, row: [L; 4], column: [L; 4]) -> L {
        // SAFETY: as for this function.
        unsafe { L::patch(nodes.pairs.as_ptr(), nodes.stride, offset, row, column) }
    }
}

/// [`Sampling::Linear`].
pub(crate) struct Linear;

// SAFETY: passes the caller's guarantees on.
unsafe impl Sampler for Linear {
    type Weights<L: Lanes> = [L; 2];

    #[inline(always)]
    unsafe fn weights<L: Lanes>(t: L) -> [L; 2] {
        // SAFETY: as for this function.
        unsafe { [L::splat(1.0).sub(t), t] }
    }

    #[inline(always)]
    unsafe fn ones<L: Lanes>(column: [L; 2]) -> L {
        // SAFETY: as for this function.
        unsafe { column[1].add(column[0]) }
    }

    #[inline(always)]
    unsafe fn patch<L: Lanes>(nodes: &Nodes, offset: *const u32, row: [L; 2], column: [L; 2]) -> L {
        // SAFETY: as for this function.
        unsafe { L::patch_of_two(nodes.pairs.as_ptr(), offset, row, column) }
    }
}

/// [`Sampling::Nearest`]: the whole weight on one of two nodes.
pub(crate) struct Nearest;

// SAFETY: passes the caller's guarantees on.
unsafe impl Sampler for Nearest {
    type Weights<L: Lanes> = [L; 2];

    #[inline(always)]
    unsafe fn weights<L: Lanes>(t: L) -> [L; 2] {
        // SAFETY: as for this function.
        unsafe {
            let first = L::select(L::splat(0.5).le(t), L::splat(0.0), L::splat(1.0));
            [first, L::splat(1.0).sub(first)]
        }
    }

    #[inline(always)]
    unsafe fn ones<L: Lanes>(_column: [L; 2]) -> L {
        // SAFETY: as for this function.
        unsafe { L::splat(1.0) }
    }

    #[inline(always)]
    unsafe fn patch<L: Lanes>(nodes: &Nodes, offset: *const u32, row: [L; 2], column: [L; 2]) -> L {
        // SAFETY: as for this function.
        unsafe { Linear::patch(nodes, offset, row, column) }
    }
}
