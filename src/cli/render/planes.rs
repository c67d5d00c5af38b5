//! `sonoweave render --mode slice`: renders planes through a volume.

use std::time::Instant;

use serde::Serialize;

use export::picture::write_rgb;
use render::section::{Box3, Planar, PlanarWork};
use render::settings::pool;
use statistics::write_json;
use volume::DenseVolume;

use super::arguments::{Arguments, Source, milliseconds};
use super::planar::SheetNumbers;
use crate::cli::{Failure, input};

/// The content of `--stats`.
#[derive(Debug, Serialize)]
struct Statistics<'a> {
    #[serde(flatten)]
    source: Source<'a>,
    mode: &'static str,
    window: [f32; 2],
    threads: usize,
    /// Time to read the volume, ms.
    read_ms: f64,
    /// Time to sample the planes, ms.
    sample_ms: f64,
    /// Time from the command's start to the picture, s.
    wall_s: f64,
    picture: SheetNumbers,
    work: PlanarWork,
    notes: &'a [String],
}

/// Draws the planes of a volume that took `read_ms` to read; `notes` are the volume's notes.
///
/// # Errors
/// [`Failure`]: the picture was not written then.
#[allow(clippy::print_stdout, clippy::print_stderr, reason = "the command's output")]
pub(super) fn run(
    arguments: &Arguments,
    volume: &DenseVolume,
    began: Instant,
    read_ms: f64,
    notes: &[String],
) -> Result<(), Failure> {
    let Arguments { view_flags, output, .. } = arguments;
    let window = arguments.window.unwrap_or_else(|| volume.range());
    let threads = input::threads(arguments.threads);
    let place = Box3::new(volume.world_from_lattice(), volume.bounds());
    let sheet = view_flags.planar.sheet(&place, view_flags.image_size)?;
    let sampling = Instant::now();
    let pool = pool(threads)?;
    let planar = Planar { volume, place, pool: pool.as_deref() };
    let mut work = PlanarWork::default();
    let mut sampled = Vec::new();
    for panel in &sheet.panels {
        let (pixels, done) = planar.sample(&panel.section);
        sampled.push(pixels);
        work += done;
    }
    let sample_ms = milliseconds(sampling);
    write_rgb(&sheet.draw(&sampled, window, view_flags.planar.wash())?, output)?;
    let wall_s = began.elapsed().as_secs_f64();
    let picture = view_flags.planar.numbers(&sheet, &sampled);
    let text = picture.to_string();
    if let Some(path) = &arguments.stats {
        let statistics = Statistics {
            source: Source::new(arguments, volume),
            mode: view_flags.mode.name(),
            window,
            threads,
            read_ms,
            sample_ms,
            wall_s,
            picture,
            work,
            notes,
        };
        write_json(path, &statistics)?;
    }
    for note in notes {
        eprintln!("sonoweave: note: {note}");
    }
    println!("{}: {text}, of {}, in {:.0} ms", output.display(), arguments.volume.display(), wall_s * 1e3);
    Ok(())
}
