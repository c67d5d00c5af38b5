//! A plane in a picture: its frame, its title, and arrows along its axes.

use image::{Rgb, RgbImage};

use super::lettering::{self, fill};
use super::style::{BORDER, DOT, INK};

/// Space to the left of a plane for its downward axis, and below it for its rightward axis,
/// pixels.
pub(super) const GUTTER: u32 = 24;
/// Length of an axis arrow, pixels.
const ARROW: u32 = 28;

/// Position of a plane in a picture.
pub(super) struct Frame {
    /// Its first pixel.
    pub(super) corner: [u32; 2],
    /// Its size in pixels.
    pub(super) size: [u32; 2],
}

impl Frame {
    /// Fills its pixels, row by row.
    pub(super) fn fill(&self, picture: &mut RgbImage, colours: impl Iterator<Item = Rgb<u8>>) {
        let ([left, top], [width, _]) = (self.corner, self.size);
        for (pixel, colour) in (0_u32..).zip(colours) {
            picture.put_pixel(left + pixel % width, top + pixel / width, colour);
        }
    }

    /// Draws a line around it; call it before filling the pixels.
    pub(super) fn border(&self, picture: &mut RgbImage) {
        let ([left, top], [width, height]) = (self.corner, self.size);
        fill(picture, [left.saturating_sub(1), top.saturating_sub(1)], [width + 2, height + 2], BORDER);
    }

    /// Writes a title whose top is `above` pixels over the plane.
    pub(super) fn title(&self, picture: &mut RgbImage, above: u32, dot: u32, title: &str) {
        lettering::write(picture, self.corner[0], self.corner[1] - above, dot, INK, title);
    }

    /// Draws arrows along its rightward and downward axis, which start outside the corner of its
    /// first pixel.
    pub(super) fn arrows(&self, picture: &mut RgbImage, [right, down]: [&str; 2]) {
        let ([left, top], [_, height]) = (self.corner, self.size);
        let letter = lettering::height(DOT);
        let below = top + height + 8;
        fill(picture, [left, below], [ARROW, DOT], INK);
        let beside = left - 10;
        fill(picture, [beside, top], [DOT, ARROW], INK);
        for step in 0..4 {
            // Heads: two strokes that open backwards from the tip.
            for (y, x) in [(below - step, beside - step), (below + step, beside + step)] {
                fill(picture, [left + ARROW - 1 - step, y], [DOT, DOT], INK);
                fill(picture, [x, top + ARROW - 1 - step], [DOT, DOT], INK);
            }
        }
        lettering::write(picture, left + ARROW + 6, below + 1 - letter / 2, DOT, INK, right);
        lettering::write(picture, beside - 4, top + ARROW + 4, DOT, INK, down);
    }
}

/// Returns the grey of a value where `low` is black and `high` white.
pub fn grey(value: f32, [low, high]: [f32; 2]) -> u8 {
    // The clamp keeps it from 0 to 255; the cast cannot wrap.
    ((value - low) / (high - low) * 255.0).round().clamp(0.0, 255.0) as u8
}
