//! A sweep of an unsteady hand, painted at its true poses.

use std::error::Error;

use glam::{DAffine3, DMat3, DVec3};

use phantom::scene::{Blobs, Scene};
use phantom::{Motion, Scan, ScanSettings, truth};
use reconstruct::{PathReconstructor, Settings};
use sonoweave_core::frames::{Image, Transform, World};
use sonoweave_core::slice::Slice;
use volume::Grid;

/// 32×28 mm of pixels.
pub(crate) const PICTURE: [u32; 2] = [160, 140];
const PIXEL_MM: f64 = 0.2;
/// Mean distance of slices, mm: 10.5 mm/s at 30 frames a second.
const GAP_MM: f64 = 0.35;
/// Frames of a sweep.
const FRAMES: u32 = 100;
/// Known poses between two frames, and the time between two of these, ns.
const STEPS: u32 = 8;
pub(crate) const STEP_NS: i64 = 1_000_000_000 / (30 * STEPS as i64);
/// Frames' times before the first frame and after the last at which the tracker measures.
const MARGIN: u32 = 30;
/// Distance of the sensor from the image's middle, mm, against v.
const LEVER_MM: f64 = 110.0;
/// Noise of a pixel, grey levels: as much in a mm² as 6 in pixels of 0.1 mm.
const NOISE_SD: f64 = 3.0;
/// Spacing of the volumes, mm.
const SPACING_MM: f64 = 0.5;
/// Width of the kernel along all axes, mm: a little less than the gap between slices.
const SIGMA_MM: f64 = 0.3;

/// A sweep.
pub(crate) struct Sweep {
    scan: Scan,
    /// The frames, at their true poses, with the numbers of their steps.
    pub(crate) frames: Vec<(u32, Slice)>,
    /// Places that are compared, and the scene's grey levels there.
    truth: Truth,
}

/// Voxels that are compared.
struct Truth {
    grid: Grid,
    grey: Vec<f32>,
    /// Whether a voxel is compared: it lies inside the slices.
    inside: Vec<bool>,
}

impl Sweep {
    /// Paints the sweep of a seed.
    ///
    /// # Errors
    /// If the phantom cannot be made.
    pub(crate) fn new(seed: u64) -> Result<Self, Box<dyn Error>> {
        let scan = Scan::new(ScanSettings {
            scene: Scene::Blobs(Blobs::draw(seed)),
            motion: Motion::Unsteady,
            frames: (FRAMES + 2 * MARGIN) * STEPS,
            gap_mm: GAP_MM / f64::from(STEPS),
            image_size: PICTURE,
            pixel_mm: [PIXEL_MM; 2],
            noise_sd: NOISE_SD,
            seed,
            interval_ns: STEP_NS,
            ..ScanSettings::default()
        })?;
        // Every second frame lies between two poses of a tracker that measures at even steps.
        let steps = (MARGIN..MARGIN + FRAMES).map(|frame| frame * STEPS + frame % 2);
        let frames: Vec<(u32, Slice)> = steps.map(|step| (step, scan.slice(step))).collect();
        let places = frames.iter().map(|(_, slice)| (slice.world_from_image, PICTURE));
        let corners = places.flat_map(|(pose, size)| {
            let [right, bottom] = size.map(|n| f64::from(n) - 1.0);
            [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]].map(|[u, v]| pose.point(DVec3::new(u, v, 0.0)))
        });
        let corners: Vec<DVec3> = corners.collect();
        let low = corners.iter().fold(DVec3::MAX, |low, corner| low.min(*corner));
        let high = corners.iter().fold(DVec3::MIN, |high, corner| high.max(*corner));
        let first = (low / SPACING_MM).ceil();
        let size = ((high / SPACING_MM).floor() - first).to_array().map(|n| n.max(0.0) as u64 + 1);
        let grid =
            Grid { origin: first * SPACING_MM, spacing: DVec3::splat(SPACING_MM), direction: DMat3::IDENTITY, size };
        let grey = truth::sample(&scan.settings().scene, &grid)?;
        let mut sweep = Self { scan, frames, truth: Truth { grid, grey, inside: Vec::new() } };
        let poses: Vec<_> = sweep.frames.iter().map(|(_, slice)| slice.world_from_image).collect();
        let weights = sweep.volume(&poses)?.into_iter().map(|[_, w]| w).collect::<Vec<_>>();
        let mut seen: Vec<f32> = weights.iter().copied().filter(|w| *w > 0.0).collect();
        seen.sort_by(f32::total_cmp);
        let median = *seen.get(seen.len() / 2).ok_or("no voxel is seen")?;
        sweep.truth.inside = weights.iter().map(|w| *w > 0.5 * median).collect();
        Ok(sweep)
    }

    /// Returns the sensor's true pose in the world, mm, at a step.
    pub(crate) fn sensor(&self, step: u32) -> DAffine3 {
        let image = self.scan.true_world_from_image(step);
        let affine = image.affine();
        let axes = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis].map(DVec3::normalize);
        let [right, bottom] = PICTURE.map(|n| f64::from(n) - 1.0);
        let middle = image.point(DVec3::new(0.5 * right, 0.5 * bottom, 0.0));
        DAffine3 { matrix3: DMat3::from_cols(axes[0], axes[1], axes[2]), translation: middle - axes[1] * LEVER_MM }
    }

    /// Returns the map from pixels to the sensor's mm.
    pub(crate) fn sensor_from_image(&self) -> DAffine3 {
        self.sensor(0).inverse() * self.scan.true_world_from_image(0).affine()
    }

    /// Returns the number of steps, over all of which the tracker measures.
    pub(crate) fn steps(&self) -> u32 {
        self.scan.frames()
    }

    /// Returns the settings of the volume.
    pub(crate) fn settings() -> Settings {
        Settings { sigma_mm: [Some(SIGMA_MM); 3], ..Settings::new(DVec3::splat(SPACING_MM)) }
    }

    /// Inserts the frames at these poses.
    ///
    /// # Errors
    /// If a slice is refused.
    pub(crate) fn reconstructed(
        &self,
        settings: Settings,
        poses: &[Transform<World, Image>],
    ) -> Result<PathReconstructor, Box<dyn Error>> {
        let mut volume = PathReconstructor::general(settings, self.scan.mask().clone())?;
        for ((_, slice), pose) in self.frames.iter().zip(poses) {
            volume.insert(&Slice { world_from_image: *pose, ..slice.clone() })?;
        }
        Ok(volume)
    }

    /// Iterates over the voxels inside the slices: lattice index, and the scene's grey level.
    pub(crate) fn inside(&self) -> impl Iterator<Item = ([i64; 3], f32)> {
        let Truth { grid: Grid { origin, size, .. }, grey, inside } = &self.truth;
        let first = (*origin / SPACING_MM).round().to_array().map(|x| x as i64);
        let [nx, ny, _] = *size;
        let voxels = (0_u64..).zip(grey.iter().zip(inside)).filter(|(_, (_, inside))| **inside);
        voxels.map(move |(i, (grey, _))| {
            let index = [i % nx, i / nx % ny, i / nx / ny];
            ([0, 1, 2].map(|a| first[a] + index[a] as i64), *grey)
        })
    }

    /// Returns numerators and weights of the voxels, from the frames at these poses.
    fn volume(&self, poses: &[Transform<World, Image>]) -> Result<Vec<[f32; 2]>, Box<dyn Error>> {
        let volume = self.reconstructed(Self::settings(), poses)?;
        let Grid { origin, size, .. } = self.truth.grid;
        let [nx, ny, nz] = size;
        let first = (origin / SPACING_MM).round().to_array().map(|x| x as i64);
        let (mut r, mut w) = (vec![0.0; nx as usize], vec![0.0; nx as usize]);
        let mut voxels = Vec::with_capacity((nx * ny * nz) as usize);
        for (z, y) in (0..nz as i64).flat_map(|z| (0..ny as i64).map(move |y| (z, y))) {
            volume.volume().row([first[0], first[1] + y, first[2] + z], &mut r, &mut w);
            voxels.extend(r.iter().zip(&w).map(|(r, w)| [*r, *w]));
        }
        Ok(voxels)
    }

    /// Returns the root mean square of a volume's error inside the slices, grey levels.
    ///
    /// # Errors
    /// If a slice is refused.
    pub(crate) fn volume_rmse(&self, poses: &[Transform<World, Image>]) -> Result<f64, Box<dyn Error>> {
        let volume = self.volume(poses)?;
        let (mut sum, mut count) = (0.0, 0.0);
        for (([r, w], truth), _) in volume.iter().zip(&self.truth.grey).zip(&self.truth.inside).filter(|(_, is)| **is) {
            if *w > 0.0 {
                sum += f64::from(r / w - truth).powi(2);
                count += 1.0;
            }
        }
        Ok(f64::sqrt(sum / count))
    }

    /// Returns the mean square of the distance of picture points from their true places, mm².
    pub(crate) fn points_ms(&self, poses: &[Transform<World, Image>]) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for ((_, slice), pose) in self.frames.iter().zip(poses) {
            for (u, v) in (0..5).flat_map(|u| (0..5).map(move |v| (u, v))) {
                let [right, bottom] = PICTURE.map(|n| f64::from(n) - 1.0);
                let at = DVec3::new(0.25 * right * f64::from(u), 0.25 * bottom * f64::from(v), 0.0);
                sum += (pose.point(at) - slice.world_from_image.point(at)).length_squared();
                count += 1.0;
            }
        }
        sum / count
    }
}
