//! A drawing over an image plane: pixels to the right and down, in the scanner's orientation.

use std::fmt::Write as _;
use std::io::Cursor;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use glam::DVec2;
use image::{ExtendedColorType, ImageEncoder as _, codecs::png::PngEncoder};

use super::escaped;

/// Colours of a map, from low to high: light to dark along one hue, readable in grey prints and
/// by colour-blind people.
const SHADES: [[u8; 3]; 5] = [[237, 244, 252], [182, 208, 238], [110, 162, 214], [48, 108, 176], [12, 52, 110]];

/// Style of a mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ink {
    /// A used detection.
    Used,
    /// A detection that was left out.
    LeftOut,
    /// An expected position.
    Expected,
}

impl Ink {
    fn colour(self) -> &'static str {
        match self {
            Self::Used => "#12a150",
            Self::LeftOut => "#e5484d",
            Self::Expected => "#f5a300",
        }
    }
}

/// A drawing over an image's pixels.
#[derive(Debug, Clone)]
pub struct Plate {
    size_px: [u32; 2],
    /// A clearly visible length, px: letters and dots scale with the image.
    unit: f64,
    /// Height of the legend below the image, px.
    below: f64,
    body: String,
}

impl Plate {
    /// Creates an empty drawing.
    pub fn new(size_px: [u32; 2]) -> Self {
        let unit = f64::from(size_px[0].max(size_px[1])) / 100.0;
        Self { size_px, unit, below: 0.0, body: String::new() }
    }

    /// Places a grey image under it, row by row from the top.
    ///
    /// # Panics
    /// When the number of grey levels differs from that of the pixels.
    pub fn picture(&mut self, grey: &[u8]) {
        let [width, height] = self.size_px;
        let mut png = Cursor::new(Vec::new());
        PngEncoder::new(&mut png)
            .write_image(grey, width, height, ExtendedColorType::L8)
            .unwrap_or_else(|error| panic!("{width}×{height} pixels of {} grey levels: {error}", grey.len()));
        let data = STANDARD.encode(png.get_ref());
        // Pixel centres lie at whole numbers.
        self.put(format_args!(
            "<image x=\"-.5\" y=\"-.5\" width=\"{width}\" height=\"{height}\" href=\"data:image/png;base64,{data}\"/>\n"
        ));
    }

    /// Draws a ring around a place, with a word next to it.
    pub fn ring(&mut self, at: DVec2, ink: Ink, word: &str) {
        let Self { unit, .. } = *self;
        let colour = ink.colour();
        let dashes =
            if ink == Ink::LeftOut { format!(" stroke-dasharray=\"{:.1}\"", 0.6 * unit) } else { String::new() };
        self.put(format_args!(
            "<circle cx=\"{:.2}\" cy=\"{:.2}\" r=\"{:.2}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{:.2}\"{dashes}/>\n",
            at.x,
            at.y,
            1.2 * unit,
            0.3 * unit
        ));
        if !word.is_empty() {
            let (x, y, size) = (at.x + 1.6 * unit, at.y - 0.8 * unit, 2.2 * unit);
            self.put(format_args!(
                "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size:.1}\" fill=\"{colour}\">{}</text>\n",
                escaped(word)
            ));
        }
    }

    /// Draws a cross at a place.
    pub fn cross(&mut self, at: DVec2, ink: Ink) {
        let r = 0.8 * self.unit;
        let (DVec2 { x, y }, colour, wide) = (at, ink.colour(), 0.3 * self.unit);
        self.put(format_args!(
            "<path d=\"M{:.2} {y:.2}h{:.2}M{x:.2} {:.2}v{:.2}\" stroke=\"{colour}\" stroke-width=\"{wide:.2}\"/>\n",
            x - r,
            2.0 * r,
            y - r,
            2.0 * r
        ));
    }

    /// Draws a dot so small that hundreds can be distinguished.
    pub fn speck(&mut self, at: DVec2) {
        self.put(format_args!(
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{:.2}\" fill=\"#111\" fill-opacity=\".35\"/>\n",
            at.x,
            at.y,
            0.22 * self.unit
        ));
    }

    /// Draws a thin line from a place, which is marked by a dot.
    pub fn vector(&mut self, from: DVec2, by: DVec2, ink: Ink) {
        let (to, colour) = (from + by, ink.colour());
        self.put(format_args!(
            "<path d=\"M{:.2} {:.2}L{:.2} {:.2}\" stroke=\"{colour}\" stroke-width=\"{:.2}\" stroke-opacity=\".7\"/>\
             <circle cx=\"{:.2}\" cy=\"{:.2}\" r=\"{:.2}\" fill=\"{colour}\"/>\n",
            from.x,
            from.y,
            to.x,
            to.y,
            0.22 * self.unit,
            from.x,
            from.y,
            0.35 * self.unit
        ));
    }

    /// Draws a colour map of cells across and down over the whole image, row by row, and its
    /// colour scale below. Values that are not finite stay empty.
    ///
    /// # Panics
    /// When the number of values differs from that of the cells.
    pub fn map(&mut self, [across, down]: [usize; 2], values: &[f64], unit: &str) {
        assert_eq!(values.len(), across * down, "{across}×{down} cells");
        let known = || values.iter().copied().filter(|value| value.is_finite());
        let (low, high) = (known().fold(f64::INFINITY, f64::min), known().fold(0.0, f64::max));
        let [width, height] = self.size_px.map(f64::from);
        let (w, h) = (width / across as f64, height / down as f64);
        for (index, value) in values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
            let (x, y) = ((index % across) as f64 * w - 0.5, (index / across) as f64 * h - 0.5);
            let colour = shade(if high > low { (value - low) / (high - low) } else { 0.0 });
            // Slightly larger, to avoid visible seams.
            self.put(format_args!(
                "<rect x=\"{x:.2}\" y=\"{y:.2}\" width=\"{:.2}\" height=\"{:.2}\" fill=\"{colour}\"/>\n",
                w + 0.2,
                h + 0.2
            ));
        }
        if low.is_finite() {
            self.ramp([low, high], unit);
        }
    }

    /// Draws the colour scale of a map, below the image.
    fn ramp(&mut self, [low, high]: [f64; 2], unit: &str) {
        const STEPS: u32 = 40;
        let Self { unit: px, size_px: [width, height], .. } = *self;
        let (top, left, step) =
            (f64::from(height) + 1.5 * px, 14.0 * px, (f64::from(width) - 28.0 * px) / f64::from(STEPS));
        for n in 0..STEPS {
            let colour = shade(f64::from(n) / f64::from(STEPS - 1));
            let x = left + f64::from(n) * step;
            self.put(format_args!(
                "<rect x=\"{x:.2}\" y=\"{top:.2}\" width=\"{:.2}\" height=\"{:.2}\" fill=\"{colour}\"/>\n",
                step + 0.2,
                2.5 * px
            ));
        }
        let (y, size, right) = (top + 2.2 * px, 2.6 * px, left + step * f64::from(STEPS) + px);
        self.put(format_args!(
            "<text x=\"{:.1}\" y=\"{y:.1}\" font-size=\"{size:.1}\" text-anchor=\"end\" fill=\"currentColor\">{low:.2} {unit}</text>\
             <text x=\"{right:.1}\" y=\"{y:.1}\" font-size=\"{size:.1}\" fill=\"currentColor\">{high:.2} {unit}</text>\n",
            left - px
        ));
        self.below = 5.5 * px;
    }

    /// Draws a polygon, such as an image's data rectangle or a fan.
    pub fn outline(&mut self, corners: &[DVec2]) {
        let points: Vec<String> = corners.iter().map(|at| format!("{:.1},{:.1}", at.x, at.y)).collect();
        self.put(format_args!(
            "<polygon points=\"{}\" fill=\"none\" stroke=\"currentColor\" stroke-opacity=\".5\" stroke-width=\"{:.2}\"/>\n",
            points.join(" "),
            0.25 * self.unit
        ));
    }

    /// Returns the drawing; `about` is a short description for readers who cannot see it.
    pub fn svg(&self, about: &str) -> String {
        let [width, height] = self.size_px.map(f64::from);
        format!(
            "<svg viewBox=\"-.5 -.5 {width} {:.1}\" role=\"img\" aria-label=\"{}\" font-family=\"system-ui,sans-serif\">\n{}</svg>",
            height + self.below,
            escaped(about),
            self.body
        )
    }

    fn put(&mut self, text: std::fmt::Arguments<'_>) {
        // Writing to a string does not fail.
        let _ = self.body.write_fmt(text);
    }
}

/// Returns the colour of a share from 0 to 1.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "between 0 and the last shade, and between grey levels"
)]
fn shade(share: f64) -> String {
    let at = share.clamp(0.0, 1.0) * (SHADES.len() - 1) as f64;
    let first = (at as usize).min(SHADES.len() - 2);
    let between = at - first as f64;
    let [r, g, b] = [0, 1, 2].map(|k| {
        let [low, high] = [SHADES[first][k], SHADES[first + 1][k]].map(f64::from);
        (low + (high - low) * between).round() as u8
    });
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plate_contains_all_elements() {
        let mut plate = Plate::new([40, 30]);
        plate.picture(&[7; 1200]);
        plate.ring(DVec2::new(3.0, 4.0), Ink::Used, "1 <a>");
        plate.ring(DVec2::new(9.0, 4.0), Ink::LeftOut, "");
        plate.cross(DVec2::new(10.0, 11.0), Ink::Expected);
        plate.vector(DVec2::new(1.0, 1.0), DVec2::new(5.0, 0.0), Ink::Used);
        plate.map([2, 2], &[0.1, 0.2, f64::NAN, 0.4], "mm");
        plate.outline(&[DVec2::ZERO, DVec2::X, DVec2::ONE]);
        plate.speck(DVec2::ONE);
        let svg = plate.svg("dots & wires");
        let document = roxmltree::Document::parse(&svg).unwrap();
        let count = |name: &str| document.descendants().filter(|node| node.has_tag_name(name)).count();
        assert_eq!([count("image"), count("circle"), count("path"), count("polygon")], [1, 4, 2, 1]);
        assert_eq!(count("rect"), 3 + 40, "cells that are known, and what their colours mean");
        assert!(svg.contains("1 &lt;a&gt;") && svg.contains("0.10 mm") && svg.contains("0.40 mm"));
    }

    #[test]
    fn larger_values_are_darker() {
        let sum = |share: f64| {
            let text = shade(share);
            (0..3).map(|k| u32::from_str_radix(&text[1 + 2 * k..3 + 2 * k], 16).unwrap()).sum::<u32>()
        };
        assert!((0..20).all(|n| sum(f64::from(n) / 20.0) > sum(f64::from(n + 1) / 20.0)));
        assert_eq!([shade(0.0), shade(1.0), shade(7.0)], ["#edf4fc", "#0c346e", "#0c346e"]);
    }
}
