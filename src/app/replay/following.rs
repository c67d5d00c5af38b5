//! Renders the picture that follows a volume during its reconstruction.

use std::path::Path;
use std::time::{Duration, Instant};

use tracing::trace_span;

use config::view_settings::Draw;
use pipeline::InsertedSlice;
use pipeline::trace::STAGE;
use render::settings::CACHE_BYTES;
use render::{Cache, RenderRegion, RenderSettings, Renderer};
use sonoweave_core::region::ClipRect;
use sonoweave_core::slice::Slice;
use statistics::{Milliseconds, PictureNumbers, PictureStatistics};
use volume::brick::BrickIndex;
use volume::lattice::{Shifted, canonical, shift};

use super::follow::Follow;
use super::series::Series;
use super::session_movie::SessionMovie;
use crate::app::render::drawing::Over;
use crate::app::render::look::Look;
use crate::failure::Failure;

/// Renders after each slice.
pub(crate) struct Following {
    look: Look,
    window: Option<[f32; 2]>,
    threads: usize,
    series: Option<Series>,
    pub(crate) movie: Option<SessionMovie>,
    pub(crate) cache: Cache,
    pub(crate) cache_bytes: u64,
    first: Option<FirstSlice>,
    slices: u64,
    to_picture_ms: Vec<f64>,
    shade_ms: Vec<f64>,
    rays_ms: Vec<f64>,
    shifted: Vec<BrickIndex>,
}

/// State that the first slice determines.
struct FirstSlice {
    renderer: Renderer,
    /// Offset of voxel indices from the inserter's lattice to the canonical one.
    offset: [i64; 3],
    /// The last slice, and the rectangle of its data.
    last: Option<(Slice, ClipRect)>,
}

impl FirstSlice {
    /// Returns the present picture and the data for annotations.
    fn over<'a>(&'a self, look: &Look) -> Over<'a> {
        let slice = self.last.as_ref().map(|(slice, data)| (slice, *data));
        Over::of(&self.renderer, look.background, slice)
    }
}

impl Following {
    pub(crate) fn new(look: &Look, window: Option<[f32; 2]>, threads: usize, series: Option<Series>) -> Self {
        Self {
            look: look.clone(),
            window,
            threads,
            series,
            movie: None,
            cache: Cache::default(),
            cache_bytes: CACHE_BYTES,
            first: None,
            slices: 0,
            to_picture_ms: Vec::new(),
            shade_ms: Vec::new(),
            rays_ms: Vec::new(),
            shifted: Vec::new(),
        }
    }

    /// Begins at the first slice, when the lattice and the extent of all slices are known.
    fn begin(&self, inserted: &InsertedSlice) -> Result<FirstSlice, Failure> {
        let range = self.window.unwrap_or_else(|| inserted.pixels.grey_levels());
        let settings = RenderSettings {
            cache: self.cache,
            cache_bytes: self.cache_bytes,
            ..self.look.settings(range, inserted.slice_axes, self.threads)?
        };
        let lattice = canonical(inserted.reconstructor.world_from_lattice());
        let Some(reached) = inserted.reached else {
            fail!("no slice has a pose; check the transforms");
        };
        let [low, high] = reached.map(|voxel| lattice.index(voxel));
        let stage = RenderRegion::new(lattice.world_from_lattice, low, high)?;
        Ok(FirstSlice { renderer: Renderer::new(&settings, stage)?, offset: lattice.offset, last: None })
    }

    /// Writes the last picture. Returns `None` if there was no slice.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be written.
    pub(crate) fn finish(&self, path: Option<&Path>) -> Result<Option<PictureStatistics>, Failure> {
        let Some(first) = &self.first else { return Ok(None) };
        let mut drawn = Vec::new();
        if let Some(path) = path {
            drawn = first.over(&self.look).write(&self.look.planar.drawn(&[]), path)?;
        }
        Ok(Some(PictureStatistics {
            slice_to_picture_ms: Milliseconds::of(&self.to_picture_ms),
            shade_ms: Milliseconds::of(&self.shade_ms),
            rays_ms: Milliseconds::of(&self.rays_ms),
            drawn,
            picture: PictureNumbers::of(&first.renderer, self.look.view.image_size),
        }))
    }
}

impl Follow for Following {
    fn follow(&mut self, inserted: &InsertedSlice<'_>) -> Result<(), Failure> {
        if self.first.is_none() {
            self.first = Some(self.begin(inserted)?);
        }
        let Some(first) = &mut self.first else { return Ok(()) };
        let FirstSlice { renderer, offset, last } = first;
        *last = inserted.mask.bounds().map(|data| (inserted.slice.clone(), data));
        let began = Instant::now();
        let span = trace_span!(target: STAGE, "draw", frame = inserted.item, slices = self.slices + 1).entered();
        let volume = Shifted::new(inserted.reconstructor.volume(), *offset);
        let updated = if inserted.upgraded {
            renderer.update_all(&volume)
        } else {
            let bricks = if *offset == [0; 3] {
                inserted.touched
            } else {
                shift(inserted.touched, *offset, &mut self.shifted);
                &self.shifted
            };
            match inserted.slab {
                Some(slab) => renderer.update_within(&volume, bricks, &slab.shifted(*offset)),
                None => renderer.update(&volume, bricks),
            }
        };
        drop(span);
        let milliseconds = |duration: Duration| duration.as_secs_f64() * 1e3;
        self.to_picture_ms.push(milliseconds(inserted.insert + began.elapsed()));
        self.shade_ms.push(milliseconds(updated.shade));
        self.rays_ms.push(milliseconds(updated.rays));
        self.slices += 1;
        let draw = self.look.planar.drawn(&[Draw::Slice, Draw::Probe]);
        if let Some(movie) = &mut self.movie {
            movie.add(inserted.slice.time_ns, first.over(&self.look).image(&draw).0)?;
        }
        if let Some(path) =
            self.series.as_ref().and_then(|series| series.path(self.slices - 1, self.slices, inserted.item))
        {
            first.over(&self.look).write(&draw, &path)?;
        }
        Ok(())
    }
}
