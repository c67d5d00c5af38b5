//! Slices of a scan in memory, with the probe's poses, and the lines in which they cross.
//!
//! Images are reduced and smoothed. Interpolation averages noise between pixels but not at pixels:
//! without smoothing, slices would agree best when most lines fall between pixels.

#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "a comparison with NaN must refuse, not pass")]

use glam::{DAffine3, DVec2, DVec3};

use crate::trajectory::pose_spline::PoseSpline;

/// Images of a scan, of one size, u fastest. They are reduced and smoothed, so that all fit in
/// memory.
#[derive(Debug, Clone)]
pub struct Slices {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) is_data: Vec<bool>,
    /// First and last column and row with data.
    pub(crate) bounds: [[f64; 2]; 2],
    /// The first row with data before reduction, which smoothing leaves out, in reduced rows.
    pub(crate) top: f64,
    /// Times, and grey values in units of 1/256.
    pub(crate) pixels: Vec<(f64, Vec<u16>)>,
    /// Maps pixels of the reduced images to mm at the probe.
    pub(crate) probe_from_pixel: DAffine3,
    /// Maps pixels of the reduced images to those of the full ones.
    pub(crate) image_from_pixel: DAffine3,
    pub(crate) poses: PoseSpline,
}

/// Sine of the smallest angle between planes; nearly parallel planes have no stable
/// intersection.
const LEAST_SINE: f64 = 0.17;

/// The smoothing filter in both directions; its sum is 16.
const BINOMIAL: [u32; 5] = [1, 4, 6, 4, 1];
const REACH: usize = 2;

/// Largest side of a reduced image, pixels.
const WIDE: u32 = 192;

/// Returns the factor by which images of this size are reduced.
pub fn reduction(width: u32, height: u32) -> u32 {
    width.max(height).div_ceil(WIDE).max(1)
}

impl Slices {
    /// Prepares for images of `width`×`height` before reduction; `is_data` marks the pixels
    /// that hold data.
    ///
    /// # Panics
    /// Panics if `is_data` does not have one flag per pixel.
    pub fn new(width: u32, height: u32, is_data: &[bool], probe_from_image: DAffine3, poses: PoseSpline) -> Self {
        let (full, by) = (width as usize, reduction(width, height) as usize);
        assert_eq!(is_data.len(), full * height as usize, "a flag for each pixel");
        let (width, height) = (full / by, height as usize / by);
        let given = is_data;
        let whole = |u: usize, v: usize| (0..by * by).all(|k| given[(v * by + k / by) * full + u * by + k % by]);
        let is_whole: Vec<bool> = (0..width * height).map(|at| whole(at % width, at / width)).collect();
        // Pixels whose smoothing reaches across the border of the data are no data.
        let is_inner = |u: usize, v: usize| {
            let within = |at: usize, end: usize| at >= REACH && at + REACH < end;
            within(u, width)
                && within(v, height)
                && (v - REACH..=v + REACH)
                    .all(|v| is_whole[v * width + u - REACH..=v * width + u + REACH].iter().all(|is| *is))
        };
        let is_data: Vec<bool> = (0..width * height).map(|at| is_inner(at % width, at / width)).collect();
        let within = || (0..width * height).filter(|at| is_data[*at]).map(|at| [at % width, at / width]);
        let bounds = [0, 1].map(|axis| {
            let ends = within().map(|place| place[axis]);
            [ends.clone().min().unwrap_or(0) as f64, ends.max().unwrap_or(0) as f64]
        });
        let scale = by as f64;
        let first = given.iter().position(|is| *is).map_or(0, |at| at / full);
        let top = (first as f64 - 0.5 * (scale - 1.0)) / scale;
        // The centre of a reduced pixel is the mean of its pixels' centres.
        let image_from_pixel = DAffine3::from_scale_rotation_translation(
            DVec3::new(scale, scale, 1.0),
            glam::DQuat::IDENTITY,
            DVec3::new(0.5 * (scale - 1.0), 0.5 * (scale - 1.0), 0.0),
        );
        let probe_from_pixel = probe_from_image * image_from_pixel;
        Self { width, height, is_data, bounds, top, pixels: Vec::new(), probe_from_pixel, image_from_pixel, poses }
    }

    /// Adds an image, reduced by the mean of its pixels and smoothed.
    ///
    /// # Panics
    /// Panics if its size differs from that given to [`Slices::new`].
    pub fn push(&mut self, time_s: f64, pixels: &[u8], width: u32, height: u32) {
        let by = reduction(width, height) as usize;
        let full = width as usize;
        assert_eq!((full / by, height as usize / by), (self.width, self.height), "a picture of another size");
        let mut sums = vec![0_u32; self.width * self.height];
        for (v, row) in pixels.chunks_exact(full).take(self.height * by).enumerate() {
            for (u, cells) in row.chunks_exact(by).enumerate() {
                sums[v / by * self.width + u] += cells.iter().map(|x| u32::from(*x)).sum::<u32>();
            }
        }
        // Smooths along rows, then along columns; beyond the border the nearest pixel counts.
        let smooth = |values: &[u32], size: usize, step: usize, at: usize, along: usize| -> u32 {
            let value =
                |off: usize| values[at - along * step + (along + off).saturating_sub(REACH).min(size - 1) * step];
            BINOMIAL.iter().enumerate().map(|(off, weight)| weight * value(off)).sum()
        };
        let cells = self.width * self.height;
        let rows: Vec<u32> = (0..cells).map(|at| smooth(&sums, self.width, 1, at, at % self.width)).collect();
        let area = (by * by) as u32;
        let both = |at: usize| {
            let sum = smooth(&rows, self.height, self.width, at, at / self.width);
            // The weights scale 255 to 255 · 256 per pixel.
            u16::try_from((sum + area / 2) / area).unwrap_or(u16::MAX)
        };
        self.pixels.push((time_s, (0..cells).map(both).collect()));
    }

    /// Returns the interpolated grey value; `None` outside of the data.
    pub(crate) fn grey(&self, pixels: &[u16], at: DVec2) -> Option<f64> {
        self.grey_and_slope(pixels, at).map(|(grey, _)| grey)
    }

    /// Returns the interpolated grey value, and its slope along u and v; `None` outside of the
    /// data.
    pub(crate) fn grey_and_slope(&self, pixels: &[u16], at: DVec2) -> Option<(f64, DVec2)> {
        if !(at.x >= 0.0 && at.y >= 0.0) {
            return None;
        }
        let (u, v) = (at.x as usize, at.y as usize);
        if u >= self.width.saturating_sub(1) || v >= self.height.saturating_sub(1) {
            return None;
        }
        let (a, b, first) = (at.x - u as f64, at.y - v as f64, v * self.width + u);
        let places = [first, first + 1, first + self.width, first + self.width + 1];
        if !places.iter().all(|place| self.is_data[*place]) {
            return None;
        }
        let [p, q, r, s] = places.map(|place| f64::from(pixels[place]) / 256.0);
        let grey = (1.0 - b) * ((1.0 - a) * p + a * q) + b * ((1.0 - a) * r + a * s);
        let slope = DVec2::new((1.0 - b) * (q - p) + b * (s - r), (1.0 - a) * (r - p) + a * (s - q));
        Some((grey, slope))
    }

    /// Returns the pose of a slice's pixels at a lag.
    pub(crate) fn placed(&self, slice: usize, lag_s: f64) -> Option<DAffine3> {
        Some(self.poses.at(self.pixels[slice].0 + lag_s)? * self.probe_from_pixel)
    }

    /// Returns the ends of two planes' intersection within the bounds of both.
    pub(crate) fn line(&self, of: [&DAffine3; 2]) -> Option<[DVec3; 2]> {
        let [n, m] = of.map(|pose| pose.matrix3.x_axis.cross(pose.matrix3.y_axis).normalize());
        let across = n.cross(m);
        let sine = across.length();
        if !(sine > LEAST_SINE) {
            return None;
        }
        let direction = across / sine;
        let [a, b] = [n.dot(of[0].translation), m.dot(of[1].translation)];
        let point = (a * m.cross(across) + b * across.cross(n)) / (sine * sine);
        let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
        for pose in of {
            let back = pose.inverse();
            let (place, step) = (back.transform_point3(point), back.transform_vector3(direction));
            for (axis, [low, high]) in self.bounds.into_iter().enumerate() {
                if step[axis].abs() < 1e-12 {
                    if !(low..=high).contains(&place[axis]) {
                        return None;
                    }
                    continue;
                }
                let ends = [(low - place[axis]) / step[axis], (high - place[axis]) / step[axis]];
                from = from.max(ends[0].min(ends[1]));
                to = to.min(ends[0].max(ends[1]));
            }
        }
        (from < to).then(|| [point + from * direction, point + to * direction])
    }

    /// Returns the distance from row to row, mm.
    pub(crate) fn row_mm(&self) -> f64 {
        self.probe_from_pixel.matrix3.y_axis.length()
    }

    /// Returns the larger side of a pixel, mm.
    pub(crate) fn pixel_mm(&self) -> f64 {
        self.probe_from_pixel.matrix3.x_axis.length().max(self.row_mm())
    }
}

#[cfg(test)]
mod tests;
