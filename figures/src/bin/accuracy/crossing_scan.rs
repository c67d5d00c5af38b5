//! Sweeps in three directions that cross, as a tracker's sensor measures them.

use std::error::Error;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use calibration::slices::Slices;
use calibration::trajectory::PoseSample;
use calibration::trajectory::pose_spline::PoseSpline;
use phantom::scene::{Blobs, Scene};
use phantom::{Motion, Scan, ScanSettings};
use sonoweave_core::slice::Pixels;
use sync::clock::TimeFlags;
use sync::history::{PoseHistory, PoseSample as Measured, Rigid};
use sync::smoothing::{Smoothing, smoothed};

use crate::sweep::STEP_NS;
use crate::tracker::Draws;

/// 51×48 mm of pixels.
const IMAGE: [u32; 2] = [128, 120];
const PIXEL_MM: f64 = 0.4;
const NOISE_SD: f64 = 3.0;
/// Slices of a sweep, frames from one to the next, and frames before the first and after the last
/// at which the tracker measures.
const SLICES: u32 = 40;
const EVERY: u32 = 3;
const MARGIN: u32 = 12;
/// Known poses between two frames, and how far the probe moves between frames, mm.
const STEPS: u32 = 8;
const GAP_MM: f64 = 0.35;
/// Steps of a sweep, and the pause before the next, ns.
pub(crate) const SWEEP: u32 = (SLICES * EVERY + 2 * MARGIN) * STEPS;
const PAUSE_NS: i64 = 2_000_000_000;
/// Distance of the sensor from the image's middle, mm, against v.
const LEVER_MM: f64 = 110.0;
const HALF_WIDTH_NS: i64 = 300_000_000;
/// Noise of the tracker, mm and degrees, 120 times a second.
pub(crate) const TRACKER: f64 = 0.3;

/// Three sweeps.
pub(crate) struct Sweeps {
    scan: Scan,
    /// Steps and pixels.
    images: Vec<(u32, Vec<u8>)>,
}

fn time_ns(step: u32) -> i64 {
    i64::from(step) * STEP_NS + i64::from(step / SWEEP) * PAUSE_NS
}

/// Returns the time of a step, s.
pub(crate) fn time_s(step: u32) -> f64 {
    time_ns(step) as f64 * 1e-9
}

impl Sweeps {
    /// Paints the sweeps.
    ///
    /// # Errors
    /// If the scan cannot be painted.
    pub(crate) fn new(seed: u64) -> Result<Self, Box<dyn Error>> {
        let scan = Scan::new(ScanSettings {
            scene: Scene::Blobs(Blobs::draw(seed)),
            motion: Motion::ThreeDirections,
            frames: 3 * SWEEP,
            gap_mm: GAP_MM / f64::from(STEPS),
            image_size: IMAGE,
            pixel_mm: [PIXEL_MM; 2],
            noise_sd: NOISE_SD,
            seed,
            interval_ns: STEP_NS,
            ..ScanSettings::default()
        })?;
        // Every second slice lies between two poses of the tracker.
        let steps = (0..3 * SLICES).map(|k| k / SLICES * SWEEP + (MARGIN + k % SLICES * EVERY) * STEPS + k % 2);
        let image = |step: u32| match &scan.slice(step).image.pixels() {
            Pixels::U8(pixels) => Ok((step, pixels.to_vec())),
            _ => Err("the scan has 8 bits"),
        };
        let images = steps.map(image).collect::<Result<_, _>>()?;
        Ok(Self { scan, images })
    }

    /// Returns the rigid frame of the image about its middle, mm.
    pub(crate) fn picture(&self, step: u32) -> DAffine3 {
        let image = self.scan.true_world_from_image(step);
        let m = image.affine().matrix3;
        let [right, bottom] = IMAGE.map(|n| f64::from(n) - 1.0);
        DAffine3 {
            matrix3: DMat3::from_cols(m.x_axis.normalize(), m.y_axis.normalize(), m.z_axis.normalize()),
            translation: image.point(DVec3::new(0.5 * right, 0.5 * bottom, 0.0)),
        }
    }

    /// Returns the map from pixels to the world's mm.
    pub(crate) fn world_from_image(&self, step: u32) -> DAffine3 {
        self.scan.true_world_from_image(step).affine()
    }

    /// Returns the sensor's pose.
    pub(crate) fn sensor(&self, step: u32) -> DAffine3 {
        self.picture(step) * DAffine3::from_translation(-DVec3::Y * LEVER_MM)
    }

    /// Returns the map from pixels to the sensor's mm.
    pub(crate) fn sensor_from_image(&self) -> DAffine3 {
        self.sensor(0).inverse() * self.world_from_image(0)
    }

    /// Returns the sensor's poses with a tracker's noise, smoothed if there is any. `drift` moves
    /// the picture in its own frame, by the step.
    pub(crate) fn poses(&self, noise: f64, draws: &mut Draws, drift: impl Fn(u32) -> DAffine3) -> Vec<PoseSample> {
        let mut found = Vec::new();
        for sweep in 0..3 {
            let measured: Vec<Measured> = (sweep * SWEEP..(sweep + 1) * SWEEP)
                .step_by(2)
                .map(|step| {
                    let picture = self.picture(step);
                    let truth = picture * drift(step) * picture.inverse() * self.sensor(step);
                    let [shift, turn] = [draws.vector() * noise, draws.vector() * noise.to_radians()];
                    let turned = DQuat::from_scaled_axis(turn) * DQuat::from_mat3(&truth.matrix3);
                    let pose = Rigid { rotation: turned.normalize(), position_mm: truth.translation + shift };
                    Measured { time_ns: time_ns(step), bound_ns: 0, flags: TimeFlags::NONE, pose, invalid: None }
                })
                .collect();
            let mut history = PoseHistory::new(measured.len(), HALF_WIDTH_NS);
            measured.iter().for_each(|sample| history.insert(sample.clone()));
            found.extend(measured.iter().map(|sample| {
                let smooth = || smoothed(&history, sample.time_ns, &Smoothing::offline(HALF_WIDTH_NS)).ok();
                let pose = if noise > 0.0 { smooth().map_or(sample.pose, |found| found.pose) } else { sample.pose };
                let Rigid { rotation, position_mm } = pose;
                PoseSample { time_s: sample.time_ns as f64 * 1e-9, rotation, position_mm }
            }));
        }
        found
    }

    /// Returns the slices by these poses and a map from pixels to the sensor's mm, which the poses
    /// lag behind.
    ///
    /// # Errors
    /// If the poses do not make a path.
    pub(crate) fn slices(
        &self,
        poses: &[PoseSample],
        sensor_from_image: DAffine3,
        lag_s: f64,
    ) -> Result<Slices, Box<dyn Error>> {
        let data = vec![true; (IMAGE[0] * IMAGE[1]) as usize];
        let mut slices = Slices::new(IMAGE[0], IMAGE[1], &data, sensor_from_image, PoseSpline::new(poses)?);
        for (step, pixels) in &self.images {
            slices.push(time_s(*step) - lag_s, pixels, IMAGE[0], IMAGE[1]);
        }
        Ok(slices)
    }

    /// Returns the steps of the slices.
    pub(crate) fn steps(&self) -> impl Iterator<Item = u32> {
        self.images.iter().map(|(step, _)| *step)
    }
}

/// Returns nine places of the image, pixels.
pub(crate) fn places() -> [DVec3; 9] {
    let [right, bottom] = IMAGE.map(|n| f64::from(n) - 1.0);
    std::array::from_fn(|k| {
        let [column, row] = [k % 3, k / 3].map(|n| f64::from(n as u8));
        DVec3::new(0.5 * right * column, 0.5 * bottom * row, 0.0)
    })
}
