//! Pictures of volumes on the disk, whole or in parts that other processes render.

use std::io::Cursor;
use std::path::Path;

use config::view_settings::Mode;
use image::RgbImage;

use super::{Keyword, LibraryError};
use crate::app::part::Part;
use crate::app::render::look::Look;
use crate::app::render::{Named, RenderVolume, Scene, composited, image};
use crate::cli::render::keywords::{Picture, parse};
use crate::failure::Failure;

/// Width and height, and red, green, blue of each pixel.
type Pixels = ([u32; 2], Vec<u8>);

fn pixels(image: RgbImage) -> Pixels {
    ([image.width(), image.height()], image.into_raw())
}

/// Opens a volume by the keywords of a picture.
fn open(path: &Path, weights: Option<&Path>, picture: &Picture) -> Result<RenderVolume, Failure> {
    RenderVolume::open(path, weights, picture.level, picture.memory_bytes)
}

/// Calls `work` with the scene of a picture that is rendered in parts.
fn in_parts<T>(
    path: &Path,
    keywords: &[Keyword],
    work: impl FnOnce(&Scene<'_>, &Look) -> Result<T, Failure>,
) -> Result<T, LibraryError> {
    let called = || {
        let picture = parse(keywords)?;
        let Picture { look, window, threads, memory_bytes, .. } = &picture;
        if look.view.mode == Mode::Slice {
            fail_usage!("mode slice: planes are not drawn in parts; give another mode, or use section");
        }
        if look.view.adaptive > 0.0 {
            fail_usage!("adaptive: a picture in parts casts every ray; leave it out");
        }
        let volume = open(path, None, &picture)?;
        work(&Scene::new(&volume, look, *window, *threads, *memory_bytes)?, look)
    };
    called().map_err(|failure| LibraryError::of_failure(path, failure))
}

/// Returns a picture of a file or an OME-Zarr folder by the flags of `render`. Chunks of OME-Zarr
/// are read when they are needed.
///
/// # Errors
/// [`LibraryError`] when it cannot be read, or a setting does not fit.
pub fn picture_of_file(path: &Path, weights: Option<&Path>, keywords: &[Keyword]) -> Result<Pixels, LibraryError> {
    let drawn = || {
        let picture = parse(keywords)?;
        let Picture { look, window, threads, memory_bytes, .. } = &picture;
        image(&open(path, weights, &picture)?, look, *window, *threads, *memory_bytes)
    };
    drawn().map(pixels).map_err(|failure| LibraryError::of_failure(path, failure))
}

/// Renders part `number` of `parts`, from 1, of a picture of an OME-Zarr folder. Returns the
/// message for [`picture_of_parts`], whose blocks may be folded.
///
/// # Errors
/// [`LibraryError`] when it cannot be read, a setting does not fit, or there is no such part.
pub fn picture_part(
    path: &Path,
    (number, parts): (u64, u64),
    is_folded: bool,
    keywords: &[Keyword],
) -> Result<Vec<u8>, LibraryError> {
    let part: Result<Part, String> = format!("{number}/{parts}").parse();
    in_parts(path, keywords, |scene, _| {
        scene.part(part.map_err(|problem| Failure::usage(format!("part: {problem}")))?, is_folded)
    })
}

/// Returns the picture of an OME-Zarr folder from the messages of all its parts.
///
/// # Errors
/// [`LibraryError`] for messages that are damaged, of another picture, given twice or missing.
pub fn picture_of_parts<B: AsRef<[u8]> + 'static>(
    path: &Path,
    messages: Vec<B>,
    keywords: &[Keyword],
) -> Result<Pixels, LibraryError> {
    let named = |(number, bytes): (usize, B)| Named {
        name: format!("message {}", number + 1),
        source: Box::new(Cursor::new(bytes)),
    };
    let messages = messages.into_iter().enumerate().map(named).collect();
    in_parts(path, keywords, |scene, look| composited(scene, messages, look)).map(pixels)
}
