//! From echoes to an image: depth gain, noise, decibels, pixels.

use glam::DVec2;

use mask::Mask;
use simd::Fused;

use super::raster::Raster;
use super::real::log2;
use super::scatter::amplitude;
use super::spread::{Spread, across, along};
use super::{Layout, Scanner, hash};
use crate::random::{Draws, Purpose};

/// Length of the receiver's noise table; a row of a frame begins at one of its entries.
const NOISES: usize = 1 << 16;

/// A scanner's parameters for displaying a raster.
#[derive(Debug, Clone)]
pub(super) struct Display {
    /// Grey levels per power of two of the squared amplitude, and for amplitude 1 in each row.
    per_octave: f32,
    at_one: Vec<f32>,
    /// Complex noise, real and imaginary parts separate, extended by the length of a row.
    noise: [Vec<f32>; 2],
    key: u32,
    /// Runs of data pixels: start in the image, and length.
    runs: Vec<(u32, u32)>,
    /// Position of each data pixel: the raster node above and left of it, and the offset from
    /// there.
    nodes: Vec<Node>,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    index: u32,
    column: f32,
    row: f32,
}

impl Display {
    /// Returns the memory of the tables, bytes.
    pub(super) fn bytes(&self) -> usize {
        let noise: usize = self.noise.iter().map(|part| size_of_val(&**part)).sum();
        noise + size_of_val(&*self.at_one) + size_of_val(&*self.runs) + size_of_val(&*self.nodes)
    }

    pub(super) fn new(scanner: &Scanner, layout: &Layout, mask: &Mask) -> Self {
        let per_db = 255.0 / scanner.dynamic_range_db;
        // A decibel is a tenth of a power of ten.
        let per_octave = per_db * 10.0 * std::f64::consts::LOG10_2;
        let at_one = (0..layout.rows).map(|row| {
            let db = scanner.tgc_db(layout.range(row).max(0.0));
            (255.0 + per_db * (db - scanner.white_db)) as f32
        });
        let level = if scanner.effects.noise { amplitude(scanner.noise_db) } else { 0.0 };
        let noise = [0, 1].map(|part| {
            let mut draws = Draws::new(scanner.seed, Purpose::Noise, u64::MAX - part);
            let mut values: Vec<f32> =
                (0..NOISES).map(|_| (level * draws.normal() * std::f64::consts::FRAC_1_SQRT_2) as f32).collect();
            values.extend_from_within(..layout.columns);
            values
        });
        let (mut runs, mut nodes) = (Vec::new(), Vec::new());
        let [width, height] = layout.image_size;
        for v in 0..height {
            for span in mask.row(v) {
                runs.push((v * width + span.start, span.end - span.start));
                nodes.extend((span.start..span.end).map(|u| Node::at(layout, DVec2::new(f64::from(u), f64::from(v)))));
            }
        }
        Self {
            per_octave: per_octave as f32,
            at_one: at_one.collect(),
            noise,
            key: hash::key(scanner.seed, 4),
            runs,
            nodes,
        }
    }

    /// Returns the start of a row of a frame in the noise.
    #[inline(always)]
    fn noise_at(&self, frame: u32, row: usize) -> usize {
        hash::mix(self.key ^ hash::mix(frame).wrapping_add((row as u32).wrapping_mul(0x9e37_79b9))) as usize % NOISES
    }
}

impl Node {
    fn at(layout: &Layout, pixel: DVec2) -> Self {
        let [column, row] = layout.raster(pixel);
        // A pixel on the border may lie a rounding error beyond it.
        let whole = [column, row].map(|x| x.max(0.0).floor());
        let last = [layout.columns - 2, layout.rows - 2];
        let whole = [0, 1].map(|i| (whole[i] as usize).min(last[i]));
        Self {
            index: (whole[1] * layout.columns + whole[0]) as u32,
            column: (column - whole[0] as f64) as f32,
            row: (row - whole[1] as f64) as f32,
        }
    }
}

/// Blurs a raster and computes the squared amplitude of each displayed row, with noise.
pub(super) struct Detect<'a> {
    pub(super) display: &'a Display,
    pub(super) spread: &'a Spread,
    pub(super) layout: &'a Layout,
    pub(super) frame: u32,
    pub(super) raster: &'a mut Raster,
    /// Buffer for a row.
    pub(super) row: &'a mut [Vec<f32>; 2],
    /// Squared amplitudes of all rows; those above the face and below the depth are left
    /// unchanged.
    pub(super) power: &'a mut [f32],
}

impl Fused for Detect<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let columns = self.layout.columns;
        let [re, im] = self.raster.both();
        let [row_re, row_im] = self.row;
        for (r, kernel) in self.spread.lateral.iter().enumerate() {
            for (values, blurred) in [(&mut *re, &mut *row_re), (&mut *im, &mut *row_im)] {
                let values = &mut values[r * columns..][..columns];
                across(kernel, values, blurred);
                values.copy_from_slice(blurred);
            }
        }
        for r in self.layout.detected() {
            along(&self.spread.axial, re, columns, r, row_re);
            along(&self.spread.axial, im, columns, r, row_im);
            let at = self.display.noise_at(self.frame, r);
            let [noise_re, noise_im] = [0, 1].map(|part: usize| &self.display.noise[part][at..][..columns]);
            let power = &mut self.power[r * columns..][..columns];
            for (c, power) in power.iter_mut().enumerate() {
                let (a, b) = (row_re[c] + noise_re[c], row_im[c] + noise_im[c]);
                *power = a * a + b * b;
            }
        }
    }
}

/// Compresses squared amplitudes, in place, and converts them to an image.
pub(super) struct Show<'a> {
    pub(super) display: &'a Display,
    pub(super) layout: &'a Layout,
    pub(super) power: &'a mut [f32],
    /// The image; pixels without data are left unchanged.
    pub(super) picture: &'a mut [u8],
}

impl Fused for Show<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let columns = self.layout.columns;
        for r in self.layout.detected() {
            let at_one = self.display.at_one[r];
            for value in &mut self.power[r * columns..][..columns] {
                // Avoids subnormal numbers; 300 dB below the reference nothing is visible.
                let grey = at_one + self.display.per_octave * log2(value.max(1e-30));
                *value = grey.clamp(0.0, 255.0);
            }
        }
        let grey = &self.power;
        let mut nodes = self.display.nodes.as_slice();
        for (first, count) in &self.display.runs {
            let (these, rest) = nodes.split_at(*count as usize);
            nodes = rest;
            let picture = &mut self.picture[*first as usize..][..*count as usize];
            for (pixel, node) in picture.iter_mut().zip(these) {
                let i = node.index as usize;
                let upper = grey[i] + (grey[i + 1] - grey[i]) * node.column;
                let j = i + columns;
                let lower = grey[j] + (grey[j + 1] - grey[j]) * node.column;
                *pixel = (upper + (lower - upper) * node.row + 0.5) as u8;
            }
        }
    }
}
