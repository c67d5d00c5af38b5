//! Pictures by rays: of a volume in memory, or of a level on the disk, whose chunks are read when
//! they are needed. If its voxels do not fit into memory at once, it is rendered part after part.

use std::ops::Range;
use std::time::{Duration, Instant};

use render::camera::Camera;
use render::classify::soft::SoftLight;
use render::partition::Message;
use render::soft::{self, SoftWork};
use render::{Compositor, Part, Picture, Plan, RenderMemory, RenderRegion, RenderSettings, RenderWork, Renderer};
use simd::team::Team;
use statistics::{PartNumbers, PictureNumbers};
use volume::Values as _;
use volume::brick::BrickIndex;

use super::request::milliseconds;
use super::volume::{LevelOnDisk, RenderVolume};
use crate::failure::{Failure, FailureKind};

/// Scene of a picture by rays.
pub(super) struct Rays<'a> {
    pub(super) volume: &'a RenderVolume,
    pub(super) settings: &'a RenderSettings,
    pub(super) soft: Option<&'a SoftLight>,
    pub(super) region: RenderRegion,
    pub(super) team: Option<&'a Team>,
    /// Limit of memory, of which chunks take a quarter, voxels a half, and rays the rest.
    pub(super) memory_bytes: u64,
}

/// A finished picture.
pub(super) struct Finished {
    pub(super) picture: Picture,
    pub(super) camera: Camera,
    pub(super) numbers: PictureNumbers,
    /// Bands of rows, one rendered after the other.
    pub(super) bands: u32,
    /// Work for soft light.
    pub(super) soft: Option<SoftWork>,
    /// Memory of the compositor; `None` without parts.
    pub(super) compositor_bytes: Option<u64>,
    /// Time to set up the rays, to read, and to shade and cast, ms.
    pub(super) prepare_ms: f64,
    pub(super) shade_ms: f64,
    pub(super) rays_ms: f64,
    pub(super) notes: Vec<String>,
    /// Its renderer, if all voxels fit into memory.
    pub(super) renderer: Option<Renderer>,
}

impl Rays<'_> {
    /// Renders the picture.
    ///
    /// # Errors
    /// [`Failure`] when memory does not suffice, or a chunk cannot be read.
    pub(super) fn picture(&self) -> Result<Finished, Failure> {
        if let Some(light) = self.soft {
            return self.in_soft_light(light);
        }
        let level = match self.volume {
            RenderVolume::Dense(dense) => {
                return self.whole(|renderer| {
                    let updated = renderer.update_all(&**dense);
                    (updated.shade, updated.rays)
                });
            }
            RenderVolume::Level(level) => level,
        };
        let bricks: Vec<BrickIndex> = level.values.bricks().collect();
        let [of_voxels, _] = self.limits();
        let whole_bytes = Plan::whole_bytes(self.settings, &self.region, &bricks);
        let is_adaptive = self.settings.adaptive > 0.0;
        if self.settings.parts.is_none() && whole_bytes <= of_voxels {
            return self.whole(|renderer| {
                let began = Instant::now();
                let region = renderer.region();
                let seen: Vec<BrickIndex> = bricks.iter().copied().filter(|brick| region.holds(*brick)).collect();
                for group in level.values.groups(&seen) {
                    level.values.load(group, self.team);
                    renderer.read(&level.values, group);
                }
                let read = began.elapsed();
                let updated = renderer.draw();
                (read + updated.shade, updated.rays)
            });
        }
        if is_adaptive {
            return Err(Failure::new(format!(
                "--adaptive: rays are left out only if all voxels fit into memory, and they would take {} MB, more \
                 than half of --max-memory; raise it, leave --adaptive out, or give a coarser --level",
                whole_bytes.div_ceil(1_000_000)
            ))
            .of(FailureKind::Memory));
        }
        let mut finished = self.in_parts(level, &bricks)?;
        if self.settings.parts.is_none() {
            finished.notes.push(format!(
                "the voxels would take {} MB at once, more than half of --max-memory: the picture is rendered in {} \
                 parts and {} bands of rows, one after the other",
                whole_bytes.div_ceil(1_000_000),
                finished.numbers.parts,
                finished.bands
            ));
        }
        Ok(finished)
    }

    /// Renders the picture in soft light.
    fn in_soft_light(&self, light: &SoftLight) -> Result<Finished, Failure> {
        let began = Instant::now();
        let bricks = self.volume.values().bricks().count() as u64;
        let most_bytes = soft::most_bytes(&self.region, bricks);
        if most_bytes > self.memory_bytes {
            return Err(Failure::new(format!(
                "--soft: the smoothed volume and its light would take up to {} MB, more than --max-memory; raise it, \
                 leave --soft out, or give a coarser --level",
                most_bytes.div_ceil(1_000_000)
            ))
            .of(FailureKind::Memory));
        }
        let (renderer, work) = soft::render(self.volume.values(), self.settings, light, &self.region)?;
        self.volume.check()?;
        let numbers = PictureNumbers::of(&renderer, self.settings.size);
        // The light belongs to this view: the renderer makes no other picture.
        Ok(Finished {
            soft: Some(work),
            renderer: None,
            ..finished(renderer, numbers, [0.0, 0.0, milliseconds(began)])
        })
    }

    /// Most bytes of voxels and of rays.
    pub(super) fn limits(&self) -> [u64; 2] {
        [self.memory_bytes / 2, self.memory_bytes / 4]
    }

    /// Renders without parts; `update` has a renderer read and draw, and returns the time of both.
    fn whole(&self, update: impl FnOnce(&mut Renderer) -> (Duration, Duration)) -> Result<Finished, Failure> {
        let began = Instant::now();
        let mut renderer = Renderer::new(self.settings, self.region)?;
        let prepare_ms = milliseconds(began);
        let (shade, rays) = update(&mut renderer);
        self.volume.check()?;
        let numbers = PictureNumbers::of(&renderer, self.settings.size);
        Ok(finished(renderer, numbers, [prepare_ms, shade.as_secs_f64() * 1e3, rays.as_secs_f64() * 1e3]))
    }

    /// Renders the picture by the renderer of another view of the same volume, which has its
    /// voxels.
    ///
    /// # Errors
    /// [`Failure`] for an invalid view.
    pub(super) fn turned(&self, mut renderer: Renderer) -> Result<Finished, Failure> {
        let began = Instant::now();
        let mut work = renderer.set_view(self.settings.view)?.work;
        work += renderer.refine(Duration::MAX).work;
        let numbers = PictureNumbers { work, ..PictureNumbers::of(&renderer, self.settings.size) };
        Ok(finished(renderer, numbers, [0.0, 0.0, milliseconds(began)]))
    }

    fn in_parts(&self, level: &LevelOnDisk, bricks: &[BrickIndex]) -> Result<Finished, Failure> {
        let began = Instant::now();
        let (parts, note) = match self.settings.parts {
            Some(parts) => self.most_parts(parts),
            None => (None, None),
        };
        let plan = Plan::new(self.settings, &self.region, bricks, parts, self.limits())?;
        let mut finished = Finished {
            picture: Picture { size: self.settings.size, pixels: Vec::new() },
            camera: Camera::new(&self.settings.view, self.settings.size, self.settings.step, &self.region)?,
            numbers: PictureNumbers::of_parts(self.settings, PartNumbers::default()),
            bands: plan.bands,
            soft: None,
            compositor_bytes: Some(0),
            prepare_ms: milliseconds(began),
            shade_ms: 0.0,
            rays_ms: 0.0,
            notes: Vec::from_iter(note),
            renderer: None,
        };
        let mut numbers =
            PartNumbers { parts: plan.parts, samples: finished.camera.samples(), ..PartNumbers::default() };
        for rows in plan.rows() {
            let mut compositor = Compositor::of_rows(self.settings, &self.region, rows.clone())?;
            finished.compositor_bytes = finished.compositor_bytes.max(Some(compositor.bytes()));
            numbers.arity = compositor.arity();
            for number in 0..plan.parts {
                let part = self.part(level, bricks, (number, plan.parts), rows.clone(), false)?;
                compositor.receive(&part.message.bytes)?;
                numbers.work += part.message.work;
                numbers.bricks += part.bricks;
                numbers.memory = RenderMemory {
                    voxels: numbers.memory.voxels.max(part.memory.voxels),
                    rays: numbers.memory.rays.max(part.memory.rays),
                };
                finished.shade_ms += part.read_ms;
                finished.rays_ms += part.draw_ms;
            }
            finished.picture.pixels.extend(compositor.picture().pixels);
        }
        // A part's own pixels are only its share of the picture's.
        let seen = finished.picture.pixels.iter().filter(|pixel| **pixel != [0.0, 0.0, 0.0, 1.0]);
        numbers.work = RenderWork { pixels_changed: seen.count() as u64, ..numbers.work };
        finished.numbers = PictureNumbers::of_parts(self.settings, numbers);
        Ok(finished)
    }

    /// Returns the number of parts that the volume can have, and a note if it is less than `parts`.
    fn most_parts(&self, parts: u32) -> (Option<u32>, Option<String>) {
        let layers = self.region.bricks()[2];
        let note = (parts > layers).then(|| {
            format!("{parts} parts were asked for, and the volume has {layers} layers of 8 voxels: {layers} parts are rendered")
        });
        (Some(parts.min(layers)), note)
    }

    /// Renders some rows of part `number` of `parts`.
    ///
    /// # Errors
    /// [`Failure`] when a chunk cannot be read.
    pub(super) fn part(
        &self,
        level: &LevelOnDisk,
        bricks: &[BrickIndex],
        (number, parts): (u32, u32),
        rows: Range<u32>,
        is_folded: bool,
    ) -> Result<RenderedPart, Failure> {
        let began = Instant::now();
        let part = Part::of_rows(self.settings, &self.region, (number, parts), rows)?;
        let mut part = if is_folded { part.folded() } else { part };
        for group in level.values.groups(&part.needed(bricks)) {
            level.values.load(group, self.team);
            part.read_on(self.team, &level.values, group);
        }
        let read_ms = milliseconds(began);
        self.volume.check()?;
        let began = Instant::now();
        let message = part.draw_on(self.team);
        let draw_ms = milliseconds(began);
        Ok(RenderedPart { message, memory: part.memory(), bricks: part.bricks(), read_ms, draw_ms })
    }
}

/// Returns the picture of a renderer, and the times to set it up, to shade and to cast, ms.
fn finished(renderer: Renderer, numbers: PictureNumbers, [prepare_ms, shade_ms, rays_ms]: [f64; 3]) -> Finished {
    Finished {
        picture: renderer.picture(),
        camera: *renderer.camera(),
        numbers,
        bands: 1,
        soft: None,
        compositor_bytes: None,
        prepare_ms,
        shade_ms,
        rays_ms,
        notes: Vec::new(),
        renderer: Some(renderer),
    }
}

/// Some rows of a part.
pub(super) struct RenderedPart {
    pub(super) message: Message,
    pub(super) memory: RenderMemory,
    pub(super) bricks: usize,
    read_ms: f64,
    draw_ms: f64,
}
