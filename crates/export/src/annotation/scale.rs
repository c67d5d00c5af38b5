//! The scale bar of a picture.

use glam::DVec3;
use image::RgbImage;

use render::camera::Camera;

use super::ink::Ink;
use super::{INK, SHADE, dot};
use crate::legend::round_length;
use crate::lettering;

/// Distance from the picture's edges, pixels.
const MARGIN: u32 = 14;

/// A bar of a round number of millimetres.
#[derive(Debug, Clone, PartialEq)]
pub struct Bar {
    /// Its length in the world, mm: 1, 2 or 5 times a power of ten.
    pub mm: f64,
    /// Its length in the picture, pixels.
    pub px: f64,
    /// Its label.
    pub label: String,
}

impl Bar {
    /// Creates the longest bar of at most a quarter of a picture's width. In a perspective view
    /// its scale is the one at `middle`, and the label gives this.
    pub fn new(camera: &Camera, middle: DVec3) -> Option<Self> {
        let [from, to] = [middle, middle + camera.axes().right].map(|at| camera.project_world(at));
        let px_per_mm = to?[0] - from?[0];
        let mm = round_length(0.25 * f64::from(camera.size()[0]) / px_per_mm)?;
        let place = if camera.is_perspective() { " at the middle" } else { "" };
        Some(Self { mm, px: mm * px_per_mm, label: format!("{mm} mm{place}") })
    }

    /// Draws it at the picture's lower left; returns whether there was room.
    pub fn draw(&self, picture: &mut RgbImage, camera: &Camera) -> bool {
        let (dot, size) = (dot(camera), camera.size());
        let text = lettering::width(&self.label, dot);
        let tall = lettering::height(dot) + 3 * MARGIN;
        if size[1] < tall || size[0] < 2 * MARGIN + text.max(self.px.ceil() as u32) {
            return false;
        }
        let y = f64::from(size[1] - MARGIN);
        let (left, right) = (f64::from(MARGIN), f64::from(MARGIN) + self.px);
        let mut ink = [Ink::new(size), Ink::new(size)];
        for (ink, wider) in ink.iter_mut().zip([2.0, 0.0]) {
            let width = f64::from(dot) + wider;
            ink.line([[left, y], [right, y]], width, [1.0; 2]);
            for end in [left, right] {
                ink.line([[end, y - 4.0], [end, y + 4.0]], width, [1.0; 2]);
            }
        }
        ink[0].lay(picture, SHADE, 0.6);
        ink[1].lay(picture, INK, 1.0);
        let top = size[1] - MARGIN - 8 - lettering::height(dot);
        lettering::write_shaded(picture, [MARGIN, top], dot, [INK, SHADE], &self.label);
        true
    }
}
