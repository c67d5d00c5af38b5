//! Windows of a slice: by how much tissue in them is displaced along v.
//!
//! A window of the light slice is sought in the pressed one by normalised cross-correlation. A
//! parabola through the peak and its neighbours gives a displacement between whole rows. Where
//! displacement changes within a window, the peak is that of the rows with most detail, whose
//! centroid is the window's depth.

use std::ops::{Range, RangeInclusive};

use crate::slices::Slices;
use crate::statistics::median;

/// Length of a window, and distance from one to the next, mm.
const LENGTH_MM: f64 = 4.0;
const STEP_MM: f64 = 3.0;
/// Largest displacement that is sought, mm.
pub(super) const SEARCH_MM: f64 = 3.4;
/// Samples of a window, and those that both slices show, as parts of the most possible.
const LEAST_SAMPLES: f64 = 0.1;
const LEAST_OVERLAP: f64 = 0.5;
/// Furthest that a window's depth is from its middle, as a part of its length.
const MOST_OFF: f64 = 0.12;

/// Grey values of a slice about their mean, in f32 for speed; 0 where there are no data.
pub(super) struct Picture {
    values: Vec<f32>,
    squares: Vec<f32>,
    data: Vec<f32>,
}

impl Picture {
    pub(super) fn new(greys: &[Option<f64>]) -> Self {
        let (sum, count) = greys.iter().flatten().fold((0.0, 0.0), |(sum, count), grey| (sum + grey, count + 1.0));
        let mean = if count > 0.0 { sum / count } else { 0.0 };
        let values: Vec<f32> = greys.iter().map(|grey| grey.map_or(0.0, |grey| (grey - mean) as f32)).collect();
        let squares = values.iter().map(|x| x * x).collect();
        let data = greys.iter().map(|grey| f32::from(u8::from(grey.is_some()))).collect();
        Self { values, squares, data }
    }

    /// Returns a slice as it is.
    pub(super) fn of(slices: &Slices, slice: usize) -> Self {
        let pixels = &slices.pixels[slice].1;
        let grey = |at: usize| slices.is_data[at].then(|| f64::from(pixels[at]) / 256.0);
        Self::new(&(0..pixels.len()).map(grey).collect::<Vec<_>>())
    }
}

/// Sums over the pixels that two pictures show in rows: their number, those of either's values and
/// squares, and of the products.
type Sums = [f64; 6];

/// Sums of all rows of one picture with the rows of another one, displaced by each shift.
struct Table {
    shifts: RangeInclusive<i64>,
    rows: usize,
    /// For each shift, the sums over all rows before each row.
    before: Vec<Sums>,
}

impl Table {
    fn new(light: &Picture, pressed: &Picture, width: usize, shifts: RangeInclusive<i64>) -> Self {
        let rows = light.values.len() / width;
        let mut before = Vec::new();
        for shift in shifts.clone() {
            let mut sums = Sums::default();
            before.push(sums);
            for row in 0..rows {
                let other = row as i64 + shift;
                if (0..rows as i64).contains(&other) {
                    let of_row = row_sums(light, pressed, width, [row, other as usize]);
                    sums = std::array::from_fn(|k| sums[k] + of_row[k]);
                }
                before.push(sums);
            }
        }
        Self { shifts, rows, before }
    }

    fn sums(&self, shift: i64, rows: &Range<usize>) -> Sums {
        let first = (shift - self.shifts.start()) as usize * (self.rows + 1);
        let [from, to] = [rows.start, rows.end].map(|row| &self.before[first + row]);
        std::array::from_fn(|k| to[k] - from[k])
    }

    /// Returns the correlation of rows at a shift; `None` if fewer than `least` pixels are shown by
    /// both.
    fn correlation(&self, shift: i64, rows: &Range<usize>, least: f64) -> Option<f64> {
        let [count, x, y, xx, yy, xy] = self.sums(shift, rows);
        if !(count >= least.max(1.0)) {
            return None;
        }
        let [vx, vy] = [xx - x * x / count, yy - y * y / count];
        // Grey values that vary by less than their rounding are constant.
        (vx > 0.1 * count && vy > 0.1 * count).then(|| (xy - x * y / count) / (vx * vy).sqrt())
    }
}

/// Numbers that are summed side by side.
const LANES: usize = 8;

fn row_sums(light: &Picture, pressed: &Picture, width: usize, rows: [usize; 2]) -> Sums {
    let [a, b] = rows.map(|row| row * width..(row + 1) * width);
    let sum = |p: &[f32], q: &[f32]| {
        let ((p, p_rest), (q, q_rest)) = (p[a.clone()].as_chunks::<LANES>(), q[b.clone()].as_chunks::<LANES>());
        let lanes = p.iter().zip(q).fold([0.0; LANES], |sums: [f32; LANES], (p, q)| {
            std::array::from_fn(|lane| sums[lane] + p[lane] * q[lane])
        });
        let rest: f32 = p_rest.iter().zip(q_rest).map(|(p, q)| p * q).sum();
        f64::from(lanes.iter().sum::<f32>() + rest)
    };
    [
        sum(&light.data, &pressed.data),
        sum(&light.values, &pressed.data),
        sum(&light.data, &pressed.values),
        sum(&light.squares, &pressed.data),
        sum(&light.data, &pressed.squares),
        sum(&light.values, &pressed.values),
    ]
}

/// A window's displacement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Found {
    /// Depth from the first row of data, without pressure, mm.
    pub(super) depth_mm: f64,
    /// Displacement towards greater depth by pressure, mm.
    pub(super) shift_mm: f64,
    /// The correlation there.
    pub(super) peak: f64,
    /// Whether the best shift was the last one that was compared.
    pub(super) at_end: bool,
}

/// Windows of all slices of a scan.
pub(super) struct Windows {
    width: usize,
    row_mm: f64,
    /// Row of depth 0, and the first and last one with data.
    top: f64,
    first: f64,
    last: f64,
    rows: Vec<Range<usize>>,
    /// Most pixels of a row.
    row_pixels: f64,
}

impl Windows {
    pub(super) fn of(slices: &Slices) -> Self {
        let row_mm = slices.row_mm();
        let [[left, right], [first, last]] = slices.bounds;
        let rows_of = |from_mm: f64, length_mm: f64| {
            let [from, to] = [from_mm, from_mm + length_mm].map(|mm| (first + mm / row_mm).round() as usize);
            from..to
        };
        let deep_mm = (last + 1.0 - first) * row_mm;
        let count = ((deep_mm - LENGTH_MM) / STEP_MM).floor().max(-1.0) + 1.0;
        let rows = (0..count as usize).map(|k| rows_of(STEP_MM * k as f64, LENGTH_MM)).collect();
        Self { width: slices.width, row_mm, top: slices.top, first, last, rows, row_pixels: right + 1.0 - left }
    }

    /// Returns the number of windows.
    pub(super) fn count(&self) -> usize {
        self.rows.len()
    }

    /// Returns the depth of the last row with data, mm.
    pub(super) fn bottom_mm(&self) -> f64 {
        (self.last - self.top) * self.row_mm
    }

    /// Returns the displacements of a slice against a light one in its plane, for windows that have
    /// data.
    pub(super) fn found(&self, light: &Picture, pressed: &Picture) -> Vec<Found> {
        let most = (SEARCH_MM / self.row_mm).round() as i64;
        let table = Table::new(light, pressed, self.width, -most..=most);
        self.rows.iter().filter_map(|rows| self.peak(&table, light, rows)).collect()
    }

    fn peak(&self, table: &Table, light: &Picture, rows: &Range<usize>) -> Option<Found> {
        let least = self.least(light, rows)?;
        let at = |shift: i64, rows: &Range<usize>| {
            table.shifts.contains(&shift).then(|| table.correlation(shift, rows, least)).flatten()
        };
        let all = table.shifts.clone().filter_map(|shift| Some((shift, at(shift, rows)?)));
        let (shift, best) = all.max_by(|a, b| a.1.total_cmp(&b.1))?;
        // A parabola through correlations of unequal rows would be biased.
        let common = self.common(rows, shift);
        let peak = at(shift, &common).unwrap_or(best);
        let sides = [at(shift - 1, &common), at(shift + 1, &common)];
        let off = match sides {
            [Some(low), Some(high)] => 0.5 * (low - high) / (low - 2.0 * peak + high).min(-1e-12),
            _ => 0.0,
        };
        let middle = 0.5 * (rows.start + rows.end - 1) as f64;
        let reach = MOST_OFF * (rows.end - rows.start) as f64;
        let row = self.centroid(table, light, &common, shift).clamp(middle - reach, middle + reach);
        Some(Found {
            depth_mm: (row - self.top) * self.row_mm,
            shift_mm: (shift as f64 + off) * self.row_mm,
            peak,
            at_end: sides.iter().any(Option::is_none),
        })
    }

    /// Returns the rows of a window that both slices show at a shift and at those beside it.
    fn common(&self, rows: &Range<usize>, shift: i64) -> Range<usize> {
        let [first, last] = [self.first as i64, self.last as i64];
        let from = (first - shift + 1).max(rows.start as i64);
        let to = (last - shift).min(rows.end as i64);
        from as usize..to.max(from) as usize
    }

    /// Returns the least number of pixels that are compared; `None` if the light slice has too few.
    fn least(&self, light: &Picture, rows: &Range<usize>) -> Option<f64> {
        let own: f32 = light.data[rows.start * self.width..rows.end * self.width].iter().sum();
        let most = (rows.end - rows.start) as f64 * self.row_pixels;
        (f64::from(own) >= LEAST_SAMPLES * most).then(|| LEAST_OVERLAP * f64::from(own))
    }

    /// Returns the centroid of the rows that both show, weighted by the squared slopes along v.
    fn centroid(&self, table: &Table, light: &Picture, rows: &Range<usize>, shift: i64) -> f64 {
        let (mut sum, mut weights) = (0.0, f64::MIN_POSITIVE);
        for row in rows.clone().filter(|row| table.sums(shift, &(*row..*row + 1))[0] > 0.0) {
            let Some(above) = row.checked_sub(1).filter(|_| row + 1 < table.rows) else { continue };
            let [low, high] = [above, row + 1].map(|row| row * self.width..(row + 1) * self.width);
            let slope =
                |(a, b): (usize, usize)| f64::from((light.values[b] - light.values[a]) * light.data[a] * light.data[b]);
            let energy: f64 = low.zip(high).map(|pair| slope(pair).powi(2)).sum();
            sum += energy * row as f64;
            weights += energy;
        }
        sum / weights
    }

    /// Returns the median correlation of windows of two slices in one plane; `None` without windows
    /// that both show.
    pub(super) fn alike(&self, one: &Picture, other: &Picture) -> Option<f64> {
        let table = Table::new(one, other, self.width, 0..=0);
        let of = |rows: &Range<usize>| table.correlation(0, rows, self.least(one, rows)?);
        let mut all: Vec<f64> = self.rows.iter().filter_map(of).collect();
        (!all.is_empty()).then(|| median(&mut all))
    }
}
