//! Antialiased lines and areas.
//!
//! All shapes of one colour are collected as the covered share of each pixel, and then drawn at
//! once. Shapes that meet or overlap are not drawn twice, and leave no seam.

use image::{Rgb, RgbImage};

/// Samples across and down a pixel, to test the coverage of an area.
const TRIES: u32 = 4;

/// Covered shares of pixels, 0 to 1. Pixel (i, j) is the square about (i, j).
#[derive(Debug, Clone)]
pub struct Ink {
    size: [u32; 2],
    shares: Vec<f32>,
    /// Range of columns and rows that hold anything: the first, and the one after the last.
    used: [[u32; 2]; 2],
}

impl Ink {
    /// Creates an empty set, for pictures of a size.
    pub fn new(size: [u32; 2]) -> Self {
        Self { size, shares: vec![0.0; size[0] as usize * size[1] as usize], used: [[u32::MAX, 0]; 2] }
    }

    /// Adds a line with round ends. `strong` is its opacity at both ends, 0 to 1; where lines
    /// meet, the largest counts.
    pub fn line(&mut self, [a, b]: [[f64; 2]; 2], width: f64, strong: [f32; 2]) {
        let reach = 0.5 * width + 1.0;
        let along = [b[0] - a[0], b[1] - a[1]];
        let squared = along[0] * along[0] + along[1] * along[1];
        let Some(pixels) = self.pixels([a[0].min(b[0]), a[1].min(b[1])], [a[0].max(b[0]), a[1].max(b[1])], reach)
        else {
            return;
        };
        for j in pixels[1][0]..pixels[1][1] {
            for i in pixels[0][0]..pixels[0][1] {
                let off = [f64::from(i) - a[0], f64::from(j) - a[1]];
                let t = ((off[0] * along[0] + off[1] * along[1]) / squared.max(1e-12)).clamp(0.0, 1.0);
                let distance = (off[0] - t * along[0]).hypot(off[1] - t * along[1]);
                let share = (0.5 * width + 0.5 - distance).clamp(0.0, 1.0) as f32;
                let share = share * (strong[0] + (strong[1] - strong[0]) * t as f32);
                let held = &mut self.shares[j as usize * self.size[0] as usize + i as usize];
                *held = held.max(share);
            }
        }
    }

    /// Adds an area whose edges do not cross, its corners in either order. Areas that touch
    /// leave no seam.
    pub fn area(&mut self, corners: &[[f64; 2]]) {
        let bound = |axis: usize, larger: fn(f64, f64) -> f64| corners.iter().map(|c| c[axis]).reduce(larger);
        let (Some(x0), Some(x1), Some(y0), Some(y1)) =
            (bound(0, f64::min), bound(0, f64::max), bound(1, f64::min), bound(1, f64::max))
        else {
            return;
        };
        let Some(pixels) = self.pixels([x0, y0], [x1, y1], 1.0) else { return };
        for j in pixels[1][0]..pixels[1][1] {
            for i in pixels[0][0]..pixels[0][1] {
                let mut within = 0_u16;
                for n in 0..TRIES * TRIES {
                    let place = |n: u32| (f64::from(n) + 0.5) / f64::from(TRIES) - 0.5;
                    within +=
                        u16::from(holds(corners, [f64::from(i) + place(n % TRIES), f64::from(j) + place(n / TRIES)]));
                }
                let held = &mut self.shares[j as usize * self.size[0] as usize + i as usize];
                *held = (*held + f32::from(within) / (TRIES * TRIES) as f32).min(1.0);
            }
        }
    }

    /// Draws the collected shapes on a picture in a colour, with opacity `dense` (0 to 1).
    /// Uncovered pixels do not change.
    pub fn lay(&self, picture: &mut RgbImage, colour: Rgb<u8>, dense: f32) {
        let [columns, rows] = self.used;
        for j in rows[0]..rows[1] {
            for i in columns[0]..columns[1] {
                let share = dense * self.shares[j as usize * self.size[0] as usize + i as usize];
                if share > 0.0
                    && let Some(pixel) = picture.get_pixel_mut_checked(i, j)
                {
                    for (below, above) in pixel.0.iter_mut().zip(colour.0) {
                        let mixed = f32::from(*below) + share * (f32::from(above) - f32::from(*below));
                        *below = mixed.round().clamp(0.0, 255.0) as u8;
                    }
                }
            }
        }
    }

    /// Returns the number of covered pixels.
    pub fn covered(&self) -> u64 {
        self.shares.iter().filter(|share| **share > 0.0).count() as u64
    }

    /// Returns the columns and rows of a box widened by `reach` that lie in the picture, and
    /// marks them as used; `None` if there are none, or the box is invalid.
    fn pixels(&mut self, low: [f64; 2], high: [f64; 2], reach: f64) -> Option<[[u32; 2]; 2]> {
        let mut pixels = [[0; 2]; 2];
        for k in 0..2 {
            let (from, to) = ((low[k] - reach).ceil().max(0.0), (high[k] + reach).floor() + 1.0);
            // Both comparisons are false for NaN.
            if !(to > 0.0 && from < f64::from(self.size[k])) {
                return None;
            }
            pixels[k] = [from as u32, (to.min(f64::from(self.size[k]))) as u32];
            if pixels[k][0] >= pixels[k][1] {
                return None;
            }
        }
        for (used, pixels) in self.used.iter_mut().zip(pixels) {
            *used = [used[0].min(pixels[0]), used[1].max(pixels[1])];
        }
        Some(pixels)
    }
}

/// Returns whether an area holds a place; on an edge, only one side counts.
fn holds(corners: &[[f64; 2]], at: [f64; 2]) -> bool {
    let mut crossings = false;
    for (n, a) in corners.iter().enumerate() {
        let b = corners[(n + 1) % corners.len()];
        if (a[1] > at[1]) != (b[1] > at[1]) && at[0] < a[0] + (at[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) {
            crossings = !crossings;
        }
    }
    crossings
}
