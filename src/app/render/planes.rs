//! Renders planes through a volume.

use std::time::Instant;

use serde::Serialize;

use export::picture::write_rgb;
use image::RgbImage;
use render::section::{Box3, Planar, PlanarWork};
use render::settings::pool;
use volume::DenseVolume;

use super::look::Look;
use super::planar::SheetNumbers;
use super::request::{Contents, Rendered, Request, Source, milliseconds};
use crate::app::json::document;
use crate::failure::Failure;

/// The report, in its JSON form.
#[derive(Debug, Serialize)]
struct Statistics<'a> {
    #[serde(flatten)]
    source: Source<'a>,
    mode: &'static str,
    window: [f32; 2],
    threads: usize,
    /// Time to read the volume, ms.
    read_ms: f64,
    /// Time to sample and draw the planes, ms.
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
pub(super) fn run(
    request: &Request<'_>,
    volume: &DenseVolume,
    began: Instant,
    read_ms: f64,
    notes: Vec<String>,
) -> Result<Rendered, Failure> {
    let Request { look, output, threads, .. } = *request;
    let window = request.window.unwrap_or_else(|| volume.range());
    let sampling = Instant::now();
    let (image, picture, work) = draw(volume, look, window, threads)?;
    let sample_ms = milliseconds(sampling);
    write_rgb(&image, output)?;
    let wall_s = began.elapsed().as_secs_f64();
    let text = picture.to_string();
    let statistics = Statistics {
        source: Source::new(request, volume),
        mode: look.view.mode.name(),
        window,
        threads,
        read_ms,
        sample_ms,
        wall_s,
        picture,
        work,
        notes: &notes,
    };
    let document = document(&statistics)?;
    Ok(Rendered { contents: Contents::Planes(text), document, wall_s, notes })
}

/// Returns the picture of a volume's planes, its numbers, and the work.
///
/// # Errors
/// [`Failure`] when the planes miss the volume, or the picture is too small.
pub(super) fn draw(
    volume: &DenseVolume,
    look: &Look,
    window: [f32; 2],
    threads: usize,
) -> Result<(RgbImage, SheetNumbers, PlanarWork), Failure> {
    let place = Box3::new(volume.world_from_lattice(), volume.bounds());
    let sheet = look.planar.sheet(&place, look.view.image_size)?;
    let pool = pool(threads)?;
    let planar = Planar { volume, place, pool: pool.as_deref() };
    let mut work = PlanarWork::default();
    let mut sampled = Vec::new();
    for panel in &sheet.panels {
        let (pixels, done) = planar.sample(&panel.section);
        sampled.push(pixels);
        work += done;
    }
    let image = sheet.draw(&sampled, window, look.planar.wash)?;
    Ok((image, look.planar.numbers(&sheet, &sampled), work))
}
