//! `sonoweave render`: renders a volume to a picture.

mod arguments;
pub(super) mod drawing;
mod lighting;
pub(super) mod planar;
mod planes;
pub(super) mod view_flags;

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use render::camera::View;
use render::{Cache, RenderRegion, RenderSettings, Renderer};
use statistics::{PictureNumbers, write_json};
use volume::DenseVolume;

use super::{Failure, input};
pub use arguments::Arguments;
use arguments::{Source, milliseconds};
use drawing::Over;
use planar::Draw;
use view_flags::{Mode, ViewFlags};

/// The content of `--stats`.
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

/// Runs the command.
///
/// # Errors
/// [`Failure`]: the picture that failed was not written then.
#[allow(clippy::print_stdout, clippy::print_stderr, reason = "the command's output")]
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let began = Instant::now();
    let Arguments { view_flags, output, .. } = arguments;
    arguments.check()?;
    let volume = DenseVolume::open(&arguments.volume, arguments.weights.as_deref(), gibibytes(arguments.max_memory)?)?;
    let read_ms = milliseconds(began);
    let mut notes = volume.notes().to_vec();
    if volume.seen() == 0 {
        notes.push(format!("{}: no voxel was seen, so the picture is all background", arguments.volume.display()));
    }
    if view_flags.mode == Mode::Slice {
        return planes::run(arguments, &volume, began, read_ms, &notes);
    }
    let window = arguments.window.unwrap_or_else(|| volume.range());
    let settings = RenderSettings {
        cache: Cache::None,
        ..view_flags.settings(window, volume.slice_axes(), input::threads(arguments.threads))?
    };
    let [low, high] = volume.bounds();
    let stage = RenderRegion::new(volume.world_from_lattice(), low, high)?;
    let turns = arguments.turntable.map_or(1, u64::from);
    let bar = input::progress("rendering", turns);
    let mut pictures = Vec::new();
    for turn in 0..turns {
        let path = match arguments.turntable {
            None => output.clone(),
            Some(_) => numbered(output, turn),
        };
        let turned = arguments.turntable.map(|_| 360.0 * turn as f64 / turns as f64);
        let drawn = draw(&volume, stage, &settings, view_flags, turned, path);
        pictures.push(drawn?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    let wall_s = began.elapsed().as_secs_f64();
    if let Some(path) = &arguments.stats {
        let statistics = Statistics {
            source: Source::new(arguments, &volume),
            mode: settings.mode.name(),
            transfer: &view_flags.transfer_name(),
            window,
            perspective: view_flags.perspective,
            step: view_flags.step,
            stop: view_flags.stops(),
            background: view_flags.background,
            threads: settings.threads,
            read_ms,
            wall_s,
            pictures,
            notes: notes.clone(),
        };
        write_json(path, &statistics)?;
    }
    for note in &notes {
        eprintln!("sonoweave: note: {note}");
    }
    let [width, height] = view_flags.image_size;
    let View { azimuth, elevation, roll, .. } = settings.view;
    let name = match arguments.turntable {
        None => output.display().to_string(),
        Some(_) => format!("{} and on, {turns} pictures", numbered(output, 0).display()),
    };
    println!(
        "{name}: {width}×{height} pixels of {}, {}, {}, from {azimuth}°, {elevation}°{}, in {:.0} ms",
        arguments.volume.display(),
        settings.mode.name(),
        view_flags.transfer_name(),
        if roll == 0.0 { String::new() } else { format!(", rolled {roll}°") },
        wall_s * 1e3
    );
    Ok(())
}

impl Arguments {
    /// Refuses, before the work, impossible outputs and settings that suit no volume.
    fn check(&self) -> Result<(), Failure> {
        check_png(&self.output)?;
        for output in [Some(&self.output), self.stats.as_ref()].into_iter().flatten() {
            input::check_output(output)?;
            for from in [Some(&self.volume), self.weights.as_ref()].into_iter().flatten() {
                input::check_is_not(output, from)?;
            }
        }
        if let Some(what) =
            self.view_flags.planar.drawn(&[]).into_iter().find(|w| matches!(w, Draw::Slice | Draw::Probe))
        {
            fail!("--draw {}: a volume's file has no current slice; draw scale or cube, or use `replay`", what.name());
        }
        if self.view_flags.mode == Mode::Slice && self.turntable.is_some() {
            fail!("--turntable: does not apply to --mode slice; leave it out");
        }
        if self.view_flags.planar.wants_weights() && self.weights.is_none() {
            fail!(
                "--overlay weight: the volume's file has no weights; give --weights with a file from `reconstruct \
                --weights`"
            );
        }
        self.view_flags.check()
    }
}

/// Checks that a picture's name is that of a PNG file.
///
/// # Errors
/// [`Failure`] when the name has another extension.
pub(super) fn check_png(path: &Path) -> Result<(), Failure> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        return Ok(());
    }
    Err(Failure(format!("{}: pictures are PNG files; give a name that ends in .png", path.display())))
}

fn draw(
    volume: &DenseVolume,
    stage: RenderRegion,
    settings: &RenderSettings,
    view_flags: &ViewFlags,
    turned: Option<f64>,
    path: PathBuf,
) -> Result<Drawn, Failure> {
    let began = Instant::now();
    let view = view_flags.view(volume.slice_axes(), turned.unwrap_or(0.0), turned.is_some());
    let mut renderer = Renderer::new(&RenderSettings { view, ..settings.clone() }, stage)?;
    let prepare_ms = milliseconds(began);
    let updated = renderer.update_all(volume);
    let began = Instant::now();
    let drawn = Over { renderer: &renderer, background: view_flags.background, slice: None }
        .write(&view_flags.planar.drawn(&[]), &path)?;
    Ok(Drawn {
        path,
        drawn,
        view: [view.azimuth, view.elevation, view.roll],
        prepare_ms,
        shade_ms: updated.shade.as_secs_f64() * 1e3,
        rays_ms: updated.rays.as_secs_f64() * 1e3,
        write_ms: milliseconds(began),
        numbers: PictureNumbers::of(&renderer, view_flags.image_size),
    })
}

/// Converts `IMG.png` to `IMG-007.png`.
fn numbered(path: &Path, number: u64) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}-{number:03}.png"))
}

fn gibibytes(gib: f64) -> Result<u64, Failure> {
    let bytes = gib * f64::from(1 << 30);
    if bytes > 0.0 && bytes.is_finite() {
        return Ok(bytes as u64);
    }
    Err(Failure(format!("--max-memory {gib}: must be a positive number of GiB")))
}
