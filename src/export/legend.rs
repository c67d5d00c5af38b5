//! What a picture's colours and lengths mean: a scale bar, the range of grey levels, the colour of the unseen.

use image::{Rgb, RgbImage};

use super::lettering::{self, fill};
use super::planes::{BORDER, DOT, GAP, INK, UNSEEN};

/// Pixels from the legend's top to its bottom.
pub(super) const HEIGHT: u32 = GREY_BAR[1];

/// Length and height of the bar of grey levels, and height of the swatch, pixels.
const GREY_BAR: [u32; 2] = [96, 14];

/// Scale bar, grey levels, unseen.
pub(super) struct Legend {
    bar_px: u32,
    bar: String,
    low: String,
    high: String,
}

impl Legend {
    /// For a picture of the given scale whose black and white are the given values.
    pub(super) fn new(px_per_mm: f64, [low, high]: [f32; 2]) -> Self {
        // The longest of 1, 2, 5 times a power of ten that takes at most 120 pixels.
        let room = 120.0 / px_per_mm;
        let decade = 10_f64.powf(room.log10().floor());
        let mm = [5.0, 2.0, 1.0].into_iter().map(|n| n * decade).find(|mm| *mm <= room).unwrap_or(decade);
        Self {
            bar_px: ((mm * px_per_mm).round() as u32).max(1),
            bar: format!("{mm} mm"),
            low: short(f64::from(low)),
            high: short(f64::from(high)),
        }
    }

    /// What is drawn from left to right: widths of bar, its text, low, grey bar, high, swatch, its text.
    fn widths(&self) -> [u32; 7] {
        let text = |t: &str| lettering::width(t, DOT);
        [self.bar_px, text(&self.bar), text(&self.low), GREY_BAR[0], text(&self.high), GREY_BAR[1], text("unseen")]
    }

    /// Pixels from its left to its right.
    pub(super) fn width(&self) -> u32 {
        // Two of the six gaps separate the groups.
        self.widths().iter().sum::<u32>() + 4 * 8 + 2 * 3 * GAP
    }

    /// Draws it with its top left corner at the given pixel.
    pub(super) fn draw(&self, picture: &mut RgbImage, left: u32, top: u32) {
        let widths = self.widths();
        let mut x = left;
        let mut place = |n: usize, gap: u32| {
            let at = x;
            x += widths[n] + gap;
            at
        };
        let bar = place(0, 8);
        let middle = top + GREY_BAR[1] / 2 - 1;
        fill(picture, [bar, middle], [self.bar_px, DOT], INK);
        for end in [bar, bar + self.bar_px.saturating_sub(DOT)] {
            fill(picture, [end, middle - 4], [DOT, 8 + DOT], INK);
        }
        lettering::write(picture, place(1, 3 * GAP), top, DOT, INK, &self.bar);
        lettering::write(picture, place(2, 8), top, DOT, INK, &self.low);
        let greys = place(3, 8);
        fill(picture, [greys - 1, top - 1], [GREY_BAR[0] + 2, GREY_BAR[1] + 2], BORDER);
        for step in 0..GREY_BAR[0] {
            let grey = (step * 255 / (GREY_BAR[0] - 1)) as u8;
            fill(picture, [greys + step, top], [1, GREY_BAR[1]], Rgb([grey; 3]));
        }
        lettering::write(picture, place(4, 3 * GAP), top, DOT, INK, &self.high);
        let swatch = place(5, 8);
        fill(picture, [swatch - 1, top - 1], [GREY_BAR[1] + 2, GREY_BAR[1] + 2], BORDER);
        fill(picture, [swatch, top], [GREY_BAR[1]; 2], UNSEEN);
        lettering::write(picture, place(6, 0), top, DOT, INK, "unseen");
    }
}

/// A number with at most two decimals, none of them trailing zeros; with an exponent where two decimals would not show it.
pub(super) fn short(x: f64) -> String {
    // What is below a millionth is left from a subtraction, not meant.
    if (1e-6..0.01).contains(&x.abs()) {
        return format!("{x:.1e}");
    }
    let text = format!("{x:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_scale_bar_read_right() {
        for (x, text) in [(-1e-9, "0"), (-0.5, "-0.5"), (164.079, "164.08"), (30.0, "30"), (0.001_23, "1.2e-3")] {
            assert_eq!(short(x), text);
        }
        for (px_per_mm, label, px) in
            [(8.0, "10 mm", 80), (2.3, "50 mm", 115), (70.0, "1 mm", 70), (500.0, "0.2 mm", 100)]
        {
            let legend = Legend::new(px_per_mm, [0.0, 1.0]);
            assert_eq!((legend.bar.as_str(), legend.bar_px), (label, px));
        }
    }
}
