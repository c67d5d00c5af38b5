//! What rendering did, in numbers.

use serde::Serialize;

use super::Milliseconds;
use crate::render::{RenderWork, Renderer};

/// Work of rendering, counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct RenderNumbers {
    /// Bricks that were looked at.
    pub bricks_read: u64,
    /// Of those, the bricks in which a value or a weight had changed.
    pub bricks_changed: u64,
    /// Voxels classified and lit.
    pub voxels_shaded: u64,
    /// Rays of which anything was sampled or composited.
    pub rays: u64,
    /// Samples interpolated.
    pub samples: u64,
    /// Samples passed over because their brick is transparent.
    pub samples_skipped: u64,
    /// Blocks that were kept and had to be folded again of their samples.
    pub blocks_resolved: u64,
    /// Blocks that were folded into pixels.
    pub blocks_folded: u64,
    /// Pixels whose value is other bits than before.
    pub pixels_changed: u64,
}

impl From<RenderWork> for RenderNumbers {
    fn from(work: RenderWork) -> Self {
        // Named one by one, so that none is forgotten.
        let RenderWork {
            bricks_read,
            bricks_changed,
            voxels_shaded,
            rays,
            samples,
            samples_skipped,
            blocks_folded,
            blocks_resolved,
            pixels_changed,
        } = work;
        Self {
            bricks_read,
            bricks_changed,
            voxels_shaded,
            rays,
            samples,
            samples_skipped,
            blocks_folded,
            blocks_resolved,
            pixels_changed,
        }
    }
}

/// The numbers of a picture that followed a volume.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PictureStatistics {
    /// Time from a slice's arrival to the finished picture: weaving, shading, rays.
    pub slice_to_picture_ms: Option<Milliseconds>,
    /// Reading what changed, classifying and lighting it.
    pub shade_ms: Option<Milliseconds>,
    /// Sampling and compositing rays.
    pub rays_ms: Option<Milliseconds>,
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
    /// What was kept of rays.
    pub cache: &'static str,
    /// Bytes that rays took, with what was kept of them.
    pub cache_bytes: u64,
    /// Bytes that values, weights and shaded voxels took.
    pub voxel_bytes: u64,
    /// Bricks of the volume that were held.
    pub bricks: usize,
    /// Work done.
    pub work: RenderNumbers,
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
            cache: renderer.cache().name(),
            cache_bytes: memory.rays,
            voxel_bytes: memory.voxels,
            bricks: renderer.bricks(),
            work: renderer.work().into(),
            notes: renderer.notes().to_vec(),
        }
    }
}
