//! Renders the picture that follows a volume during its reconstruction.

use std::path::Path;
use std::time::{Duration, Instant};

use tracing::trace_span;

use pipeline::InsertedSlice;
use pipeline::trace::STAGE;
use render::settings::CACHE_BYTES;
use render::{Cache, RenderRegion, RenderSettings, Renderer};
use sonoweave_core::region::ClipRect;
use sonoweave_core::slice::Slice;
use statistics::{Milliseconds, PictureNumbers, PictureStatistics};
use volume::brick::BrickIndex;
use volume::lattice::{Shifted, canonical, shift};

use super::series::Series;
use crate::cli::Failure;
use crate::cli::render::drawing::Over;
use crate::cli::render::planar::Draw;
use crate::cli::render::view_flags::ViewFlags;

/// Renders after each slice.
pub(super) struct Following<'a> {
    look: &'a ViewFlags,
    window: Option<[f32; 2]>,
    threads: usize,
    series: Option<Series>,
    pub(super) cache: Cache,
    pub(super) cache_bytes: u64,
    begun: Option<Begun>,
    slices: u64,
    to_picture_ms: Vec<f64>,
    shade_ms: Vec<f64>,
    rays_ms: Vec<f64>,
    shifted: Vec<BrickIndex>,
}

/// State that the first slice determines.
struct Begun {
    renderer: Renderer,
    /// Offset of voxel indices from the inserter's lattice to the canonical one.
    offset: [i64; 3],
    /// The last slice, and the rectangle of its data.
    last: Option<(Slice, ClipRect)>,
}

impl Begun {
    /// Returns the present picture and the data for annotations.
    fn over<'a>(&'a self, look: &ViewFlags) -> Over<'a> {
        let slice = self.last.as_ref().map(|(slice, data)| (slice, *data));
        Over { renderer: &self.renderer, background: look.background, slice }
    }
}

impl<'a> Following<'a> {
    pub(super) fn new(look: &'a ViewFlags, window: Option<[f32; 2]>, threads: usize, series: Option<Series>) -> Self {
        Self {
            look,
            window,
            threads,
            series,
            cache: Cache::default(),
            cache_bytes: CACHE_BYTES,
            begun: None,
            slices: 0,
            to_picture_ms: Vec::new(),
            shade_ms: Vec::new(),
            rays_ms: Vec::new(),
            shifted: Vec::new(),
        }
    }

    /// Begins at the first slice, when the lattice and the extent of all slices are known.
    fn begin(&self, woven: &InsertedSlice) -> Result<Begun, Failure> {
        let range = self.window.unwrap_or_else(|| woven.pixels.grey_levels());
        let settings = RenderSettings {
            cache: self.cache,
            cache_bytes: self.cache_bytes,
            ..self.look.settings(range, woven.slice_axes, self.threads)?
        };
        let lattice = canonical(woven.weaver.world_from_lattice());
        let Some(reached) = woven.reached else {
            return Err(Failure("no slice has a pose; check the transforms".into()));
        };
        let [low, high] = reached.map(|voxel| lattice.index(voxel));
        let stage = RenderRegion::new(lattice.world_from_lattice, low, high)?;
        Ok(Begun { renderer: Renderer::new(&settings, stage)?, offset: lattice.offset, last: None })
    }

    /// Draws what a slice has changed.
    ///
    /// # Errors
    /// [`Failure`] when a picture cannot be drawn or written.
    pub(super) fn look(&mut self, woven: &InsertedSlice) -> Result<(), Failure> {
        if self.begun.is_none() {
            self.begun = Some(self.begin(woven)?);
        }
        let Some(begun) = &mut self.begun else { return Ok(()) };
        let Begun { renderer, offset, last } = begun;
        *last = woven.mask.bounds().map(|data| (woven.slice.clone(), data));
        let began = Instant::now();
        let span = trace_span!(target: STAGE, "draw", frame = woven.item, slices = self.slices + 1).entered();
        let volume = Shifted::new(woven.weaver.volume(), *offset);
        let updated = if woven.upgraded {
            renderer.update_all(&volume)
        } else {
            let bricks = if *offset == [0; 3] {
                woven.touched
            } else {
                shift(woven.touched, *offset, &mut self.shifted);
                &self.shifted
            };
            match woven.slab {
                Some(slab) => renderer.update_within(&volume, bricks, &slab.shifted(*offset)),
                None => renderer.update(&volume, bricks),
            }
        };
        drop(span);
        let milliseconds = |duration: Duration| duration.as_secs_f64() * 1e3;
        self.to_picture_ms.push(milliseconds(woven.insert + began.elapsed()));
        self.shade_ms.push(milliseconds(updated.shade));
        self.rays_ms.push(milliseconds(updated.rays));
        self.slices += 1;
        if let Some(path) =
            self.series.as_ref().and_then(|series| series.path(self.slices - 1, self.slices, woven.item))
        {
            begun.over(self.look).write(&self.look.planar.drawn(&[Draw::Slice, Draw::Probe]), &path)?;
        }
        Ok(())
    }

    /// Writes the last picture. Returns `None` if there was no slice.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be written.
    pub(super) fn finish(&self, path: Option<&Path>) -> Result<Option<PictureStatistics>, Failure> {
        let Some(begun) = &self.begun else { return Ok(None) };
        let mut drawn = Vec::new();
        if let Some(path) = path {
            drawn = begun.over(self.look).write(&self.look.planar.drawn(&[]), path)?;
        }
        Ok(Some(PictureStatistics {
            slice_to_picture_ms: Milliseconds::of(&self.to_picture_ms),
            shade_ms: Milliseconds::of(&self.shade_ms),
            rays_ms: Milliseconds::of(&self.rays_ms),
            drawn,
            picture: PictureNumbers::of(&begun.renderer, self.look.image_size),
        }))
    }
}

/// Prints the drawn pictures and their timings to stdout, and notes for the user to stderr.
#[allow(clippy::print_stdout, clippy::print_stderr, reason = "the command's output")]
pub(super) fn report(statistics: &PictureStatistics, path: Option<&Path>) {
    let PictureStatistics { slice_to_picture_ms, picture, .. } = statistics;
    for note in &picture.notes {
        eprintln!("sonoweave: note: {note}");
    }
    let Some(ms) = slice_to_picture_ms else { return };
    let name = path.map_or_else(|| "the picture".into(), |path| path.display().to_string());
    let [width, height] = picture.image_size;
    println!(
        "{name}: {width}×{height} pixels, {:.2} ms from slice to picture (median; p95 {:.2}, p99 {:.2}), {} cache of {:.0} MB",
        ms.median,
        ms.p95,
        ms.p99,
        picture.cache,
        picture.cache_bytes as f64 / 1e6
    );
}
