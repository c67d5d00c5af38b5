//! The hot loop: one slice into one brick, sixteen voxels at a time.
//!
//! A tile of the brick makes a vector. Plane distance, node column and node row are affine in the voxel, so a vector's are one addition away
//! from its first voxel's. Vectors that the slab does not meet are known before the loop from their extreme lanes (rounding is monotone, so
//! that test loses none). What remains costs one 4×4 spline sum, one Gaussian and two multiply-adds per voxel.
#![allow(unsafe_code, reason = "the inner loop runs on `Lanes`, by pointer")]

use super::kernel::AxisKernel;
use super::nodes::Nodes;
use super::simd::{LANES, Lanes, dispatch};
use super::slab::{LEAST_CERTAINTY, Sight};
use crate::volume::brick::{Brick, TILE, VOXELS, voxel_at};
use crate::volume::sparse::Slot;

/// Vectors in a brick.
const VECTORS: usize = VOXELS / LANES;

/// One brick's share of a slice.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Task {
    pub(crate) slot: Slot,
    pub(crate) sight: Sight,
    /// Node column, node row, plane distance in σ: value at the brick's first voxel, steps per voxel along x, y, z.
    pub(crate) functions: [[f32; 4]; 3],
    /// Voxels that gained weight.
    pub(crate) updated: u32,
    /// Voxels whose weight was clamped.
    pub(crate) clamped: u32,
    /// Vectors that were sampled.
    pub(crate) vectors: u32,
}

/// The slice, filtered, and the off-plane kernel.
#[derive(Clone, Copy)]
pub(crate) struct View<'a> {
    pub(crate) value: &'a Nodes,
    pub(crate) certainty: &'a Nodes,
    /// What the values are relative to.
    pub(crate) level: f32,
    /// Turn what a patch of values, or of certainties, sums to into grey levels and shares: powers of two.
    unit: [f32; 2],
    /// Half width of the support, in σ.
    pub(crate) reach: f32,
    /// Subtracted from the Gaussian.
    pub(crate) pedestal: f32,
    /// Largest weight a voxel keeps.
    pub(crate) most_weight: f32,
}

impl<'a> View<'a> {
    /// A picture and its certainty, seen through the off-plane kernel.
    pub(crate) fn new(
        value: &'a Nodes,
        level: f32,
        certainty: &'a Nodes,
        normal: &AxisKernel,
        most_weight: f32,
    ) -> Self {
        Self {
            value,
            certainty,
            level,
            unit: [value, certainty].map(|nodes| 2.0_f32.powi(-nodes.scale - 15)),
            reach: (normal.support_mm / normal.sigma_mm) as f32,
            pedestal: normal.pedestal as f32,
            most_weight,
        }
    }
}

/// Position of each lane's voxel in its tile, along x, y, z.
const LANE: [[f32; LANES]; 3] = positions(1);
/// Position of each tile's first voxel in the brick, along x, y, z.
const START: [[f32; VECTORS]; 3] = positions(LANES);

/// Along each axis, the positions of every `stride`-th voxel of a brick.
const fn positions<const N: usize>(stride: usize) -> [[f32; N]; 3] {
    let mut table = [[0.0; N]; 3];
    let mut i = 0;
    while i < N {
        let voxel = voxel_at(i * stride);
        let mut axis = 0;
        while axis < 3 {
            table[axis][i] = voxel[axis] as f32;
            axis += 1;
        }
        i += 1;
    }
    table
}

/// One affine function over a brick.
struct Spread<L> {
    /// Difference of each lane from its vector's first.
    lanes: L,
    /// Value at each vector's first voxel.
    starts: [f32; VECTORS],
}

impl<L: Lanes> Spread<L> {
    /// # Safety
    /// The instruction set of `L` must be available.
    #[inline(always)]
    unsafe fn new([base, x, y, z]: [f32; 4]) -> Self {
        let mut starts = [0.0; VECTORS];
        // SAFETY: all arrays hold whole vectors; the instruction set as for this function.
        unsafe {
            for half in [0, LANES] {
                let column = L::load(START[0].as_ptr().add(half)).mul_add(L::splat(x), L::splat(base));
                let row = L::load(START[1].as_ptr().add(half)).mul_add(L::splat(y), column);
                let layer = L::load(START[2].as_ptr().add(half)).mul_add(L::splat(z), row);
                layer.store(starts.as_mut_ptr().add(half));
            }
            let column = L::load(LANE[0].as_ptr()).mul(L::splat(x));
            let row = L::load(LANE[1].as_ptr()).mul_add(L::splat(y), column);
            Self { lanes: L::load(LANE[2].as_ptr()).mul_add(L::splat(z), row), starts }
        }
    }

    /// # Safety
    /// The instruction set of `L` must be available.
    #[inline(always)]
    unsafe fn at(&self, vector: usize) -> L {
        // SAFETY: as for this function.
        unsafe { self.lanes.add(L::splat(self.starts[vector])) }
    }
}

/// Bit k: vector k has a lane with |q| ≤ reach, or may have one.
///
/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn met<L: Lanes>(q: &Spread<L>, [_, x, y, z]: [f32; 4], reach: f32) -> u32 {
    // The extreme lanes are corners of the tile; their offsets are rounded as `Spread::new` rounds them.
    let (mut low, mut high) = (0.0_f32, 0.0_f32);
    for corner in 1..8_u8 {
        let end = |axis: u8| if corner >> axis & 1 == 1 { (TILE[axis as usize] - 1) as f32 } else { 0.0 };
        let offset = end(2).mul_add(z, end(1).mul_add(y, end(0) * x));
        (low, high) = (low.min(offset), high.max(offset));
    }
    // SAFETY: `starts` holds two vectors; the instruction set as for this function.
    unsafe {
        let mut vectors = 0;
        for from in [0, LANES] {
            let start = L::load(q.starts.as_ptr().add(from));
            let above = L::splat(-reach).le(start.add(L::splat(high)));
            let below = start.add(L::splat(low)).le(L::splat(reach));
            vectors |= u32::from(L::bits(L::and(above, below))) << from;
        }
        vectors
    }
}

/// Weights of the four cubic B-splines that reach a point t ∈ [0, 1) past the second of their knots.
///
/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn spline_weights<L: Lanes>(t: L) -> [L; 4] {
    // SAFETY: as for this function.
    unsafe {
        let sixth = L::splat(1.0 / 6.0);
        let s = L::splat(1.0).sub(t);
        let t2 = t.mul(t);
        let first = s.mul(s).mul(s.mul(sixth));
        let last = t2.mul(t.mul(sixth));
        let second = t.mul_add(L::splat(0.5), L::splat(-1.0)).mul_add(t2, L::splat(2.0 / 3.0));
        // What is left of 1: a constant picture stays constant.
        let third = L::splat(1.0).sub(first).sub(last).sub(second);
        [first, second, third, last]
    }
}

/// exp(−q²/2) for |q| ≤ 13: 2ⁿ·2ᶠ with a polynomial for 2ᶠ, |f| ≤ ½ (degree 7: rounding is all that remains).
///
/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn gaussian<L: Lanes>(q: L) -> L {
    // SAFETY: as for this function.
    unsafe {
        let exponent = q.mul(q).mul(L::splat(-0.5 * std::f32::consts::LOG2_E)).max(L::splat(-125.0));
        let n = exponent.round_ties_even();
        let f = exponent.sub(n);
        // Taylor coefficients (ln 2)ᵏ/k!: at |f| ≤ ½ the first term left out is below 6e-9.
        let mut sum = L::splat(1.525_273e-5);
        for c in [1.540_353e-4, 1.333_355_8e-3, 9.618_129e-3, 5.550_411e-2, 2.402_265e-1, std::f32::consts::LN_2, 1.0] {
            sum = sum.mul_add(f, L::splat(c));
        }
        sum.scale_by_power_of_two(n)
    }
}

/// What the first pass over a brick finds out and the second uses, for each tile that the slab meets.
///
/// Two passes, because the second spends its time waiting for loads whose addresses come at the end of the first's chain of operations: apart,
/// the processor overlaps several tiles in each (measured: inserts 1.8 times faster than with one pass).
pub(crate) struct Scratch {
    /// Which tile of the brick.
    vector: [u8; VECTORS],
    /// Where each lane's patch begins among the nodes.
    offset: [[u32; LANES]; VECTORS],
    /// How far past the patch's second node the voxel lies, along u and v.
    along_u: [[f32; LANES]; VECTORS],
    along_v: [[f32; LANES]; VECTORS],
    /// Off-plane weight; −1 in lanes that take no part.
    weight: [[f32; LANES]; VECTORS],
}

impl Scratch {
    pub(crate) const fn new() -> Self {
        Self {
            vector: [0; VECTORS],
            offset: [[0; LANES]; VECTORS],
            along_u: [[0.0; LANES]; VECTORS],
            along_v: [[0.0; LANES]; VECTORS],
            weight: [[0.0; LANES]; VECTORS],
        }
    }
}

/// First pass: finds the tiles that the slice reaches, the weights of their voxels and where to sample. Returns their number.
///
/// Positions are first brought inside the nodes, so that whatever the geometry no patch leaves them.
///
/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn locate<L: Lanes>(brick: Option<&Brick>, task: &Task, view: &View<'_>, scratch: &mut Scratch) -> usize {
    // SAFETY: the scratch arrays hold whole vectors; prefetches read nothing; the instruction set as for this function.
    unsafe {
        let [u, v, q] = task.functions;
        let mut vectors = met(&Spread::<L>::new(q), q, view.reach);
        let (u, v, q) = (Spread::<L>::new(u), Spread::<L>::new(v), Spread::<L>::new(q));
        let nodes = view.value;
        let (last_u, last_v) = (L::splat((nodes.columns - 3) as f32), L::splat((nodes.rows - 3) as f32));
        let one = L::splat(1.0);
        let stride = L::splat(nodes.stride as f32);
        let back = L::splat(-(nodes.stride as f32) - 1.0);
        let reach = L::splat(view.reach);
        let minus_reach = L::splat(-view.reach);
        let partial = task.sight == Sight::Partial;
        let mut count = 0;
        while vectors != 0 {
            let vector = vectors.trailing_zeros() as usize;
            vectors &= vectors - 1;
            let q = q.at(vector);
            let mut mask = L::and(minus_reach.le(q), q.le(reach));
            let (u, v) = (u.at(vector), v.at(vector));
            if partial {
                let inside_u = L::and(one.le(u), u.le(last_u));
                let inside_v = L::and(one.le(v), v.le(last_v));
                mask = L::and(mask, L::and(inside_u, inside_v));
            }
            if L::bits(mask) == 0 {
                continue;
            }
            if let Some(brick) = brick {
                L::prefetch(brick.r.as_ptr().add(vector * LANES));
                L::prefetch(brick.w.as_ptr().add(vector * LANES));
            }
            // `min` and `max` give their second operand for NaN.
            let u = u.max(one).min(last_u);
            let v = v.max(one).min(last_v);
            let (column, row) = (u.floor(), v.floor());
            scratch.vector[count] = vector as u8;
            // Exact: `SliceFilter::new` keeps the number of nodes within 2²⁴.
            row.mul_add(stride, column.add(back)).store_integers(scratch.offset[count].as_mut_ptr());
            u.sub(column).store(scratch.along_u[count].as_mut_ptr());
            v.sub(row).store(scratch.along_v[count].as_mut_ptr());
            // The pedestal's rounding can leave −1e−9 at the very end of the support.
            let weight = gaussian(q).sub(L::splat(view.pedestal)).max(L::splat(0.0));
            L::select(mask, weight, L::splat(-1.0)).store(scratch.weight[count].as_mut_ptr());
            count += 1;
        }
        count
    }
}

/// What [`Lanes::patch`] gives, to the bit, where every node is 1: the sum of the column weights (those of the rows sum to 1 exactly).
///
/// It is 1 but for rounding; entered as certainty, the rounding of the weights cancels in numerator over weight, and a constant stays one.
///
/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn patch_of_ones<L: Lanes>(column: [L; 4]) -> L {
    // SAFETY: as for this function.
    unsafe { column[3].add(column[2].add(column[1].add(column[0]))) }
}

/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn weave_lanes<L: Lanes>(brick: &mut Brick, task: &mut Task, view: &View<'_>, scratch: &mut Scratch) {
    // SAFETY: vector k covers elements 16k..16k+16 of the brick's arrays of 512. `locate` keeps columns in 1..=columns−3 and rows in
    // 1..=rows−3, so patches span columns 0..=columns−1 and rows 0..=rows−1 at most; value and certainty have one shape (they come
    // from one filter). The instruction set as for this function.
    unsafe {
        let count = locate::<L>(Some(brick), task, view, scratch);
        task.vectors = count as u32;
        let most = L::splat(view.most_weight);
        let level = L::splat(view.level);
        let unit = L::splat(view.unit[0]);
        let stride = view.value.stride;
        for i in 0..count {
            let vector = usize::from(scratch.vector[i]);
            let weight = L::load(scratch.weight[i].as_ptr());
            let mut mask = L::splat(0.0).le(weight);
            let offset = scratch.offset[i].as_ptr();
            let row = spline_weights(L::load(scratch.along_v[i].as_ptr()));
            let column = spline_weights(L::load(scratch.along_u[i].as_ptr()));
            let certainty = if task.sight == Sight::Partial {
                let certainty =
                    L::patch(view.certainty.pairs.as_ptr(), stride, offset, row, column).mul(L::splat(view.unit[1]));
                mask = L::and(mask, L::splat(LEAST_CERTAINTY).le(certainty));
                if L::bits(mask) == 0 {
                    continue;
                }
                certainty
            } else {
                patch_of_ones(column)
            };
            let contrast = L::patch(view.value.pairs.as_ptr(), stride, offset, row, column);
            let sum = contrast.mul_add(unit, certainty.mul(level));
            let r = L::load(brick.r.as_ptr().add(vector * LANES));
            let w = L::load(brick.w.as_ptr().add(vector * LANES));
            let mut new_r = sum.mul_add(weight, r);
            let mut new_w = certainty.mul_add(weight, w);
            let bits = L::bits(mask);
            task.updated += bits.count_ones();
            let fits = new_w.le(most);
            let above = bits & !L::bits(fits);
            if above != 0 {
                // most·(r + s·f) / (w + c·f), as the step from r: on top of the sum's rounding, scaling it down would add its own with every
                // slice, and a constant would drift off (measured in the plane of a parked slice: 1.3e-5, this way 1.8e-6).
                let excess = certainty.mul_add(weight, w.sub(most));
                let step = sum.mul(weight).mul_add(most, L::splat(0.0).sub(excess.mul(r))).div(new_w);
                new_r = L::select(fits, new_r, r.add(step));
                new_w = L::select(fits, new_w, most);
                task.clamped += above.count_ones();
            }
            L::select(mask, new_r, r).store(brick.r.as_mut_ptr().add(vector * LANES));
            L::select(mask, new_w, w).store(brick.w.as_mut_ptr().add(vector * LANES));
        }
    }
}

/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn touches_lanes<L: Lanes>(task: &Task, view: &View<'_>, scratch: &mut Scratch) -> bool {
    // SAFETY: as for `weave_lanes`.
    unsafe {
        let count = locate::<L>(None, task, view, scratch);
        if task.sight == Sight::Full {
            return count > 0;
        }
        for i in 0..count {
            let row = spline_weights(L::load(scratch.along_v[i].as_ptr()));
            let column = spline_weights(L::load(scratch.along_u[i].as_ptr()));
            let nodes = view.certainty;
            let offset = scratch.offset[i].as_ptr();
            let certainty =
                L::patch(nodes.pairs.as_ptr(), nodes.stride, offset, row, column).mul(L::splat(view.unit[1]));
            let reached = L::splat(0.0).le(L::load(scratch.weight[i].as_ptr()));
            if L::bits(L::and(reached, L::splat(LEAST_CERTAINTY).le(certainty))) != 0 {
                return true;
            }
        }
        false
    }
}

dispatch!(
    /// Weaves a slice into a brick and counts in the task what that changed.
    pub(crate) fn weave => weave_lanes(brick: &mut Brick, task: &mut Task, view: &View<'_>, scratch: &mut Scratch)
);

dispatch!(
    /// Whether [`weave`] would change any voxel: asked before a brick is made.
    pub(crate) fn touches => touches_lanes(task: &Task, view: &View<'_>, scratch: &mut Scratch) -> bool
);

/// `met` answers in 32 bits, and a tile is a vector.
const _: () = assert!(VECTORS == 32 && TILE[0] * TILE[1] * TILE[2] == LANES);
