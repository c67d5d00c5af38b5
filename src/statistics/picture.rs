//! What rendering did, in numbers.

use serde::Serialize;

use super::Milliseconds;
use crate::render::light::{DepthCue, Light, Parts, Source};
use crate::render::{RenderWork, Renderer, Shading};

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

/// A light.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LightNumbers {
    /// Towards it, in the world; `null` for one at the eye.
    pub direction: Option<[f64; 3]>,
    /// In which parts it is returned.
    #[serde(flatten)]
    pub parts: Parts,
    /// Whether it reaches the backs of surfaces.
    pub two_sided: bool,
    /// Brightness near and far; `null` where it does not fade.
    pub depth_cue: Option<DepthCue>,
}

impl LightNumbers {
    fn of(light: Light) -> Self {
        Self {
            direction: match light.source() {
                Source::Headlight => None,
                Source::Fixed(towards) => Some(towards.to_array()),
            },
            parts: light.parts(),
            two_sided: light.is_two_sided(),
            depth_cue: light.depth_cue(),
        }
    }
}

/// A renderer, and what it has done.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PictureNumbers {
    /// Pixels to the right and down.
    pub image_size: [u32; 2],
    /// What of the volume it shows.
    pub mode: &'static str,
    /// Whether voxels or samples were classified, where anything was.
    pub shading: Option<&'static str>,
    /// Of an isosurface, grey levels.
    pub isovalue: Option<f64>,
    /// The light, where any fell.
    pub light: Option<LightNumbers>,
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
            mode: renderer.mode().name(),
            shading: renderer.mode().shading().map(Shading::name),
            isovalue: renderer.mode().isovalue(),
            light: renderer.mode().is_lit().then(|| LightNumbers::of(renderer.light())),
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
