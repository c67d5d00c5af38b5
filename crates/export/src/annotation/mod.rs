//! Overlays on finished pictures: the current slice and the probe, a scale bar, and the world's
//! orientation.
//!
//! - [`ink`]: antialiased lines and areas, collected before they are drawn on a picture.
//! - [`mod@slice`]: the outline of a slice and a probe above it.
//! - [`scale`]: a scale bar.
//! - [`cube`]: a cube whose faces name the world's axes.
//!
//! Overlays are drawn on a copy of the 8 bit pixels, after rendering, and do not affect the data
//! kept for the next picture. Each takes a [`Camera`], and so supports parallel and perspective
//! views alike.

use image::{Rgb, RgbImage};

use render::Picture;
use render::camera::Camera;

pub mod cube;
pub mod ink;
pub mod scale;
pub mod slice;

#[cfg(test)]
mod tests;

/// Colour of lettering and of the scale bar.
const INK: Rgb<u8> = Rgb([236, 236, 236]);
/// Outline colour of lines and letters, for contrast on white and on black.
const SHADE: Rgb<u8> = Rgb([8, 8, 12]);

/// Returns a picture over its background, as a copy to draw on.
///
/// # Panics
/// When the number of the picture's pixels does not match its size: the renderer has just made
/// both.
pub fn copy(picture: &Picture, background: [f32; 3]) -> RgbImage {
    let [width, height] = picture.size;
    RgbImage::from_raw(width, height, picture.over(background)).expect("three values a pixel")
}

/// Returns the pixels per dot of the lettering, by picture size.
fn dot(camera: &Camera) -> u32 {
    let [width, height] = camera.size();
    1 + u32::from(width.min(height) >= 400)
}
