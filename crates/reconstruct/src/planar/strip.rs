//! The columns that a slice meets, and the sum across u: the hot loop.
//!
//! In a view along z a slice is a line, and it changes a strip of columns around it. A column
//! gains the weighted sum of the lines of voxels computed from the image's rows. The lines are
//! as long as the column, and their loads need no conversion, gather or mask.
#![allow(unsafe_code, reason = "the inner loop runs on `Lanes`, by pointer")]

use glam::DVec3;

use simd::sharing::{Handed, Sharing};
use simd::{LANES, Lanes, Simd, dispatch};
use volume::brick::EDGE;
use volume::columns::{COLUMNS, TileIndex, TileMut};
use volume::{ColumnVolume, Prism};

use super::plane::SliceLine;
use super::table::{KernelTable, MOST_TAPS, RowKernel, Taps};
use crate::Refused;
use crate::decay::{Decay, LEAST_FACTOR, LEAST_TOUCH};
use crate::entry::shrunk;
use crate::slab::LEAST_CERTAINTY;

/// Tiles that one task of a thread processes.
const TILES_PER_TASK: usize = 2;
/// Vectors of a column that are summed at once.
const AT_ONCE: usize = 4;
/// Half a tile, from its centre to the centre of its outermost columns.
const HALF: f64 = (EDGE as f64 - 1.0) / 2.0;
/// Widening of interval tests against rounding, in rows and mm.
const SLACK: f64 = 1e-3;

/// The part of a slice that falls on one tile.
#[derive(Debug, Clone, Copy)]
pub(super) struct Task {
    slot: u32,
    pub(super) tile: TileIndex,
    /// Columns that gained weight.
    pub(super) updated: u32,
    /// Columns whose weight was clamped.
    pub(super) clamped: u32,
    /// Products of lines and weights.
    pub(super) taps: u64,
}

/// A slice in terms of columns.
#[derive(Clone, Copy)]
pub(super) struct Strip<'a> {
    pub(super) slice_line: SliceLine,
    pub(super) rows: &'a RowKernel,
    pub(super) normal: &'a KernelTable,
    /// Least weight that changes a column.
    pub(super) least: f32,
}

/// The lines that it adds.
#[derive(Clone, Copy)]
pub(super) struct Lines<'a> {
    /// One for each row, `stride` apart.
    pub(super) values: &'a [f32],
    pub(super) stride: usize,
    /// Grey level that they are relative to.
    pub(super) level: f32,
    /// Largest weight that a column keeps.
    pub(super) most_weight: f32,
    /// The decay, if any, and the slice's time on the decay's clock, ns.
    pub(super) decay: Option<(Decay, i64)>,
}

impl Strip<'_> {
    /// Row and distance at a column.
    #[inline(always)]
    fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let [row, distance] =
            [self.slice_line.row, self.slice_line.distance].map(|[base, dx, dy]| base + x * dx + y * dy);
        (row, distance)
    }

    /// Whether a row lies within the kernel's support of an existing one.
    #[inline(always)]
    fn reaches(&self, row: f64) -> bool {
        row >= -self.rows.reach && row <= (self.rows.rows - 1) as f64 + self.rows.reach
    }

    /// Row and distance of column `column` of a tile; `None` outside the kernel's support.
    #[inline(always)]
    fn place(&self, tile: TileIndex, column: usize) -> Option<(f64, f64)> {
        let at = |axis: usize, inside: usize| f64::from(tile[axis]) * EDGE as f64 + inside as f64;
        let (row, distance) = self.at(at(0, column % EDGE), at(1, column / EDGE));
        (distance.abs() <= self.normal.support_mm && self.reaches(row)).then_some((row, distance))
    }

    /// Returns the taps of a column at this position and its weight across the slice; `None` if
    /// it takes no part.
    ///
    /// # Safety
    /// The instruction set of `L` must be available.
    #[inline(always)]
    unsafe fn taps<L: Lanes>(
        &self,
        (row, distance): (f64, f64),
        weights: &mut [f32; MOST_TAPS],
    ) -> Option<(Taps, f32)> {
        // SAFETY: as for this function.
        let taps = unsafe { self.rows.taps::<L>(row, weights) };
        (taps.share >= LEAST_CERTAINTY).then(|| (taps, self.normal.weight(distance)))
    }

    /// Least and largest contributing value of row and distance.
    fn limits(&self) -> [[f64; 2]; 2] {
        let (reach, support) = (self.rows.reach, self.normal.support_mm);
        [[-reach, (self.rows.rows - 1) as f64 + reach], [-support, support]]
    }

    /// Returns the strip along `depth` voxels from `first_z` on, around all contributing
    /// voxels; lattice indices.
    pub(super) fn prism(&self, first_z: i64, depth: usize) -> Option<Prism> {
        let [row, distance] =
            [self.slice_line.row, self.slice_line.distance].map(|[base, dx, dy]| (base, DVec3::new(dx, dy, 0.0)));
        let [rows, across] = self.limits().map(|[low, high]| [low - SLACK, high + SLACK]);
        let along = [first_z as f64, first_z as f64 + depth as f64 - 1.0];
        Prism::between([row, distance, (0.0, DVec3::Z)], [rows, across, along])
    }

    /// Returns the tiles of the box around the strip, per axis, both inclusive; `None` when an
    /// index is out of range.
    fn tile_box(&self) -> Option<[[i32; 2]; 2]> {
        let limits = self.limits();
        let ([b, bx, by], [c, cx, cy]) = (self.slice_line.row, self.slice_line.distance);
        let determinant = bx * cy - by * cx;
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in 0..4_usize {
            let (row, distance) = (limits[0][corner & 1] - b, limits[1][corner >> 1] - c);
            let column = [(row * cy - distance * by) / determinant, (distance * bx - row * cx) / determinant];
            for axis in 0..2 {
                low[axis] = low[axis].min(column[axis]);
                high[axis] = high[axis].max(column[axis]);
            }
        }
        let tile = |x: f64, widen: f64| {
            let index = ((x + widen) / EDGE as f64).floor();
            (index.abs() < f64::from(i32::MAX / EDGE as i32)).then_some(index as i32)
        };
        let axis = |a: usize| Some([tile(low[a], -1.0)?, tile(high[a], 1.0)?]);
        Some([axis(0)?, axis(1)?])
    }

    /// Calls `visit` for each tile that may hold columns of the strip, in the lattice's order,
    /// until it returns false.
    fn walk(&self, [xs, ys]: [[i32; 2]; 2], mut visit: impl FnMut(TileIndex) -> bool) {
        let (edge, limits) = (EDGE as f64, self.limits());
        let steps = [self.slice_line.row, self.slice_line.distance];
        for y in ys[0]..=ys[1] {
            let (row, distance) = self.at(HALF, f64::from(y) * edge + HALF);
            let (mut first, mut last) = (f64::from(xs[0]), f64::from(xs[1]));
            for (start, ([_, dx, dy], limit)) in [row, distance].into_iter().zip(steps.into_iter().zip(limits)) {
                let radius = HALF * (dx.abs() + dy.abs()) + SLACK;
                let (low, high) = (limit[0] - radius - start, limit[1] + radius - start);
                if (dx * edge).abs() < 1e-12 {
                    if low > 0.0 || high < 0.0 {
                        last = f64::NEG_INFINITY;
                    }
                } else {
                    let (a, b) = (low / (dx * edge), high / (dx * edge));
                    first = first.max(a.min(b).ceil());
                    last = last.min(a.max(b).floor());
                }
            }
            if first > last {
                continue;
            }
            for x in first as i32..=last as i32 {
                if !visit([x, y]) {
                    return;
                }
            }
        }
    }
}

/// The tiles of one slice. Reused for each slice to keep its memory.
#[derive(Default)]
pub(super) struct Plan {
    /// Tiles that may change, in the lattice's order.
    pub(super) tasks: Vec<Task>,
    /// Indices of those that do not exist and will change.
    absent: Vec<usize>,
    /// Tiles that interval tests could not exclude.
    pub(super) considered: u64,
    chunks: Vec<Handed<f32>>,
}

impl Plan {
    /// Finds a slice's tiles; nothing is changed. A tile that does not exist is added only if a
    /// column of it would change.
    ///
    /// # Errors
    /// [`Refused::OutOfRange`] and [`Refused::Memory`].
    pub(super) fn find(
        &mut self,
        strip: &Strip<'_>,
        volume: &ColumnVolume,
        simd: Simd,
        limit_bytes: u64,
    ) -> Result<(), Refused> {
        self.tasks.clear();
        self.absent.clear();
        self.considered = 0;
        let tiles = strip.tile_box().ok_or(Refused::OutOfRange)?;
        let most = limit_bytes / volume.tile_bytes();
        let room = most.saturating_sub(volume.tiles() as u64);
        let memory = |tiles: u64| Refused::memory(tiles.saturating_mul(volume.tile_bytes()), limit_bytes);
        let spans = tiles.map(|[low, high]| u64::from(high.abs_diff(low)) + 1);
        // A strip of n tiles spans at most about n rows; one with far more rows than the memory
        // holds tiles cannot fit.
        if spans[1] / 64 > most {
            return Err(memory(spans[1] - most));
        }
        let mut weights = [0.0; MOST_TAPS];
        strip.walk(tiles, |tile| {
            self.considered += 1;
            let slot = volume.find(tile);
            if slot.is_none() {
                if !touches(simd, tile, strip, &mut weights) {
                    return true;
                }
                self.absent.push(self.tasks.len());
            }
            self.tasks.push(Task { slot: slot.unwrap_or_default(), tile, updated: 0, clamped: 0, taps: 0 });
            self.absent.len() as u64 <= room
        });
        match (self.absent.len() as u64).saturating_sub(room) {
            0 => Ok(()),
            needed => Err(memory(needed)),
        }
    }

    /// Creates the missing tiles.
    ///
    /// # Errors
    /// [`Refused::Memory`] when the system has none to give; nothing has changed then.
    pub(super) fn make(&mut self, volume: &mut ColumnVolume) -> Result<(), Refused> {
        if volume.reserve(self.absent.len()).is_err() {
            let bytes = self.absent.len() as u64 * volume.tile_bytes();
            return Err(Refused::memory(bytes, self.tasks.len() as u64 * volume.tile_bytes()));
        }
        for task in &self.absent {
            self.tasks[*task].slot = volume.insert(self.tasks[*task].tile);
        }
        Ok(())
    }

    /// Inserts the slice into all tiles, each by one thread.
    pub(super) fn insert(
        &mut self,
        volume: &mut ColumnVolume,
        strip: &Strip<'_>,
        lines: &Lines<'_>,
        simd: Simd,
        sharing: Sharing,
    ) {
        self.chunks.clear();
        self.chunks.extend(volume.chunk_pointers().map(Handed));
        let (chunks, len, volume) = (self.chunks.as_slice(), volume.tile_len(), &*volume);
        sharing.chunks_with(
            &mut self.tasks,
            TILES_PER_TASK,
            || [0.0; MOST_TAPS],
            |weights, _, tasks| {
                for task in tasks {
                    let (chunk, first) = volume.locate(task.slot);
                    let chunk: Handed<f32> = chunks[chunk];
                    // SAFETY: `chunks` holds the base of each chunk of the volume, which is
                    // borrowed mutably for this function. `locate` gives the position of a
                    // whole tile inside its chunk for every slot that the volume has handed
                    // out. Each tile of the lattice is visited once in a walk and has its own
                    // slot, so no two tasks reach the same tile.
                    let tile = unsafe { std::slice::from_raw_parts_mut(chunk.0.add(first), len) };
                    insert(simd, tile, task, strip, lines, weights);
                }
            },
        );
    }
}

dispatch!(
    /// Adds a slice to the columns of a tile that it reaches, and counts them in the task.
    fn insert => insert_lanes(
        tile: &mut [f32],
        task: &mut Task,
        strip: &Strip<'_>,
        lines: &Lines<'_>,
        weights: &mut [f32; MOST_TAPS],
    )
);

/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn insert_lanes<L: Lanes>(
    tile: &mut [f32],
    task: &mut Task,
    strip: &Strip<'_>,
    lines: &Lines<'_>,
    weights: &mut [f32; MOST_TAPS],
) {
    let stride = lines.stride;
    let tile = TileMut::new(tile, stride);
    for column in 0..COLUMNS {
        let Some(place) = strip.place(task.tile, column) else { continue };
        let column_values = &mut tile.columns[column * stride..][..stride];
        // SAFETY: the instruction set as for this function.
        let Some((taps, across)) = (unsafe { strip.taps::<L>(place, weights) }) else { continue };
        let mut gained = across * taps.share;
        let (mut fade, mut part) = (1.0, 1.0);
        if let Some((decay, now_ns)) = lines.decay {
            if gained < LEAST_TOUCH {
                continue;
            }
            if tile.weights[column] > 0.0 {
                let factor = decay.factor((now_ns - tile.written_ns[column]) as f64 * 1e-9) as f32;
                fade = if factor < LEAST_FACTOR { 0.0 } else { factor };
                part = if matches!(decay, Decay::PaperLiteral { .. }) { 1.0 - fade } else { 1.0 };
            }
            tile.written_ns[column] = now_ns;
        }
        gained *= part;
        let faded = tile.weights[column] * fade;
        let weight = faded + gained;
        let fits = weight <= lines.most_weight;
        // most·(r + s) / (w + g), as a step from r: see the general path's clamp.
        let (keep, lost) = match fits {
            true => (1.0, 0.0),
            false => (lines.most_weight / weight, (gained + (faded - lines.most_weight)) / weight),
        };
        tile.weights[column] = if fits { weight } else { lines.most_weight };
        let weights = &mut weights[taps.first..][..taps.rows.len()];
        let scale = across / taps.total * (part * keep);
        for weight in weights.iter_mut() {
            *weight *= scale;
        }
        task.updated += 1;
        task.clamped += u32::from(!fits);
        task.taps += (weights.len() * stride) as u64;
        let rows = &lines.values[taps.rows.start * stride..];
        let sum = Sum { rows, stride, weights, level: lines.level, gained: gained * keep, fade, lost };
        // SAFETY: the instruction set as for this function.
        unsafe { add::<L>(column_values, &sum) };
    }
}

dispatch!(
    /// Whether [`insert`] would change any column; called before a tile is created.
    fn touches => touches_lanes(tile: TileIndex, strip: &Strip<'_>, weights: &mut [f32; MOST_TAPS]) -> bool
);

/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn touches_lanes<L: Lanes>(tile: TileIndex, strip: &Strip<'_>, weights: &mut [f32; MOST_TAPS]) -> bool {
    for column in 0..COLUMNS {
        if let Some(place) = strip.place(tile, column) {
            // SAFETY: the instruction set as for this function.
            let taps = unsafe { strip.taps::<L>(place, weights) };
            if taps.is_some_and(|(taps, across)| across * taps.share >= strip.least) {
                return true;
            }
        }
    }
    false
}

/// The sum that a column gains.
#[derive(Clone, Copy)]
pub(super) struct Sum<'a> {
    /// Lines of voxels, `stride` apart, and their weights.
    pub(super) rows: &'a [f32],
    pub(super) stride: usize,
    pub(super) weights: &'a [f32],
    /// Level that the lines are relative to, and the weight gained.
    pub(super) level: f32,
    pub(super) gained: f32,
    /// Fraction of the older sums that remains.
    pub(super) fade: f32,
    /// Fraction of those that is lost when the weight is clamped.
    pub(super) lost: f32,
}

/// `column[z] = old + (Σ weights[t]·rows[t·stride + z] + level·gained − old·lost)` with
/// `old = column[z]·fade`, in the order of t.
///
/// Computed as a step from the old value. Scaling the sum down when the weight is clamped would
/// add a rounding error of its size with every slice, and a constant would drift.
///
/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
pub(super) unsafe fn add<L: Lanes>(column: &mut [f32], sum: &Sum<'_>) {
    let len = column.len();
    assert!(len.is_multiple_of(LANES) && len <= sum.stride);
    assert!(sum.weights.is_empty() || sum.rows.len() >= (sum.weights.len() - 1) * sum.stride + len);
    // SAFETY: the assertions keep every load of row t < weights.len() at z + 16 ≤ len inside
    // `rows` and those of the column inside it; the instruction set as for this function.
    unsafe {
        let mut z = 0;
        while z + AT_ONCE * LANES <= len {
            add_at::<L, AT_ONCE>(column.as_mut_ptr().add(z), sum.rows.as_ptr().add(z), sum);
            z += AT_ONCE * LANES;
        }
        while z < len {
            add_at::<L, 1>(column.as_mut_ptr().add(z), sum.rows.as_ptr().add(z), sum);
            z += LANES;
        }
    }
}

/// Processes N vectors of [`add`].
///
/// # Safety
/// N vectors must lie at `column` and at each of the rows from `rows` on; the instruction set
/// of `L` must be available.
#[inline(always)]
unsafe fn add_at<L: Lanes, const N: usize>(column: *mut f32, rows: *const f32, sum: &Sum<'_>) {
    // SAFETY: as for this function.
    unsafe {
        let mut contrast = [L::splat(0.0); N];
        let mut row = rows;
        for weight in sum.weights {
            let weight = L::splat(*weight);
            for (i, contrast) in contrast.iter_mut().enumerate() {
                *contrast = L::load(row.add(i * LANES)).mul_add(weight, *contrast);
            }
            row = row.wrapping_add(sum.stride);
        }
        let (level, gained) = (L::splat(sum.level), L::splat(sum.gained));
        let (fade, lost) = (L::splat(sum.fade), L::splat(-sum.lost));
        let shrinks = sum.fade < 1.0 || sum.lost > 0.0;
        for (i, contrast) in contrast.into_iter().enumerate() {
            let at = column.add(i * LANES);
            let old = L::load(at).mul(fade);
            let new = old.add(old.mul_add(lost, level.mul_add(gained, contrast)));
            let new = if shrinks { shrunk(new) } else { new };
            new.store(at);
        }
    }
}
