//! Corrections of a scan's poses before it is reconstructed, as `sonoweave correct` has them.

use std::error::Error;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use calibration::slices::Slices;
use calibration::tracker::noise::TrackerNoise;
use calibration::trajectory::PoseSample as Placed;
use calibration::trajectory::pose_spline::PoseSpline;
use mask::Mask;
use sonoweave_core::frames::Transform;
use sonoweave_core::named::StaticTransform;
use sonoweave_core::slice::{Pixels, Slice};
use sync::clock::TimeFlags;
use sync::history::{PoseSample, Rigid};
use sync::pairing::timed::{FrameTime, Source};
use sync::smoothing::Smoothing;
use sync::{PairingOptions, TimedOptions, TimedPairing};

/// Time before and after a slice over which poses are smoothed, ns.
const HALF_WIDTH_NS: i64 = 300_000_000;

/// A correction of poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Correction {
    /// Smoothing over time.
    Smoothing,
    /// By the images of neighbouring slices.
    Jitter,
}

impl Correction {
    pub(crate) const ALL: [Self; 2] = [Self::Smoothing, Self::Jitter];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Smoothing => "smoothed poses",
            Self::Jitter => "poses by neighbours",
        }
    }

    /// Returns the slices with corrected poses. They stay as they are where the correction refuses
    /// them.
    ///
    /// # Errors
    /// If the image has no size, or a slice has no pose.
    pub(crate) fn correct(
        self,
        slices: &[Slice],
        mask: &Mask,
        noise: TrackerNoise,
    ) -> Result<Vec<Slice>, Box<dyn Error>> {
        match self {
            Self::Smoothing => smoothed(slices),
            Self::Jitter => by_neighbours(slices, mask, noise),
        }
    }
}

/// Returns the map from an image's pixels to mm about its middle.
fn picture_from_image(slice: &Slice) -> DAffine3 {
    let m = slice.world_from_image.affine().matrix3;
    let [width, height] = [slice.image.width(), slice.image.height()].map(f64::from);
    let pixel_mm = DVec3::new(m.x_axis.length(), m.y_axis.length(), 1.0);
    DAffine3 {
        matrix3: DMat3::from_diagonal(pixel_mm),
        translation: DVec3::new(-0.5 * (width - 1.0), -0.5 * (height - 1.0), 0.0) * pixel_mm,
    }
}

/// Returns the pose of an image's middle.
fn middle(slice: &Slice, picture_from_image: &DAffine3) -> Rigid {
    let pose = slice.world_from_image.affine() * picture_from_image.inverse();
    Rigid { rotation: DQuat::from_mat3(&pose.matrix3).normalize(), position_mm: pose.translation }
}

fn smoothed(slices: &[Slice]) -> Result<Vec<Slice>, Box<dyn Error>> {
    let Some(first) = slices.first() else { return Ok(Vec::new()) };
    let picture_from_image = picture_from_image(first);
    let rows =
        Transform::<sonoweave_core::frames::World, sonoweave_core::frames::Image>::from_affine(picture_from_image);
    let statics = vec![StaticTransform::new("Image", "Probe", &rows.to_rows())?];
    let smoothing = Some(Smoothing { half_width_ns: HALF_WIDTH_NS, ahead_ns: HALF_WIDTH_NS });
    let mut pairing = TimedPairing::<()>::new(TimedOptions {
        pairing: PairingOptions { statics, ..PairingOptions::default() },
        sources: vec![Source { smoothing, ..Source::new("Probe", "Tracker") }],
        ..TimedOptions::default()
    })?;
    for slice in slices {
        let pose = middle(slice, &picture_from_image);
        pairing
            .pose(0, PoseSample { time_ns: slice.time_ns, bound_ns: 0, flags: TimeFlags::NONE, pose, invalid: None });
    }
    let place = |slice: &Slice| {
        let size = [slice.image.width(), slice.image.height()];
        let time = FrameTime { time_ns: slice.time_ns, bound_ns: 0, flags: TimeFlags::NONE, size };
        let placed = pairing.place(&time).map_err(|unplaced| unplaced.to_string())?;
        Ok(Slice { world_from_image: placed.world_from_image, ..slice.clone() })
    };
    slices.iter().map(place).collect()
}

fn by_neighbours(slices: &[Slice], mask: &Mask, noise: TrackerNoise) -> Result<Vec<Slice>, Box<dyn Error>> {
    let Some(first) = slices.first() else { return Ok(Vec::new()) };
    let picture_from_image = picture_from_image(first);
    let sample = |slice: &Slice| {
        let Rigid { rotation, position_mm } = middle(slice, &picture_from_image);
        Placed { time_s: slice.time_ns as f64 * 1e-9, rotation, position_mm }
    };
    let poses = PoseSpline::new(&slices.iter().map(sample).collect::<Vec<_>>())?;
    let [width, height] = [first.image.width(), first.image.height()];
    let is_data: Vec<bool> = (0..width * height).map(|at| mask.contains(at % width, at / width)).collect();
    let mut read = Slices::new(width, height, &is_data, picture_from_image, poses);
    for slice in slices {
        let Pixels::U8(pixels) = slice.image.pixels() else { return Err("images of 8 bits are corrected".into()) };
        read.push(slice.time_ns as f64 * 1e-9, pixels, width, height);
    }
    let Ok(jitter) = read.jitter(noise) else { return Ok(slices.to_vec()) };
    let corrected = |(at, slice): (usize, &Slice)| {
        let world_from_image = Transform::from_affine(jitter.corrected(at, slice.world_from_image.affine()));
        Slice { world_from_image, ..slice.clone() }
    };
    Ok(slices.iter().enumerate().map(corrected).collect())
}
