//! Labels in pictures: a 5×7 bitmap font of the characters used, so that no font has to be
//! shipped or rasterised. ab_glyph and fontdue need a font file, and blur letters of seven dots.

use image::{Rgb, RgbImage};

/// Distance between characters, in dots: five of the glyph and one between.
const ADVANCE: u32 = 6;

/// Dots from the top of a capital to the base line.
const HEIGHT: u32 = 7;

/// Returns the rows of a glyph from the top, the leftmost dot in bit 4; `None` for an
/// unsupported character.
fn glyph(character: char) -> Option<[u8; 7]> {
    Some(match character {
        '0' => [0b01110, 0b10001, 0b10011, 0b10101, 0b11001, 0b10001, 0b01110],
        '1' => [0b00100, 0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110],
        '2' => [0b01110, 0b10001, 0b00001, 0b00110, 0b01000, 0b10000, 0b11111],
        '3' => [0b01110, 0b10001, 0b00001, 0b00110, 0b00001, 0b10001, 0b01110],
        '4' => [0b00010, 0b00110, 0b01010, 0b10010, 0b11111, 0b00010, 0b00010],
        '5' => [0b11111, 0b10000, 0b11110, 0b00001, 0b00001, 0b10001, 0b01110],
        '6' => [0b00110, 0b01000, 0b10000, 0b11110, 0b10001, 0b10001, 0b01110],
        '7' => [0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b01000, 0b01000],
        '8' => [0b01110, 0b10001, 0b10001, 0b01110, 0b10001, 0b10001, 0b01110],
        '9' => [0b01110, 0b10001, 0b10001, 0b01111, 0b00001, 0b00010, 0b01100],
        '.' => [0, 0, 0, 0, 0, 0b01100, 0b01100],
        ',' => [0, 0, 0, 0, 0b01100, 0b00100, 0b01000],
        '-' => [0, 0, 0, 0b11111, 0, 0, 0],
        '+' => [0, 0b00100, 0b00100, 0b11111, 0b00100, 0b00100, 0],
        '=' => [0, 0, 0b11111, 0, 0b11111, 0, 0],
        'X' => [0b10001, 0b10001, 0b01010, 0b00100, 0b01010, 0b10001, 0b10001],
        'Y' => [0b10001, 0b10001, 0b01010, 0b00100, 0b00100, 0b00100, 0b00100],
        'Z' => [0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b10000, 0b11111],
        'a' => [0, 0, 0b01110, 0b00001, 0b01111, 0b10001, 0b01111],
        'b' => [0b10000, 0b10000, 0b10110, 0b11001, 0b10001, 0b11001, 0b10110],
        'c' => [0, 0, 0b01110, 0b10000, 0b10000, 0b10001, 0b01110],
        'd' => [0b00001, 0b00001, 0b01101, 0b10011, 0b10001, 0b10011, 0b01101],
        'e' => [0, 0, 0b01110, 0b10001, 0b11111, 0b10000, 0b01110],
        'f' => [0b00110, 0b01001, 0b01000, 0b11100, 0b01000, 0b01000, 0b01000],
        'g' => [0, 0b01111, 0b10001, 0b10001, 0b01111, 0b00001, 0b01110],
        'h' => [0b10000, 0b10000, 0b10110, 0b11001, 0b10001, 0b10001, 0b10001],
        'i' => [0b00100, 0, 0b01100, 0b00100, 0b00100, 0b00100, 0b01110],
        'k' => [0b10000, 0b10000, 0b10010, 0b10100, 0b11000, 0b10100, 0b10010],
        'l' => [0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110],
        'm' => [0, 0, 0b11010, 0b10101, 0b10101, 0b10001, 0b10001],
        'n' => [0, 0, 0b10110, 0b11001, 0b10001, 0b10001, 0b10001],
        'o' => [0, 0, 0b01110, 0b10001, 0b10001, 0b10001, 0b01110],
        'p' => [0, 0b10110, 0b11001, 0b10001, 0b11110, 0b10000, 0b10000],
        'r' => [0, 0, 0b10110, 0b11001, 0b10000, 0b10000, 0b10000],
        's' => [0, 0, 0b01110, 0b10000, 0b01110, 0b00001, 0b11110],
        't' => [0b01000, 0b01000, 0b11100, 0b01000, 0b01000, 0b01001, 0b00110],
        'u' => [0, 0, 0b10001, 0b10001, 0b10001, 0b10011, 0b01101],
        'v' => [0, 0, 0b10001, 0b10001, 0b10001, 0b01010, 0b00100],
        'w' => [0, 0, 0b10001, 0b10001, 0b10101, 0b10101, 0b01010],
        'x' => [0, 0, 0b10001, 0b01010, 0b00100, 0b01010, 0b10001],
        'y' => [0, 0, 0b10001, 0b10001, 0b01111, 0b00001, 0b01110],
        'z' => [0, 0, 0b11111, 0b00010, 0b00100, 0b01000, 0b11111],
        _ => return None,
    })
}

/// Returns the width of a text in pixels; each dot is `dot` pixels wide.
pub(crate) fn width(text: &str, dot: u32) -> u32 {
    (text.chars().count() as u32 * ADVANCE).saturating_sub(1) * dot
}

/// Returns the height of a line in pixels.
pub(crate) fn height(dot: u32) -> u32 {
    HEIGHT * dot
}

/// Calls `dot` for each dot of a text, by column and row from its top left corner; a character
/// without a glyph is a gap.
pub(crate) fn dots(text: &str, mut dot: impl FnMut(u32, u32)) {
    for (n, character) in (0..).zip(text.chars()) {
        let Some(rows) = glyph(character) else { continue };
        for (row, bits) in (0..).zip(rows) {
            for column in (0..5).filter(|column| bits >> (4 - column) & 1 == 1) {
                dot(n * ADVANCE + column, row);
            }
        }
    }
}

/// Writes a text with its top left corner at (x, y), clipped to the picture.
pub(crate) fn write(picture: &mut RgbImage, x: u32, y: u32, dot: u32, colour: Rgb<u8>, text: &str) {
    dots(text, |column, row| fill(picture, [x + column * dot, y + row * dot], [dot, dot], colour));
}

/// Writes like [`write()`], in the first colour with an outline of a pixel in the second,
/// legible on any background.
pub(crate) fn write_shaded(
    picture: &mut RgbImage,
    [x, y]: [u32; 2],
    dot: u32,
    [colour, rim]: [Rgb<u8>; 2],
    text: &str,
) {
    dots(text, |column, row| {
        let (left, top) = ((x + column * dot).saturating_sub(1), (y + row * dot).saturating_sub(1));
        fill(picture, [left, top], [dot + 2, dot + 2], rim);
    });
    write(picture, x, y, dot, colour, text);
}

/// Fills a rectangle, clipped to the picture.
pub(crate) fn fill(picture: &mut RgbImage, [left, top]: [u32; 2], [width, height]: [u32; 2], colour: Rgb<u8>) {
    for y in top..top + height {
        for x in left..left + width {
            if let Some(pixel) = picture.get_pixel_mut_checked(x, y) {
                *pixel = colour;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn label_characters_have_distinct_glyphs() {
        let used = "0123456789.,-+=XYZxyzatmmkunseenvoxelofslicedghrwpb";
        let mut glyphs: Vec<_> = used.chars().map(|c| (glyph(c).unwrap(), c)).collect();
        glyphs.sort_unstable();
        glyphs.dedup();
        assert!(glyphs.windows(2).all(|w| w[0].0 != w[1].0));
    }

    #[test]
    fn text_fills_its_width_and_is_clipped() {
        let mut picture = RgbImage::new(40, 20);
        write(&mut picture, 3, 2, 2, Rgb([255; 3]), "-x");
        let lit: Vec<_> = picture.enumerate_pixels().filter(|(.., p)| p.0[0] == 255).map(|(x, y, _)| (x, y)).collect();
        let (right, bottom) = (lit.iter().map(|p| p.0).max().unwrap(), lit.iter().map(|p| p.1).max().unwrap());
        assert_eq!((right + 1, bottom + 1), (3 + width("-x", 2), 2 + height(2)));
        write(&mut picture, 35, 15, 3, Rgb([255; 3]), "888");
    }
}
