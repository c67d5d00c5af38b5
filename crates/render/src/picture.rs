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
        let value = |x: f32| (x * 255.0).round_ties_even().clamp(0.0, 255.0) as u8;
        self.pixels
            .iter()
            .flat_map(|[r, g, b, t]| {
                [(r, 0), (g, 1), (b, 2)].map(|(c, channel)| value(t.mul_add(background[channel], *c)))
            })
            .collect()
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
}
