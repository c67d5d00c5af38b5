//! First-moment correction: a voxel's value at the voxel, where its slices' mean lies beside it.
//!
//! Slices reach a voxel from distances q along their normals n, with weights w. Between uneven gaps
//! the mean distance μ = Σ w·q·n / Σ w is not zero, nor where only one side was scanned. The
//! weighted mean then is the value at μ from the voxel. In regression this is the design bias of a
//! local mean (Fan & Gijbels 1996). To first order, subtraction of the slope removes it:
//!
//! | quantity | formula |
//! |---|---|
//! | corrected value | r/w − μ·∇(r/w) |
//! | mean distance | μ = c·∇w/w along the slices' normals |
//! | factor, mm² | c = −Σ q·k(q)·Dk(q) / Σ (Dk(q))², k the kernel across the plane |
//!
//! For a Gaussian the moment is in the sums of weights already: as ∂k/∂q = −q·k/σ², the moment
//! Σ w·q·n is σ²·∇(Σ w), so that no further sums are kept. c is the factor that fits best for any
//! kernel, and for differences D over two voxels; it is σ² for a Gaussian on a fine lattice. The
//! coarser the lattice, the less of the moment is found, and the less is corrected: a voxel
//! spacing of no more than σ across the plane finds most of it.
//!
//! ∇w also grows across the borders of the image, where no moment belongs to it. Hence only its
//! part along the normals of the whole scan counts. Where a neighbour is unseen, nothing is
//! corrected along that axis.

use glam::{DMat3, DVec3};

use volume::Voxels;
use volume::brick::{BrickIndex, EDGE};
use volume::read::SEEN;

use super::kernel::{AxisKernel, Shape};
use super::normals::Normals;
use super::sample::{quantile, sample};

/// Voxels of a row that are read at a time.
const RUN: usize = 64;
/// Step of the sums over distances, in σ, and least step of a difference: the kernel's end is a
/// step itself.
const FINE: f64 = 0.01;
const LEAST_STEP: f64 = 0.1;
/// Voxels from which figures of a whole volume are taken, at most.
const MOST: usize = 1 << 20;

/// A volume whose values are corrected; its weights are those of the sums.
pub struct FirstMoment<'a> {
    volume: &'a dyn Voxels,
    /// Converts the difference of weights over two voxels along each axis, divided by the weight,
    /// to the mean distance in mm.
    moment: DMat3,
    /// Voxel spacing, mm.
    spacing_mm: DVec3,
    /// The largest mean distance, mm: beyond the last slice it would grow up to the kernel's end,
    /// and noise with it.
    most_mm: f64,
}

/// Usual corrections of a volume's seen voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correction {
    /// Median of the mean distances' lengths, mm.
    pub distance_mm: f64,
    /// Median of the changes, up or down, grey levels.
    pub change: f64,
    /// Their 95th percentile.
    pub change_p95: f64,
}

/// Sums and weights of a row of voxels and of those beside it.
struct Rows {
    /// With one voxel before and after.
    own: [[f32; RUN + 2]; 2],
    /// Before and after along y, before and after along z.
    beside: [[[f32; RUN]; 2]; 4],
}

/// The correction of a voxel.
struct Corrected {
    /// Numerator and weight of the mean.
    sums: [f32; 2],
    /// Mean distance of the slices, mm.
    mean_mm: DVec3,
    /// The part of the value that it brings, grey levels.
    excess: f64,
}

impl<'a> FirstMoment<'a> {
    /// Returns the corrected volume. `normal` is the kernel across the plane.
    pub(super) fn new(volume: &'a dyn Voxels, spacing_mm: DVec3, normal: &AxisKernel, normals: &Normals) -> Self {
        let along = normals.mean();
        let most = largest_eigenvalue(&along);
        let factor = |axis: usize| {
            let step_mm = 2.0 * spacing_mm[axis];
            factor(normal, 0.5 * step_mm * along.col(axis)[axis].max(0.0).sqrt()) / step_mm
        };
        let moment = match most > 0.0 {
            true => along * (1.0 / most) * DMat3::from_diagonal(DVec3::new(factor(0), factor(1), factor(2))),
            false => DMat3::ZERO,
        };
        Self { volume, moment, spacing_mm, most_mm: normal.sigma_effective_mm() }
    }

    /// Whether a kernel across the plane tells distances by its weights.
    pub(super) fn suits(normal: &AxisKernel) -> bool {
        normal.shape != Shape::Box
    }

    /// Returns the usual corrections, from at most a million voxels; `None` if none was seen.
    pub fn correction(&self) -> Option<Correction> {
        let (mut distances, mut changes) = (Vec::new(), Vec::new());
        for block in sample(self.volume, MOST) {
            let [x, y, z] = block.map(|b| i64::from(b) * EDGE as i64);
            for row in 0..(EDGE * EDGE) as i64 {
                let start = [x, y + row % EDGE as i64, z + row / EDGE as i64];
                self.corrections(start, EDGE, |_, Corrected { sums: [_, w], mean_mm, excess }| {
                    if w > SEEN {
                        distances.push(mean_mm.length());
                        changes.push(excess.abs());
                    }
                });
            }
        }
        Some(Correction {
            distance_mm: quantile(&mut distances, 0.5)?,
            change: quantile(&mut changes, 0.5)?,
            change_p95: quantile(&mut changes, 0.95)?,
        })
    }

    /// Calls `visit` for each voxel of a row of at most [`RUN`], with its position.
    fn corrections(&self, start: [i64; 3], count: usize, mut visit: impl FnMut(usize, Corrected)) {
        let Rows { own: [r, w], beside: [before_y, after_y, before_z, after_z] } = self.rows(start, count);
        for at in 0..count {
            let sums = [r[at + 1], w[at + 1]];
            let (mut mean_mm, mut excess) = (DVec3::ZERO, 0.0);
            if sums[1] > SEEN {
                let ends = [
                    [[r[at], w[at]], [r[at + 2], w[at + 2]]],
                    [&before_y, &after_y].map(|row| [row[0][at], row[1][at]]),
                    [&before_z, &after_z].map(|row| [row[0][at], row[1][at]]),
                ];
                let difference = |of: fn([f32; 2]) -> f32| {
                    let along = ends.map(|[low, high]| match low[1] > SEEN && high[1] > SEEN {
                        true => f64::from(of(high) - of(low)),
                        false => 0.0,
                    });
                    DVec3::from_array(along)
                };
                let weights = difference(|[_, w]| w) / f64::from(sums[1]);
                mean_mm = (self.moment * weights).clamp_length_max(self.most_mm);
                excess = mean_mm.dot(difference(|[r, w]| r / w) / (2.0 * self.spacing_mm));
            }
            visit(at, Corrected { sums, mean_mm, excess });
        }
    }

    fn rows(&self, [x, y, z]: [i64; 3], count: usize) -> Rows {
        let mut rows = Rows { own: [[0.0; RUN + 2]; 2], beside: [[[0.0; RUN]; 2]; 4] };
        let [r, w] = &mut rows.own;
        self.volume.row([x - 1, y, z], &mut r[..count + 2], &mut w[..count + 2]);
        let starts = [[x, y - 1, z], [x, y + 1, z], [x, y, z - 1], [x, y, z + 1]];
        for ([r, w], start) in rows.beside.iter_mut().zip(starts) {
            self.volume.row(start, &mut r[..count], &mut w[..count]);
        }
        rows
    }
}

/// Returns c for a lattice whose neighbours are `step_mm` apart along the normal.
fn factor(kernel: &AxisKernel, step_mm: f64) -> f64 {
    let step = step_mm.max(LEAST_STEP * kernel.sigma_mm);
    let fine = FINE * kernel.sigma_mm;
    let end = ((kernel.support_mm + step) / fine).ceil() as i32;
    let (mut moment, mut squares) = (0.0, 0.0);
    for i in -end..=end {
        let q = f64::from(i) * fine;
        let slope = (kernel.weight(q + step) - kernel.weight(q - step)) / (2.0 * step);
        moment -= q * kernel.weight(q) * slope;
        squares += slope * slope;
    }
    moment / squares
}

/// Returns the largest eigenvalue of a symmetric matrix that is not negative.
fn largest_eigenvalue(matrix: &DMat3) -> f64 {
    // Squares leave the largest: 2⁻⁶⁴ of any that is a thousandth less.
    let mut power = *matrix;
    for _ in 0..16 {
        let most = power.to_cols_array().into_iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        if most <= 0.0 {
            return 0.0;
        }
        power *= 1.0 / most;
        power *= power;
    }
    let direction = [0, 1, 2].map(|a| power.col(a)).into_iter().max_by(|a, b| a.length().total_cmp(&b.length()));
    let direction = direction.unwrap_or(DVec3::X).normalize_or_zero();
    direction.dot(*matrix * direction)
}

impl Voxels for FirstMoment<'_> {
    fn row(&self, [x, y, z]: [i64; 3], r: &mut [f32], w: &mut [f32]) {
        assert_eq!(r.len(), w.len());
        for ((r, w), first) in r.chunks_mut(RUN).zip(w.chunks_mut(RUN)).zip((x..).step_by(RUN)) {
            self.corrections([first, y, z], r.len(), |at, Corrected { sums, excess, .. }| {
                [r[at], w[at]] = [sums[0] - excess as f32 * sums[1], sums[1]];
            });
        }
    }

    fn seen_bounds(&self) -> Option<([i64; 3], [i64; 3])> {
        self.volume.seen_bounds()
    }

    fn blocks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        self.volume.blocks()
    }

    fn bytes(&self) -> u64 {
        self.volume.bytes()
    }
}

#[cfg(test)]
mod tests;
