//! The scans, and their preparation before the timing.

use std::error::Error;

use glam::DVec3;

use phantom::scene::{Blobs, Scene};
use phantom::{Motion, Scan, ScanSettings};
use reconstruct::planar::PlanarSettings;
use reconstruct::{PathReconstructor, Settings, SettingsError};
use render::camera::View;
use render::classify::transfer::Transfer;
use render::{RenderRegion, RenderSettings};
use sonoweave_core::slice::Slice;

/// A scan and its rendered picture.
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
    /// Goals from a slice to its picture, ms: median and 99th percentile.
    pub(crate) goals: [f64; 2],
    /// Name of the table of whole pictures; their sizes, and the maximum ms of each.
    pub(crate) stills: (&'static str, &'static [([u32; 2], f64)]),
    /// Name of the table of pictures in parts.
    pub(crate) parts: &'static str,
    /// Name of the table of changed planes, if any.
    pub(crate) slab: Option<&'static str>,
}

const SPACING_MM: f64 = 0.5;
/// Threads of everything that is timed.
pub(crate) const THREADS: usize = 2;

// Two voxels per pixel along u, which becomes the columns' axis.
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
    parts: "paper-parts",
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
        parts: "paper-dense-parts",
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
        parts: "cube-parts",
        slab: None,
    },
];

/// A case with all untimed preparation done.
pub(crate) struct Ready {
    pub(crate) slices: Vec<Slice>,
    /// The volume of all slices.
    pub(crate) whole: PathReconstructor,
    pub(crate) region: RenderRegion,
    pub(crate) view_settings: RenderSettings,
    scan: Scan,
    reconstruction: Settings,
    planar: bool,
}

impl Ready {
    /// Scans the phantom and reconstructs it.
    ///
    /// # Errors
    /// If the case itself is invalid.
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
        let reconstruction = Settings { threads: THREADS, ..Settings::new(DVec3::splat(SPACING_MM)) };
        let planar = case.motion != Motion::Freehand;
        let mut whole = reconstructor(&scan, &reconstruction, planar)?;
        for slice in &slices {
            whole.insert(slice)?;
        }
        let (low, high) = whole.volume().seen_bounds().ok_or("nothing was seen")?;
        let region = RenderRegion::new(whole.world_from_lattice(), low, high)?;
        let view_settings = RenderSettings {
            view: View { azimuth: 30.0, elevation: 20.0, ..View::default() },
            threads: THREADS,
            ..RenderSettings::new(case.image, Transfer::preset(case.preset, [0.0, 255.0])?)
        };
        Ok(Self { slices, whole, region, view_settings, scan, reconstruction, planar })
    }

    /// Returns an empty volume for the same scan.
    ///
    /// # Errors
    /// None that [`Self::new`] would not have returned.
    pub(crate) fn reconstructor(&self) -> Result<PathReconstructor, SettingsError> {
        reconstructor(&self.scan, &self.reconstruction, self.planar)
    }

    /// Returns the axis of the volume that is closest to the sweep direction.
    pub(crate) fn sweep_axis(&self) -> usize {
        let normal = self.scan.true_world_from_image(self.slices.len() as u32 / 2).affine().matrix3.z_axis;
        let along = self.region.region_from_world().transform_vector3(normal).abs();
        (0..3).max_by(|a, b| along[*a].total_cmp(&along[*b])).unwrap_or(0)
    }
}

fn reconstructor(scan: &Scan, reconstruction: &Settings, planar: bool) -> Result<PathReconstructor, SettingsError> {
    match planar {
        true => PathReconstructor::planar(reconstruction.clone(), PlanarSettings::default(), scan.mask().clone()),
        false => PathReconstructor::general(reconstruction.clone(), scan.mask().clone()),
    }
}

/// Returns the view along a direction of the world.
pub(crate) fn along(direction: DVec3) -> View {
    let d = direction.normalize();
    let elevation = libm::asin((-d.z).clamp(-1.0, 1.0)).to_degrees();
    View { azimuth: libm::atan2(-d.x, d.y).to_degrees(), elevation, ..View::default() }
}
