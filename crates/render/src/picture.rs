//! A rendered picture: premultiplied colour and transmittance of each pixel, and its composition
//! over a background.

/// A finished picture, row by row from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Pixels to the right and down.
    pub size: [u32; 2],
    /// Premultiplied red, green, blue, and the transmittance to the background.
    pub pixels: Vec<[f32; 4]>,
}

impl Picture {
    /// Returns the picture over a background of red, green, blue from 0 to 1: three 8 bit values
    /// a pixel, rounded to the nearest.
    pub fn over(&self, background: [f32; 3]) -> Vec<u8> {
        self.pixels.iter().flat_map(|pixel| bytes_over(*pixel, background)).collect()
    }

    /// Returns the largest and root mean square difference of two pictures over black, over all
    /// channels.
    ///
    /// # Panics
    /// When the pictures differ in size.
    pub fn difference(&self, other: &Self) -> [f64; 2] {
        assert_eq!(self.size, other.size, "pictures of one size are compared");
        let (mut most, mut squares, mut count) = (0.0_f64, 0.0, 0.0);
        for (a, b) in self.pixels.iter().zip(&other.pixels) {
            for (a, b) in a.iter().zip(b) {
                let off = f64::from(*a) - f64::from(*b);
                most = most.max(off.abs());
                squares += off * off;
                count += 1.0;
            }
        }
        [most, f64::sqrt(squares / f64::max(count, 1.0))]
    }
}

/// A picture over a background, 8 bits a channel, row by row from the top left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum OpaquePixels {
    /// One byte a pixel: red, green and blue are equal everywhere.
    Grey(Vec<u8>),
    /// Red, green and blue.
    Colour(Vec<u8>),
}

/// Returns red, green and blue of a pixel over a background, rounded to the nearest.
#[inline(always)]
pub(crate) fn bytes_over([r, g, b, t]: [f32; 4], background: [f32; 3]) -> [u8; 3] {
    [(r, 0), (g, 1), (b, 2)].map(|(c, channel)| byte(t.mul_add(background[channel], c)))
}

/// Returns a value from 0 to 1 in 255ths, to the nearest and ties to even.
#[inline(always)]
fn byte(value: f32) -> u8 {
    // Sums of this size have a precision of 1. A library's function would be called for each
    // value where the target has no instruction for rounding.
    const WHOLE: f32 = 12_582_912.0;
    ((value * 255.0).clamp(0.0, 255.0) + WHOLE).to_bits() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn background_shows_through_transparent_pixels() {
        let picture = Picture { size: [2, 1], pixels: vec![[0.5, 0.25, 0.0, 0.5], [0.0, 0.0, 0.0, 1.0]] };
        assert_eq!(picture.over([1.0, 0.5, 0.0]), [255, 128, 0, 255, 128, 0]);
        assert_eq!(picture.over([0.0; 3]), [128, 64, 0, 0, 0, 0]);
        let other = Picture { pixels: vec![[0.5, 0.25, 0.0, 0.5], [0.0, 0.0, 0.5, 1.0]], ..picture.clone() };
        assert_eq!(picture.difference(&other), [0.5, f64::sqrt(0.25 / 8.0)]);
    }

    #[test]
    fn bytes_are_nearest_values_ties_to_even_within_range() {
        let plain = |x: f32| (x * 255.0).round_ties_even().clamp(0.0, 255.0) as u8;
        let steps = (0..=0x4_0000_u32).map(|n| (n as f32 - 1000.0) / 260_000.0);
        let ties = (0..255_u32).map(|n| (n as f32 + 0.5) / 255.0);
        let ends = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MIN_POSITIVE, -0.0, 1.0, 1e9];
        for x in steps.chain(ties).chain(ends) {
            assert_eq!(byte(x), plain(x), "{x}");
        }
    }
}
