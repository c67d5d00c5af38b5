//! Detects wires in an image: bright spots that stand out from their surroundings.
//!
//! A wire's cross-section is a spot whose size depends on the scanner and on the image scale;
//! both are unknown. So the detector works on several sizes of the image (a binomial pyramid).
//! In each it compares every local maximum with a ring around it. The contrast is the height
//! above the ring's brightest parts. A spot rises above all of its ring. A line (the tank's
//! floor, the transducer's face, a reverberation) does not, because it crosses the ring. The
//! image itself gives the level of speckle, because most maxima are speckle. A spot counts if
//! its contrast is several times the median contrast.

use glam::DVec2;

use sonoweave_core::region::ClipRect;

use crate::picture::GreyView;

/// Number of image sizes; a pixel of the last one covers eight of the image along each axis.
const LEVELS: usize = 4;
/// Radius of the ring, pixels of the level: just outside the largest spot for that level (a
/// half-width of about 2).
const RING: f64 = 4.5;
/// Number of points of the ring.
const POINTS: usize = 16;
/// Number of the ring's brightest points that a spot must exceed on average. Two other spots
/// may lie on the ring; a line covers four and more points.
const BRIGHTEST: usize = 3;
/// Minimum ratio of a spot's contrast to the level's median. With exponentially distributed
/// contrasts, one maximum in 2⁸ reaches it by chance.
const ABOVE_SPECKLE: f32 = 8.0;
/// Minimum number of maxima for a level's median to represent speckle.
const SPECKLED: usize = 48;
/// Minimum contrast, grey levels: several times the rounding to whole levels.
const LEAST_CONTRAST: f32 = 6.0;
/// Maximum number of spots, those with most contrast: several times the number of wires of
/// phantoms.
pub const MOST_DOTS: usize = 40;
/// Share of a spot's height above its ring at which its centre is computed.
const OWN_SHARE: f32 = 0.5;

/// A bright spot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dot {
    /// Its centre, pixels.
    pub at_px: DVec2,
    /// Height above its surroundings, grey levels.
    pub contrast: f32,
    /// Its area, pixels.
    pub area_px: u32,
}

/// Counts of work, for benches and tests.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DotWork {
    /// Smoothed pixels of all sizes.
    pub smoothed: usize,
    /// Maxima compared with their rings.
    pub rings: usize,
    /// Spots with a computed centre.
    pub weighed: usize,
}

/// Finds spots; reuses its memory from image to image.
#[derive(Debug, Default)]
pub struct DotFinder {
    levels: Vec<Level>,
    row: Vec<f32>,
    candidates: Vec<Candidate>,
    contrasts: Vec<f32>,
    region: Vec<(u32, u32)>,
    taken: Vec<bool>,
    dots: Vec<Dot>,
    work: DotWork,
}

/// The image in one size.
#[derive(Debug, Default)]
struct Level {
    width: usize,
    height: usize,
    /// Smoothed grey values.
    grey: Vec<f32>,
}

#[derive(Debug, Clone, Copy)]
struct Candidate {
    level: usize,
    /// Position in pixels of the level.
    at: [usize; 2],
    contrast: f32,
    /// Mean of the ring's brightest parts.
    around: f32,
}

impl DotFinder {
    /// Returns a finder without state.
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the spots of an image within `clip`, those with most contrast first, at most
    /// [`MOST_DOTS`].
    pub fn find(&mut self, picture: &GreyView<'_>, clip: Option<ClipRect>) -> &[Dot] {
        self.work = DotWork::default();
        self.smooth(picture, clip);
        self.candidates.clear();
        for level in 0..self.levels.len() {
            self.maxima(level);
        }
        self.candidates
            .sort_by(|a, b| b.contrast.total_cmp(&a.contrast).then(a.level.cmp(&b.level)).then(a.at.cmp(&b.at)));
        self.weigh();
        &self.dots
    }

    /// Returns the work for the last image.
    pub fn work(&self) -> DotWork {
        self.work
    }

    /// Computes the image in all sizes.
    fn smooth(&mut self, picture: &GreyView<'_>, clip: Option<ClipRect>) {
        let (width, height) = (picture.width(), picture.height());
        self.levels.resize_with(LEVELS, Level::default);
        let clip =
            clip.map(|c| [c.x, c.y, c.x.saturating_add(c.width), c.y.saturating_add(c.height)].map(|n| n as usize));
        let [left, top, right, bottom] = clip.unwrap_or([0, 0, width, height]);
        let (left, right) = (left.min(width), right.min(width));
        let first = &mut self.levels[0];
        (first.width, first.height) = (width, height);
        first.grey.clear();
        first.grey.resize(width * height, 0.0);
        for v in top.min(height)..bottom.min(height) {
            let to = &mut first.grey[v * width..][left..right];
            to.iter_mut().zip(&picture.row(v)[left..right]).for_each(|(to, &grey)| *to = f32::from(grey));
        }
        for level in 0..LEVELS {
            if level > 0 {
                let (finer, coarser) = self.levels.split_at_mut(level);
                halve(&finer[level - 1], &mut coarser[0]);
            }
            let Level { width, height, grey } = &mut self.levels[level];
            binomial(grey, *width, *height, &mut self.row);
            self.work.smoothed += *width * *height;
        }
    }

    /// Finds the maxima of a level that exceed its speckle.
    fn maxima(&mut self, index: usize) {
        let Level { width, height, grey } = &self.levels[index];
        let (width, height) = (*width, *height);
        let ring = ring();
        // The ring must lie in the image. A spot at the very border is cut, and its centre is
        // displaced.
        let border = RING.ceil() as usize + 1;
        let first = self.candidates.len();
        self.contrasts.clear();
        for v in border..height.saturating_sub(border) {
            let rows = [v - 1, v, v + 1].map(|row| &grey[row * width..][..width]);
            for u in border..width.saturating_sub(border) {
                let peak = rows[1][u];
                // The maximum of a plateau is its first pixel.
                let is_peak = peak > LEAST_CONTRAST
                    && peak > rows[1][u - 1]
                    && peak >= rows[1][u + 1]
                    && rows[0][u - 1..=u + 1].iter().all(|other| peak > *other)
                    && rows[2][u - 1..=u + 1].iter().all(|other| peak >= *other);
                if !is_peak {
                    continue;
                }
                self.work.rings += 1;
                let mut brightest = [f32::NEG_INFINITY; BRIGHTEST];
                for offset in &ring {
                    let mut sample = between(grey, width, u, v, *offset);
                    for kept in &mut brightest {
                        if sample > *kept {
                            std::mem::swap(kept, &mut sample);
                        }
                    }
                }
                let around = brightest.iter().sum::<f32>() / BRIGHTEST as f32;
                let contrast = peak - around;
                if contrast > 0.0 {
                    self.contrasts.push(contrast);
                    self.candidates.push(Candidate { level: index, at: [u, v], contrast, around });
                }
            }
        }
        let mut least = LEAST_CONTRAST;
        if self.contrasts.len() >= SPECKLED {
            let middle = self.contrasts.len() / 2;
            let (_, median, _) = self.contrasts.select_nth_unstable_by(middle, f32::total_cmp);
            least = least.max(ABOVE_SPECKLE * *median);
        }
        let mut kept = first;
        for i in first..self.candidates.len() {
            if self.candidates[i].contrast >= least {
                self.candidates.swap(kept, i);
                kept += 1;
            }
        }
        self.candidates.truncate(kept);
    }

    /// Computes the centres of the best candidates. A pixel belongs to one spot only.
    fn weigh(&mut self) {
        let Level { width, height, grey } = &self.levels[0];
        let (width, height) = (*width, *height);
        self.taken.clear();
        self.taken.resize(width * height, false);
        self.dots.clear();
        for candidate in &self.candidates {
            if self.dots.len() == MOST_DOTS {
                break;
            }
            let scale = 1_usize << candidate.level;
            // The brightest pixel of those that made the maximum.
            let reach = 2 * scale;
            let centre = candidate.at.map(|n| n * scale + scale / 2);
            let span = |at: usize, size: usize| at.saturating_sub(reach)..(at + reach + 1).min(size);
            let mut peak = (f32::NEG_INFINITY, 0, 0);
            for v in span(centre[1], height) {
                for u in span(centre[0], width) {
                    if grey[v * width + u] > peak.0 {
                        peak = (grey[v * width + u], u, v);
                    }
                }
            }
            let (top, u, v) = peak;
            if self.taken[v * width + u] {
                continue;
            }
            self.work.weighed += 1;
            let base = candidate.around.min(top);
            let least = base + OWN_SHARE * (top - base);
            // All connected pixels above that height, no farther than the ring.
            let limit = (RING * scale as f64).ceil() as usize;
            self.region.clear();
            self.region.push((u as u32, v as u32));
            self.taken[v * width + u] = true;
            let (mut sum, mut moment, mut next, mut free) = (0.0, DVec2::ZERO, 0, true);
            while let Some(&(x, y)) = self.region.get(next) {
                next += 1;
                let (x, y) = (x as usize, y as usize);
                let weight = f64::from(grey[y * width + x] - least);
                sum += weight;
                moment += weight * DVec2::new(x as f64, y as f64);
                let neighbours = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
                for (x, y) in neighbours {
                    if x >= width || y >= height || x.abs_diff(u) > limit || y.abs_diff(v) > limit {
                        continue;
                    }
                    let at = y * width + x;
                    if grey[at] <= least {
                        continue;
                    }
                    // The region touches an earlier one: both are one spot.
                    if self.taken[at] {
                        free &= self.region.contains(&(x as u32, y as u32));
                        continue;
                    }
                    self.taken[at] = true;
                    self.region.push((x as u32, y as u32));
                }
            }
            if free && sum > 0.0 {
                let area_px = u32::try_from(self.region.len()).unwrap_or(u32::MAX);
                self.dots.push(Dot { at_px: moment / sum, contrast: candidate.contrast, area_px });
            }
        }
    }
}

/// Returns the offsets of the ring's points, pixels of the level.
fn ring() -> [[f64; 2]; POINTS] {
    std::array::from_fn(|i| {
        let angle = i as f64 * std::f64::consts::TAU / POINTS as f64;
        [RING * angle.cos(), RING * angle.sin()]
    })
}

/// Returns the grey value at an offset from a pixel, bilinear. The offset stays in the image.
fn between(grey: &[f32], width: usize, u: usize, v: usize, [du, dv]: [f64; 2]) -> f32 {
    let (x, y) = (u as f64 + du, v as f64 + dv);
    let (left, top) = (x.floor(), y.floor());
    let (a, b) = ((x - left) as f32, (y - top) as f32);
    let at = top as usize * width + left as usize;
    let upper = grey[at] + a * (grey[at + 1] - grey[at]);
    let lower = grey[at + width] + a * (grey[at + width + 1] - grey[at + width]);
    upper + b * (lower - upper)
}

/// Smooths by 1 4 6 4 1 along both axes, in place; the surroundings count as 0.
fn binomial(grey: &mut [f32], width: usize, height: usize, row: &mut Vec<f32>) {
    const OUTER: f32 = 1.0 / 16.0;
    const INNER: f32 = 4.0 / 16.0;
    const CENTRE: f32 = 6.0 / 16.0;
    if width == 0 {
        return;
    }
    // Along u, with two zero pixels at either end.
    row.clear();
    row.resize(width + 4, 0.0);
    for line in grey.chunks_exact_mut(width) {
        row[2..width + 2].copy_from_slice(line);
        for (out, near) in line.iter_mut().zip(row.windows(5)) {
            *out = OUTER * (near[0] + near[4]) + INNER * (near[1] + near[3]) + CENTRE * near[2];
        }
    }
    // Along v; keeps the original two rows above.
    row.clear();
    row.resize(2 * width, 0.0);
    let (before, above) = row.split_at_mut(width);
    for v in 0..height {
        let (done, below) = grey[v * width..].split_at_mut(width);
        let under = |rows: usize| (v + rows < height).then(|| &below[(rows - 1) * width..][..width]);
        let (first, second) = (under(1), under(2));
        for u in 0..width {
            let own = done[u];
            let near = above[u] + first.map_or(0.0, |row| row[u]);
            let far = before[u] + second.map_or(0.0, |row| row[u]);
            done[u] = OUTER * far + INNER * near + CENTRE * own;
            before[u] = above[u];
            above[u] = own;
        }
    }
}

/// Halves the size along both axes; each pixel is the mean of four.
fn halve(from: &Level, to: &mut Level) {
    (to.width, to.height) = (from.width / 2, from.height / 2);
    to.grey.clear();
    to.grey.resize(to.width * to.height, 0.0);
    if to.width == 0 {
        return;
    }
    for (v, line) in to.grey.chunks_exact_mut(to.width).enumerate() {
        let upper = &from.grey[2 * v * from.width..][..2 * to.width];
        let lower = &from.grey[(2 * v + 1) * from.width..][..2 * to.width];
        for ((out, a), b) in line.iter_mut().zip(upper.chunks_exact(2)).zip(lower.chunks_exact(2)) {
            *out = 0.25 * (a[0] + a[1] + b[0] + b[1]);
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
