//! The paper's test of the renderer: 90 slices of 128² woven into 128×128×256 voxels while a picture of 256² follows them.

use std::error::Error;
use std::time::Instant;

use glam::DVec3;
use sonoweave::phantom::scene::{Blobs, Scene};
use sonoweave::phantom::{Motion, Scan, ScanSettings};
use sonoweave::reconstruct::planar::PlanarSettings;
use sonoweave::reconstruct::{Settings, Touched, Weaver};
use sonoweave::render::camera::View;
use sonoweave::render::transfer::Transfer;
use sonoweave::render::{Cache, Picture, RenderMemory, RenderSettings, RenderWork, Renderer, Stage, Updated};
use sonoweave::slice::Slice;

/// Slices of the paper's test.
pub(crate) const SLICES: u32 = 90;
/// Distance of voxels, mm.
const SPACING_MM: f64 = 0.5;
/// Pixels of the picture, to the right and down.
const PICTURE: [u32; 2] = [256; 2];

/// The scan, and what is looked at.
pub(crate) struct Doll {
    scan: Scan,
    pub(crate) slices: Vec<Slice>,
    pub(crate) whole: Weaver,
    pub(crate) stage: Stage,
    /// On one thread, as the paper's.
    pub(crate) look: RenderSettings,
}

/// What it took to follow a scan, and what came of it.
pub(crate) struct Followed {
    /// Reconstruction, shading, rays; ms of each slice.
    pub(crate) ms: Vec<[f64; 3]>,
    pub(crate) work: RenderWork,
    pub(crate) memory: RenderMemory,
    pub(crate) picture: Picture,
    /// Samples of a block.
    pub(crate) arity: u32,
}

impl Doll {
    /// The first so many slices.
    pub(crate) fn new(slices: u32) -> Result<Self, Box<dyn Error>> {
        let scan = Scan::new(ScanSettings {
            scene: Scene::Blobs(Blobs::draw(2)),
            motion: Motion::Jittered,
            frames: SLICES,
            image_size: [128; 2],
            // Two voxels to the pixel along u, which becomes the columns' axis.
            pixel_mm: [0.99, 0.5],
            gap_mm: 64.0 / f64::from(SLICES),
            noise_sd: 6.0,
            ..ScanSettings::default()
        })?;
        let slices = scan.slices((SLICES - slices) / 2..(SLICES + slices) / 2);
        let mut whole = weaver(&scan, 1)?;
        for slice in &slices {
            whole.insert(slice)?;
        }
        let (low, high) = whole.volume().seen_bounds().ok_or("nothing was seen")?;
        let stage = Stage::new(whole.world_from_lattice(), low, high)?;
        let look = RenderSettings {
            view: View { azimuth: 30.0, elevation: 20.0, ..View::default() },
            ..RenderSettings::new(PICTURE, Transfer::preset("phantom", [0.0, 255.0])?)
        };
        Ok(Self { scan, slices, whole, stage, look })
    }

    pub(crate) fn weaver(&self, threads: usize) -> Result<Weaver, Box<dyn Error>> {
        weaver(&self.scan, threads)
    }

    /// The picture of all slices, made at once with nothing kept.
    pub(crate) fn at_once(&self, look: &RenderSettings) -> Result<(Picture, RenderWork), Box<dyn Error>> {
        let mut renderer = Renderer::new(&RenderSettings { cache: Cache::None, ..look.clone() }, self.stage)?;
        let work = renderer.update_all(self.whole.volume()).work;
        Ok((renderer.picture(), work))
    }

    /// Weaves slice by slice, the picture after each.
    pub(crate) fn follow(&self, look: &RenderSettings) -> Result<Followed, Box<dyn Error>> {
        self.follow_and(look, |_, _, _, _| Ok(()))
    }

    /// As [`Self::follow`], with a look at volume and renderer after each slice, what it did, and which slice it was.
    pub(crate) fn follow_and(
        &self,
        look: &RenderSettings,
        mut after: impl FnMut(usize, &Weaver, &Renderer, &RenderWork) -> Result<(), Box<dyn Error>>,
    ) -> Result<Followed, Box<dyn Error>> {
        let (mut weaver, mut renderer) = (self.weaver(look.threads)?, Renderer::new(look, self.stage)?);
        let mut ms = Vec::with_capacity(self.slices.len());
        for (number, slice) in self.slices.iter().enumerate() {
            let began = Instant::now();
            let touched = weaver.insert(slice)?;
            let insert = began.elapsed();
            let updated = show(&mut renderer, &weaver, &touched);
            ms.push([insert, updated.shade, updated.rays].map(|d| d.as_secs_f64() * 1e3));
            after(number, &weaver, &renderer, &updated.work)?;
        }
        let (work, memory, arity) = (renderer.work(), renderer.memory(), renderer.arity());
        Ok(Followed { ms, work, memory, picture: renderer.picture(), arity })
    }
}

/// Brings a picture up to date with what a slice touched.
pub(crate) fn show(renderer: &mut Renderer, weaver: &Weaver, touched: &Touched) -> Updated {
    match &touched.slab {
        Some(slab) => renderer.update_within(weaver.volume(), &touched.bricks, slab),
        None => renderer.update(weaver.volume(), &touched.bricks),
    }
}

fn weaver(scan: &Scan, threads: usize) -> Result<Weaver, Box<dyn Error>> {
    let settings = Settings { threads, ..Settings::new(DVec3::splat(SPACING_MM)) };
    Ok(Weaver::planar(settings, PlanarSettings::default(), scan.mask().clone())?)
}
