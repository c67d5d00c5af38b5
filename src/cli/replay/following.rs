//! The picture that follows a volume while it is woven.

use std::path::Path;
use std::time::{Duration, Instant};

use calibration::region::ClipRect;
use tracing::trace_span;

use super::series::Series;
use crate::cli::Failure;
use crate::cli::render::drawing::Over;
use crate::cli::render::look::Look;
use crate::cli::render::planar::Draw;
use crate::pipeline::{Onlooker, Woven};
use crate::render::settings::CACHE_BYTES;
use crate::render::{Cache, RenderSettings, Renderer, Stage};
use crate::slice::Slice;
use crate::statistics::{Milliseconds, PictureNumbers, PictureStatistics};
use crate::trace::STAGE;
use crate::volume::brick::BrickIndex;
use crate::volume::lattice::{Shifted, canonical, shift};

/// Renders after each slice.
pub(super) struct Following<'a> {
    look: &'a Look,
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

/// What the first slice has settled.
struct Begun {
    renderer: Renderer,
    /// Of voxel indices from the weaver's lattice to the canonical one.
    offset: [i64; 3],
    /// The slice that came last, and the rectangle of its data.
    last: Option<(Slice, ClipRect)>,
}

impl Begun {
    /// The picture as it is and what is drawn over it.
    fn over<'a>(&'a self, look: &Look) -> Over<'a> {
        let slice = self.last.as_ref().map(|(slice, data)| (slice, *data));
        Over { renderer: &self.renderer, background: look.background, slice }
    }
}

impl<'a> Following<'a> {
    pub(super) fn new(look: &'a Look, window: Option<[f32; 2]>, threads: usize, series: Option<Series>) -> Self {
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

    /// The lattice and where all slices will lie are known now.
    fn begin(&self, woven: &Woven) -> Result<Begun, Failure> {
        let range = self.window.unwrap_or_else(|| woven.pixels.grey_levels());
        let settings = RenderSettings {
            cache: self.cache,
            cache_bytes: self.cache_bytes,
            ..self.look.settings(range, woven.slice_axes, self.threads)?
        };
        let lattice = canonical(woven.weaver.world_from_lattice());
        let Some(reached) = woven.reached else {
            return Err(Failure("no slice has a place that could be looked at; check the transforms".into()));
        };
        let [low, high] = reached.map(|voxel| lattice.index(voxel));
        let stage = Stage::new(lattice.world_from_lattice, low, high)?;
        Ok(Begun { renderer: Renderer::new(&settings, stage)?, offset: lattice.offset, last: None })
    }

    fn look(&mut self, woven: &Woven) -> Result<(), Failure> {
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

    /// Writes the last picture. `None` where no slice came.
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

impl Onlooker for Following<'_> {
    fn woven(&mut self, woven: &Woven) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        self.look(woven).map_err(|Failure(sentence)| sentence.into())
    }
}

/// What was drawn and how long it took, on stdout; what the user should know, on stderr.
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
