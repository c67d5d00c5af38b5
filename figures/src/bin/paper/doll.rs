//! The paper's test of the renderer: 90 slices of 128² inserted into 128×128×256 voxels, while a
//! picture of 256² is updated.

use std::error::Error;
use std::time::Instant;

use glam::DVec3;

use phantom::scene::{Blobs, Scene};
use phantom::{Motion, Scan, ScanSettings};
use reconstruct::planar::PlanarSettings;
use reconstruct::{PathReconstructor, Settings, Touched};
use render::camera::View;
use render::classify::transfer::Transfer;
use render::{Cache, Picture, RenderMemory, RenderRegion, RenderSettings, RenderWork, Renderer, Updated};
use sonoweave_core::slice::Slice;

/// Slices of the paper's test.
pub(crate) const SLICES: u32 = 90;
/// Voxel spacing, mm.
const SPACING_MM: f64 = 0.5;
/// Size of the picture, pixels to the right and down.
const PICTURE: [u32; 2] = [256; 2];

/// The scan and its view settings.
pub(crate) struct Doll {
    scan: Scan,
    pub(crate) slices: Vec<Slice>,
    pub(crate) whole: PathReconstructor,
    pub(crate) region: RenderRegion,
    /// One thread, like the paper.
    pub(crate) view_settings: RenderSettings,
}

/// Costs and results of rendering incrementally along a scan.
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
    /// Returns the test with `slices` slices from its middle.
    pub(crate) fn new(slices: u32) -> Result<Self, Box<dyn Error>> {
        let scan = Scan::new(ScanSettings {
            scene: Scene::Blobs(Blobs::draw(2)),
            motion: Motion::Jittered,
            frames: SLICES,
            image_size: [128; 2],
            // Two voxels per pixel along u, which becomes the columns' axis.
            pixel_mm: [0.99, 0.5],
            gap_mm: 64.0 / f64::from(SLICES),
            noise_sd: 6.0,
            ..ScanSettings::default()
        })?;
        let slices = scan.slices((SLICES - slices) / 2..(SLICES + slices) / 2);
        let mut whole = reconstructor(&scan, 1)?;
        for slice in &slices {
            whole.insert(slice)?;
        }
        let (low, high) = whole.volume().seen_bounds().ok_or("nothing was seen")?;
        let region = RenderRegion::new(whole.world_from_lattice(), low, high)?;
        let view_settings = RenderSettings {
            view: View { azimuth: 30.0, elevation: 20.0, ..View::default() },
            ..RenderSettings::new(PICTURE, Transfer::preset("phantom", [0.0, 255.0])?)
        };
        Ok(Self { scan, slices, whole, region, view_settings })
    }

    pub(crate) fn reconstructor(&self, threads: usize) -> Result<PathReconstructor, Box<dyn Error>> {
        reconstructor(&self.scan, threads)
    }

    /// Returns the picture of all slices, rendered at once without a cache.
    pub(crate) fn at_once(&self, view_settings: &RenderSettings) -> Result<(Picture, RenderWork), Box<dyn Error>> {
        let mut renderer = Renderer::new(&RenderSettings { cache: Cache::None, ..view_settings.clone() }, self.region)?;
        let work = renderer.update_all(self.whole.volume()).work;
        Ok((renderer.picture(), work))
    }

    /// Inserts slice by slice, and updates the picture after each.
    pub(crate) fn follow(&self, view_settings: &RenderSettings) -> Result<Followed, Box<dyn Error>> {
        self.follow_and(view_settings, |_, _, _, _| Ok(()))
    }

    /// Same as [`Self::follow`]. Calls `after` after each slice with its number, the volume, the
    /// renderer and its work.
    pub(crate) fn follow_and(
        &self,
        view_settings: &RenderSettings,
        mut after: impl FnMut(usize, &PathReconstructor, &Renderer, &RenderWork) -> Result<(), Box<dyn Error>>,
    ) -> Result<Followed, Box<dyn Error>> {
        let (mut reconstructor, mut renderer) =
            (self.reconstructor(view_settings.threads)?, Renderer::new(view_settings, self.region)?);
        let mut ms = Vec::with_capacity(self.slices.len());
        for (number, slice) in self.slices.iter().enumerate() {
            let began = Instant::now();
            let touched = reconstructor.insert(slice)?;
            let insert = began.elapsed();
            let updated = show(&mut renderer, &reconstructor, &touched);
            ms.push([insert, updated.shade, updated.rays].map(|d| d.as_secs_f64() * 1e3));
            after(number, &reconstructor, &renderer, &updated.work)?;
        }
        let (work, memory, arity) = (renderer.work(), renderer.memory(), renderer.arity());
        Ok(Followed { ms, work, memory, picture: renderer.picture(), arity })
    }
}

/// Updates a picture after an inserted slice.
pub(crate) fn show(renderer: &mut Renderer, reconstructor: &PathReconstructor, touched: &Touched) -> Updated {
    match &touched.slab {
        Some(slab) => renderer.update_within(reconstructor.volume(), &touched.bricks, slab),
        None => renderer.update(reconstructor.volume(), &touched.bricks),
    }
}

fn reconstructor(scan: &Scan, threads: usize) -> Result<PathReconstructor, Box<dyn Error>> {
    let settings = Settings { threads, ..Settings::new(DVec3::splat(SPACING_MM)) };
    Ok(PathReconstructor::planar(settings, PlanarSettings::default(), scan.mask().clone())?)
}
