//! Planes of numbers, and maps of pixels, with their sums over windows.

use super::super::shape::{Run, runs};

/// A plane of f32, row by row.
#[derive(Debug, Clone)]
pub(super) struct Plane {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) values: Vec<f32>,
}

impl Plane {
    /// Returns the means over 3×3 pixels; beyond the border, its pixels are repeated.
    pub(super) fn smoothed(&self) -> Self {
        let along = |values: &[f32], count: usize, stride: usize, out: &mut [f32]| {
            for at in 0..count {
                let (before, after) = (at.saturating_sub(1), (at + 1).min(count - 1));
                out[at * stride] =
                    (values[before * stride] + values[at * stride] + values[after * stride]) * (1.0 / 3.0);
            }
        };
        let mut rows = vec![0.0; self.values.len()];
        for (row, out) in self.values.chunks_exact(self.width).zip(rows.chunks_exact_mut(self.width)) {
            along(row, self.width, 1, out);
        }
        let mut values = vec![0.0; self.values.len()];
        for row in 0..self.height {
            let (before, after) = (row.saturating_sub(1), (row + 1).min(self.height - 1));
            let line = |row: usize| &rows[row * self.width..][..self.width];
            let lines = line(before).iter().zip(line(row)).zip(line(after));
            for (out, ((a, b), c)) in values[row * self.width..].iter_mut().zip(lines) {
                *out = (a + b + c) * (1.0 / 3.0);
            }
        }
        Self { values, ..*self }
    }

    /// Returns the value between pixels, by bilinear interpolation; `None` outside the plane.
    pub(super) fn sample(&self, u: f64, v: f64) -> Option<f32> {
        let (x, y) = (u.floor(), v.floor());
        if !(x >= 0.0 && y >= 0.0 && u <= (self.width - 1) as f64 && v <= (self.height - 1) as f64) {
            return None;
        }
        let (fx, fy) = ((u - x) as f32, (v - y) as f32);
        let (x, y) = (x as usize, y as usize);
        let (right, below) = ((x + 1).min(self.width - 1), (y + 1).min(self.height - 1));
        let at = |x: usize, y: usize| self.values[y * self.width + x];
        let upper = at(x, y) + (at(right, y) - at(x, y)) * fx;
        let lower = at(x, below) + (at(right, below) - at(x, below)) * fx;
        Some(upper + (lower - upper) * fy)
    }
}

/// A map of pixels.
#[derive(Debug, Clone)]
pub(crate) struct Map {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) set: Vec<bool>,
}

impl Map {
    /// Returns the map of the runs of a `width`×`height` map.
    pub(super) fn of_runs(width: usize, height: usize, runs: &[Run]) -> Self {
        let mut set = vec![false; width * height];
        for run in runs {
            set[run.row * width + run.start..run.row * width + run.end].fill(true);
        }
        Self { width, height, set }
    }

    /// Returns the runs of set pixels.
    pub(super) fn runs(&self) -> Vec<Run> {
        runs(&self.set, self.width)
    }

    /// Whether pixel (u, v) is set; none outside the map is.
    pub(super) fn at(&self, u: i64, v: i64) -> bool {
        let inside = |at: i64, count: usize| usize::try_from(at).ok().filter(|at| *at < count);
        match (inside(u, self.width), inside(v, self.height)) {
            (Some(u), Some(v)) => self.set[v * self.width + u],
            _ => false,
        }
    }

    /// Returns the pixels with a set one in the square of this radius.
    fn dilated(&self, radius: usize) -> Self {
        self.by_window(radius, |count, _| count > 0)
    }

    /// Returns the pixels whose square of this radius is set as far as it lies in the map.
    fn eroded(&self, radius: usize) -> Self {
        self.by_window(radius, |count, of| count == of)
    }

    /// Returns the map without gaps narrower than 2·radius.
    pub(super) fn closed(&self, radius: usize) -> Self {
        self.dilated(radius).eroded(radius)
    }

    /// Returns the map without parts that a square of this radius does not fit into.
    pub(crate) fn opened(&self, radius: usize) -> Self {
        self.eroded(radius).dilated(radius)
    }

    /// Returns the map with all regions filled that do not reach its border.
    pub(super) fn filled(&self) -> Self {
        let open = Self { set: self.set.iter().map(|set| !set).collect(), ..*self };
        let mut rim = Self { set: vec![false; self.set.len()], ..*self };
        for (at, set) in rim.set.iter_mut().enumerate() {
            let (u, v) = (at % self.width, at / self.width);
            *set = u == 0 || v == 0 || u + 1 == self.width || v + 1 == self.height;
        }
        let outside = open.connected_to(&rim);
        Self { set: outside.set.iter().map(|outside| !outside).collect(), ..*self }
    }

    /// Returns the regions of this map, connected by their sides, that have a pixel in another.
    pub(super) fn connected_to(&self, seeds: &Self) -> Self {
        let (width, count) = (self.width, self.set.len());
        let mut set = vec![false; count];
        let mut next: Vec<usize> = (0..count).filter(|&at| self.set[at] && seeds.set[at]).collect();
        next.iter().for_each(|&at| set[at] = true);
        while let Some(at) = next.pop() {
            let column = at % width;
            let beside = [
                (column > 0).then(|| at - 1),
                (column + 1 < width).then_some(at + 1),
                at.checked_sub(width),
                Some(at + width).filter(|&at| at < count),
            ];
            for at in beside.into_iter().flatten() {
                if self.set[at] && !set[at] {
                    set[at] = true;
                    next.push(at);
                }
            }
        }
        Self { set, ..*self }
    }

    /// Tests, for each pixel, the number of set pixels in its window and the window's size in
    /// the map.
    fn by_window(&self, radius: usize, test: impl Fn(usize, usize) -> bool) -> Self {
        let (width, height) = (self.width, self.height);
        let window = |at: usize, count: usize| (at.saturating_sub(radius), (at + radius + 1).min(count));
        // Sums of the rectangle above and left of each corner.
        let mut sums = vec![0_usize; (width + 1) * (height + 1)];
        for row in 0..height {
            let mut sum = 0;
            for column in 0..width {
                sum += usize::from(self.set[row * width + column]);
                sums[(row + 1) * (width + 1) + column + 1] = sums[row * (width + 1) + column + 1] + sum;
            }
        }
        let mut set = Vec::with_capacity(self.set.len());
        for row in 0..height {
            let (top, bottom) = window(row, height);
            for column in 0..width {
                let (left, right) = window(column, width);
                let corner = |row: usize, column: usize| sums[row * (width + 1) + column];
                let count = corner(bottom, right) + corner(top, left) - corner(top, right) - corner(bottom, left);
                set.push(test(count, (bottom - top) * (right - left)));
            }
        }
        Self { set, ..*self }
    }
}

/// Returns the median; of an even number, the upper one. 0 without numbers.
pub(super) fn median(values: &mut [f32]) -> f32 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f32::total_cmp).1 }
}
