//! Detects the floor of a water tank in a frame, as a straight line.
//!
//! Everything else in the frame (names, rulers, the transducer's own echo) is static while the
//! probe moves up and down. So the darkest value of each pixel is subtracted first ([`Still`]).
//! The rest is reduced and filtered for rows brighter than those above and below. It is then
//! summed along every line of up to 50° across the frame (a Radon transform by shears). The
//! best line is refined in the full frame by the echo's centre in every column, with Tukey's
//! weights.
//!
//! The columns decide whether there is a floor: in how many of them the most prominent pixel
//! lies on the line. Without a floor this happens by chance only, and Chernoff's inequality
//! bounds the chance.

use glam::DVec2;

use super::robust::Biweight;
use crate::picture::GreyView;
use crate::statistics::{deviation_about_zero, median};

/// The static part of the frames: the darkest value of each pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Still {
    size: [usize; 2],
    least: Vec<u8>,
}

impl Still {
    /// Starts with a first frame.
    pub fn new(view: &GreyView<'_>) -> Self {
        Self { size: view.size(), least: view.rows().flatten().copied().collect() }
    }

    /// Adds another frame. Returns false, and changes nothing, if its size differs.
    pub fn add(&mut self, view: &GreyView<'_>) -> bool {
        if self.size != view.size() {
            return false;
        }
        self.least.iter_mut().zip(view.rows().flatten()).for_each(|(least, x)| *least = (*least).min(*x));
        true
    }
}

/// A straight line in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Its point in the middle of its visible part, px.
    pub point_px: DVec2,
    /// Its direction, of length 1, to the right.
    pub direction: DVec2,
    /// First and last column of its visible part.
    pub columns: [f64; 2],
    /// Standard deviation of the echo's centres in single columns from it, px.
    pub scatter_px: f64,
}

impl Line {
    /// Returns its perpendicular distance below a point, px; negative if it passes above.
    pub fn below(&self, point_px: DVec2) -> f64 {
        let normal = DVec2::new(-self.direction.y, self.direction.x);
        normal.dot(self.point_px - point_px)
    }

    /// Returns its angle against the frame's rows, degrees; positive downwards to the right.
    pub fn angle_deg(&self) -> f64 {
        self.direction.y.atan2(self.direction.x).to_degrees()
    }
}

/// Reasons why a frame has no line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoLine {
    /// Nothing in it moves.
    #[error("nothing moves; move the probe")]
    Nothing,
    /// The moving pixels form no line.
    #[error("what moves lies on no line; show the floor alone")]
    Scattered,
}

/// Largest width and height of the reduced frame.
const REDUCED: usize = 208;
/// Tangent of the steepest line.
const STEEPEST: f64 = 1.2;
/// Half heights of an echo and of the rows it is compared with, in rows of the reduced frame.
const INNER: usize = 1;
const OUTER: usize = 6;
/// Largest distance from the line of a column's most prominent pixel, in rows of the reduced
/// frame.
const ON_LINE: f64 = 2.0;
/// Number of columns of the reduced frame that speckle correlates.
const ALIKE: f64 = 4.0;
/// Largest probability of finding a floor in a frame without one.
const MISTAKEN: f64 = 1e-6;
/// Share of the frame's columns that must show the line.
const LEAST_COLUMNS: f64 = 0.1;
const ROUNDS: usize = 8;

/// Finds lines in frames of one size; reuses its memory from frame to frame.
#[derive(Debug, Clone)]
pub struct Finder {
    still: Still,
    /// Number of pixels, along u and along v, per reduced pixel.
    by: usize,
    size: [usize; 2],
    moving: Vec<f32>,
    reduced: Vec<f32>,
    /// Column by column: lines are summed along columns.
    outstanding: Vec<f32>,
    sums: Vec<f32>,
}

impl Finder {
    /// Returns a finder for frames with a known static part.
    pub fn new(still: Still) -> Self {
        let [width, height] = still.size;
        let by = width.max(height).div_ceil(REDUCED);
        let size = [width / by, height / by];
        let cells = size[0] * size[1];
        Self {
            by,
            size,
            moving: vec![0.0; width * height],
            reduced: vec![0.0; cells],
            outstanding: vec![0.0; cells],
            sums: vec![0.0; size[1]],
            still,
        }
    }

    /// Finds the line in a frame.
    ///
    /// # Errors
    /// [`NoLine`] if there is none.
    ///
    /// # Panics
    /// Panics if the frame's size differs from that of the static part.
    pub fn find(&mut self, view: &GreyView<'_>) -> Result<Line, NoLine> {
        assert_eq!(view.size(), self.still.size, "the pictures' size");
        for ((moving, x), least) in self.moving.iter_mut().zip(view.rows().flatten()).zip(&self.still.least) {
            *moving = f32::from(x.saturating_sub(*least));
        }
        self.reduce();
        self.stand_out();
        let (middle, slope) = self.best_shear().ok_or(NoLine::Nothing)?;
        self.check(middle, slope)?;
        // The centre of a reduced pixel is the mean of its pixels' centres.
        let off = 0.5 * (self.by as f64 - 1.0);
        let centre = 0.5 * (self.size[0] as f64 - 1.0);
        let to_full = |reduced: f64| reduced * self.by as f64 + off;
        self.refine(Straight { at: to_full(centre), row: to_full(middle), slope })
    }

    fn reduce(&mut self) {
        let [width, height] = self.size;
        self.reduced.fill(0.0);
        let full = self.still.size[0];
        for (v, row) in self.moving.chunks_exact(full).take(height * self.by).enumerate() {
            let sums = &mut self.reduced[v / self.by * width..][..width];
            for (sum, cells) in sums.iter_mut().zip(row.chunks_exact(self.by)) {
                *sum += cells.iter().sum::<f32>();
            }
        }
        let area = (self.by * self.by) as f32;
        self.reduced.iter_mut().for_each(|x| *x /= area);
    }

    /// Computes how much brighter the rows about each pixel are than those farther above and
    /// below. The square root keeps a single bright echo from outweighing a line.
    fn stand_out(&mut self) {
        let [width, height] = self.size;
        let mut sums = vec![0.0_f32; height + 1];
        for u in 0..width {
            for v in 0..height {
                sums[v + 1] = sums[v] + self.reduced[v * width + u];
            }
            for v in 0..height {
                let mean = |reach: usize| {
                    let (from, to) = (v.saturating_sub(reach), (v + reach + 1).min(height));
                    (sums[to] - sums[from], (to - from) as f32)
                };
                let ((near, n), (all, m)) = (mean(INNER), mean(OUTER));
                let beside = (all - near) / (m - n).max(1.0);
                self.outstanding[u * height + v] = (near / n - beside).max(0.0).sqrt();
            }
        }
    }

    /// Returns the line of the greatest sum: its row in the middle column, and its slope.
    fn best_shear(&mut self) -> Option<(f64, f64)> {
        let [width, height] = self.size.map(|side| side as i64);
        let centre = 0.5 * (width as f64 - 1.0);
        // Neighbouring slopes differ by a row at the frame's sides.
        let steps = (STEEPEST * centre).ceil() as i32;
        let mut best = (0.0_f32, None);
        for step in -steps..=steps {
            let slope = f64::from(step) / centre.max(1.0);
            self.sums.fill(0.0);
            for (u, column) in self.outstanding.chunks_exact(self.size[1].max(1)).enumerate() {
                let shift = (slope * (u as f64 - centre)).round() as i64;
                let (from, to) = ((-shift).max(0), (height - shift).min(height));
                if from < to {
                    let [sums, values] = [0, shift].map(|by| (from + by) as usize..(to + by) as usize);
                    self.sums[sums].iter_mut().zip(&column[values]).for_each(|(sum, value)| *sum += value);
                }
            }
            for (middle, sum) in self.sums.iter().enumerate() {
                if *sum > best.0 {
                    best = (*sum, Some((middle as f64, slope)));
                }
            }
        }
        best.1
    }

    /// Checks that the line is not the best by chance.
    fn check(&self, middle: f64, slope: f64) -> Result<(), NoLine> {
        let [width, height] = self.size;
        let centre = 0.5 * (width as f64 - 1.0);
        let (mut lit, mut on) = (0.0, 0.0);
        for (u, column) in self.outstanding.chunks_exact(height).enumerate() {
            let (mut brightest, mut at) = (0.0_f32, None);
            for (v, value) in column.iter().enumerate() {
                if *value > brightest {
                    (brightest, at) = (*value, Some(v));
                }
            }
            let Some(at) = at else { continue };
            lit += 1.0;
            let row = middle + slope * (u as f64 - centre);
            on += f64::from((at as f64 - row).abs() <= ON_LINE);
        }
        if lit < LEAST_COLUMNS * width as f64 {
            return Err(NoLine::Nothing);
        }
        let chance = ((2.0 * ON_LINE + 1.0) / height as f64).min(0.9);
        let share: f64 = (on / lit).clamp(0.0, 1.0);
        let part = |own: f64, by: f64| if own > 0.0 { own * (own / by).ln() } else { 0.0 };
        let divergence = part(share, chance) + part(1.0 - share, 1.0 - chance);
        // Accounts for the number of lines that were tried.
        let tried = height as f64 * 2.0 * STEEPEST * centre;
        if share > chance && lit / ALIKE * divergence > (tried / MISTAKEN).ln() {
            return Ok(());
        }
        Err(NoLine::Scattered)
    }

    /// Finds the echo's centre in every column about the line and fits a line to the centres,
    /// repeatedly.
    fn refine(&self, mut line: Straight) -> Result<Line, NoLine> {
        let full = self.still.size[0];
        let mut reach = self.reach(&line);
        let mut centres = Vec::with_capacity(full);
        let mut fitted = None;
        for round in 0..ROUNDS {
            centres.clear();
            centres.extend((0..full).filter_map(|u| Some((u as f64, self.centre(u, line.row_at(u as f64), reach)?))));
            let through = line.through(&centres).ok_or(NoLine::Scattered)?;
            line = through.line;
            fitted = Some(through);
            if round == 1 {
                reach = self.reach(&line);
            }
        }
        let Some(Through { first, last, scatter, count, .. }) = fitted else { return Err(NoLine::Scattered) };
        if (count as f64) < LEAST_COLUMNS * full as f64 {
            return Err(NoLine::Scattered);
        }
        let middle = 0.5 * (first + last);
        Ok(Line {
            point_px: DVec2::new(middle, line.row_at(middle)),
            direction: DVec2::new(1.0, line.slope).normalize(),
            columns: [first, last],
            scatter_px: scatter,
        })
    }

    fn moving_at(&self, u: usize, v: i64) -> Option<f32> {
        let v = usize::try_from(v).ok()?;
        self.moving.get(v * self.still.size[0] + u).copied()
    }

    /// Returns the rows on either side of the line that its echo takes: twice the width at half
    /// maximum of the mean profile.
    fn reach(&self, line: &Straight) -> i64 {
        let most = (OUTER * self.by) as i64;
        let mean = |off: i64| {
            let values =
                (0..self.still.size[0]).filter_map(|u| self.moving_at(u, line.row_at(u as f64).round() as i64 + off));
            values.map(f64::from).sum::<f64>() / self.still.size[0] as f64
        };
        let profile: Vec<f64> = (-most..=most).map(mean).collect();
        let base = median(&mut profile.clone());
        let top = profile.iter().copied().fold(0.0, f64::max);
        let is_half = |x: &f64| *x - base > 0.5 * (top - base);
        let (first, last) = (profile.iter().position(is_half), profile.iter().rposition(is_half));
        let width = first.zip(last).map_or(1, |(first, last)| last - first + 1);
        ((2 * width) as i64).clamp(self.by as i64 + 1, most)
    }

    /// Returns the centre of a column's echo within `reach` rows of `row`; `None` if there is
    /// none.
    fn centre(&self, u: usize, row: f64, reach: i64) -> Option<f64> {
        let middle = row.round() as i64;
        let rows =
            || (middle - reach..=middle + reach).filter_map(|v| Some((v as f64, f64::from(self.moving_at(u, v)?))));
        // A window cut by the frame's border would bias the centre inwards.
        if rows().count() as i64 != 2 * reach + 1 {
            return None;
        }
        let least = rows().map(|(_, x)| x).fold(f64::INFINITY, f64::min);
        let (mut sum, mut moment) = (0.0, 0.0);
        for (v, x) in rows() {
            // The weights vanish at the window's ends, so that shifting the window causes no
            // jumps.
            let off = (v - row) / (reach as f64 + 1.0);
            let weight = (x - least) * (1.0 - off * off).max(0.0);
            sum += weight;
            moment += weight * v;
        }
        (sum > 0.0).then(|| moment / sum)
    }
}

/// A line given by its row in a column, and its slope.
#[derive(Debug, Clone, Copy)]
struct Straight {
    at: f64,
    row: f64,
    slope: f64,
}

/// A line fitted to centres.
struct Through {
    line: Straight,
    first: f64,
    last: f64,
    scatter: f64,
    count: usize,
}

impl Straight {
    fn row_at(&self, u: f64) -> f64 {
        self.row + self.slope * (u - self.at)
    }

    /// Fits a line to the columns' centres with Tukey's weights about this one; `None` if there
    /// are too few.
    fn through(&self, centres: &[(f64, f64)]) -> Option<Through> {
        let mut line = *self;
        let mut through = None;
        for _ in 0..5 {
            let mut left: Vec<f64> = centres.iter().map(|(u, v)| v - line.row_at(*u)).collect();
            let weights: Vec<f64> = {
                // The scale is at least a hundredth of a pixel, the resolution of the echoes'
                // centres.
                let scale = deviation_about_zero(&mut left.clone()).max(0.01);
                left.iter_mut().map(|r| Biweight::of(*r, scale).weight).collect()
            };
            let total: f64 = weights.iter().sum();
            let mean = |of: &dyn Fn(f64, f64) -> f64| {
                centres.iter().zip(&weights).map(|((u, v), w)| w * of(*u, *v)).sum::<f64>() / total
            };
            let (u, v) = (mean(&|u, _| u), mean(&|_, v| v));
            let (uu, uv) = (mean(&|x, _| (x - u) * (x - u)), mean(&|x, y| (x - u) * (y - v)));
            if !(uu > 0.0) {
                return None;
            }
            line = Self { at: u, row: v, slope: uv / uu };
            let counts = || centres.iter().zip(&weights).filter(|(_, w)| **w > 0.0).map(|((u, _), _)| *u);
            let scatter = mean(&|x, y| (y - line.row_at(x)).powi(2)).sqrt();
            through = Some(Through {
                line,
                first: counts().next()?,
                last: counts().next_back()?,
                scatter,
                count: counts().count(),
            });
        }
        through
    }
}

#[cfg(test)]
mod tests;
