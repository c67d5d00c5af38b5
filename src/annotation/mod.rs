//! What is drawn over finished pictures: where the current slice and the probe are, how long a millimetre is, and how the world lies.
//!
//! - [`ink`]: antialiased lines and areas, gathered before they are laid on a picture.
//! - [`mod@slice`]: the outline of a slice and a probe above it.
//! - [`scale`]: a scale bar.
//! - [`cube`]: a cube whose faces name the world's axes.
//!
//! All draw on a copy of 8 bit pixels, after rendering: what is kept for the next picture never sees them. Each takes a [`Camera`] and so fits parallel and
//! perspective views alike.

use image::{Rgb, RgbImage};

use crate::render::Picture;
use crate::render::camera::Camera;

pub mod cube;
pub mod ink;
pub mod scale;
pub mod slice;

#[cfg(test)]
mod tests;

/// Colour of lettering and of the scale bar.
const INK: Rgb<u8> = Rgb([236, 236, 236]);
/// Beneath lines and letters, so that they are read before white and before black.
const SHADE: Rgb<u8> = Rgb([8, 8, 12]);

/// A picture before its background, to be drawn on.
///
/// # Panics
/// When the picture's pixels do not fill it: the renderer has just made both.
pub fn copy(picture: &Picture, background: [f32; 3]) -> RgbImage {
    let [width, height] = picture.size;
    RgbImage::from_raw(width, height, picture.over(background)).expect("three values a pixel")
}

/// Pixels a dot of the lettering, in pictures of a size.
fn dot(camera: &Camera) -> u32 {
    let [width, height] = camera.size();
    1 + u32::from(width.min(height) >= 400)
}
