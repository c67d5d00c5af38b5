//! Renders planes through a volume.

use std::time::Instant;

use serde::Serialize;

use export::picture::write_rgb;
use export::sections::Wash;
use image::RgbImage;
use render::section::{self, Box3, PlanarWork};
use render::settings::team;

use super::look::Look;
use super::planar::SheetNumbers;
use super::request::{Contents, Rendered, Request, Source, milliseconds};
use super::volume::RenderVolume;
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

/// Draws the planes of a volume that took `read_ms` to open.
///
/// # Errors
/// [`Failure`]: the picture was not written then.
pub(super) fn run(
    request: &Request<'_>,
    volume: &RenderVolume,
    began: Instant,
    read_ms: f64,
) -> Result<Rendered, Failure> {
    let Request { look, output, threads, .. } = *request;
    let sampling = Instant::now();
    let Planar { image, numbers: picture, work, window } = draw(volume, look, request.window, threads)?;
    let sample_ms = milliseconds(sampling);
    write_rgb(&image, output)?;
    let wall_s = began.elapsed().as_secs_f64();
    let (text, notes) = (picture.to_string(), volume.notes(request.volume));
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

/// A finished picture of planes.
pub(super) struct Planar {
    pub(super) image: RgbImage,
    numbers: SheetNumbers,
    work: PlanarWork,
    window: [f32; 2],
}

/// Draws a volume's planes. `window` has the grey values of black and white; `None` for the
/// volume's.
///
/// # Errors
/// [`Failure`] when the planes miss the volume, the picture is too small, or a chunk cannot be
/// read.
pub(super) fn draw(
    volume: &RenderVolume,
    look: &Look,
    window: Option<[f32; 2]>,
    threads: usize,
) -> Result<Planar, Failure> {
    if look.planar.wash == Wash::Weight && !volume.has_weights() {
        fail!("--overlay weight: the volume has no weights; leave it out, or give --weights");
    }
    let placed = volume.placed();
    let place = Box3::new(placed.world_from_lattice(), placed.bounds());
    let sheet = look.planar.sheet(&place, look.view.image_size)?;
    let team = team(threads)?;
    let window = window.unwrap_or_else(|| volume.range(team.as_deref()));
    let planes = section::Planar { volume: volume.values(), place, team: team.as_deref() };
    let mut work = PlanarWork::default();
    let mut sampled = Vec::new();
    for panel in &sheet.panels {
        let (pixels, done) = planes.sample(&panel.section);
        sampled.push(pixels);
        work += done;
    }
    volume.check()?;
    let image = sheet.draw(&sampled, window, look.planar.wash)?;
    Ok(Planar { image, numbers: look.planar.numbers(&sheet, &sampled), work, window })
}
