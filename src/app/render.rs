//! Renders a volume to pictures.

pub(crate) mod drawing;
pub(crate) mod look;
mod message;
pub(crate) mod planar;
mod planes;
mod rays;
mod request;
mod volume;

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use export::movie::Movie;
use formats::whole::{persist, temporary};
use image::RgbImage;
use serde::Serialize;
use simd::team::Team;

use config::view_settings::Mode;
use render::camera::View;
use render::classify::soft::SoftLight;
use render::settings::team;
use render::{Cache, RenderRegion, RenderSettings};
use statistics::PictureNumbers;

use super::json::document;
use super::part::Part;
use super::reporter::Steps;
use crate::failure::Failure;
use drawing::Over;
use look::Look;
pub(crate) use message::Named;
use rays::{Finished, Rays};
pub(crate) use request::{Contents, Rendered, Request, Task};
use request::{Source, milliseconds};
use volume::LevelOnDisk;
pub(crate) use volume::RenderVolume;

/// The report, in its JSON form.
#[derive(Debug, Serialize)]
struct Statistics<'a> {
    #[serde(flatten)]
    source: Source<'a>,
    mode: &'static str,
    transfer: &'a str,
    /// Preset of soft light.
    soft: Option<&'a str>,
    window: [f32; 2],
    perspective: Option<f64>,
    step: f64,
    /// `null` if rays do not end early.
    stop: Option<f32>,
    background: [f32; 3],
    /// Operations of the crop that hide parts of the volume.
    crop: usize,
    threads: usize,
    /// Time to read the volume, ms.
    read_ms: f64,
    /// Time from the command's start to the last picture, s.
    wall_s: f64,
    pictures: Vec<Drawn>,
    /// `null` if each picture is a file.
    movie: Option<Made>,
    notes: Vec<String>,
}

/// The movie of all pictures.
#[derive(Debug, Serialize)]
struct Made {
    /// Pictures a second.
    hz: f64,
    bytes: u64,
}

/// One picture.
#[derive(Debug, Serialize)]
struct Drawn {
    path: PathBuf,
    /// Annotations drawn over it.
    drawn: Vec<&'static str>,
    /// Azimuth, elevation, roll, degrees.
    view: [f64; 3],
    /// Bands of rows, one rendered after the other, and the memory of the compositor of one; `null`
    /// without parts.
    bands: u32,
    /// Bricks smoothed for soft light.
    bricks_smoothed: Option<u64>,
    compositor_bytes: Option<u64>,
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
        let volume = RenderVolume::open(self.volume, self.weights, self.level, self.memory_bytes)?;
        let read_ms = milliseconds(began);
        if self.look.view.mode == Mode::Slice {
            return planes::run(self, &volume, began, read_ms);
        }
        let scene = Scene::new(&volume, self.look, self.window, self.threads, self.memory_bytes)?;
        match &self.task {
            Task::Pictures => self.pictures(&scene, steps, began, read_ms),
            Task::Part(part, is_folded) => self.part(&scene, *part, *is_folded, began),
            Task::Composite(messages) => self.composite(&scene, messages, began, read_ms),
        }
    }

    fn pictures(&self, scene: &Scene<'_>, steps: Steps<'_>, began: Instant, read_ms: f64) -> Result<Rendered, Failure> {
        let turns = self.turntable.map_or(1, u64::from);
        let step = steps("rendering", turns);
        let (mut pictures, mut notes, mut renderer) = (Vec::new(), Vec::new(), None);
        let mut movie = self.movie.map(|rate| Movie::create(self.output, scene.settings.size, rate)).transpose()?;
        for turn in 0..turns {
            let path = match (self.turntable, &movie) {
                (Some(_), None) => numbered(self.output, turn),
                _ => self.output.to_path_buf(),
            };
            let turned = self.turntable.map(|_| 360.0 * turn as f64 / turns as f64);
            let view = self.look.view.view(scene.volume.placed().slice_axes(), turned.unwrap_or(0.0), turned.is_some());
            let settings = RenderSettings { view, ..scene.settings.clone() };
            let rays = scene.rays(&settings);
            let mut finished = match renderer.take() {
                Some(renderer) => rays.turned(renderer)?,
                None => rays.picture()?,
            };
            renderer = finished.renderer.take();
            if turn == 0 {
                notes.extend(finished.notes.iter().cloned());
            }
            pictures.push(self.write(scene, finished, view, path, movie.as_mut())?);
            step(turn + 1);
        }
        let movie = movie.map(|movie| Ok::<_, Failure>(Made { hz: movie.rate().hz(), bytes: movie.finish()? }));
        drop(step);
        self.report(scene, (pictures, movie.transpose()?), notes, began, read_ms)
    }

    /// Writes a picture to its file, or adds it to a movie.
    fn write(
        &self,
        scene: &Scene<'_>,
        finished: Finished,
        view: View,
        path: PathBuf,
        movie: Option<&mut Movie>,
    ) -> Result<Drawn, Failure> {
        let began = Instant::now();
        let over = Over::of_picture(finished.picture, &finished.camera, &scene.region, self.look.background);
        let draw = self.look.planar.drawn(&[]);
        let drawn = match movie {
            Some(movie) => {
                let (picture, drawn) = over.image(&draw);
                movie.push(Arc::new(picture))?;
                drawn
            }
            None => over.write(&draw, &path)?,
        };
        Ok(Drawn {
            path,
            drawn,
            view: [view.azimuth, view.elevation, view.roll],
            bands: finished.bands,
            bricks_smoothed: finished.soft.map(|work| work.bricks_smoothed),
            compositor_bytes: finished.compositor_bytes,
            prepare_ms: finished.prepare_ms,
            shade_ms: finished.shade_ms,
            rays_ms: finished.rays_ms,
            write_ms: milliseconds(began),
            numbers: finished.numbers,
        })
    }

    fn report(
        &self,
        scene: &Scene<'_>,
        (pictures, movie): (Vec<Drawn>, Option<Made>),
        mut notes: Vec<String>,
        began: Instant,
        read_ms: f64,
    ) -> Result<Rendered, Failure> {
        let wall_s = began.elapsed().as_secs_f64();
        notes.extend(scene.volume.notes(self.volume));
        let (look, settings) = (self.look, &scene.settings);
        let statistics = Statistics {
            source: Source::new(self, scene.volume),
            mode: settings.mode.name(),
            transfer: look.transfer_name(),
            soft: look.soft.as_deref(),
            window: scene.window,
            perspective: look.view.perspective,
            step: look.view.step,
            stop: look.view.stops(),
            background: look.background,
            crop: settings.crop.present().len(),
            threads: settings.threads,
            read_ms,
            wall_s,
            pictures,
            movie,
            notes: notes.clone(),
        };
        let document = document(&statistics)?;
        Ok(Rendered { contents: Contents::Rays(settings.view), document, wall_s, notes })
    }

    fn part(&self, scene: &Scene<'_>, part: Part, is_folded: bool, began: Instant) -> Result<Rendered, Failure> {
        let level = scene.level("--part")?;
        let failed = |error: io::Error| Failure::io(self.output, "writing", &error);
        let mut file = BufWriter::new(temporary(self.output).map_err(failed)?);
        let rays = scene.rays(&scene.settings);
        let report = message::write_part(&rays, level, part, is_folded, &mut file, failed)?;
        let file = file.into_inner().map_err(|error| failed(error.into_error()))?;
        persist(file, self.output).map_err(failed)?;
        let text = format!("part {}/{}, {} bytes", part.number, part.of, report.message_bytes);
        let notes = scene.volume.notes(self.volume);
        let wall_s = began.elapsed().as_secs_f64();
        Ok(Rendered { contents: Contents::Part(text), document: document(&report)?, wall_s, notes })
    }

    fn composite(
        &self,
        scene: &Scene<'_>,
        messages: &[PathBuf],
        began: Instant,
        read_ms: f64,
    ) -> Result<Rendered, Failure> {
        let open = |path: &PathBuf| {
            let source = File::open(path).map_err(|error| Failure::io(path, "opening", &error))?;
            Ok(Named { name: path.display().to_string(), source: Box::new(source) })
        };
        let messages = messages.iter().map(open).collect::<Result<_, Failure>>()?;
        let finished = scene.composite(messages)?;
        let drawn = self.write(scene, finished, scene.settings.view, self.output.to_path_buf(), None)?;
        self.report(scene, (vec![drawn], None), Vec::new(), began, read_ms)
    }
}

/// A volume, and all that its pictures by rays depend on.
pub(crate) struct Scene<'a> {
    volume: &'a RenderVolume,
    window: [f32; 2],
    settings: RenderSettings,
    soft: Option<SoftLight>,
    region: RenderRegion,
    team: Option<Arc<Team>>,
    memory_bytes: u64,
}

impl<'a> Scene<'a> {
    /// Prepares pictures. `window` has the grey values of black and white; `None` for the volume's.
    ///
    /// # Errors
    /// [`Failure`] when the settings do not suit the volume, or it cannot be read.
    pub(crate) fn new(
        volume: &'a RenderVolume,
        look: &Look,
        window: Option<[f32; 2]>,
        threads: usize,
        memory_bytes: u64,
    ) -> Result<Self, Failure> {
        let team = team(threads)?;
        let window = window.unwrap_or_else(|| volume.range(team.as_deref()));
        volume.check()?;
        let placed = volume.placed();
        let mut settings =
            RenderSettings { cache: Cache::None, ..look.settings(window, placed.slice_axes(), threads)? };
        let mut soft = None;
        if let Some(name) = &look.soft {
            let (light, transfer) = SoftLight::preset(name, window.map(f64::from))?;
            soft = Some(light);
            if look.view.transfer.is_none() {
                settings.transfer = transfer;
            }
        }
        let [low, high] = placed.bounds();
        let region = RenderRegion::new(placed.world_from_lattice(), low, high)?;
        Ok(Self { volume, window, settings, soft, region, team, memory_bytes })
    }

    fn rays<'b>(&'b self, settings: &'b RenderSettings) -> Rays<'b> {
        Rays {
            volume: self.volume,
            settings,
            soft: self.soft.as_ref(),
            region: self.region,
            team: self.team.as_deref(),
            memory_bytes: self.memory_bytes,
        }
    }

    /// Returns the level on the disk that `flag` needs.
    fn level(&self, flag: &str) -> Result<&LevelOnDisk, Failure> {
        match self.volume {
            RenderVolume::Level(level) => Ok(level),
            RenderVolume::Dense(_) => {
                fail_usage!("{flag}: applies to OME-Zarr volumes, of which a process reads a part; leave it out")
            }
        }
    }

    /// Renders a part of the picture to a message.
    ///
    /// # Errors
    /// [`Failure`] when there is no such part, memory does not suffice, or a chunk cannot be read.
    pub(crate) fn part(&self, part: Part, is_folded: bool) -> Result<Vec<u8>, Failure> {
        let mut bytes = Vec::new();
        let level = self.level("part")?;
        message::write_part(&self.rays(&self.settings), level, part, is_folded, &mut bytes, Failure::from)?;
        Ok(bytes)
    }

    /// Composites the messages of all parts.
    ///
    /// # Errors
    /// [`Failure`] for messages that are damaged, of another picture, given twice or missing.
    fn composite(&self, messages: Vec<Named>) -> Result<Finished, Failure> {
        message::composite(&self.rays(&self.settings), self.level("--composite")?, messages)
    }
}

/// Returns the picture of a volume. `window` has the grey values of black and white; `None` for the
/// volume's.
///
/// # Errors
/// [`Failure`] when the settings do not suit the volume, memory does not suffice, or it cannot be
/// read.
pub(crate) fn image(
    volume: &RenderVolume,
    look: &Look,
    window: Option<[f32; 2]>,
    threads: usize,
    memory_bytes: u64,
) -> Result<RgbImage, Failure> {
    if look.view.mode == Mode::Slice {
        return Ok(planes::draw(volume, look, window, threads)?.image);
    }
    let scene = Scene::new(volume, look, window, threads, memory_bytes)?;
    Ok(over(&scene, scene.rays(&scene.settings).picture()?, look))
}

/// Returns the picture of a volume from the messages of all its parts.
///
/// # Errors
/// Same as [`Scene::composite`].
pub(crate) fn composited(scene: &Scene<'_>, messages: Vec<Named>, look: &Look) -> Result<RgbImage, Failure> {
    Ok(over(scene, scene.composite(messages)?, look))
}

fn over(scene: &Scene<'_>, finished: Finished, look: &Look) -> RgbImage {
    let over = Over::of_picture(finished.picture, &finished.camera, &scene.region, look.background);
    over.image(&look.planar.drawn(&[])).0
}

/// Converts `IMG.png` to `IMG-007.png`.
pub(crate) fn numbered(path: &Path, number: u64) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}-{number:03}.png"))
}
