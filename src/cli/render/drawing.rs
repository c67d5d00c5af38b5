//! What is drawn over a rendered picture, and its file.

use std::path::Path;

use super::planar::Draw;
use crate::annotation::scale::Bar;
use crate::annotation::slice::SliceMarks;
use crate::annotation::{copy, cube};
use crate::cli::Failure;
use crate::export::picture::{write_picture, write_rgb};
use crate::render::Renderer;
use crate::slice::Slice;
use calibration::region::ClipRect;

/// A picture and what can be drawn over it.
pub(in crate::cli) struct Over<'a> {
    pub(in crate::cli) renderer: &'a Renderer,
    pub(in crate::cli) background: [f32; 3],
    /// The slice that came last, and the rectangle of its data.
    pub(in crate::cli) slice: Option<(&'a Slice, ClipRect)>,
}

impl Over<'_> {
    /// Writes the picture; what is drawn over it is drawn on a copy. Returns the names of what was drawn: what has no room, or lies outside, is left out.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be written.
    pub(in crate::cli) fn write(&self, draw: &[Draw], path: &Path) -> Result<Vec<&'static str>, Failure> {
        let picture = self.renderer.picture();
        if draw.is_empty() {
            write_picture(&picture, self.background, path)?;
            return Ok(Vec::new());
        }
        let mut over = copy(&picture, self.background);
        let (camera, middle) = (self.renderer.camera(), self.renderer.stage().centre_mm());
        let seen = |at| self.renderer.transmittance_to(at);
        let marks =
            self.slice.map(|(slice, data)| SliceMarks { world_from_image: slice.world_from_image, data, seen: &seen });
        let mut drawn = Vec::new();
        for what in draw {
            let done = match what {
                Draw::Slice => marks.as_ref().is_some_and(|marks| marks.outline(&mut over, camera) > 0),
                Draw::Probe => marks.as_ref().is_some_and(|marks| marks.probe(&mut over, camera) > 0),
                Draw::Scale => Bar::new(camera, middle).is_some_and(|bar| bar.draw(&mut over, camera)),
                Draw::Cube => !cube::draw(&mut over, camera).is_empty(),
                Draw::None => false,
            };
            if done {
                drawn.push(what.name());
            }
        }
        write_rgb(&over, path)?;
        Ok(drawn)
    }
}
