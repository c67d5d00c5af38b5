//! What rendering did, in numbers.

use serde::Serialize;

use super::Milliseconds;
use crate::render::{RenderWork, Renderer};

/// The numbers of a picture that followed a volume.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PictureStatistics {
    /// Time from a slice's arrival to the finished picture: weaving, shading, rays.
    pub slice_to_picture_ms: Option<Milliseconds>,
    /// Reading what changed, classifying and lighting it.
    pub shade_ms: Option<Milliseconds>,
    /// Sampling and compositing rays.
    pub rays_ms: Option<Milliseconds>,
    /// What was drawn over the last picture.
    pub drawn: Vec<&'static str>,
    /// The picture.
    pub picture: PictureNumbers,
}

/// A renderer, and what it has done.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PictureNumbers {
    /// Pixels to the right and down.
    pub image_size: [u32; 2],
    /// Samples along a ray.
    pub samples_per_ray: u32,
    /// Samples of a block of the fold.
    pub arity: u32,
    /// Differences of pixels, in parts of the full range, for which rays were left out; 0 casts one a pixel.
    pub adaptive: f32,
    /// What was kept of rays.
    pub cache: &'static str,
    /// Bytes that rays took, with what was kept of them.
    pub cache_bytes: u64,
    /// Bytes that values, weights and shaded voxels took.
    pub voxel_bytes: u64,
    /// Bricks of the volume that were held.
    pub bricks: usize,
    /// Work done.
    pub work: RenderWork,
    /// What the user should know: sentences.
    pub notes: Vec<String>,
}

impl PictureNumbers {
    /// Of a renderer as it is now; pictures of `image_size`.
    pub fn of(renderer: &Renderer, image_size: [u32; 2]) -> Self {
        let memory = renderer.memory();
        Self {
            image_size,
            samples_per_ray: renderer.samples(),
            arity: renderer.arity(),
            adaptive: renderer.adaptive(),
            cache: renderer.cache().name(),
            cache_bytes: memory.rays,
            voxel_bytes: memory.voxels,
            bricks: renderer.bricks(),
            work: renderer.work(),
            notes: renderer.notes().to_vec(),
        }
    }
}
