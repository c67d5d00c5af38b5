//! How wide a text is in the font that is compiled in, and where it wraps.

use std::sync::LazyLock;

use skrifa::instance::{LocationRef, Size};
use skrifa::{FontRef, MetadataProvider};

/// Of the font as an SVG asks for it; where it is missing, the next is as wide.
pub const FAMILY: &str = "DejaVu Sans, Verdana, sans-serif";

/// Advance of each character below U+2300 in parts of the letters' size.
static ADVANCES: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let Ok(font) = FontRef::new(dejavu::sans::regular()) else { return Vec::new() };
    let (glyphs, metrics) = (font.charmap(), font.glyph_metrics(Size::new(1.0), LocationRef::default()));
    (0..0x2300_u32).map(|c| glyphs.map(c).and_then(|glyph| metrics.advance_width(glyph)).unwrap_or(USUAL)).collect()
});

/// For a character that the font lacks.
const USUAL: f32 = 0.6;
/// Bold letters are wider by this.
const BOLD: f64 = 1.12;

/// Size of subscripts in parts of the letters' size.
pub const SUBSCRIPT: f64 = 0.72;

/// Width of one line of letters of `size` pixels; what follows an underscore is a subscript.
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

/// Width of one line of bold letters, at most.
pub fn width_bold(text: &str, size: f64) -> f64 {
    BOLD * width(text, size)
}

/// Lines no wider than `most` pixels, unless a word alone is.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_font_has_every_letter_that_figures_use_and_their_own_widths() {
        let font = FontRef::new(dejavu::sans::regular()).unwrap();
        for c in "aZ09 −×·±≤≥≈√σπ∞µ⁻⁰¹²³⁴⁵⁶⁷⁸⁹–→ΣφΔ°′".chars() {
            assert!(font.charmap().map(c).is_some(), "{c}");
        }
        assert!(width("iiii", 12.0) < 0.5 * width("MMMM", 12.0));
        assert!(width("σ_eff", 12.0) < width("σeff", 12.0) && width("σ_eff", 12.0) > width("σe", 12.0));
        assert!((width("ab", 20.0) - 2.0 * width("ab", 10.0)).abs() < 1e-9);
    }

    #[test]
    fn wrapped_lines_fit_and_lose_no_word() {
        let text = "Samples are taken at irregular distances, as by a hand, and each counts by its distance.";
        let lines = wrap(text, 12.0, 150.0);
        assert!(lines.len() > 2 && lines.iter().all(|line| width(line, 12.0) <= 150.0));
        assert_eq!(lines.join(" "), text);
    }
}
