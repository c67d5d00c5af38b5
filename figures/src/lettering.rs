//! Width of texts in the compiled-in font, and line wrapping.

use std::sync::LazyLock;

use skrifa::instance::{LocationRef, Size};
use skrifa::{FontRef, MetadataProvider};

/// Font families in the SVG; the second has the same widths as the first.
pub const FAMILY: &str = "DejaVu Sans, Verdana, sans-serif";

/// Advance of each character below U+2300, relative to the font size.
static ADVANCES: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let Ok(font) = FontRef::new(dejavu::sans::regular()) else { return Vec::new() };
    let (glyphs, metrics) = (font.charmap(), font.glyph_metrics(Size::new(1.0), LocationRef::default()));
    (0..0x2300_u32).map(|c| glyphs.map(c).and_then(|glyph| metrics.advance_width(glyph)).unwrap_or(USUAL)).collect()
});

/// Advance of a character that the font lacks.
const USUAL: f32 = 0.6;
/// Width of bold letters relative to regular ones.
const BOLD: f64 = 1.12;

/// Size of subscripts relative to the font size.
pub const SUBSCRIPT: f64 = 0.72;

/// Returns the width of one line at `size` pixels; an underscore begins a subscript.
pub fn width(text: &str, size: f64) -> f64 {
    let (mut total, mut part) = (0.0, 1.0);
    for c in text.chars() {
        part = match c {
            '_' => SUBSCRIPT,
            c if c.is_ascii_alphanumeric() => part,
            _ => 1.0,
        };
        if c != '_' {
            total += part * f64::from(*ADVANCES.get(c as usize).unwrap_or(&USUAL));
        }
    }
    size * total
}

/// Splits the text after an underscore: the subscript, up to the first character that is not
/// alphanumeric, and the rest.
pub fn subscript(after: &str) -> (&str, &str) {
    after.split_at(after.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(after.len()))
}

/// Returns an upper bound of the width of one line of bold letters.
pub fn width_bold(text: &str, size: f64) -> f64 {
    BOLD * width(text, size)
}

/// Wraps text into lines of at most `most` pixels; a longer word gets its own line.
pub fn wrap(text: &str, size: f64, most: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width(line, size) + width(" ", size) + width(word, size) <= most => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}
