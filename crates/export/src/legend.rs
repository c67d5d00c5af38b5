//! Legends of pictures: a scale bar, colour ranges, and colours with their own meaning.

use image::{Rgb, RgbImage};

use super::lettering::{self, fill};
use super::style::{BORDER, DOT, GAP, INK, UNSEEN};

/// Height of the legend, pixels.
pub(crate) const HEIGHT: u32 = RAMP[1];

/// Length and height of a colour range, and height of a swatch, pixels.
const RAMP: [u32; 2] = [96, 14];
/// Distance between a text and its symbol, pixels.
const BESIDE: u32 = 8;
/// Longest scale bar, pixels.
const LONGEST_BAR: f64 = 120.0;

/// One entry of the legend.
#[derive(Clone)]
pub(crate) enum Entry {
    /// A scale bar and its length in the world.
    Bar { px: u32, label: String },
    /// Colours from `low` to `high`.
    Ramp { low: String, high: String, colours: Vec<Rgb<u8>> },
    /// A colour.
    Swatch { colour: Rgb<u8>, label: &'static str },
}

impl Entry {
    /// Creates the bar for a picture's scale and width; it takes at most a quarter of the width.
    pub(crate) fn bar(px_per_mm: f64, width: u32) -> Option<Self> {
        let mm = round_length(LONGEST_BAR.min(0.25 * f64::from(width)) / px_per_mm)?;
        Some(Self::Bar { px: ((mm * px_per_mm).round() as u32).max(1), label: format!("{mm} mm") })
    }

    /// Creates a range from black to white.
    pub(crate) fn greys([low, high]: [f32; 2]) -> Self {
        let colours = (0..=u8::MAX).map(|grey| Rgb([grey; 3])).collect();
        Self::Ramp { low: short(f64::from(low)), high: short(f64::from(high)), colours }
    }

    /// Creates the entry for unseen voxels.
    pub(crate) fn unseen() -> Self {
        Self::Swatch { colour: UNSEEN, label: "unseen" }
    }

    fn width(&self, Spread { dot, ramp, .. }: Spread) -> u32 {
        let text = |t: &str| lettering::width(t, dot);
        match self {
            Self::Bar { px, label } => px + BESIDE + text(label),
            Self::Ramp { low, high, .. } => text(low) + 2 * BESIDE + ramp + text(high),
            Self::Swatch { label, .. } => RAMP[1] + BESIDE + text(label),
        }
    }

    fn draw(&self, picture: &mut RgbImage, left: u32, top: u32, Spread { dot, ramp: long, .. }: Spread) {
        let line = top + (HEIGHT - lettering::height(dot)) / 2;
        match self {
            Self::Bar { px, label } => {
                let middle = top + HEIGHT / 2 - 1;
                fill(picture, [left, middle], [*px, DOT], INK);
                for end in [left, left + px.saturating_sub(DOT)] {
                    fill(picture, [end, middle - 4], [DOT, 8 + DOT], INK);
                }
                lettering::write(picture, left + px + BESIDE, line, dot, INK, label);
            }
            Self::Ramp { low, high, colours } => {
                lettering::write(picture, left, line, dot, INK, low);
                let ramp = left + lettering::width(low, dot) + BESIDE;
                fill(picture, [ramp - 1, top - 1], [long + 2, RAMP[1] + 2], BORDER);
                for step in 0..long {
                    let at = step as usize * (colours.len() - 1) / (long - 1) as usize;
                    fill(picture, [ramp + step, top], [1, RAMP[1]], colours[at]);
                }
                lettering::write(picture, ramp + long + BESIDE, line, dot, INK, high);
            }
            Self::Swatch { colour, label } => {
                fill(picture, [left - 1, top - 1], [RAMP[1] + 2, RAMP[1] + 2], BORDER);
                fill(picture, [left, top], [RAMP[1]; 2], *colour);
                lettering::write(picture, left + RAMP[1] + BESIDE, line, dot, INK, label);
            }
        }
    }
}

/// A legend, from left to right.
pub(crate) struct Legend {
    entries: Vec<Entry>,
    spread: Spread,
}

/// Sizes of a legend's parts, pixels.
#[derive(Debug, Clone, Copy)]
struct Spread {
    /// A dot of the lettering.
    dot: u32,
    /// Between entries.
    between: u32,
    /// A colour range.
    ramp: u32,
}

/// From wide to narrow.
const SPREADS: [Spread; 5] = [
    Spread { dot: DOT, between: 3 * GAP, ramp: RAMP[0] },
    Spread { dot: DOT, between: 3 * GAP / 2, ramp: RAMP[0] },
    Spread { dot: 1, between: 3 * GAP / 2, ramp: RAMP[0] },
    Spread { dot: 1, between: GAP, ramp: RAMP[0] * 2 / 3 },
    Spread { dot: 1, between: 3 * GAP / 4, ramp: RAMP[0] / 2 },
];

impl Legend {
    /// Creates a legend of full width.
    pub(crate) fn new(entries: Vec<Entry>) -> Self {
        Self { entries, spread: SPREADS[0] }
    }

    /// Creates a legend of at most `width` pixels, with smaller gaps and text if needed. If that
    /// is still too wide, the last entries are left out.
    pub(crate) fn within(mut entries: Vec<Entry>, width: u32) -> Self {
        loop {
            for spread in SPREADS {
                let legend = Self { entries, spread };
                if legend.width() <= width {
                    return legend;
                }
                entries = legend.entries;
            }
            // Too wide in every size.
            if entries.pop().is_none() {
                return Self::new(entries);
            }
        }
    }

    /// Returns the width in pixels.
    pub(crate) fn width(&self) -> u32 {
        let gaps = self.entries.len().saturating_sub(1) as u32 * self.spread.between;
        self.entries.iter().map(|entry| entry.width(self.spread)).sum::<u32>() + gaps
    }

    /// Draws it with its top left corner at the given pixel.
    pub(crate) fn draw(&self, picture: &mut RgbImage, left: u32, top: u32) {
        let mut x = left;
        for entry in &self.entries {
            entry.draw(picture, x, top, self.spread);
            x += entry.width(self.spread) + self.spread.between;
        }
    }
}

/// Returns the longest of 1, 2, 5 times a power of ten that is not longer than `room`; `None` if
/// that is not a length.
pub(crate) fn round_length(room: f64) -> Option<f64> {
    if !(room > 0.0 && room.is_finite()) {
        return None;
    }
    // Parsing gives the number nearest to the power of ten, which prints exactly.
    let decade: f64 = format!("1e{}", room.log10().floor()).parse().ok()?;
    [5.0, 2.0, 1.0].into_iter().map(|n| n * decade).find(|length| *length <= room * (1.0 + 1e-12))
}

/// Formats a number with at most two decimals, without trailing zeros; with an exponent if two
/// decimals would not show it.
pub(crate) fn short(x: f64) -> String {
    // Numbers below a millionth are residues of a subtraction.
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
    fn numbers_and_scale_bar_are_formatted() {
        for (x, text) in [(-1e-9, "0"), (-0.5, "-0.5"), (164.079, "164.08"), (30.0, "30"), (0.001_23, "1.2e-3")] {
            assert_eq!(short(x), text);
        }
        for (px_per_mm, text, px) in
            [(8.0, "10 mm", 80), (2.3, "50 mm", 115), (70.0, "1 mm", 70), (500.0, "0.2 mm", 100)]
        {
            let Some(Entry::Bar { px: found, label }) = Entry::bar(px_per_mm, 2000) else { panic!("{text}") };
            assert_eq!((label.as_str(), found), (text, px));
        }
        assert!(matches!(Entry::bar(8.0, 200), Some(Entry::Bar { px: 40, .. })), "a quarter of 200 pixels at most");
        for (room, length) in [(10.0, 10.0), (9.99, 5.0), (4.99, 2.0), (0.3, 0.2), (1000.0, 1000.0), (0.0199, 0.01)] {
            assert_eq!(round_length(room), Some(length));
        }
        assert!([0.0, -1.0, f64::NAN, f64::INFINITY].into_iter().all(|room| round_length(room).is_none()));
    }

    #[test]
    fn legend_fits_available_width() {
        let entries = || vec![Entry::bar(8.0, 2000).unwrap(), Entry::greys([0.0, 255.0]), Entry::unseen()];
        let wide = Legend::new(entries()).width();
        let mut before = wide;
        for room in [wide, wide - 1, wide - 60, 300, 200, 100, 5] {
            let legend = Legend::within(entries(), room);
            assert!(legend.width() <= room.min(before), "{} of {room}", legend.width());
            before = legend.width();
        }
        assert_eq!((Legend::within(entries(), wide).width(), before), (wide, 0));
    }
}
