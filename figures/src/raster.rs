//! Raster images within a figure.

use std::error::Error;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
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
        format!("data:image/png;base64,{}", STANDARD.encode(png))
    }
}
