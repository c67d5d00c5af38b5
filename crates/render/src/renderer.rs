//! The renderer: keeps a picture that follows its volume. Only the changed parts are shaded,
//! sampled and composited again.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use simd::sharing::Sharing;
use simd::team::Team;
use volume::brick::BrickIndex;
use volume::{Prism, Values};

use super::RenderError;
use super::camera::{Camera, View};
use super::classify::light::Light;
use super::classify::shade::Shader;
use super::classify::transfer::Transfer;
use super::crop::{Crop, Cropped, LatticeCrop};
use super::layers::{Channels, Image, Layers, channels};
use super::mode::{Mode, VoxelData};
use super::partition::choice;
use super::partition::shared::Parts;
use super::picture::{OpaquePixels, Picture, bytes_over};
use super::rays::composite::{CompositeMode, Fold};
use super::rays::marks::Marks;
use super::refine::{CacheChoice, Context, Sparse};
use super::region::RenderRegion;
use super::settings::{Cache, RenderSettings};
use super::shaded::Dirty;
use super::snapshot::{Changed, VoxelSnapshot};
use super::stock::stocked;
use super::work::{RenderMemory, RenderWork};

/// Time and work of an update.
#[derive(Debug, Clone, Copy, Default)]
pub struct Updated {
    /// Time to read, classify and light the changes; in parts, to read them.
    pub shade: Duration,
    /// Time to sample and composite rays; in parts, also to classify and light.
    pub rays: Duration,
    /// Work done.
    pub work: RenderWork,
}

/// Refinement progress of a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Whether the picture equals that of a renderer made for the view.
    pub finished: bool,
    /// Current ray distance of the whole picture, pixels; 1 when finished, with adaptive rays
    /// too.
    pub spacing: usize,
    /// Work done.
    pub work: RenderWork,
}

/// Keeps the picture of a volume.
pub struct Renderer {
    settings: RenderSettings,
    camera: Camera,
    region: RenderRegion,
    mode: Mode,
    transfer: Transfer,
    light: Light,
    shader: Shader<f32>,
    /// The parts of the volume that the crop hides.
    crop: LatticeCrop,
    snapshot: VoxelSnapshot,
    fold: Fold,
    team: Option<Arc<Team>>,
    image: Image,
    /// The parts, if the picture is rendered in parts. They then hold the voxels, and the image
    /// only the pixels.
    parts: Parts,
    cache_choice: CacheChoice,
    work: RenderWork,
    /// Changes that were read but are not drawn yet.
    changed: Vec<Changed>,
    /// Voxels to be shaded again.
    due: Vec<Changed>,
    dirty: Vec<Dirty>,
    marks: Marks,
    /// Bricks that changed while the view was hidden; `None` while it is visible.
    missed: Option<BTreeSet<BrickIndex>>,
}

/// Builds the context of a renderer and its threads.
macro_rules! context {
    ($renderer:ident, $sharing:ident) => {
        Context {
            camera: &$renderer.camera,
            marks: &$renderer.marks,
            region: &$renderer.region,
            snapshot: &$renderer.snapshot,
            shader: &$renderer.shader,
            fold: $renderer.fold,
            simd: $renderer.settings.simd,
            sharing: $sharing,
        }
    };
}

impl Renderer {
    /// Creates a picture of an empty volume.
    ///
    /// # Errors
    /// [`RenderError`] for invalid settings.
    pub fn new(settings: &RenderSettings, region: RenderRegion) -> Result<Self, RenderError> {
        settings.mode.check()?;
        let camera = Camera::new(&settings.view, settings.size, settings.step, &region)?;
        let shader = Shader::new(settings, &camera, &region);
        let marks = Marks::new(&camera, settings.mode.reach());
        let fold = settings.fold(camera.samples())?;
        let team = settings.team()?;
        let mut image = match shader.is_grey() {
            true => Image::Grey(Layers::new(&camera, &region, settings, fold)),
            false => Image::Colour(Layers::new(&camera, &region, settings, fold)),
        };
        let mut cache_choice = channels!(&image, layers => CacheChoice::choose(settings, &layers.rows));
        let one_level =
            channels!(&image, layers => layers.rows.iter().map(|row| row.cache_bytes(Cache::OneLevel)).sum());
        let (count, note) = choice::choose(settings, &region, one_level)?;
        let mut parts = Parts::default();
        if count > 1 {
            parts = Parts::new(settings, &region, (&camera, &image), count, Sharing::of(team.as_deref()))?;
            cache_choice.cache = Cache::OneLevel;
            cache_choice.notes = Vec::from_iter(note);
        } else {
            cache_choice.notes.extend(note);
            image.keep(cache_choice.cache, fold);
        }
        if settings.adaptive > 0.0 {
            channels!(&mut image, layers => layers.sparse = Some(Sparse::new(&camera, &region, settings.adaptive, true)));
        }
        Ok(Self {
            settings: settings.clone(),
            camera,
            region,
            mode: settings.mode,
            transfer: settings.transfer.clone(),
            light: settings.light,
            shader,
            crop: LatticeCrop::new(settings.crop.present(), region.world_from_lattice()),
            snapshot: VoxelSnapshot::new(&region, stocked(&region)),
            fold,
            team,
            image,
            parts,
            cache_choice,
            work: RenderWork::default(),
            changed: Vec::new(),
            due: Vec::new(),
            dirty: Vec::new(),
            missed: None,
            marks,
        })
    }

    /// Updates the picture from some bricks of a volume, given by lattice index divided by 8.
    /// The picture then equals, bit for bit, that of a renderer which reads the whole volume at
    /// once. While a new view is [refined](Self::refine), the picture converges to that.
    ///
    /// While the view is [hidden](Self::hide), the bricks are only noted.
    pub fn update(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex]) -> Updated {
        self.update_and_draw(volume, bricks, None)
    }

    /// Updates like [`Self::update`], if all changed voxels of the bricks lie in a slab; lattice
    /// indices. The slab makes the update faster and changes no bit. Changes outside the slab
    /// are missed.
    pub fn update_within(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex], slab: &Prism) -> Updated {
        self.update_and_draw(volume, bricks, Some(slab))
    }

    fn update_and_draw(
        &mut self,
        volume: &(impl Values + ?Sized),
        bricks: &[BrickIndex],
        slab: Option<&Prism>,
    ) -> Updated {
        let team = self.team.clone();
        let read = self.read_shared(Sharing::of(team.as_deref()), volume, bricks);
        let mut updated = self.draw_within(slab);
        updated.shade += read.shade;
        updated.work += read.work;
        updated
    }

    /// Reads some bricks of a volume, the first half of [`Self::update`]. The second half,
    /// [`Self::draw`], does not need the volume, so insertion can continue meanwhile. The
    /// picture stays unchanged until then. Several reads may precede one draw.
    ///
    /// The calling thread does this alone, whatever the settings say. A caller that holds the
    /// volume then never waits for a thread that got less processor time.
    pub fn read(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex]) -> Updated {
        self.read_shared(Sharing::Alone, volume, bricks)
    }

    fn read_shared(&mut self, sharing: Sharing, volume: &(impl Values + ?Sized), bricks: &[BrickIndex]) -> Updated {
        if let Some(missed) = &mut self.missed {
            missed.extend(bricks);
            return Updated::default();
        }
        let began = Instant::now();
        let volume = &Cropped::new(volume, &self.crop);
        let bricks_unprepared = match self.parts.is_none() {
            true => {
                let (visible, simd) = (self.shader.visible(), self.settings.simd);
                self.snapshot.read(volume, bricks, |_| true, visible, (simd, sharing), &mut self.changed)
            }
            false => {
                self.parts.read(volume, bricks, sharing);
                0
            }
        };
        let work = RenderWork { bricks_read: bricks.len() as u64, bricks_unprepared, ..RenderWork::default() };
        self.work += work;
        Updated { shade: began.elapsed(), work, ..Updated::default() }
    }

    /// Hides other parts of the volume. Only bricks are read again that one of both crops may
    /// hide, and the other does not.
    pub fn set_crop(&mut self, crop: Crop, volume: &(impl Values + ?Sized)) -> Updated {
        let lattice = self.region.world_from_lattice();
        let [lost, gained] = self.settings.crop.differing(&crop).map(|of| LatticeCrop::new(of, lattice));
        let bricks: Vec<BrickIndex> =
            volume.bricks().filter(|brick| lost.reaches(*brick) || gained.reaches(*brick)).collect();
        self.crop = LatticeCrop::new(crop.present(), lattice);
        self.parts.set_crop(|| LatticeCrop::new(crop.present(), lattice));
        self.settings.crop = crop;
        self.update(volume, &bricks)
    }

    /// Updates the picture from the bricks [read](Self::read) before.
    pub fn draw(&mut self) -> Updated {
        self.draw_within(None)
    }

    /// Updates the picture like [`Self::draw`], if all changed voxels of the bricks lie in a slab;
    /// lattice indices. The slab makes the update faster and changes no bit.
    pub fn draw_within(&mut self, slab: Option<&Prism>) -> Updated {
        let began = Instant::now();
        if !self.parts.is_none() {
            return self.draw_parts(slab);
        }
        let mut work = RenderWork { bricks_changed: self.changed.len() as u64, ..RenderWork::default() };
        if self.changed.is_empty() {
            return Updated::default();
        }
        let (simd, sharing) = (self.settings.simd, Sharing::of(self.team.as_deref()));
        self.dirty.clear();
        self.snapshot.dilated(&mut self.changed, &mut self.due, sharing);
        let (snapshot, shader, dirty) = (&self.snapshot, &self.shader, &mut self.dirty);
        work += channels!(&mut self.image, layers => {
            layers.voxels.update(snapshot, &self.due, shader, (simd, sharing), dirty)
        });
        let shade = began.elapsed();
        let first = self.region.first();
        let slab = slab.map(|slab| slab.shifted(first.map(|x| -x)));
        debug_assert!(slab.is_none_or(|slab| self.changed.iter().all(|changed| changed.lies_in(&slab))));
        self.marks.set(&self.dirty, slab.as_ref().map(|slab| &slab.faces));
        let (context, cache) = (context!(self, sharing), self.cache_choice.cache);
        work += channels!(&mut self.image, layers => layers.follow(&self.dirty, context, cache));
        let rays = began.elapsed() - shade;
        self.changed.clear();
        self.work += work;
        Updated { shade, rays, work }
    }

    /// Same as [`Self::draw_within`], in parts. They shade and cast side by side, so all of it is
    /// time of the rays.
    fn draw_parts(&mut self, slab: Option<&Prism>) -> Updated {
        let began = Instant::now();
        if !self.parts.has_changed() {
            return Updated::default();
        }
        let slab = slab.map(|slab| slab.shifted(self.region.first().map(|x| -x)));
        let sharing = Sharing::of(self.team.as_deref());
        let work = self.parts.draw(slab.as_ref(), &mut self.image, self.fold, sharing);
        self.work += work;
        Updated { shade: Duration::ZERO, rays: began.elapsed(), work }
    }

    /// Changes the view. The picture is at once a coarse one of the new view, and
    /// [`Self::refine`] makes it exact. Remaining work for an earlier view is dropped. A picture
    /// in parts is rendered without parts from then on.
    ///
    /// # Errors
    /// [`RenderError::View`] for an invalid view; then nothing changes.
    pub fn set_view(&mut self, view: View) -> Result<Updated, RenderError> {
        let began = Instant::now();
        if view == self.settings.view {
            return Ok(Updated::default());
        }
        let camera = Camera::new(&view, self.settings.size, self.settings.step, &self.region)?;
        self.draw();
        self.parts.unite(&mut self.snapshot, &mut self.image);
        self.settings.view = view;
        let work = self.turn(camera, self.light.depends_on_view());
        Ok(Updated { shade: Duration::ZERO, rays: began.elapsed(), work })
    }

    /// Widens the render region. All voxels are kept, and the picture is cast again like that of a
    /// [new view](Self::set_view). Returns `false`, and changes nothing, where only a new renderer
    /// can: for parts, and if the region does not hold the present one.
    ///
    /// # Errors
    /// [`RenderError`] for settings that are invalid with this region; then nothing changes.
    pub fn widen(&mut self, region: RenderRegion) -> Result<bool, RenderError> {
        let camera = Camera::new(&self.settings.view, self.settings.size, self.settings.step, &region)?;
        let fold = self.settings.fold(camera.samples())?;
        let is_whole = self.parts.is_none() && self.settings.parts.is_none();
        let Some(by) = region.place_of(&self.region).filter(|_| is_whole) else { return Ok(false) };
        self.draw();
        self.snapshot.widen(&region, by, stocked(&region));
        channels!(&mut self.image, layers => layers.voxels.widen(&region, by, stocked(&region)));
        (self.region, self.fold) = (region, fold);
        // Depth is that in the region. The light of the present view may be unfinished.
        let is_unlit = channels!(&self.image, layers => layers.refinement.as_ref().is_some_and(|of| of.relight));
        self.turn(camera, is_unlit || self.light.depth_cue().is_some());
        Ok(true)
    }

    /// Begins the picture of another camera; `relight` if its light differs.
    fn turn(&mut self, camera: Camera, relight: bool) -> RenderWork {
        self.camera = camera;
        self.marks = Marks::new(&self.camera, self.mode.reach());
        self.shader = Shader::new(&self.settings, &self.camera, &self.region);
        let relight = relight && self.mode.voxel_data() == VoxelData::Lit && self.mode.is_lit();
        let epsilon = self.settings.adaptive;
        let visible = self.missed.is_none();
        let sharing = Sharing::of(self.team.as_deref());
        let context = context!(self, sharing);
        let work = channels!(&mut self.image, layers => {
            layers.turn(context, epsilon, relight);
            if visible { layers.begin(context) } else { RenderWork::default() }
        });
        self.work += work;
        work
    }

    /// Continues the refinement of a new view until it is exact or the time is over; at least
    /// one step. A step takes a few milliseconds, so a caller soon gets to a waiting slice or
    /// another view. Does nothing while the view is [hidden](Self::hide).
    pub fn refine(&mut self, time: Duration) -> Progress {
        let began = Instant::now();
        self.draw();
        let mut work = RenderWork::default();
        let sharing = Sharing::of(self.team.as_deref());
        let context = context!(self, sharing);
        let cache_choice = &mut self.cache_choice;
        let visible = self.missed.is_none();
        let spacing = channels!(&mut self.image, layers => loop {
            let spacing = layers.spacing();
            if spacing.is_none() || !visible {
                break spacing;
            }
            work += layers.step(context, cache_choice);
            if began.elapsed() >= time {
                break layers.spacing();
            }
        });
        self.work += work;
        Progress { finished: spacing.is_none(), spacing: spacing.unwrap_or(1), work }
    }

    /// Marks the view as hidden: nothing is shaded or cast until [it is visible
    /// again](Self::show).
    pub fn hide(&mut self) {
        self.draw();
        self.missed.get_or_insert_default();
    }

    /// Marks the view as visible and applies the changes missed meanwhile.
    pub fn show(&mut self, volume: &(impl Values + ?Sized)) -> Updated {
        let Some(missed) = self.missed.take() else { return Updated::default() };
        self.update(volume, &Vec::from_iter(missed))
    }

    /// Updates like [`Self::update`], from all bricks of a volume.
    pub fn update_all(&mut self, volume: &(impl Values + ?Sized)) -> Updated {
        let bricks: Vec<BrickIndex> = volume.bricks().collect();
        self.update(volume, &bricks)
    }

    /// Returns the current picture.
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

    /// Returns the current picture over a background of red, green, blue from 0 to 1, with the
    /// bytes of [`Picture::over`]. It is grey if picture and background are.
    pub fn opaque_pixels(&self, background: [f32; 3]) -> OpaquePixels {
        let (mode, transfer) = (self.mode, &self.transfer);
        let [red, green, blue] = background;
        let is_grey = red == green
            && green == blue
            && (mode.composite_mode(transfer) == CompositeMode::Over || transfer.is_grey());
        let (width, work) = (self.camera.size()[0], (self.settings.simd, Sharing::of(self.team.as_deref())));
        match &self.image {
            Image::Grey(layers) if is_grey => OpaquePixels::Grey(layers.bytes_of(width, work, |p| {
                [bytes_over(mode.pixel([p.colour[0]; 3], p.transmittance, transfer), background)[0]]
            })),
            Image::Grey(layers) => OpaquePixels::Colour(layers.bytes_of(width, work, |p| {
                bytes_over(mode.pixel([p.colour[0]; 3], p.transmittance, transfer), background)
            })),
            Image::Colour(layers) => OpaquePixels::Colour(
                layers
                    .bytes_of(width, work, |p| bytes_over(mode.pixel(p.colour, p.transmittance, transfer), background)),
            ),
        }
    }

    /// Returns the settings, with the present view and crop.
    pub fn settings(&self) -> &RenderSettings {
        &self.settings
    }

    /// Returns the render mode.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Returns the light.
    pub fn light(&self) -> Light {
        self.light
    }

    /// Returns the work done so far.
    pub fn work(&self) -> RenderWork {
        self.work
    }

    /// Returns notes for the user: sentences.
    pub fn notes(&self) -> &[String] {
        &self.cache_choice.notes
    }

    /// Returns the ray cache in use; smaller than requested if that would have taken too much
    /// memory.
    pub fn cache(&self) -> Cache {
        self.cache_choice.cache
    }

    /// Returns the pixel difference below which rays are left out; see
    /// [`RenderSettings::adaptive`].
    pub fn adaptive(&self) -> f32 {
        self.settings.adaptive
    }

    /// Returns the samples of a block.
    pub fn arity(&self) -> u32 {
        self.fold.arity
    }

    /// Returns the samples along a ray.
    pub fn samples(&self) -> u32 {
        self.camera.samples()
    }

    /// Returns the camera.
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

    pub(super) fn parts(&self) -> &Parts {
        &self.parts
    }

    /// Returns the number of parts in which it is rendered; 1 if it is rendered without.
    pub fn count_of_parts(&self) -> u32 {
        self.parts.count()
    }

    /// Returns the render region.
    pub fn region(&self) -> &RenderRegion {
        &self.region
    }

    /// Returns the memory in use.
    pub fn memory(&self) -> RenderMemory {
        let (shaded, rays) = channels!(&self.image, layers => (layers.voxels.bytes(), layers.bytes()));
        let [voxels, of_parts] = self.parts.bytes();
        RenderMemory { voxels: voxels + self.snapshot.bytes() + shaded, rays: rays + of_parts }
    }

    /// Returns the number of bricks whose voxels are held: those that have shown anything, and
    /// their neighbours.
    pub fn bricks(&self) -> usize {
        self.snapshot.len() + self.parts.bricks()
    }
}
