//! Slices of a recording in memory, for calibrations by crossing slices.

use calibration::slices::Slices;
use calibration::trajectory::pose_spline::PoseSpline;
use config::Settings;
use mask::Mask;

use super::latency::{Poses, Source};
use super::recorded::data;
use crate::failure::Failure;

/// Largest number of slices held at once. Pairs of more take longer than they are worth.
const MOST_SLICES: u64 = 1000;

/// Finds the pixels of a recording's images that change at all.
pub(crate) struct Varying {
    size: [u32; 2],
    /// Smallest and largest value of each pixel.
    ends: Vec<[u8; 2]>,
}

impl Varying {
    /// Begins with an image.
    pub(crate) fn new(pixels: &[u8], size: [u32; 2]) -> Self {
        Self { size, ends: pixels.iter().map(|x| [*x; 2]).collect() }
    }

    /// Returns width and height, pixels.
    pub(crate) fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Adds an image of the same size.
    pub(crate) fn add(&mut self, pixels: &[u8]) {
        self.ends.iter_mut().zip(pixels).for_each(|([low, high], x)| (*low, *high) = ((*low).min(*x), (*high).max(*x)));
    }

    /// Marks the pixels with data: those of the mask, or without one, those that change.
    pub(crate) fn is_data(&self, mask: Option<&Mask>) -> Vec<bool> {
        let width = self.size[0];
        let is_data = |(at, [low, high]): (u32, &[u8; 2])| match mask {
            Some(mask) => mask.contains(at % width, at / width),
            None => low < high,
        };
        (0..).zip(&self.ends).map(is_data).collect()
    }
}

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
    let mut varying: Option<Varying> = None;
    let mut count = 0_u64;
    let unfit = source.pictures(|image, _| {
        count += 1;
        match &mut varying {
            None => varying = Some(Varying::new(image.pixels, image.size)),
            Some(varying) if varying.size != image.size => return Err(sizes(source)),
            Some(varying) => varying.add(image.pixels),
        }
        Ok(())
    })?;
    notes.extend(unfit.notes());
    let Some(varying) = varying else {
        fail!("{}: holds no usable frame; record it again", source.paths()[0].display());
    };
    let [width, height] = varying.size;
    let is_data = varying.is_data(data(&source.mask().unwrap_or(calibration.mask()), varying.size)?.as_ref());
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
