//! The sum along u: converts a slice's pixels into lines of voxels along z, one for each row of
//! the image.
//!
//! `line[v][z] = Σᵤ A[z][u]·o[u][v]`. Row z of A holds the kernel around voxel z at the
//! existing pixels, scaled to sum 1. The fraction of the kernel that lies on them is the
//! voxel's share, which enters its weight. Sixteen neighbouring voxels are summed at once over
//! all pixels that any of them reaches: products with zero cost less than transposing the
//! image.
#![allow(unsafe_code, reason = "the inner loop runs on `Lanes`, by pointer")]

use std::ops::Range;

use simd::sharing::Sharing;
use simd::{LANES, Lanes, Simd, dispatch};
use sonoweave_core::slice::{Image, Pixels};

use super::plane::ScanPlane;
use crate::kernel::AxisKernel;
use crate::slab::LEAST_CERTAINTY;

/// Rows of the image that one task sums, and the number summed at once. The latter hides the
/// latency of the multiply-adds; with the weights, it fits the registers of AVX2.
const ROWS_PER_TASK: usize = 24;
const ROWS_AT_ONCE: usize = 6;

/// Sixteen f32, aligned so that no load crosses a cache line.
#[derive(Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C, align(64))]
struct Vector([f32; LANES]);

/// Sixteen voxels' weights of the pixels that any of them reaches.
#[derive(Clone)]
struct Block {
    /// Columns of the data.
    columns: Range<usize>,
    /// Index of their first weight in [`Bands::weights`].
    first: usize,
}

/// The band matrix, and the lines that it made of the last slice.
#[derive(Clone)]
pub(super) struct Bands {
    /// Lattice index of a line's first voxel.
    pub(super) first_z: i64,
    /// Fraction of the kernel around each voxel that lies on data: at least
    /// [`LEAST_CERTAINTY`].
    pub(super) share: Vec<f32>,
    /// Origin of the data, as column and row of the image, and its size.
    corner: [usize; 2],
    size: [usize; 2],
    blocks: Vec<Block>,
    weights: Vec<Vector>,
    /// `lines[row·stride + z]`, Σ A·(o − level).
    lines: Vec<Vector>,
    /// Grey level that the lines are relative to: the first pixel that is data. A constant
    /// image is then exactly constant.
    pub(super) level: f32,
    /// Each task's pixels as f32.
    pixels: Vec<Vec<f32>>,
    /// Products of a slice, zeros included.
    pub(super) products: u64,
}

/// Returns the first voxel along z that a scan reaches, and each voxel's fraction of the kernel
/// on its pixels.
fn shares(plane: &ScanPlane, columns: Range<usize>, kernel: &AxisKernel) -> (i64, Vec<f32>) {
    let reach = kernel.support_mm / plane.column_mm();
    let z_of = |u: f64| plane.z_first + plane.z_step * u;
    let first = z_of(columns.start as f64 - reach).ceil();
    let last = z_of((columns.end - 1) as f64 + reach).floor();
    let share = |z: f64| {
        let weights = weights(plane, kernel, z);
        let on_data = |(u, _): &(i64, f64)| columns.start as i64 <= *u && *u < columns.end as i64;
        let total: f64 = weights.iter().map(|(_, w)| w).sum();
        // The whole kernel gives exactly 1.
        match weights.iter().all(on_data) {
            true => 1.0,
            false => (weights.iter().filter(|w| on_data(w)).map(|(_, w)| w).sum::<f64>() / total) as f32,
        }
    };
    let shares: Vec<f32> = (0..=(last - first).max(-1.0) as i64).map(|i| share(first + i as f64)).collect();
    let enough = |share: &f32| *share >= LEAST_CERTAINTY;
    match (shares.iter().position(enough), shares.iter().rposition(enough)) {
        (Some(low), Some(high)) => (first as i64 + low as i64, shares[low..=high].to_vec()),
        _ => (first as i64, Vec::new()),
    }
}

/// The kernel around voxel `z` at the columns of an unbounded image.
fn weights(plane: &ScanPlane, kernel: &AxisKernel, z: f64) -> Vec<(i64, f64)> {
    let (u, pixel) = ((z - plane.z_first) / plane.z_step, plane.column_mm());
    let reach = kernel.support_mm / pixel;
    let columns = (u - reach).ceil() as i64..=(u + reach).floor() as i64;
    columns.map(|j| (j, kernel.weight((u - j as f64) * pixel))).collect()
}

impl Bands {
    /// Creates the bands for images whose data is `size` pixels from `corner` on.
    pub(super) fn new(plane: &ScanPlane, corner: [usize; 2], size: [usize; 2], kernel: &AxisKernel) -> Self {
        let columns = corner[0]..corner[0] + size[0];
        let (first_z, share) = shares(plane, columns.clone(), kernel);
        let (mut blocks, mut weights_of_blocks) = (Vec::new(), Vec::new());
        for from in (0..share.len()).step_by(LANES) {
            let rows: Vec<Vec<(usize, f64)>> = (from..share.len().min(from + LANES))
                .map(|z| {
                    let mut row: Vec<(usize, f64)> = weights(plane, kernel, (first_z + z as i64) as f64)
                        .into_iter()
                        .filter_map(|(u, w)| {
                            let u = usize::try_from(u).ok().filter(|u| columns.contains(u))?;
                            Some((u - columns.start, w))
                        })
                        .collect();
                    let total: f64 = row.iter().map(|(_, w)| w).sum();
                    row.iter_mut().for_each(|(_, w)| *w /= total);
                    row
                })
                .collect();
            let used = || rows.iter().flatten().map(|(u, _)| *u);
            let columns = used().min().unwrap_or(0)..used().max().map_or(0, |u| u + 1);
            let first = weights_of_blocks.len();
            weights_of_blocks.resize(first + columns.len(), Vector([0.0; LANES]));
            for (lane, row) in rows.iter().enumerate() {
                for (u, w) in row {
                    weights_of_blocks[first + u - columns.start].0[lane] = *w as f32;
                }
            }
            blocks.push(Block { columns, first });
        }
        let vectors = size[1] * blocks.len();
        Self {
            first_z,
            share,
            corner,
            size,
            lines: vec![Vector([0.0; LANES]); vectors],
            level: 0.0,
            pixels: vec![vec![0.0; ROWS_PER_TASK * size[0]]; size[1].div_ceil(ROWS_PER_TASK)],
            products: (size[1] * weights_of_blocks.len() * LANES) as u64,
            blocks,
            weights: weights_of_blocks,
        }
    }

    /// Voxels of a line including padding to whole vectors.
    pub(super) fn stride(&self) -> usize {
        self.blocks.len() * LANES
    }

    /// The lines of the last slice, one after the other.
    pub(super) fn lines(&self) -> &[f32] {
        bytemuck::cast_slice(&self.lines)
    }

    /// Sums an image along u.
    pub(super) fn sum(&mut self, image: &Image, simd: Simd, sharing: Sharing) {
        match image.pixels() {
            Pixels::U8(p) => self.sum_of(p, |x| f32::from(*x), image.width(), simd, sharing),
            Pixels::U16(p) => self.sum_of(p, |x| f32::from(*x), image.width(), simd, sharing),
            Pixels::F32(p) => self.sum_of(p, |x| *x, image.width(), simd, sharing),
        }
    }

    fn sum_of<T: Sync>(
        &mut self,
        picture: &[T],
        grey: impl Fn(&T) -> f32 + Sync,
        width: u32,
        simd: Simd,
        sharing: Sharing,
    ) {
        let vectors = self.blocks.len();
        if vectors == 0 {
            return;
        }
        let [u, v] = self.corner;
        let [columns, width] = [self.size[0], width as usize];
        let level = grey(&picture[v * width + u]);
        self.level = level;
        let (blocks, weights) = (&self.blocks, bytemuck::cast_slice(&self.weights));
        sharing.chunks_beside(&mut self.lines, vectors * ROWS_PER_TASK, &mut self.pixels, |pixels, index, lines| {
            let rows = lines.len() / vectors;
            let top = v + index * ROWS_PER_TASK;
            for (row, pixels) in (top..top + rows).zip(pixels.chunks_exact_mut(columns)) {
                for (to, from) in pixels.iter_mut().zip(&picture[row * width + u..]) {
                    *to = grey(from) - level;
                }
            }
            sum_rows(simd, &pixels[..rows * columns], columns, blocks, weights, bytemuck::cast_slice_mut(lines));
        });
    }
}

dispatch!(
    /// Sums rows of `columns` pixels into lines of as many vectors as there are blocks.
    fn sum_rows => sum_rows_lanes(pixels: &[f32], columns: usize, blocks: &[Block], weights: &[f32], lines: &mut [f32])
);

/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn sum_rows_lanes<L: Lanes>(
    pixels: &[f32],
    columns: usize,
    blocks: &[Block],
    weights: &[f32],
    lines: &mut [f32],
) {
    let stride = blocks.len() * LANES;
    let rows = pixels.len() / columns;
    assert!(lines.len() == rows * stride);
    // SAFETY: the instruction set as for this function; `sum_block` asserts its own bounds.
    unsafe {
        let mut row = 0;
        while row + ROWS_AT_ONCE <= rows {
            let (pixels, lines) = (&pixels[row * columns..], &mut lines[row * stride..]);
            for (i, block) in blocks.iter().enumerate() {
                sum_block::<L, ROWS_AT_ONCE>(pixels, columns, block, weights, &mut lines[i * LANES..], stride);
            }
            row += ROWS_AT_ONCE;
        }
        while row < rows {
            let (pixels, lines) = (&pixels[row * columns..], &mut lines[row * stride..]);
            for (i, block) in blocks.iter().enumerate() {
                sum_block::<L, 1>(pixels, columns, block, weights, &mut lines[i * LANES..], stride);
            }
            row += 1;
        }
    }
}

/// `lines[row·stride + lane] = Σᵤ weights[u][lane]·pixels[row·columns + u]` for a block's
/// columns, ascending, and R rows.
///
/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn sum_block<L: Lanes, const R: usize>(
    pixels: &[f32],
    columns: usize,
    block: &Block,
    weights: &[f32],
    lines: &mut [f32],
    stride: usize,
) {
    let weights = &weights[block.first * LANES..][..block.columns.len() * LANES];
    assert!(block.columns.end <= columns && pixels.len() >= R * columns && lines.len() >= (R - 1) * stride + LANES);
    // SAFETY: the assertion keeps pixel (R − 1)·columns + u, u < columns.end ≤ columns, inside
    // `pixels` and a vector at (R − 1)·stride inside `lines`; the slice above holds a vector
    // for each column of the block.
    unsafe {
        let mut sum = [L::splat(0.0); R];
        for (i, u) in block.columns.clone().enumerate() {
            let weight = L::load(weights.as_ptr().add(i * LANES));
            for (row, sum) in sum.iter_mut().enumerate() {
                *sum = weight.mul_add(L::splat(*pixels.as_ptr().add(row * columns + u)), *sum);
            }
        }
        for (row, sum) in sum.iter().enumerate() {
            sum.store(lines.as_mut_ptr().add(row * stride));
        }
    }
}
