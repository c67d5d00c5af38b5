//! Annotations over a rendered picture, and its file.

use std::path::Path;

use config::view_settings::Draw;
use export::annotation::scale::Bar;
use export::annotation::slice::SliceMarks;
use export::annotation::{copy, cube};
use export::picture::write_rgb;
use image::RgbImage;
use render::camera::Camera;
use render::{Picture, RenderRegion, Renderer};
use sonoweave_core::region::ClipRect;
use sonoweave_core::slice::Slice;

use crate::failure::Failure;

/// A picture, and the data for annotations over it.
pub(crate) struct Over<'a> {
    picture: Picture,
    camera: &'a Camera,
    region: &'a RenderRegion,
    background: [f32; 3],
    /// The last slice, the rectangle of its data, and the renderer that knows what hides it.
    slice: Option<(&'a Slice, ClipRect, &'a Renderer)>,
}

impl<'a> Over<'a> {
    /// Takes a renderer's present picture, and the last slice with the rectangle of its data.
    pub(crate) fn of(renderer: &'a Renderer, background: [f32; 3], slice: Option<(&'a Slice, ClipRect)>) -> Self {
        let slice = slice.map(|(slice, data)| (slice, data, renderer));
        Self { slice, ..Self::of_picture(renderer.picture(), renderer.camera(), renderer.region(), background) }
    }

    /// Takes a picture by a camera, without a slice.
    pub(crate) fn of_picture(
        picture: Picture,
        camera: &'a Camera,
        region: &'a RenderRegion,
        background: [f32; 3],
    ) -> Self {
        Self { picture, camera, region, background, slice: None }
    }

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
        let mut over = copy(&self.picture, self.background);
        let (camera, middle) = (self.camera, self.region.centre_mm());
        let seen = self.slice.map(|(.., renderer)| move |at| renderer.transmittance_to(at));
        let marks = self.slice.zip(seen.as_ref()).map(|((slice, data, _), seen)| SliceMarks {
            world_from_image: slice.world_from_image,
            data,
            seen,
        });
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
