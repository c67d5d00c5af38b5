//! The hot loop: inserts one slice into one brick, sixteen voxels at a time.
//!
//! A tile of the brick makes a vector. Plane distance, node column and node row are affine in
//! the voxel, so a vector's values are one addition away from those of its first voxel. Vectors
//! that the slab does not meet are found before the loop from their extreme lanes (rounding is
//! monotone, so that test loses none). The loop costs one 4×4 spline sum, one Gaussian and two
//! multiply-adds per voxel.
#![allow(unsafe_code, reason = "the inner loop runs on `Lanes`, by pointer")]

use simd::{LANES, Lanes, dispatch};
use volume::brick::{TILE, VOXELS, voxel_at};

use super::compounding::Entry;
use super::decay::{LEAST_TOUCH, rebase, shift};
use super::entry::{BrickData, Sample, enter, mean};
use super::sampling::{Linear, Nearest, Sampler, Sampling, Spline};
use super::slab::{LEAST_CERTAINTY, Overlap};
use super::task::{FilteredSlice, Task};

/// Loops of their own: for [`Entry::Mean`], for [`Entry::MeanAndSquares`], and for any entry.
const MEAN: u8 = 0;
const MEAN_AND_SQUARES: u8 = 1;
const ANY: u8 = 2;
/// Vectors in a brick.
const VECTORS: usize = VOXELS / LANES;

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

/// Returns a mask with bit k set if vector k has, or may have, a lane with |q| ≤ reach.
///
/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn met<L: Lanes>(q: &Spread<L>, [_, x, y, z]: [f32; 4], reach: f32) -> u32 {
    // The extreme lanes are corners of the tile; their offsets are rounded in the same way as
    // in `Spread::new`.
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

/// Results of the first pass over a brick for the second, for each tile that the slab meets.
///
/// There are two passes because the second waits for loads whose addresses result from the
/// first's chain of operations. When they are separate, the processor overlaps several tiles in
/// each (measured: inserts 1.8 times faster than with one pass).
pub(crate) struct Scratch {
    /// Index of the tile in the brick.
    vector: [u8; VECTORS],
    /// Start of each lane's patch among the nodes.
    offset: [[u32; LANES]; VECTORS],
    /// Distance of the voxel from the patch's second node, along u and v.
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

/// First pass: finds the tiles that the slice reaches, the weights of their voxels and the
/// sampling positions. Returns the number of tiles.
///
/// Positions are first clamped to the nodes, so that no patch leaves them for any geometry.
///
/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn locate<L: Lanes>(
    data: Option<&BrickData<'_>>,
    task: &Task,
    filtered: &FilteredSlice<'_>,
    scratch: &mut Scratch,
) -> usize {
    // SAFETY: the scratch arrays hold whole vectors; prefetches read nothing; the instruction
    // set as for this function.
    unsafe {
        let [u, v, q] = task.functions;
        let falloff = &filtered.rule.falloff;
        let mut vectors = met(&Spread::<L>::new(q), q, falloff.reach);
        let (u, v, q) = (Spread::<L>::new(u), Spread::<L>::new(v), Spread::<L>::new(q));
        let nodes = filtered.value;
        let (last_u, last_v) = (L::splat((nodes.columns - 3) as f32), L::splat((nodes.rows - 3) as f32));
        let one = L::splat(1.0);
        let stride = L::splat(nodes.stride as f32);
        let back = L::splat(-((nodes.stride + 1) as f32) * filtered.rule.sampling.back() as f32);
        let reach = L::splat(falloff.reach);
        let minus_reach = L::splat(-falloff.reach);
        let slice_weight = L::splat(filtered.weight);
        let partial = task.overlap == Overlap::Partial;
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
            if let Some(BrickData { brick, squares, .. }) = data {
                L::prefetch(brick.r.as_ptr().add(vector * LANES));
                L::prefetch(brick.w.as_ptr().add(vector * LANES));
                if let Some(squares) = squares {
                    L::prefetch(squares.tiles[vector].as_ptr());
                }
            }
            // `min` and `max` return their second operand for NaN.
            let u = u.max(one).min(last_u);
            let v = v.max(one).min(last_v);
            let (column, row) = (u.floor(), v.floor());
            scratch.vector[count] = vector as u8;
            // Exact: `SliceFilter::new` keeps the number of nodes within 2²⁴.
            row.mul_add(stride, column.add(back)).store_integers(scratch.offset[count].as_mut_ptr());
            u.sub(column).store(scratch.along_u[count].as_mut_ptr());
            v.sub(row).store(scratch.along_v[count].as_mut_ptr());
            L::select(mask, falloff.at(q).mul(slice_weight), L::splat(-1.0)).store(scratch.weight[count].as_mut_ptr());
            count += 1;
        }
        count
    }
}

/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn insert_lanes<L: Lanes>(
    data: &mut BrickData<'_>,
    task: &mut Task,
    filtered: &FilteredSlice<'_>,
    scratch: &mut Scratch,
) {
    // SAFETY: as for this function.
    unsafe {
        // The default case, and that with standard errors, have loops of their own without the
        // others' branches and registers.
        match (filtered.rule.sampling, filtered.rule.entry) {
            (Sampling::Spline, _) if filtered.pixel_weights.is_some() => {
                insert_sampled::<L, Spline, ANY>(data, task, filtered, scratch);
            }
            (Sampling::Spline, Entry::Mean) => insert_sampled::<L, Spline, MEAN>(data, task, filtered, scratch),
            (Sampling::Spline, Entry::MeanAndSquares) => {
                insert_sampled::<L, Spline, MEAN_AND_SQUARES>(data, task, filtered, scratch);
            }
            (Sampling::Spline, _) => insert_sampled::<L, Spline, ANY>(data, task, filtered, scratch),
            (Sampling::Linear, _) => insert_sampled::<L, Linear, ANY>(data, task, filtered, scratch),
            (Sampling::Nearest, _) => insert_sampled::<L, Nearest, ANY>(data, task, filtered, scratch),
        }
    }
}

/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn insert_sampled<L: Lanes, S: Sampler, const ENTRY: u8>(
    data: &mut BrickData<'_>,
    task: &mut Task,
    filtered: &FilteredSlice<'_>,
    scratch: &mut Scratch,
) {
    // SAFETY: vector k covers elements 16k..16k+16 of the brick's arrays of 512. `locate` keeps
    // columns in 1..=columns−3 and rows in 1..=rows−3, so patches span columns 0..=columns−1
    // and rows 0..=rows−1 at most. Value, certainty and weights of pixels have one shape. The
    // instruction set as for this function.
    unsafe {
        let count = locate::<L>(Some(data), task, filtered, scratch);
        task.vectors = count as u32;
        if data.change.rebase != 1.0 {
            rebase(&mut data.brick.r, &mut data.brick.w, data.change.rebase);
        }
        if data.change.shift > 0
            && let Some(ages) = &mut data.ages
        {
            shift(&mut ages.0, data.change.shift);
        }
        let level = L::splat(filtered.level);
        let unit = L::splat(filtered.unit[0]);
        for i in 0..count {
            let vector = usize::from(scratch.vector[i]);
            let mut weight = L::load(scratch.weight[i].as_ptr());
            let mut mask = L::splat(0.0).le(weight);
            let offset = scratch.offset[i].as_ptr();
            let row = S::weights(L::load(scratch.along_v[i].as_ptr()));
            let column = S::weights(L::load(scratch.along_u[i].as_ptr()));
            let certainty = if task.overlap == Overlap::Partial {
                let certainty = S::patch::<L>(filtered.certainty, offset, row, column).mul(L::splat(filtered.unit[1]));
                mask = L::and(mask, L::splat(LEAST_CERTAINTY).le(certainty));
                if L::bits(mask) == 0 {
                    continue;
                }
                certainty
            } else {
                S::ones(column)
            };
            if ENTRY == ANY
                && let Some(weights) = filtered.pixel_weights
            {
                weight = weight.mul(S::patch::<L>(weights, offset, row, column).mul(L::splat(filtered.unit[2])));
            }
            let contrast = S::patch::<L>(filtered.value, offset, row, column);
            let sample = Sample { weight, contrast: contrast.mul(unit), certainty, level };
            let at = vector * LANES;
            match ENTRY {
                MEAN => mean::<L, false>(data, at, mask, &sample, filtered, task),
                MEAN_AND_SQUARES => mean::<L, true>(data, at, mask, &sample, filtered, task),
                _ => enter(data, at, mask, &sample, filtered, task),
            }
        }
    }
}

/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn touches_lanes<L: Lanes>(task: &Task, filtered: &FilteredSlice<'_>, scratch: &mut Scratch) -> bool {
    // SAFETY: as for this function.
    unsafe {
        let count = locate::<L>(None, task, filtered, scratch);
        if task.overlap == Overlap::Full && !matches!(filtered.rule.entry, Entry::Decay(_)) {
            return count > 0;
        }
        match filtered.rule.sampling {
            Sampling::Spline => sees::<L, Spline>(count, task, filtered, scratch),
            Sampling::Linear => sees::<L, Linear>(count, task, filtered, scratch),
            Sampling::Nearest => sees::<L, Nearest>(count, task, filtered, scratch),
        }
    }
}

/// Whether one of the located voxels lies on data, and weighs enough.
///
/// # Safety
/// The instruction set of `L` must be available; the first `count` entries of `scratch` were
/// filled by [`locate`].
#[inline(always)]
unsafe fn sees<L: Lanes, S: Sampler>(
    count: usize,
    task: &Task,
    filtered: &FilteredSlice<'_>,
    scratch: &Scratch,
) -> bool {
    // SAFETY: as for `insert_sampled`.
    unsafe {
        let least = if matches!(filtered.rule.entry, Entry::Decay(_)) { LEAST_TOUCH } else { 0.0 };
        for i in 0..count {
            let column = S::weights(L::load(scratch.along_u[i].as_ptr()));
            let certainty = if task.overlap == Overlap::Partial {
                let row = S::weights(L::load(scratch.along_v[i].as_ptr()));
                let offset = scratch.offset[i].as_ptr();
                S::patch::<L>(filtered.certainty, offset, row, column).mul(L::splat(filtered.unit[1]))
            } else {
                S::ones(column)
            };
            let weight = L::load(scratch.weight[i].as_ptr());
            let reached = L::and(L::splat(0.0).le(weight), L::splat(least).le(certainty.mul(weight)));
            if L::bits(L::and(reached, L::splat(LEAST_CERTAINTY).le(certainty))) != 0 {
                return true;
            }
        }
        false
    }
}

dispatch!(
    /// Inserts a slice into a brick and counts the changes in the task.
    pub(crate) fn insert => insert_lanes(data: &mut BrickData<'_>, task: &mut Task, filtered: &FilteredSlice<'_>, scratch: &mut Scratch)
);

dispatch!(
    /// Whether [`insert`] would change any voxel; called before a brick is created.
    pub(crate) fn touches => touches_lanes(task: &Task, filtered: &FilteredSlice<'_>, scratch: &mut Scratch) -> bool
);

/// `met` returns 32 bits, and a tile is a vector.
const _: () = assert!(VECTORS == 32 && TILE[0] * TILE[1] * TILE[2] == LANES);
