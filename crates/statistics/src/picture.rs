//! Numbers of a rendering.

use serde::Serialize;

use render::classify::light::{DepthCue, Light, Parts, Source};
use render::{Cache, RenderMemory, RenderSettings, RenderWork, Renderer, Shading};

use super::Milliseconds;

/// The numbers of an incrementally rendered picture.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PictureStatistics {
    /// Time from a slice's arrival to the finished picture: insertion, shading, rays.
    pub slice_to_picture_ms: Option<Milliseconds>,
    /// Time for reading, classifying and lighting the changes.
    pub shade_ms: Option<Milliseconds>,
    /// Time for sampling and compositing rays.
    pub rays_ms: Option<Milliseconds>,
    /// Overlays of the last picture.
    pub drawn: Vec<&'static str>,
    /// The picture.
    pub picture: PictureNumbers,
}

/// A light.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LightNumbers {
    /// Direction towards it, in the world; `null` for a headlight.
    pub direction: Option<[f64; 3]>,
    /// Its ambient, diffuse and specular parts.
    #[serde(flatten)]
    pub parts: Parts,
    /// Whether it lights the backs of surfaces.
    pub two_sided: bool,
    /// Brightness near and far; `null` without depth cueing.
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

/// A renderer's settings and work.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PictureNumbers {
    /// Pixels to the right and down.
    pub image_size: [u32; 2],
    /// Composite mode.
    pub mode: &'static str,
    /// Whether voxels or samples were classified, if any were.
    pub shading: Option<&'static str>,
    /// Grey value of the isosurface.
    pub isovalue: Option<f64>,
    /// The light, if the mode is lit.
    pub light: Option<LightNumbers>,
    /// Samples along a ray.
    pub samples_per_ray: u32,
    /// Samples per block when compositing.
    pub arity: u32,
    /// Differences of pixels, as a fraction of the full range, below which rays were skipped; 0
    /// casts one ray per pixel.
    pub adaptive: f32,
    /// Parts of the volume that were rendered each by itself; 1 without parts.
    pub parts: u32,
    /// Kind of ray cache.
    pub cache: &'static str,
    /// Memory of the rays and their cache, bytes.
    pub cache_bytes: u64,
    /// Memory of values, weights and shaded voxels, bytes.
    pub voxel_bytes: u64,
    /// Stored bricks of the volume.
    pub bricks: usize,
    /// Work done.
    pub work: RenderWork,
    /// Notes for the user, as sentences.
    pub notes: Vec<String>,
}

/// Numbers of a picture that was rendered part after part.
#[derive(Debug, Clone, Default)]
pub struct PartNumbers {
    /// Samples along a ray.
    pub samples: u32,
    /// Samples of a block.
    pub arity: u32,
    /// Number of parts.
    pub parts: u32,
    /// Most memory of a part.
    pub memory: RenderMemory,
    /// Bricks of all parts; one that two parts needed counts twice.
    pub bricks: usize,
    /// Work of all parts.
    pub work: RenderWork,
}

impl PictureNumbers {
    /// Returns the numbers of a picture that was rendered part after part.
    pub fn of_parts(settings: &RenderSettings, parts: PartNumbers) -> Self {
        let PartNumbers { samples, arity, parts, memory, bricks, work } = parts;
        let mode = settings.mode;
        Self {
            image_size: settings.size,
            mode: mode.name(),
            shading: mode.shading().map(Shading::name),
            isovalue: mode.isovalue(),
            light: mode.is_lit().then(|| LightNumbers::of(settings.light)),
            samples_per_ray: samples,
            arity,
            adaptive: 0.0,
            parts,
            cache: Cache::OneLevel.name(),
            cache_bytes: memory.rays,
            voxel_bytes: memory.voxels,
            bricks,
            work,
            notes: Vec::new(),
        }
    }

    /// Returns the present numbers of a renderer; its pictures have `image_size`.
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
            parts: renderer.count_of_parts(),
            cache: renderer.cache().name(),
            cache_bytes: memory.rays,
            voxel_bytes: memory.voxels,
            bricks: renderer.bricks(),
            work: renderer.work(),
            notes: renderer.notes().to_vec(),
        }
    }
}
