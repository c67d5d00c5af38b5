//! Annotations over a rendered picture, and its file.

use std::path::Path;

use config::view_settings::Draw;
use export::annotation::scale::Bar;
use export::annotation::slice::SliceMarks;
use export::annotation::{copy, cube};
use export::picture::write_rgb;
use image::RgbImage;
use render::Renderer;
use sonoweave_core::region::ClipRect;
use sonoweave_core::slice::Slice;

use crate::failure::Failure;

/// A picture, and the data for annotations over it.
pub(crate) struct Over<'a> {
    pub(crate) renderer: &'a Renderer,
    pub(crate) background: [f32; 3],
    /// The last slice, and the rectangle of its data.
    pub(crate) slice: Option<(&'a Slice, ClipRect)>,
}

impl Over<'_> {
    /// Writes the picture, with annotations on a copy of it. Returns the names of the drawn
    /// annotations. An annotation without room, or outside the picture, is left out.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be written.
    pub(crate) fn write(&self, draw: &[Draw], path: &Path) -> Result<Vec<&'static str>, Failure> {
        let (over, drawn) = self.image(draw);
        write_rgb(&over, path)?;
        Ok(drawn)
    }

    /// Returns the picture with annotations, and the names of those that are drawn.
    pub(crate) fn image(&self, draw: &[Draw]) -> (RgbImage, Vec<&'static str>) {
        let mut over = copy(&self.renderer.picture(), self.background);
        let (camera, middle) = (self.renderer.camera(), self.renderer.region().centre_mm());
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
        (over, drawn)
    }
}
