//! Snapshots: writes the pages' pictures into files.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use image::{ExtendedColorType, ImageEncoder as _, ImageResult, RgbImage};

use export::picture::write_rgb;
use pipeline::control::Progress;

use super::encoded_frame::{EncodedFrame, Kind, Pixmap};
use super::request_error::RequestError;
use super::served::Served;

/// Largest snapshot number in a folder.
const MOST: u32 = 100_000;

/// Guard that allows one snapshot at a time.
struct Busy(Arc<AtomicBool>);

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

/// Writes the newest pictures into the session's folder on a background thread. The session
/// controller reports the result.
///
/// # Errors
/// [`RequestError`] if there is no picture, or no folder to write to.
pub(super) fn keep(served: &Served) -> Result<String, RequestError> {
    let (controller, broadcaster) = (&served.session.controller, &served.session.broadcaster);
    let folder = controller.folder().map_err(RequestError::of_session)?.to_owned();
    let shots: Vec<_> = Kind::ALL.into_iter().filter_map(|kind| broadcaster.newest(kind)).collect();
    if shots.is_empty() {
        return Err(RequestError::NothingToSave);
    }
    if served.snapping.swap(true, Ordering::Relaxed) {
        return Err(RequestError::SnapshotBusy);
    }
    let (busy, controller) = (Busy(Arc::clone(&served.snapping)), Arc::clone(controller));
    let write = move || {
        let busy = busy;
        match write(&folder, &shots) {
            Ok(first) => controller.report(Progress::Done, format!("the pictures are saved: {}", first.display())),
            Err(why) => controller.report(Progress::Failed, format!("the pictures are not saved: {why}")),
        }
        drop(busy);
    };
    let begun = std::thread::Builder::new().name("snapshot".into()).spawn(write);
    begun.map_err(|error| RequestError::SnapshotThread(error.to_string()))?;
    Ok("the pictures are being saved".into())
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

/// Writes the pictures as `snapshot-001-scanner.png` and so on, with the next free number.
/// Returns the first of the files.
fn write(folder: &Path, shots: &[Arc<EncodedFrame>]) -> Result<PathBuf, String> {
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let names = |number: u32| -> Vec<PathBuf> {
        shots.iter().map(|shot| folder.join(format!("snapshot-{number:03}-{}.png", name(shot.kind)))).collect()
    };
    let paths = (1..=MOST).map(names).find(|paths| paths.iter().all(|path| !path.exists()));
    let paths = paths.ok_or_else(|| format!("{}: has {MOST} snapshots; choose another folder", folder.display()))?;
    for (shot, path) in shots.iter().zip(&paths) {
        let picture = rgb(shot).ok_or("a picture's number of pixels differs from its size")?;
        write_rgb(&picture, path).map_err(|error| error.to_string())?;
    }
    Ok(paths[0].clone())
}

/// Converts a picture to RGB.
fn rgb(shot: &EncodedFrame) -> Option<RgbImage> {
    let pixels = match &shot.pixels {
        Pixmap::Grey(pixels) => pixels.iter().flat_map(|value| [*value; 3]).collect(),
        Pixmap::Colour(pixels) => pixels.to_vec(),
    };
    RgbImage::from_raw(shot.size[0], shot.size[1], pixels)
}

/// Encodes a picture as PNG.
///
/// # Errors
/// The encoder's.
pub(super) fn png(shot: &EncodedFrame) -> ImageResult<Vec<u8>> {
    let (pixels, colour) = match &shot.pixels {
        Pixmap::Grey(pixels) => (pixels, ExtendedColorType::L8),
        Pixmap::Colour(pixels) => (pixels, ExtendedColorType::Rgb8),
    };
    let mut bytes = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut bytes);
    encoder.write_image(pixels, shot.size[0], shot.size[1], colour)?;
    Ok(bytes)
}
