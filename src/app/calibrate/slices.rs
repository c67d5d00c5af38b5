//! Slices of a recording in memory, for calibrations by crossing slices.

use calibration::slices::Slices;
use calibration::trajectory::pose_spline::PoseSpline;
use config::Settings;

use super::latency::{Poses, Source};
use super::recorded::data;
use crate::failure::Failure;

/// Largest number of slices held at once. Pairs of more take longer than they are worth.
const MOST_SLICES: u64 = 1000;

/// Reads the slices of a recording, evenly thinned if there are many. A frame has the pose that the
/// tracker has stamped `lag_s` later. Sentences for the user go to `notes`.
///
/// # Errors
/// [`Failure`] when the recording cannot be read, has no usable frames or poses, or nothing relates
/// the image to the probe.
pub(super) fn slices(
    source: &Source,
    calibration: &Settings,
    poses: Poses,
    lag_s: f64,
    notes: &mut Vec<String>,
) -> Result<Slices, Failure> {
    let (samples, probe_from_image) = source.placed(calibration, poses, notes)?;
    let poses = PoseSpline::new(&samples)?;
    // Finds the pixels that change at all, and counts the video frames.
    let mut ends: Option<(Vec<[u8; 2]>, [u32; 2])> = None;
    let mut count = 0_u64;
    let unfit = source.pictures(|image, _| {
        count += 1;
        match &mut ends {
            None => ends = Some((image.pixels.iter().map(|x| [*x; 2]).collect(), image.size)),
            Some((_, size)) if *size != image.size => return Err(sizes(source)),
            Some((ends, _)) => {
                ends.iter_mut()
                    .zip(image.pixels)
                    .for_each(|([low, high], x)| (*low, *high) = ((*low).min(*x), (*high).max(*x)));
            }
        }
        Ok(())
    })?;
    notes.extend(unfit.notes());
    let Some((ends, [width, height])) = ends else {
        fail!("{}: holds no usable frame; record it again", source.paths()[0].display());
    };
    let mask = data(&source.mask().unwrap_or(calibration.mask()), [width, height])?;
    let is_data: Vec<bool> = (0..height)
        .flat_map(|v| (0..width).map(move |u| (u, v)))
        .zip(&ends)
        .map(|((u, v), [low, high])| match &mask {
            Some(mask) => mask.contains(u, v),
            None => low < high,
        })
        .collect();
    let mut slices = Slices::new(width, height, &is_data, probe_from_image, poses);
    let every = count.div_ceil(MOST_SLICES).max(1);
    let mut at = 0_u64;
    source.pictures(|image, stamps| {
        if at.is_multiple_of(every) {
            slices.push(stamps.given_s + lag_s, image.pixels, width, height);
        }
        at += 1;
        Ok(())
    })?;
    Ok(slices)
}

/// Returns the refusal of frames of several sizes.
pub(super) fn sizes(source: &Source) -> Failure {
    Failure::new(format!("{}: its frames have several sizes; record frames of one size", source.paths()[0].display()))
}
