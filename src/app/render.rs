//! Renders a volume to pictures.

pub(crate) mod drawing;
pub(crate) mod look;
pub(crate) mod planar;
mod planes;
mod request;

use std::path::{Path, PathBuf};
use std::time::Instant;

use image::RgbImage;
use serde::Serialize;

use config::view_settings::Mode;
use render::{Cache, RenderRegion, RenderSettings, Renderer};
use statistics::PictureNumbers;
use volume::DenseVolume;

use super::json::document;
use super::reporter::Steps;
use super::volume_input::dense;
use crate::failure::Failure;
use drawing::Over;
use look::Look;
pub(crate) use request::{Contents, Rendered, Request};
use request::{Source, milliseconds};

/// The report, in its JSON form.
#[derive(Debug, Serialize)]
struct Statistics<'a> {
    #[serde(flatten)]
    source: Source<'a>,
    mode: &'static str,
    transfer: &'a str,
    window: [f32; 2],
    perspective: Option<f64>,
    step: f64,
    /// `null` if rays do not end early.
    stop: Option<f32>,
    background: [f32; 3],
    threads: usize,
    /// Time to read the volume, ms.
    read_ms: f64,
    /// Time from the command's start to the last picture, s.
    wall_s: f64,
    pictures: Vec<Drawn>,
    notes: Vec<String>,
}

/// One picture.
#[derive(Debug, Serialize)]
struct Drawn {
    path: PathBuf,
    /// Annotations drawn over it.
    drawn: Vec<&'static str>,
    /// Azimuth, elevation, roll, degrees.
    view: [f64; 3],
    /// Time to set up the rays.
    prepare_ms: f64,
    /// Time to read, classify and light voxels.
    shade_ms: f64,
    /// Time to sample and composite rays.
    rays_ms: f64,
    /// Time to encode and write the file.
    write_ms: f64,
    #[serde(flatten)]
    numbers: PictureNumbers,
}

impl Request<'_> {
    /// Renders the volume.
    ///
    /// # Errors
    /// [`Failure`]: the picture that failed was not written then.
    pub(crate) fn run(&self, steps: Steps<'_>) -> Result<Rendered, Failure> {
        let began = Instant::now();
        let Self { look, output, .. } = self;
        let volume = dense(self.volume, self.weights, self.memory_bytes)?;
        let read_ms = milliseconds(began);
        let mut notes = volume.notes().to_vec();
        if volume.seen() == 0 {
            notes.push(format!("{}: no voxel was seen, so the picture is all background", self.volume.display()));
        }
        if look.view.mode == Mode::Slice {
            return planes::run(self, &volume, began, read_ms, notes);
        }
        let window = self.window.unwrap_or_else(|| volume.range());
        let settings =
            RenderSettings { cache: Cache::None, ..look.settings(window, volume.slice_axes(), self.threads)? };
        let [low, high] = volume.bounds();
        let stage = RenderRegion::new(volume.world_from_lattice(), low, high)?;
        let turns = self.turntable.map_or(1, u64::from);
        let step = steps("rendering", turns);
        let mut pictures = Vec::new();
        for turn in 0..turns {
            let path = match self.turntable {
                None => output.to_path_buf(),
                Some(_) => numbered(output, turn),
            };
            let turned = self.turntable.map(|_| 360.0 * turn as f64 / turns as f64);
            let drawn = draw(&volume, stage, &settings, look, turned, path);
            pictures.push(drawn?);
            step(turn + 1);
        }
        drop(step);
        let wall_s = began.elapsed().as_secs_f64();
        let statistics = Statistics {
            source: Source::new(self, &volume),
            mode: settings.mode.name(),
            transfer: look.view.transfer_name(),
            window,
            perspective: look.view.perspective,
            step: look.view.step,
            stop: look.view.stops(),
            background: look.background,
            threads: settings.threads,
            read_ms,
            wall_s,
            pictures,
            notes: notes.clone(),
        };
        let document = document(&statistics)?;
        Ok(Rendered { contents: Contents::Rays(settings.view), document, wall_s, notes })
    }
}

/// Returns the picture of a volume. `window` has the grey values of black and white; `None` for
/// the volume's.
///
/// # Errors
/// [`Failure`] when the settings do not suit the volume.
pub(crate) fn image(
    volume: &DenseVolume,
    look: &Look,
    window: Option<[f32; 2]>,
    threads: usize,
) -> Result<RgbImage, Failure> {
    let window = window.unwrap_or_else(|| volume.range());
    if look.view.mode == Mode::Slice {
        return Ok(planes::draw(volume, look, window, threads)?.0);
    }
    let settings = RenderSettings { cache: Cache::None, ..look.settings(window, volume.slice_axes(), threads)? };
    let [low, high] = volume.bounds();
    let stage = RenderRegion::new(volume.world_from_lattice(), low, high)?;
    let view = look.view.view(volume.slice_axes(), 0.0, false);
    let mut renderer = Renderer::new(&RenderSettings { view, ..settings }, stage)?;
    renderer.update_all(volume);
    let over = Over { renderer: &renderer, background: look.background, slice: None };
    Ok(over.image(&look.planar.drawn(&[])).0)
}

fn draw(
    volume: &DenseVolume,
    stage: RenderRegion,
    settings: &RenderSettings,
    look: &Look,
    turned: Option<f64>,
    path: PathBuf,
) -> Result<Drawn, Failure> {
    let began = Instant::now();
    let view = look.view.view(volume.slice_axes(), turned.unwrap_or(0.0), turned.is_some());
    let mut renderer = Renderer::new(&RenderSettings { view, ..settings.clone() }, stage)?;
    let prepare_ms = milliseconds(began);
    let updated = renderer.update_all(volume);
    let began = Instant::now();
    let drawn =
        Over { renderer: &renderer, background: look.background, slice: None }.write(&look.planar.drawn(&[]), &path)?;
    Ok(Drawn {
        path,
        drawn,
        view: [view.azimuth, view.elevation, view.roll],
        prepare_ms,
        shade_ms: updated.shade.as_secs_f64() * 1e3,
        rays_ms: updated.rays.as_secs_f64() * 1e3,
        write_ms: milliseconds(began),
        numbers: PictureNumbers::of(&renderer, look.view.image_size),
    })
}

/// Converts `IMG.png` to `IMG-007.png`.
pub(crate) fn numbered(path: &Path, number: u64) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}-{number:03}.png"))
}
