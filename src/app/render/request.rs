//! A volume to render, and the finished pictures.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use export::movie::Rate;
use ome_zarr::ChunkWork;
use render::camera::View;

use super::look::Look;
use super::volume::RenderVolume;
use crate::app::part::Part;

/// The first part of the report: the rendered volume.
#[derive(Debug, Serialize)]
pub(super) struct Source<'a> {
    version: &'static str,
    input: &'a Path,
    weights: Option<&'a Path>,
    /// Voxels along x, y, z, and the number of seen ones; `null` if not all were read.
    size: [u32; 3],
    voxels_seen: Option<u64>,
    /// Level of an OME-Zarr volume, and the work of reading it.
    level: Option<usize>,
    reading: Option<ChunkWork>,
}

impl<'a> Source<'a> {
    pub(super) fn new(request: &'a Request<'_>, volume: &RenderVolume) -> Self {
        let (level, reading) = volume.level().unzip();
        Self {
            version: env!("CARGO_PKG_VERSION"),
            input: request.volume,
            weights: request.weights,
            size: volume.placed().header().size,
            voxels_seen: volume.seen(),
            level,
            reading,
        }
    }
}

/// A volume, and the pictures to make of it.
pub(crate) struct Request<'a> {
    pub(crate) volume: &'a Path,
    pub(crate) weights: Option<&'a Path>,
    pub(crate) output: &'a Path,
    /// Grey values that are black and white; `None` for the volume's.
    pub(crate) window: Option<[f32; 2]>,
    /// Number of pictures all around the vertical; `None` for a single picture.
    pub(crate) turntable: Option<u16>,
    /// Rate of the movie of those pictures; `None` writes each to a file.
    pub(crate) movie: Option<Rate>,
    pub(crate) threads: usize,
    /// Memory limit for the volume, bytes.
    pub(crate) memory_bytes: u64,
    /// Level of an OME-Zarr volume; `None` for the finest.
    pub(crate) level: Option<usize>,
    pub(crate) task: Task,
    pub(crate) look: &'a Look,
}

/// Work of a request.
pub(crate) enum Task {
    /// The pictures.
    Pictures,
    /// The message of one part of a picture, whose blocks are folded or not.
    Part(Part, bool),
    /// A picture of the messages of all parts.
    Composite(Vec<PathBuf>),
}

/// The finished pictures.
pub(crate) struct Rendered {
    pub(crate) contents: Contents,
    /// The report, as a JSON document.
    pub(crate) document: String,
    /// Time from the beginning to the last picture, s.
    pub(crate) wall_s: f64,
    pub(crate) notes: Vec<String>,
}

/// Contents of the pictures.
pub(crate) enum Contents {
    /// Planes, in words.
    Planes(String),
    /// Rays, from the first picture's view.
    Rays(View),
    /// A part of a picture, in words.
    Part(String),
}

/// Returns the time since an instant, ms.
pub(super) fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
