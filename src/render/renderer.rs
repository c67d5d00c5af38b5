//! A picture that follows its volume: what changed is shaded, sampled and composited again, and nothing else.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::RenderError;
use super::camera::{Camera, View};
use super::cast::Fold;
use super::layers::{Image, Layers};
use super::light::Light;
use super::marks::Marks;
use super::mode::{Keeps, Mode};
use super::picture::Picture;
use super::refine::{Keeping, Scene, Sparse};
use super::settings::{Cache, RenderSettings};
use super::shade::Shader;
use super::shaded::Dirty;
use super::shown::{Changed, Shown};
use super::stage::Stage;
use super::transfer::Transfer;
use super::work::RenderWork;
use crate::sharing::Sharing;
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

/// How far the refinement of a view has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Whether the picture is the one that a renderer made for the view would have.
    pub finished: bool,
    /// Distance of the rays that the whole picture has at least, pixels; 1 when finished, with adaptive rays too.
    pub spacing: usize,
    /// What was done.
    pub work: RenderWork,
}

/// Keeps the picture of a volume.
pub struct Renderer {
    settings: RenderSettings,
    camera: Camera,
    stage: Stage,
    mode: Mode,
    transfer: Transfer,
    light: Light,
    shader: Shader<f32>,
    shown: Shown,
    fold: Fold,
    pool: Option<Arc<rayon::ThreadPool>>,
    image: Image,
    keeping: Keeping,
    work: RenderWork,
    /// What was read and is not drawn yet.
    changed: Vec<Changed>,
    dirty: Vec<Dirty>,
    marks: Marks,
    /// Bricks that changed while nobody looked; `None` while somebody does.
    missed: Option<BTreeSet<BrickIndex>>,
}

/// Calls a method of a picture in as many channels as it has.
macro_rules! layers {
    ($image:expr, $layers:ident => $call:expr) => {
        match $image {
            Image::Grey($layers) => $call,
            Image::Colour($layers) => $call,
        }
    };
}

/// What a picture is made from, of a renderer and its threads.
macro_rules! scene {
    ($renderer:ident, $sharing:ident) => {
        Scene {
            camera: &$renderer.camera,
            marks: &$renderer.marks,
            stage: &$renderer.stage,
            shown: &$renderer.shown,
            shader: &$renderer.shader,
            fold: $renderer.fold,
            simd: $renderer.settings.simd,
            sharing: $sharing,
        }
    };
}

impl Renderer {
    /// A picture of an empty volume.
    ///
    /// # Errors
    /// [`RenderError`] when the settings make no picture.
    pub fn new(settings: &RenderSettings, stage: Stage) -> Result<Self, RenderError> {
        settings.mode.check()?;
        let camera = Camera::new(&settings.view, settings.size, settings.step, &stage)?;
        let shader = Shader::new(settings, &camera, &stage);
        let marks = Marks::new(&camera, settings.mode.reach());
        let fold = settings.fold(camera.samples())?;
        let pool = settings.pool()?;
        let mut image = match shader.is_grey() {
            true => Image::Grey(Layers::new(&camera, &stage, settings)),
            false => Image::Colour(Layers::new(&camera, &stage, settings)),
        };
        let keeping = layers!(&image, layers => Keeping::choose(settings, &layers.rows, fold));
        image.keep(keeping.cache, fold);
        if settings.adaptive > 0.0 {
            layers!(&mut image, layers => layers.sparse = Some(Sparse::new(&camera, &stage, settings.adaptive)));
        }
        Ok(Self {
            settings: settings.clone(),
            camera,
            stage,
            mode: settings.mode,
            transfer: settings.transfer.clone(),
            light: settings.light,
            shader,
            shown: Shown::new(&stage),
            fold,
            pool,
            image,
            keeping,
            work: RenderWork::default(),
            changed: Vec::new(),
            dirty: Vec::new(),
            missed: None,
            marks,
        })
    }

    /// Brings the picture up to date with what a volume holds in some bricks, given by lattice index divided by 8. The picture is then the one that a renderer
    /// makes that is shown the whole volume at once, bit for bit; while a new view is [refined](Self::refine), it comes to that.
    ///
    /// While [nobody looks](Self::look_away), the bricks are only noted.
    pub fn update(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex]) -> Updated {
        self.take(volume, bricks, None)
    }

    /// As [`Self::update`], where all voxels of the bricks that changed since they were given last lie in a slab; lattice indices. That makes it faster, and
    /// changes no bit; other voxels that changed are not seen to have.
    pub fn update_within(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex], slab: &Prism) -> Updated {
        self.take(volume, bricks, Some(slab))
    }

    fn take(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex], slab: Option<&Prism>) -> Updated {
        let pool = self.pool.clone();
        let read = self.read_within(pool.as_deref(), volume, bricks);
        let mut updated = self.draw_within(slab);
        updated.shade += read.shade;
        updated.work.bricks_read = read.work.bricks_read;
        updated
    }

    /// Takes over what a volume holds in some bricks, as the first half of [`Self::update`]: the volume is not needed for the second, [`Self::draw`], so that it can be
    /// woven on meanwhile. The picture stays as it is until then. May be called several times before.
    ///
    /// The calling thread does it alone, whatever the settings say: whoever waits for the volume waits for no thread that has come by less of a processor.
    pub fn read(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex]) -> Updated {
        self.read_within(None, volume, bricks)
    }

    fn read_within(
        &mut self,
        pool: Option<&rayon::ThreadPool>,
        volume: &(impl Values + ?Sized),
        bricks: &[BrickIndex],
    ) -> Updated {
        if let Some(missed) = &mut self.missed {
            missed.extend(bricks);
            return Updated::default();
        }
        let began = Instant::now();
        let work = RenderWork { bricks_read: bricks.len() as u64, ..RenderWork::default() };
        Sharing::within(pool, |sharing| {
            self.shown.take(volume, bricks, self.settings.simd, sharing, &mut self.changed);
        });
        self.work += work;
        Updated { shade: began.elapsed(), work, ..Updated::default() }
    }

    /// Brings the picture up to date with what was [read](Self::read).
    pub fn draw(&mut self) -> Updated {
        self.draw_within(None)
    }

    fn draw_within(&mut self, slab: Option<&Prism>) -> Updated {
        let began = Instant::now();
        let mut work = RenderWork { bricks_changed: self.changed.len() as u64, ..RenderWork::default() };
        if self.changed.is_empty() {
            return Updated::default();
        }
        let pool = self.pool.clone();
        let (shade, rays) = Sharing::within(pool.as_deref(), |sharing| {
            self.dirty.clear();
            let simd = self.settings.simd;
            let voxels = self.shown.dilated(&self.changed);
            let (shown, shader, dirty) = (&self.shown, &self.shader, &mut self.dirty);
            work.voxels_shaded += layers!(&mut self.image, layers => {
                layers.voxels.update(shown, &voxels, shader, simd, sharing, dirty)
            });
            let shade = began.elapsed();
            let first = self.stage.first();
            let slab = slab.map(|slab| slab.shifted(first.map(|x| -x)));
            debug_assert!(slab.is_none_or(|slab| self.changed.iter().all(|changed| changed.lies_in(&slab))));
            self.marks.set(&self.dirty, slab.as_ref().map(|slab| &slab.faces));
            let (scene, cache) = (scene!(self, sharing), self.keeping.cache);
            work += layers!(&mut self.image, layers => layers.follow(&self.dirty, scene, cache));
            (shade, began.elapsed() - shade)
        });
        self.changed.clear();
        self.work += work;
        Updated { shade, rays, work }
    }

    /// Looks from elsewhere. The picture is at once a coarse one of the new view, and [`Self::refine`] makes it exact; what was to be done for a view before is
    /// dropped.
    ///
    /// # Errors
    /// [`RenderError::View`] for no view; then nothing has changed.
    pub fn look(&mut self, view: View) -> Result<Updated, RenderError> {
        let began = Instant::now();
        if view == self.settings.view {
            return Ok(Updated::default());
        }
        let camera = Camera::new(&view, self.settings.size, self.settings.step, &self.stage)?;
        self.draw();
        self.settings.view = view;
        self.camera = camera;
        self.marks = Marks::new(&self.camera, self.mode.reach());
        self.shader = Shader::new(&self.settings, &self.camera, &self.stage);
        let relight = self.mode.keeps() == Keeps::Lit && self.mode.is_lit() && self.light.depends_on_view();
        let epsilon = self.settings.adaptive;
        let looks = self.missed.is_none();
        let pool = self.pool.clone();
        let work = Sharing::within(pool.as_deref(), |sharing| {
            let scene = scene!(self, sharing);
            layers!(&mut self.image, layers => {
                layers.turn(scene, epsilon, relight);
                if looks { layers.begin(scene) } else { RenderWork::default() }
            })
        });
        self.work += work;
        Ok(Updated { shade: Duration::ZERO, rays: began.elapsed(), work })
    }

    /// Goes on making the picture of a new view exact, step by step, until it is or the time is over; at least one step. A step takes a few milliseconds, so a
    /// caller that has a slice or another view waiting comes to it soon. Does nothing while [nobody looks](Self::look_away).
    pub fn refine(&mut self, time: Duration) -> Progress {
        let began = Instant::now();
        self.draw();
        let mut work = RenderWork::default();
        let pool = self.pool.clone();
        let spacing = Sharing::within(pool.as_deref(), |sharing| {
            let scene = scene!(self, sharing);
            let keeping = &mut self.keeping;
            let looks = self.missed.is_none();
            layers!(&mut self.image, layers => loop {
                let spacing = layers.spacing();
                if spacing.is_none() || !looks {
                    break spacing;
                }
                work += layers.step(scene, keeping);
                if began.elapsed() >= time {
                    break layers.spacing();
                }
            })
        });
        self.work += work;
        Progress { finished: spacing.is_none(), spacing: spacing.unwrap_or(1), work }
    }

    /// Nobody looks from now on: nothing is shaded or cast until [somebody does](Self::look_back).
    pub fn look_away(&mut self) {
        self.draw();
        self.missed.get_or_insert_default();
    }

    /// Somebody looks again: catches up with what changed in the meantime.
    pub fn look_back(&mut self, volume: &(impl Values + ?Sized)) -> Updated {
        let Some(missed) = self.missed.take() else { return Updated::default() };
        self.update(volume, &Vec::from_iter(missed))
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
                layers.pixels(|p| self.mode.pixel([p.colour[0]; 3], p.transmittance, &self.transfer))
            }
            Image::Colour(layers) => layers.pixels(|p| self.mode.pixel(p.colour, p.transmittance, &self.transfer)),
        };
        Picture { size, pixels }
    }

    /// What of the volume is shown.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// The light on it.
    pub fn light(&self) -> Light {
        self.light
    }

    /// Work done so far.
    pub fn work(&self) -> RenderWork {
        self.work
    }

    /// What the user should know: sentences.
    pub fn notes(&self) -> &[String] {
        &self.keeping.notes
    }

    /// What is kept of rays; less than was asked for where that would have been too much.
    pub fn cache(&self) -> Cache {
        self.keeping.cache
    }

    /// Differences of pixels for which rays are left out; see [`RenderSettings::adaptive`].
    pub fn adaptive(&self) -> f32 {
        self.settings.adaptive
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

    pub(super) fn fold(&self) -> Fold {
        self.fold
    }

    pub(super) fn shader(&self) -> &Shader<f32> {
        &self.shader
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
        let (shaded, rays) = layers!(&self.image, layers => (layers.voxels.bytes(), layers.bytes()));
        RenderMemory { voxels: self.shown.bytes() + shaded, rays }
    }

    /// Bricks of the stage that hold anything.
    pub fn bricks(&self) -> usize {
        self.shown.len()
    }
}
