//! Poses of a sweep's frames from a tracker's, by the pairing of sessions.

use std::error::Error;
use std::time::Instant;

use sonoweave_core::frames::{Image, Transform, World};
use sonoweave_core::named::StaticTransform;
use sonoweave_core::slice::Slice;
use sync::clock::TimeFlags;
use sync::history::PoseSample;
use sync::pairing::timed::{FrameTime, Source};
use sync::smoothing::Smoothing;
use sync::{PairingOptions, TimedOptions, TimedPairing};

use crate::sweep::{STEP_NS, Sweep};

/// Origin of the poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Method {
    /// The true poses.
    Exact,
    /// Interpolation between two poses.
    Interpolated,
    /// Smoothing, by the time before and after a frame, and by the time ahead that is used, ns.
    Smoothed(Smoothing),
}

/// Poses of frames.
pub(crate) struct Poses {
    pub(crate) world_from_image: Vec<Transform<World, Image>>,
    /// Number of poses that were not smoothed though they should be.
    pub(crate) not_smoothed: usize,
    /// Root mean square of the error that smoothing states for the image's corners, mm.
    pub(crate) error_mm: f64,
}

impl Method {
    /// Returns the poses of all frames.
    ///
    /// # Errors
    /// If a frame has no pose.
    pub(crate) fn poses(self, sweep: &Sweep, measured: &[PoseSample]) -> Result<Poses, Box<dyn Error>> {
        let smoothing = match self {
            Self::Exact => {
                let world_from_image = sweep.frames.iter().map(|(_, slice)| slice.world_from_image).collect();
                return Ok(Poses { world_from_image, not_smoothed: 0, error_mm: 0.0 });
            }
            Self::Interpolated => None,
            Self::Smoothed(smoothing) => Some(smoothing),
        };
        let pairing = pairing(smoothing, sweep, measured)?;
        let mut poses = Poses { world_from_image: Vec::new(), not_smoothed: 0, error_mm: 0.0 };
        for (step, slice) in &sweep.frames {
            let placed = pairing.place(&time_of(*step, slice)).map_err(|unplaced| unplaced.to_string())?;
            poses.world_from_image.push(placed.world_from_image);
            if let Some(effect) = placed.smoothing {
                poses.not_smoothed += usize::from(effect.not_smoothed.is_some());
                poses.error_mm += effect.error_mm.powi(2) / sweep.frames.len() as f64;
            }
        }
        poses.error_mm = poses.error_mm.sqrt();
        Ok(poses)
    }
}

/// Returns the time to find the pose of each frame, ms, with smoothing or without.
///
/// # Errors
/// If a frame has no pose.
pub(crate) fn times(
    smoothing: Option<Smoothing>,
    sweep: &Sweep,
    measured: &[PoseSample],
) -> Result<Vec<f64>, Box<dyn Error>> {
    let pairing = pairing(smoothing, sweep, measured)?;
    let time = |(step, slice): &(u32, Slice)| {
        let began = Instant::now();
        pairing.place(&time_of(*step, slice)).map_err(|unplaced| unplaced.to_string())?;
        Ok(began.elapsed().as_secs_f64() * 1e3)
    };
    sweep.frames.iter().map(time).collect()
}

/// Returns the pairing of a session that has these measured poses.
fn pairing(
    smoothing: Option<Smoothing>,
    sweep: &Sweep,
    measured: &[PoseSample],
) -> Result<TimedPairing<()>, Box<dyn Error>> {
    let rows = Transform::<World, Image>::from_affine(sweep.sensor_from_image()).to_rows();
    let statics = vec![StaticTransform::new("Image", "Probe", &rows)?];
    let mut pairing = TimedPairing::<()>::new(TimedOptions {
        pairing: PairingOptions { statics, ..PairingOptions::default() },
        sources: vec![Source { smoothing, ..Source::new("Probe", "Tracker") }],
        ..TimedOptions::default()
    })?;
    measured.iter().for_each(|sample| pairing.pose(0, sample.clone()));
    Ok(pairing)
}

fn time_of(step: u32, slice: &Slice) -> FrameTime {
    let size = [slice.image.width(), slice.image.height()];
    FrameTime { time_ns: i64::from(step) * STEP_NS, bound_ns: 0, flags: TimeFlags::NONE, size }
}
