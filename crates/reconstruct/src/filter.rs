//! In-plane filtering: converts a slice's pixels into spline coefficients on the nodes of a
//! coarser lattice, once per slice.
//!
//! Pixels that are not data (outside the scanner's image) have certainty 0. Numerator Σ k·c·b
//! and certainty Σ k·c are filtered alike (normalised convolution; Knutsson & Westin 1993). The
//! certainty depends on the mask alone, so it is filtered once and kept. Masked pixels are
//! never read: the plane holds zeros there from the beginning, and only the spans of the mask
//! are rewritten.
#![allow(unsafe_code, reason = "the inner loops run on `Lanes`, by pointer")]

use std::ops::Range;

use mask::{Mask, Span};
use simd::sharing::Sharing;
use simd::{LANES, Lanes, Simd, dispatch};
use sonoweave_core::slice::{Image, Pixels};

use super::nodes::{MOST_NODES, Nodes};
use super::settings::SettingsError;
use super::spline::{PhaseTaps, Step, Taps};

/// Rows of nodes that one task filters.
const ROWS_PER_TASK: usize = 8;

/// Work of the filter for one slice.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FilterWork {
    /// Pixels read.
    pub pixels: u64,
    /// Nodes computed.
    pub nodes: u64,
    /// Products summed, both passes, in whole vectors.
    pub taps: u64,
}

/// The work for one row of nodes, fixed with the mask.
#[derive(Debug, Clone)]
struct NodeRow {
    phase: usize,
    /// First tap used, and the plane's row under it.
    first_tap: usize,
    plane_row: usize,
    taps: usize,
    /// Columns of the plane that are not all masked, widened to whole vectors.
    columns: Range<usize>,
    /// Nodes that those columns reach, widened to whole vectors (in phase groups when there are
    /// several nodes per pixel).
    nodes: Range<usize>,
}

/// Memory of one task.
#[derive(Debug, Clone)]
struct Scratch {
    /// The filtered row, with a margin for the taps on both sides.
    row: Vec<f32>,
    /// The row's samples by residue modulo the step, or the nodes by phase.
    split: Vec<Vec<f32>>,
}

/// The filter for slices of one size, mask and pixel size.
#[derive(Clone)]
pub(crate) struct SliceFilter {
    simd: Simd,
    taps: [Taps; 2],
    mask: Mask,
    /// First column and row of the box around the data.
    corner: [usize; 2],
    plane_rows: usize,
    plane_stride: usize,
    plane: Vec<f32>,
    /// Position of the plane's column 0 in [`Scratch::row`].
    margin: usize,
    node_rows: Vec<NodeRow>,
    scratch: Vec<Scratch>,
    /// Σ k·c·(b − level).
    pub(crate) value: Nodes,
    /// Grey level that the values are relative to: the image's first pixel that is data.
    /// Rounding is then relative to contrast and not to brightness, and a constant image is
    /// exactly constant after any filter.
    pub(crate) level: f32,
    /// Work of filtering one slice.
    pub(crate) work: FilterWork,
}

fn round_up(n: usize) -> usize {
    n.next_multiple_of(LANES)
}

impl SliceFilter {
    /// Iterates over the weights of all taps, u before v.
    pub(crate) fn weights(&self) -> impl Iterator<Item = f32> {
        self.taps.iter().flat_map(|taps| &taps.phases).flat_map(|phase| phase.weights.iter().copied())
    }

    /// Creates the filter for images of the mask's size.
    ///
    /// `margin_px`: largest distance of contributing voxels from the data, per axis.
    ///
    /// # Errors
    /// [`SettingsError::EmptyMask`] and [`SettingsError::Nodes`].
    pub(crate) fn new(simd: Simd, taps: [Taps; 2], mask: Mask, margin_px: [f64; 2]) -> Result<Self, SettingsError> {
        let bounds = mask.bounds().ok_or(SettingsError::EmptyMask)?;
        let [u_low, v_low] = [bounds.x as usize, bounds.y as usize];
        let [u_high, v_high] = [u_low + bounds.width as usize - 1, v_low + bounds.height as usize - 1];
        let plane_rows = v_high - v_low + 1;
        let plane_columns = u_high - u_low + 1;
        // One vector more than needed: loads may begin at any column.
        let plane_stride = round_up(plane_columns) + LANES;

        // Nodes: the data's box, widened by the margin and by the spline's support of two
        // nodes.
        let nodes_of = |taps: &Taps, low: usize, high: usize, margin: f64| {
            let h = taps.step.pixels();
            let mut first = ((low as f64 - margin) / h).floor() as i64 - 2;
            if let Step::Up(r) = taps.step {
                // Starts with phase 0.
                first = first.div_euclid(i64::from(r)) * i64::from(r);
            }
            let last = ((high as f64 + margin) / h).ceil() as i64 + 3;
            (first, (last - first + 1) as usize)
        };
        let (first_u, columns) = nodes_of(&taps[0], u_low, u_high, margin_px[0]);
        let (first_v, rows) = nodes_of(&taps[1], v_low, v_high, margin_px[1]);
        let group = match taps[0].step {
            Step::Down(_) => 1,
            Step::Up(r) => r as usize,
        };
        let stride = round_up(columns.div_ceil(group)) * group + LANES;
        match rows.checked_mul(stride) {
            Some(nodes) if nodes <= MOST_NODES => {}
            nodes => return Err(SettingsError::Nodes(nodes.unwrap_or(usize::MAX))),
        }

        let (_, anchor) = taps[0].anchor(first_u);
        let first_tap = taps[0].phases.iter().map(|p| i64::from(p.first)).min().unwrap_or(0);
        // Plane column 0 is pixel u_low; scratch index 0 is the first pixel that node 0 reads.
        let margin = usize::try_from(u_low as i64 - (anchor + first_tap))
            .expect("node 0 lies two nodes and more left of the data, and its first tap not right of it");

        let mut filter = Self {
            simd,
            mask,
            corner: [u_low, v_low],
            plane_rows,
            plane_stride,
            plane: vec![0.0; plane_rows * plane_stride],
            margin,
            node_rows: Vec::new(),
            scratch: Vec::new(),
            value: Nodes::new([first_u, first_v], columns, rows, stride),
            level: 0.0,
            work: FilterWork::default(),
            taps,
        };
        filter.node_rows = (0..rows).map(|row| filter.plan(row, plane_columns)).collect();
        filter.scratch = vec![filter.make_scratch(); rows.div_ceil(ROWS_PER_TASK)];
        filter.work = filter.count();

        Ok(filter)
    }

    /// Returns Σ k·c on the nodes: the filter of an image of ones.
    pub(crate) fn certainty(&mut self, sharing: Sharing) -> Nodes {
        self.fill(|_, _, to| to.fill(1.0), sharing);
        self.run(1.0, sharing);
        self.value.clone()
    }

    /// Bound on the deviation of the sampled image from the exact sum, both axes, as a fraction
    /// of the image's range.
    pub(crate) fn deviation(&self) -> f64 {
        let [u, v] = [self.taps[0].deviation, self.taps[1].deviation];
        u + v + u * v + self.rounding()
    }

    /// Rounding part of the deviation. Each node contributes half a unit, of which there are at
    /// least 16384 to the range. The four row weights contribute up to three halves of 2⁻¹⁵ on
    /// either side of their sum.
    fn rounding(&self) -> f64 {
        let gain: f32 = self.taps.iter().map(Taps::gain).product();
        f64::from(gain) * (0.5 / 16384.0 + 3.0 / 32768.0)
    }

    /// Node spacing in pixels along u and v.
    pub(crate) fn step_px(&self) -> [f64; 2] {
        [self.taps[0].step.pixels(), self.taps[1].step.pixels()]
    }

    fn plan(&self, row: usize, plane_columns: usize) -> NodeRow {
        let (phase, anchor) = self.taps[1].anchor(self.value.first[1] + row as i64);
        let taps = &self.taps[1].phases[phase];
        // Row of the plane under the first tap; taps above and below the data have no effect.
        let top = anchor + i64::from(taps.first) - self.corner[1] as i64;
        let first_tap = usize::try_from(-top).unwrap_or(0).min(taps.weights.len());
        let plane_row = usize::try_from(top).unwrap_or(0);
        let count = (taps.weights.len() - first_tap).min(self.plane_rows.saturating_sub(plane_row));
        let spans = || (plane_row..plane_row + count).flat_map(|row| self.spans(row));
        let low = spans().map(|s| s.start as usize).min().map_or(0, |u| u - self.corner[0]);
        let high = spans().map(|s| s.end as usize).max().map_or(0, |u| u - self.corner[0]);
        let low = low / LANES * LANES;
        let columns = low..(low + round_up(high - low)).min(round_up(plane_columns));
        let nodes = self.reached(&columns);
        NodeRow { phase, first_tap, plane_row, taps: count, columns, nodes }
    }

    /// Returns the data in a row of the plane, in columns of the image.
    fn spans(&self, plane_row: usize) -> &[Span] {
        self.mask.row((self.corner[1] + plane_row) as u32)
    }

    /// Returns the nodes (or groups of nodes) whose taps touch the plane's `columns`, in whole
    /// vectors.
    fn reached(&self, columns: &Range<usize>) -> Range<usize> {
        if columns.is_empty() {
            return 0..0;
        }
        let longest = self.taps[0].phases.iter().map(|p| p.weights.len()).max().unwrap_or(0) + self.spread();
        let step = self.pixel_step();
        // Node (or group) i reads scratch indices step·i .. step·i + longest.
        let low = (columns.start + self.margin + 1).saturating_sub(longest).div_ceil(step) / LANES * LANES;
        let high = (columns.end + self.margin - 1) / step + 1;
        let most = match self.taps[0].step {
            Step::Down(_) => self.value.columns,
            Step::Up(r) => self.value.columns.div_ceil(r as usize),
        };
        low..(low + round_up(high.min(most) - low.min(high.min(most))))
    }

    /// Pixels from node to node, or from group to group.
    fn pixel_step(&self) -> usize {
        match self.taps[0].step {
            Step::Down(k) => k as usize,
            Step::Up(_) => 1,
        }
    }

    /// Distance from the earliest to the latest first tap among the phases, pixels.
    fn spread(&self) -> usize {
        let firsts = || self.taps[0].phases.iter().map(|p| p.first);
        (firsts().max().unwrap_or(0) - firsts().min().unwrap_or(0)) as usize
    }

    fn make_scratch(&self) -> Scratch {
        let longest = self.taps[0].phases.iter().map(|p| p.weights.len()).max().unwrap_or(0) + self.spread();
        let step = self.pixel_step();
        // Vectors may run past the last node, so the memory behind it must exist.
        let outputs = round_up(self.value.columns) + LANES;
        let length = (step * outputs + longest + LANES).max(self.margin + self.plane_stride + LANES);
        let split = match self.taps[0].step {
            Step::Down(1) => Vec::new(),
            Step::Down(k) => vec![vec![0.0; outputs + longest / k as usize + 1 + LANES]; k as usize],
            Step::Up(r) => vec![vec![0.0; outputs]; r as usize],
        };
        Scratch { row: vec![0.0; length], split }
    }

    fn count(&self) -> FilterWork {
        let mut work = FilterWork { pixels: self.mask.area(), ..FilterWork::default() };
        for row in &self.node_rows {
            work.taps += (row.taps * row.columns.len()) as u64;
            for phase in &self.taps[0].phases {
                work.nodes += row.nodes.len() as u64;
                work.taps += (row.nodes.len() * phase.weights.len()) as u64;
            }
        }
        work
    }

    /// Filters an image; the result is in [`Self::value`].
    pub(crate) fn filter(&mut self, image: &Image, sharing: Sharing) {
        let size = [self.mask.width(), self.mask.height()];
        assert_eq!([image.width(), image.height()], size, "the caller refuses pictures of another size");
        let range = match image.pixels() {
            Pixels::U8(p) => {
                self.fill_relative(p, |x| f32::from(*x), sharing);
                255.0
            }
            Pixels::U16(p) => {
                self.fill_relative(p, |x| f32::from(*x), sharing);
                self.range()
            }
            Pixels::F32(p) => {
                self.fill_relative(p, |x| *x, sharing);
                self.range()
            }
        };
        self.run(range, sharing);
    }

    /// Largest magnitude in the plane.
    fn range(&self) -> f32 {
        self.plane.iter().fold(0.0, |most, x| x.abs().max(most))
    }

    /// Fills the plane with the data of an image, relative to its first pixel that is data.
    fn fill_relative<T: Sync>(&mut self, pixels: &[T], grey: impl Fn(&T) -> f32 + Sync, sharing: Sharing) {
        let width = self.mask.width() as usize;
        let first = self.spans(0).first().map_or(0, |span| span.start as usize);
        let level = grey(&pixels[self.corner[1] * width + first]);
        self.level = level;
        self.fill(
            |u, v, to| {
                for (to, from) in to.iter_mut().zip(&pixels[v * width + u..]) {
                    *to = grey(from) - level;
                }
            },
            sharing,
        );
    }

    /// Writes each span of the plane: `source(u, v, to)` fills `to` with the pixels from (u, v) on.
    fn fill(&mut self, source: impl Fn(usize, usize, &mut [f32]) + Sync, sharing: Sharing) {
        let [u0, v0] = self.corner;
        let mask = &self.mask;
        // Sixty-four rows per task: filling is little more than a copy.
        let rows = 64;
        sharing.chunks(&mut self.plane, self.plane_stride * rows, |index, lines| {
            for (row, plane) in (index * rows..).zip(lines.chunks_mut(self.plane_stride)) {
                for span in mask.row((v0 + row) as u32) {
                    let (start, end) = (span.start as usize, span.end as usize);
                    source(start, v0 + row, &mut plane[start - u0..end - u0]);
                }
            }
        });
    }

    /// Filters the plane, whose magnitudes are at most `range`.
    fn run(&mut self, range: f32, sharing: Sharing) {
        let mut data = std::mem::take(&mut self.value.data);
        let mut scratch = std::mem::take(&mut self.scratch);
        let this = &*self;
        sharing.chunks_beside(&mut data, this.value.stride * ROWS_PER_TASK, &mut scratch, |scratch, index, rows| {
            filter_rows(this.simd, this, index * ROWS_PER_TASK, rows, scratch);
        });
        self.value.data = data;
        self.scratch = scratch;
        // Taps of either sign can carry a node beyond the pixels' range, at most by their sum
        // of magnitudes.
        let gain: f32 = self.taps.iter().map(Taps::gain).product();
        self.value.pack(self.simd, range * gain, sharing);
    }
}

dispatch!(
    /// Filters the node rows from `first` on into `rows`.
    fn filter_rows => filter_rows_lanes(filter: &SliceFilter, first: usize, rows: &mut [f32], scratch: &mut Scratch)
);

/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn filter_rows_lanes<L: Lanes>(filter: &SliceFilter, first: usize, rows: &mut [f32], scratch: &mut Scratch) {
    for (row, out) in (first..).zip(rows.chunks_mut(filter.value.stride)) {
        let plan = &filter.node_rows[row];
        if plan.columns.is_empty() || plan.taps == 0 {
            continue;
        }
        // Filter down the columns.
        let weights = &filter.taps[1].phases[plan.phase].weights[plan.first_tap..][..plan.taps];
        let plane = &filter.plane[plan.plane_row * filter.plane_stride..];
        let at = filter.margin + plan.columns.start;
        let to = filter.margin + plan.columns.end;
        scratch.row[..at].fill(0.0);
        scratch.row[to..].fill(0.0);
        // SAFETY: the instruction set as for this function.
        unsafe { down::<L>(plane, filter.plane_stride, plan.columns.clone(), weights, &mut scratch.row[at..to]) };
        // Filter along the row.
        match filter.taps[0].step {
            Step::Down(k) => {
                let taps = &filter.taps[0].phases[0];
                let k = k as usize;
                if k > 1 {
                    let reach = plan.nodes.end + taps.weights.len() / k + 1;
                    for (residue, split) in scratch.split.iter_mut().enumerate() {
                        let samples = scratch.row[residue..].iter().step_by(k);
                        for (to, from) in split[..reach].iter_mut().zip(samples) {
                            *to = *from;
                        }
                    }
                }
                let samples: &[Vec<f32>] = if k > 1 { &scratch.split } else { std::slice::from_ref(&scratch.row) };
                // SAFETY: the instruction set as for this function.
                unsafe { along::<L>(samples, 0, taps, plan.nodes.clone(), out) };
            }
            Step::Up(r) => {
                let earliest = filter.taps[0].phases.iter().map(|p| p.first).min().unwrap_or(0);
                for (phase, taps) in filter.taps[0].phases.iter().enumerate() {
                    let shift = (taps.first - earliest) as usize;
                    let samples = std::slice::from_ref(&scratch.row);
                    // SAFETY: the instruction set as for this function.
                    unsafe { along::<L>(samples, shift, taps, plan.nodes.clone(), &mut scratch.split[phase]) };
                }
                for (phase, split) in scratch.split.iter().enumerate() {
                    for group in plan.nodes.clone() {
                        out[group * r as usize + phase] = split[group];
                    }
                }
            }
        }
    }
}

/// `out[c] = Σ weights[t]·plane[t·stride + columns.start + c]`, in the order of t.
///
/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn down<L: Lanes>(plane: &[f32], stride: usize, columns: Range<usize>, weights: &[f32], out: &mut [f32]) {
    assert!(columns.len() == out.len() && columns.len().is_multiple_of(LANES) && columns.end <= stride);
    assert!(plane.len() >= weights.len() * stride);
    // SAFETY: the assertions keep every load (row t < weights.len(), column < stride) inside
    // `plane` and every store inside `out`.
    unsafe {
        let from = plane.as_ptr().add(columns.start);
        let mut column = 0;
        // Four vectors at a time hide the latency of the multiply-adds.
        while column + 4 * LANES <= columns.len() {
            let mut sum = [L::splat(0.0); 4];
            for (t, weight) in weights.iter().enumerate() {
                let weight = L::splat(*weight);
                let row = from.add(t * stride + column);
                for (i, sum) in sum.iter_mut().enumerate() {
                    *sum = L::load(row.add(i * LANES)).mul_add(weight, *sum);
                }
            }
            for (i, sum) in sum.iter().enumerate() {
                sum.store(out.as_mut_ptr().add(column + i * LANES));
            }
            column += 4 * LANES;
        }
        while column < columns.len() {
            let mut sum = L::splat(0.0);
            for (t, weight) in weights.iter().enumerate() {
                sum = L::load(from.add(t * stride + column)).mul_add(L::splat(*weight), sum);
            }
            sum.store(out.as_mut_ptr().add(column));
            column += LANES;
        }
    }
}

/// `out[i] = Σ weights[t]·samples[t mod k][shift + i + t div k]` for the nodes i, k =
/// samples.len(), in the order of t.
///
/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn along<L: Lanes>(samples: &[Vec<f32>], shift: usize, taps: &PhaseTaps, nodes: Range<usize>, out: &mut [f32]) {
    let k = samples.len();
    let longest = taps.weights.len().div_ceil(k);
    assert!(nodes.len().is_multiple_of(LANES) && nodes.end <= out.len());
    assert!(samples.iter().all(|s| s.len() >= shift + nodes.end + longest));
    // SAFETY: the assertions keep every load (index < shift + nodes.end + longest) and store
    // (index < nodes.end) inside its slice.
    unsafe {
        let mut node = nodes.start;
        // Four vectors at a time hide the latency of the multiply-adds.
        while node + 4 * LANES <= nodes.end {
            let mut sum = [L::splat(0.0); 4];
            for (quotient, weights) in taps.weights.chunks(k).enumerate() {
                for (samples, weight) in samples.iter().zip(weights) {
                    let weight = L::splat(*weight);
                    let from = samples.as_ptr().add(shift + node + quotient);
                    for (i, sum) in sum.iter_mut().enumerate() {
                        *sum = L::load(from.add(i * LANES)).mul_add(weight, *sum);
                    }
                }
            }
            for (i, sum) in sum.iter().enumerate() {
                sum.store(out.as_mut_ptr().add(node + i * LANES));
            }
            node += 4 * LANES;
        }
        while node < nodes.end {
            let mut sum = L::splat(0.0);
            for (quotient, weights) in taps.weights.chunks(k).enumerate() {
                for (samples, weight) in samples.iter().zip(weights) {
                    let from = samples.as_ptr().add(shift + node + quotient);
                    sum = L::load(from).mul_add(L::splat(*weight), sum);
                }
            }
            sum.store(out.as_mut_ptr().add(node));
            node += LANES;
        }
    }
}

#[cfg(test)]
mod tests;
