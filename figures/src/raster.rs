//! Raster images within a figure.

use std::error::Error;

use resvg::tiny_skia::{ColorU8, Pixmap};

/// Pixels, row by row from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    width: u32,
    height: u32,
    /// Red, green, blue of each pixel.
    rgb: Vec<u8>,
}

impl Raster {
    /// Makes an image of three bytes per pixel; `None` if they do not match the size.
    pub fn rgb(size: [u32; 2], rgb: Vec<u8>) -> Option<Self> {
        let [width, height] = size;
        let whole = u64::from(width) * u64::from(height) * 3 == rgb.len() as u64 && !rgb.is_empty();
        whole.then_some(Self { width, height, rgb })
    }

    /// Makes an image of one byte per pixel, black to white; `None` if they do not match the
    /// size.
    pub fn grey(size: [u32; 2], grey: &[u8]) -> Option<Self> {
        Self::rgb(size, grey.iter().flat_map(|g| [*g; 3]).collect())
    }

    /// Returns width over height.
    pub(crate) fn aspect(&self) -> f64 {
        f64::from(self.width) / f64::from(self.height)
    }

    pub(crate) fn width(&self) -> u32 {
        self.width
    }

    /// Returns a pixmap.
    ///
    /// # Errors
    /// If it is larger than memory.
    pub(crate) fn pixmap(&self) -> Result<Pixmap, Box<dyn Error>> {
        let mut pixmap = Pixmap::new(self.width, self.height).ok_or("the picture is larger than memory")?;
        for (to, from) in pixmap.pixels_mut().iter_mut().zip(self.rgb.chunks_exact(3)) {
            *to = ColorU8::from_rgba(from[0], from[1], from[2], 255).premultiply();
        }
        Ok(pixmap)
    }

    /// Returns a PNG as a data URL, which an SVG can show.
    pub(crate) fn address(&self) -> String {
        let png = self.pixmap().and_then(|pixmap| Ok(pixmap.encode_png()?)).unwrap_or_default();
        format!("data:image/png;base64,{}", base64(&png))
    }
}

/// Base64 as in RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let word = group.iter().fold(0_u32, |word, byte| word << 8 | u32::from(*byte)) << (8 * (3 - group.len()));
        for k in 0..4 {
            let letter = LETTERS[(word >> (18 - 6 * k) & 63) as usize];
            text.push(if k > group.len() { '=' } else { char::from(letter) });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_matches_rfc_examples() {
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
        assert_eq!(base64(&[0xfb, 0xff]), "+/8=");
    }

    #[test]
    fn image_with_wrong_byte_count_is_none() {
        assert!(Raster::grey([2, 2], &[0; 3]).is_none() && Raster::rgb([1, 1], vec![0; 4]).is_none());
        assert!(Raster::grey([0, 2], &[]).is_none());
        let picture = Raster::grey([2, 1], &[0, 255]).unwrap();
        assert_eq!(picture.pixmap().unwrap().pixels()[1].red(), 255);
    }
}
