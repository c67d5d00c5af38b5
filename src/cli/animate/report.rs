//! Reports on pictures that followed a reconstruction.

use std::path::Path;

use statistics::PictureStatistics;

use crate::app::replay::planes::PlanesStatistics;
use crate::cli::progress::say;

/// Prints the drawn pictures and their timings to stdout, and notes for the user to stderr.
pub(super) fn of_rays(statistics: &PictureStatistics, path: Option<&Path>) {
    let PictureStatistics { slice_to_picture_ms, picture, .. } = statistics;
    for note in &picture.notes {
        say(&format!("note: {note}"));
    }
    let Some(ms) = slice_to_picture_ms else { return };
    let name = path.map_or_else(|| "the picture".into(), |path| path.display().to_string());
    let [width, height] = picture.image_size;
    print_line!(
        "{name}: {width}×{height} pixels, {:.2} ms from slice to picture (median; p95 {:.2}, p99 {:.2}), {} cache of {:.0} MB",
        ms.median,
        ms.p95,
        ms.p99,
        picture.cache,
        picture.cache_bytes as f64 / 1e6
    );
}

/// Prints the drawn planes to stdout.
pub(super) fn of_planes(statistics: &PlanesStatistics, path: Option<&Path>) {
    let name = path.map_or_else(|| "the picture".into(), |path| path.display().to_string());
    let of = if statistics.from == "raw" { "the nearest slices" } else { "the volume" };
    print_line!("{name}: {}, of {of}", statistics.picture);
}
