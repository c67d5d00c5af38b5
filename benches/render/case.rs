//! The scans, and what is made of each before anything is timed.

use std::error::Error;

use glam::DVec3;
use sonoweave::phantom::scene::{Blobs, Scene};
use sonoweave::phantom::{Motion, Scan, ScanSettings};
use sonoweave::reconstruct::planar::PlanarSettings;
use sonoweave::reconstruct::{Settings, SettingsError, Weaver};
use sonoweave::render::camera::View;
use sonoweave::render::transfer::Transfer;
use sonoweave::render::{RenderSettings, Stage};
use sonoweave::slice::Slice;

/// A scan and its picture.
pub(crate) struct Case {
    pub(crate) id: &'static str,
    pub(crate) title: &'static str,
    slices: u32,
    pixels: [u32; 2],
    pixel_mm: [f64; 2],
    gap_mm: f64,
    motion: Motion,
    pub(crate) image: [u32; 2],
    /// Transfer function.
    pub(crate) preset: &'static str,
    /// Median and 99th percentile of a slice to its picture, ms.
    pub(crate) goals: [f64; 2],
    /// Name of the table of whole pictures; their sizes, and ms that each may take.
    pub(crate) stills: (&'static str, &'static [([u32; 2], f64)]),
    /// Name of the table of changed planes, where there is one.
    pub(crate) slab: Option<&'static str>,
}

const SPACING_MM: f64 = 0.5;
/// Of all that is timed.
pub(crate) const THREADS: usize = 2;

// Along u, which becomes the columns' axis, two voxels to the pixel.
const PAPER: Case = Case {
    id: "paper",
    title: "90 slices of 128×128 pixels, 128×128×256 voxels, picture of 256×256",
    slices: 90,
    pixels: [128; 2],
    pixel_mm: [0.99, 0.5],
    gap_mm: 64.0 / 90.0,
    motion: Motion::Jittered,
    image: [256; 2],
    preset: "phantom",
    goals: [8.0, 15.0],
    stills: ("paper-stills", &[([256; 2], 57.0), ([512; 2], 217.0)]),
    slab: Some("slab"),
};

pub(crate) const CASES: [Case; 3] = [
    PAPER,
    // No voxel is empty, and no ray ends early.
    Case {
        id: "paper-dense",
        title: "90 slices of 128×128 pixels, 128×128×256 voxels, picture of 256×256, everything visible",
        preset: "xray",
        stills: ("paper-dense-stills", &[([256; 2], 57.0), ([512; 2], 217.0)]),
        slab: Some("slab-dense"),
        ..PAPER
    },
    Case {
        id: "cube",
        title: "90 slices of 256×256 pixels by hand, 256³ voxels, picture of 512×512",
        slices: 90,
        pixels: [256; 2],
        pixel_mm: [0.5; 2],
        gap_mm: 1.4,
        motion: Motion::Freehand,
        image: [512; 2],
        preset: "phantom",
        goals: [15.0, 33.0],
        stills: ("cube-stills", &[([512; 2], 477.0)]),
        slab: None,
    },
];

/// A case with all that is not timed done.
pub(crate) struct Ready {
    pub(crate) slices: Vec<Slice>,
    /// The volume of all slices.
    pub(crate) whole: Weaver,
    pub(crate) stage: Stage,
    pub(crate) look: RenderSettings,
    scan: Scan,
    weave: Settings,
    planar: bool,
}

impl Ready {
    /// Scans the phantom and weaves it.
    ///
    /// # Errors
    /// Where the case itself is wrong.
    pub(crate) fn new(case: &Case) -> Result<Self, Box<dyn Error>> {
        let scan = Scan::new(ScanSettings {
            scene: Scene::Blobs(Blobs::draw(2)),
            motion: case.motion,
            frames: case.slices,
            gap_mm: case.gap_mm,
            image_size: case.pixels,
            pixel_mm: case.pixel_mm,
            noise_sd: 6.0,
            ..ScanSettings::default()
        })?;
        let slices = scan.slices(0..case.slices);
        let weave = Settings { threads: THREADS, ..Settings::new(DVec3::splat(SPACING_MM)) };
        let planar = case.motion != Motion::Freehand;
        let mut whole = weaver(&scan, &weave, planar)?;
        for slice in &slices {
            whole.insert(slice)?;
        }
        let (low, high) = whole.volume().seen_bounds().ok_or("nothing was seen")?;
        let stage = Stage::new(whole.world_from_lattice(), low, high)?;
        let look = RenderSettings {
            view: View { azimuth: 30.0, elevation: 20.0, ..View::default() },
            threads: THREADS,
            ..RenderSettings::new(case.image, Transfer::preset(case.preset, [0.0, 255.0])?)
        };
        Ok(Self { slices, whole, stage, look, scan, weave, planar })
    }

    /// An empty volume for the same scan.
    ///
    /// # Errors
    /// None that [`Self::new`] has not met.
    pub(crate) fn weaver(&self) -> Result<Weaver, SettingsError> {
        weaver(&self.scan, &self.weave, self.planar)
    }

    /// The axis of the volume along which slices follow each other.
    pub(crate) fn sweep_axis(&self) -> usize {
        let normal = self.scan.true_world_from_image(self.slices.len() as u32 / 2).affine().matrix3.z_axis;
        let along = self.stage.stage_from_world().transform_vector3(normal).abs();
        (0..3).max_by(|a, b| along[*a].total_cmp(&along[*b])).unwrap_or(0)
    }
}

fn weaver(scan: &Scan, weave: &Settings, planar: bool) -> Result<Weaver, SettingsError> {
    match planar {
        true => Weaver::planar(weave.clone(), PlanarSettings::default(), scan.mask().clone()),
        false => Weaver::general(weave.clone(), scan.mask().clone()),
    }
}

/// The view along a direction of the world.
pub(crate) fn along(direction: DVec3) -> View {
    let d = direction.normalize();
    let elevation = libm::asin((-d.z).clamp(-1.0, 1.0)).to_degrees();
    View { azimuth: libm::atan2(-d.x, d.y).to_degrees(), elevation, ..View::default() }
}
