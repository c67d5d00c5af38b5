//! A picture that follows its volume: what changed is shaded, sampled and composited again, and nothing else.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::RenderError;
use super::camera::Camera;
use super::cast::Fold;
use super::layers::{Image, Layers};
use super::marks::Marks;
use super::picture::Picture;
use super::settings::{Cache, RenderSettings};
use super::shade::Shader;
use super::shaded::Dirty;
use super::shown::{Changed, Shown};
use super::stage::Stage;
use super::work::RenderWork;
use crate::sharing::Sharing;
use crate::simd::Simd;
use crate::volume::brick::BrickIndex;
use crate::volume::{Prism, Values};

/// What an update took, and did.
#[derive(Debug, Clone, Copy, Default)]
pub struct Updated {
    /// Reading what changed, classifying and lighting it.
    pub shade: Duration,
    /// Sampling and compositing rays.
    pub rays: Duration,
    /// What was done.
    pub work: RenderWork,
}

/// Bytes held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RenderMemory {
    /// Values, weights and shaded voxels.
    pub voxels: u64,
    /// Rays, with what is kept of them.
    pub rays: u64,
}

/// Keeps the picture of a volume.
pub struct Renderer {
    camera: Camera,
    stage: Stage,
    shader: Shader<f32>,
    shown: Shown,
    fold: Fold,
    simd: Simd,
    pool: Option<Arc<rayon::ThreadPool>>,
    image: Image,
    cache: Cache,
    notes: Vec<String>,
    work: RenderWork,
    changed: Vec<Changed>,
    dirty: Vec<Dirty>,
    marks: Marks,
}

impl Renderer {
    /// A picture of an empty volume.
    ///
    /// # Errors
    /// [`RenderError`] when the settings make no picture.
    pub fn new(settings: &RenderSettings, stage: Stage) -> Result<Self, RenderError> {
        let camera = Camera::new(&settings.view, settings.size, settings.step, &stage)?;
        let shader = Shader::new(settings, &camera, &stage);
        let marks = Marks::new(&camera);
        let fold = settings.fold(camera.samples())?;
        let pool = settings.pool()?;
        let mut notes = Vec::new();
        let mut image = match shader.is_grey() {
            true => Image::Grey(Layers::new(&camera, &stage)),
            false => Image::Colour(Layers::new(&camera, &stage)),
        };
        let fits = |cache: &Cache| image.cache_bytes(*cache, fold) <= settings.cache_bytes;
        let smaller = [settings.cache, Cache::OneLevel, Cache::None];
        let cache = smaller.into_iter().find(fits).unwrap_or(Cache::None);
        if cache != settings.cache {
            notes.push(format!(
                "the {} ray cache would take {:.0} MB, more than the {:.0} MB that it may: the cache is {} instead; raise --cache-bytes, or ask for a \
                 smaller picture or a longer step",
                settings.cache.name(),
                image.cache_bytes(settings.cache, fold) as f64 / 1e6,
                settings.cache_bytes as f64 / 1e6,
                cache.name()
            ));
        }
        image.keep(cache, fold);
        Ok(Self {
            camera,
            stage,
            shader,
            shown: Shown::new(&stage),
            fold,
            simd: settings.simd,
            pool,
            image,
            cache,
            notes,
            work: RenderWork::default(),
            changed: Vec::new(),
            dirty: Vec::new(),
            marks,
        })
    }

    /// Brings the picture up to date with what a volume holds in some bricks, given by lattice index divided by 8. The picture is then the one that a renderer
    /// makes that is shown the whole volume at once, bit for bit.
    pub fn update(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex]) -> Updated {
        self.take(volume, bricks, None)
    }

    /// As [`Self::update`], where all voxels of the bricks that changed since they were given last lie in a slab; lattice indices. That makes it faster, and
    /// changes no bit; other voxels that changed are not seen to have.
    pub fn update_within(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex], slab: &Prism) -> Updated {
        self.take(volume, bricks, Some(slab))
    }

    fn take(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex], slab: Option<&Prism>) -> Updated {
        let began = Instant::now();
        let mut work = RenderWork { bricks_read: bricks.len() as u64, ..RenderWork::default() };
        let pool = self.pool.clone();
        let (shade, rays) = Sharing::within(pool.as_deref(), |sharing| {
            self.changed.clear();
            self.dirty.clear();
            self.shown.take(volume, bricks, self.simd, sharing, &mut self.changed);
            work.bricks_changed = self.changed.len() as u64;
            if self.changed.is_empty() {
                return (began.elapsed(), Duration::ZERO);
            }
            let voxels = self.shown.dilated(&self.changed);
            let (shown, shader, dirty) = (&self.shown, &self.shader, &mut self.dirty);
            work.voxels_shaded += match &mut self.image {
                Image::Grey(layers) => layers.shaded.update(shown, &voxels, shader, self.simd, sharing, dirty),
                Image::Colour(layers) => layers.shaded.update(shown, &voxels, shader, self.simd, sharing, dirty),
            };
            let shade = began.elapsed();
            let first = self.stage.first();
            let slab = slab.map(|slab| slab.shifted(first.map(|x| -x)));
            debug_assert!(slab.is_none_or(|slab| self.changed.iter().all(|changed| changed.lies_in(&slab))));
            self.marks.set(&self.dirty, slab.as_ref().map(|slab| &slab.faces));
            work += match &mut self.image {
                Image::Grey(layers) => layers.cast(&self.marks, self.fold, self.simd, sharing),
                Image::Colour(layers) => layers.cast(&self.marks, self.fold, self.simd, sharing),
            };
            (shade, began.elapsed() - shade)
        });
        self.work += work;
        Updated { shade, rays, work }
    }

    /// As [`Self::update`] with all bricks of a volume.
    pub fn update_all(&mut self, volume: &(impl Values + ?Sized)) -> Updated {
        let bricks: Vec<BrickIndex> = volume.bricks().collect();
        self.update(volume, &bricks)
    }

    /// The picture as it is.
    pub fn picture(&self) -> Picture {
        let size = self.camera.size();
        let pixels = match &self.image {
            Image::Grey(layers) => {
                let grey = |p: &super::cast::Through<1>| [p.colour[0], p.colour[0], p.colour[0], p.transmittance];
                layers.rows.iter().flat_map(|row| row.pixels.iter().map(grey)).collect()
            }
            Image::Colour(layers) => {
                let colour = |p: &super::cast::Through<3>| [p.colour[0], p.colour[1], p.colour[2], p.transmittance];
                layers.rows.iter().flat_map(|row| row.pixels.iter().map(colour)).collect()
            }
        };
        Picture { size, pixels }
    }

    /// Work done so far.
    pub fn work(&self) -> RenderWork {
        self.work
    }

    /// What the user should know: sentences.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// What is kept of rays; less than was asked for where that would have been too much.
    pub fn cache(&self) -> Cache {
        self.cache
    }

    /// Samples of a block.
    pub fn arity(&self) -> u32 {
        self.fold.arity
    }

    /// Samples along a ray.
    pub fn samples(&self) -> u32 {
        self.camera.samples()
    }

    /// The rays.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    pub(super) fn image(&self) -> &Image {
        &self.image
    }

    /// The box that is looked at.
    pub fn stage(&self) -> &Stage {
        &self.stage
    }

    /// Bytes held.
    pub fn memory(&self) -> RenderMemory {
        let (shaded, rays) = match &self.image {
            Image::Grey(layers) => (layers.shaded.bytes(), layers.bytes()),
            Image::Colour(layers) => (layers.shaded.bytes(), layers.bytes()),
        };
        RenderMemory { voxels: self.shown.bytes() + shaded, rays }
    }

    /// Bricks of the stage that hold anything.
    pub fn bricks(&self) -> usize {
        self.shown.len()
    }
}
