//! A volume to render, and the finished pictures.

use std::path::Path;
use std::time::Instant;

use serde::Serialize;

use render::camera::View;
use volume::DenseVolume;

use super::look::Look;

/// The first part of the report: the rendered volume.
#[derive(Debug, Serialize)]
pub(super) struct Source<'a> {
    version: &'static str,
    input: &'a Path,
    weights: Option<&'a Path>,
    /// Voxels along x, y, z, and the number of seen ones.
    size: [u32; 3],
    voxels_seen: u64,
}

impl<'a> Source<'a> {
    pub(super) fn new(request: &'a Request<'_>, volume: &DenseVolume) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION"),
            input: request.volume,
            weights: request.weights,
            size: volume.header().size,
            voxels_seen: volume.seen(),
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
    pub(crate) threads: usize,
    /// Memory limit for the volume, bytes.
    pub(crate) memory_bytes: u64,
    pub(crate) look: &'a Look,
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
}

/// Returns the time since an instant, ms.
pub(super) fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
