//! The pictures that pages see, into files.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use image::{ExtendedColorType, ImageEncoder as _, RgbImage};

use super::Served;
use super::screen::{Kind, Pixmap, Shot};
use crate::desk::How;
use crate::export::picture::write_rgb;

/// Names that are tried in a folder.
const MOST: u32 = 100_000;

/// One at a time.
struct Busy(Arc<AtomicBool>);

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

/// Writes the newest pictures into the session's folder, by a thread that nobody waits for. What becomes of it the desk tells.
///
/// # Errors
/// A sentence where there is none, or nowhere to write it to.
pub(super) fn keep(served: &Served) -> Result<String, String> {
    let (desk, screen) = (&served.shown.desk, &served.shown.screen);
    let folder = desk.folder()?.to_owned();
    let shots: Vec<_> = Kind::ALL.into_iter().filter_map(|kind| screen.newest(kind)).collect();
    if shots.is_empty() {
        return Err("there is no picture yet that could be kept".into());
    }
    if served.snapping.swap(true, Ordering::Relaxed) {
        return Err("the last snapshot is still being written; wait for it".into());
    }
    let (busy, desk) = (Busy(Arc::clone(&served.snapping)), Arc::clone(desk));
    let write = move || {
        let busy = busy;
        match write(&folder, &shots) {
            Ok(first) => desk.happened(How::Done, format!("the pictures are kept: {}", first.display())),
            Err(why) => desk.happened(How::Failed, format!("the pictures are not kept: {why}")),
        }
        drop(busy);
    };
    let begun = std::thread::Builder::new().name("snapshot".into()).spawn(write);
    begun.map_err(|error| format!("no thread for it: {error}"))?;
    Ok("the pictures are being kept".into())
}

fn name(kind: Kind) -> &'static str {
    match kind {
        Kind::Slice => "scanner",
        Kind::View => "volume",
        Kind::AcrossZ => "across-z",
        Kind::AcrossY => "across-y",
        Kind::AcrossX => "across-x",
        Kind::Free => "free",
    }
}

/// Writes them as `snapshot-001-scanner.png` and so on, by the next number that is free; the first of the files.
fn write(folder: &Path, shots: &[Arc<Shot>]) -> Result<PathBuf, String> {
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let names = |number: u32| -> Vec<PathBuf> {
        shots.iter().map(|shot| folder.join(format!("snapshot-{number:03}-{}.png", name(shot.kind)))).collect()
    };
    let paths = (1..=MOST).map(names).find(|paths| paths.iter().all(|path| !path.exists()));
    let paths = paths.ok_or_else(|| format!("{}: has {MOST} snapshots; choose another folder", folder.display()))?;
    for (shot, path) in shots.iter().zip(&paths) {
        let picture = rgb(shot).ok_or("a picture has not as many pixels as its size says")?;
        write_rgb(&picture, path).map_err(|error| error.to_string())?;
    }
    Ok(paths[0].clone())
}

/// A picture in colour.
fn rgb(shot: &Shot) -> Option<RgbImage> {
    let pixels = match &shot.pixels {
        Pixmap::Grey(pixels) => pixels.iter().flat_map(|value| [*value; 3]).collect(),
        Pixmap::Colour(pixels) => pixels.to_vec(),
    };
    RgbImage::from_raw(shot.size[0], shot.size[1], pixels)
}

/// A picture as PNG.
///
/// # Errors
/// A sentence.
pub(super) fn png(shot: &Shot) -> Result<Vec<u8>, String> {
    let (pixels, colour) = match &shot.pixels {
        Pixmap::Grey(pixels) => (pixels, ExtendedColorType::L8),
        Pixmap::Colour(pixels) => (pixels, ExtendedColorType::Rgb8),
    };
    let mut bytes = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut bytes);
    encoder.write_image(pixels, shot.size[0], shot.size[1], colour).map_err(|error| error.to_string())?;
    Ok(bytes)
}
