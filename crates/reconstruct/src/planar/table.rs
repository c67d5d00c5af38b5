//! The kernel as a table for columns: values at equal steps of the distance, interpolated
//! linearly.
#![allow(unsafe_code, reason = "a column's taps are found on `Lanes`, by pointer")]

use std::ops::Range;

use simd::{LANES, Lanes};

use crate::kernel::AxisKernel;
use crate::spline::MOST_SUPPORT_PX;

/// Steps from the kernel's middle to the end of its support. Linear interpolation is within
/// 2e-6 of a Gaussian's peak (h²/8 times its curvature, at a support of 3.9 σ).
const STEPS: usize = 1024;
/// Largest number of taps of a kernel.
pub(super) const MOST_TAPS: usize = 2 * MOST_SUPPORT_PX as usize + 2;
/// Index of each lane.
const LANE: [f32; LANES] = {
    let mut lanes = [0.0; LANES];
    let mut i = 0;
    while i < LANES {
        lanes[i] = i as f32;
        i += 1;
    }
    lanes
};

/// The kernel of one axis over distance.
#[derive(Clone)]
pub(super) struct KernelTable {
    /// Value at each step and the difference to the next, which is 0 at the end of the support.
    values: Box<[[f32; 2]; STEPS + 1]>,
    steps_per_mm: f64,
    /// Half width of the support, mm.
    pub(super) support_mm: f64,
}

impl KernelTable {
    pub(super) fn new(kernel: &AxisKernel) -> Self {
        let at = |i: usize| kernel.weight(kernel.support_mm * (i.min(STEPS) as f64 / STEPS as f64));
        let mut values = Box::new([[0.0; 2]; STEPS + 1]);
        for (i, value) in values.iter_mut().enumerate() {
            *value = [at(i) as f32, (at(i + 1) - at(i)) as f32];
        }
        Self { values, steps_per_mm: STEPS as f64 / kernel.support_mm, support_mm: kernel.support_mm }
    }

    /// Weight at a distance within the support.
    #[inline(always)]
    pub(super) fn weight(&self, mm: f64) -> f32 {
        // Distances beyond the end by rounding count as the end.
        let steps = (mm.abs() * self.steps_per_mm).min(STEPS as f64);
        let [value, rise] = self.values[steps as usize];
        value + (steps - steps.floor()) as f32 * rise
    }
}

/// The kernel across the image's rows.
#[derive(Clone)]
pub(super) struct RowKernel {
    table: KernelTable,
    steps_per_row: f64,
    /// Half width of the support, rows.
    pub(super) reach: f64,
    /// Number of existing rows.
    pub(super) rows: usize,
}

/// The rows around a position and their weights.
#[derive(Clone)]
pub(super) struct Taps {
    /// Existing rows.
    pub(super) rows: Range<usize>,
    /// Index of their first weight.
    pub(super) first: usize,
    /// Sum of all weights, over the rows of an unbounded image.
    pub(super) total: f32,
    /// Fraction of it that lies on existing rows.
    pub(super) share: f32,
}

impl RowKernel {
    pub(super) fn new(kernel: &AxisKernel, row_mm: f64, rows: usize) -> Self {
        let table = KernelTable::new(kernel);
        Self { steps_per_row: table.steps_per_mm * row_mm, reach: kernel.support_mm / row_mm, table, rows }
    }

    /// Computes the taps around row `v`, which lies within the support of an existing row.
    /// `weights` receives them, not yet divided by their total.
    ///
    /// # Safety
    /// The instruction set of `L` must be available.
    #[inline(always)]
    pub(super) unsafe fn taps<L: Lanes>(&self, v: f64, weights: &mut [f32; MOST_TAPS]) -> Taps {
        let first = (v - self.reach).ceil();
        let count = (((v + self.reach).floor() - first) as usize + 1).min(MOST_TAPS);
        let (start, step) = (((first - v) * self.steps_per_row) as f32, self.steps_per_row as f32);
        let (mut cells, mut past) = ([0_u32; LANES], [0.0_f32; LANES]);
        let mut total = 0.0_f32;
        for (block, weights) in weights[..count].chunks_mut(LANES).enumerate() {
            // SAFETY: loads and stores are of arrays of sixteen; the instruction set as for
            // this function.
            unsafe {
                let tap = L::load(LANE.as_ptr()).add(L::splat((block * LANES) as f32));
                let steps = tap.mul_add(L::splat(step), L::splat(start));
                let steps = steps.max(L::splat(0.0).sub(steps)).min(L::splat(STEPS as f32));
                let cell = steps.floor();
                cell.store_integers(cells.as_mut_ptr());
                steps.sub(cell).store(past.as_mut_ptr());
            }
            for (weight, (cell, past)) in weights.iter_mut().zip(cells.iter().zip(&past)) {
                let [value, rise] = self.table.values[*cell as usize];
                *weight = value + past * rise;
                total += *weight;
            }
        }
        let first = first as i64;
        let low = ((-first).max(0) as usize).min(count);
        let high = ((self.rows as i64 - first).max(0) as usize).clamp(low, count);
        let share = match high - low == count {
            true => 1.0,
            false => weights[low..high].iter().sum::<f32>() / total,
        };
        let top = (first + low as i64) as usize;
        Taps { rows: top..top + (high - low), first: low, total, share }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::{Method, Support};
    use simd::portable::Portable;

    #[test]
    fn table_matches_kernel_to_end_of_support() {
        for method in [Method::Gaussian, Method::GaussianTruncated] {
            let kernel = AxisKernel::new(method, 0.7, Support::Energy(1e-4)).unwrap();
            let table = KernelTable::new(&kernel);
            for i in 0..=10_007 {
                let mm = kernel.support_mm * f64::from(i) / 10_007.0;
                let error = (f64::from(table.weight(mm)) - kernel.weight(mm)).abs();
                assert!(error < 2.5e-6, "{method:?} at {mm}: {error}");
            }
        }
    }

    #[test]
    fn taps_outside_image_count_in_total_only() {
        let kernel = AxisKernel::new(Method::Gaussian, 1.0, Support::Energy(1e-4)).unwrap();
        let rows = RowKernel::new(&kernel, 0.8, 20);
        let mut weights = [0.0; MOST_TAPS];
        // SAFETY: portable lanes need no instruction set.
        let mut taps = |v: f64| unsafe { rows.taps::<Portable>(v, &mut weights) };
        let inside = taps(9.3);
        assert_eq!((inside.rows, inside.first, inside.share), (5..15, 0, 1.0));
        for (v, expected) in [(-0.5, 0.5), (19.5, 0.5), (-5.0, 0.0), (24.0, 0.0)] {
            let taps = taps(v);
            assert!((taps.share - expected).abs() < 2e-2 && taps.rows.end <= 20, "{v}: {} {:?}", taps.share, taps.rows);
        }
        // Half of the kernel lies on either side of the border between rows.
        assert!((taps(-0.5).share - 0.5).abs() < 1e-6);
    }
}
