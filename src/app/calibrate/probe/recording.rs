//! Wire images and poses from a recording.

use glam::DVec2;

use calibration::picture::GreyView;
use calibration::probe::track::Track;
use calibration::probe::{DotFinder, Dots, Layout, Matcher, Observation, Recording};
use config::phantom::FrameNames;
use mask::{Mask, MaskSettings};
use sonoweave_core::region::ClipRect;

use super::super::recorded::{GreyImage, Recorded, Tracked, data};
use crate::app::reporter::Steps;
use crate::failure::{Failure, Reason};

/// Observations from a recording.
pub(crate) struct Observed<S = Dots> {
    pub(crate) observations: Vec<Observation<S>>,
    /// Sensor poses between the images, if the recording has them.
    track: Option<Track>,
    pub(crate) size_px: [u32; 2],
    /// Whether all images have a time.
    timed: bool,
    /// Reason of the first image without poses.
    first_refusal: Option<String>,
}

impl<S> Observed<S> {
    /// Observes all images of a recording, which must have one size.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read, or holds no grey images of 8 bits.
    pub(crate) fn new(
        recorded: &Recorded,
        tracked: &Tracked,
        steps: Steps<'_>,
        mut observe: impl FnMut(&GreyImage<'_>) -> Result<S, Failure>,
    ) -> Result<Self, Failure> {
        let within = |problem: String| Failure::new(format!("{}: {problem}", recorded.path().display()));
        let step = steps("searching", tracked.pictures());
        let mut searched = 0;
        let (mut observations, mut size_px, mut timed, mut first_refusal) = (Vec::new(), None, true, None);
        let unfit = recorded.pictures(|image| {
            searched += 1;
            step(searched);
            let size = *size_px.get_or_insert(image.size);
            if image.size != size {
                return Err(within(sizes(size, image.size)));
            }
            timed &= image.stamps.is_some();
            let seen = observe(&image).map_err(|Failure(Reason { sentence: why, .. })| within(why))?;
            let poses = tracked.at(&image).map_err(|why| first_refusal.get_or_insert(why)).ok();
            observations.push(Observation { frame: number(image.frame), time_s: image.time_s(), seen, poses });
            Ok(())
        })?;
        drop(step);
        let first_refusal = unfit.first().map(str::to_owned).or(first_refusal);
        let Some(size_px) = size_px else {
            let why = first_refusal.map_or(String::new(), |why| format!("; the first frame: {why}"));
            return Err(within(format!("holds no usable frame{why}")));
        };
        Ok(Self { observations, track: tracked.track().cloned(), size_px, timed, first_refusal })
    }

    /// Returns the form that the calibration takes.
    pub(crate) fn recording(&self) -> Recording<'_, S> {
        let Self { observations, track, size_px, timed, .. } = self;
        Recording { observations, track: track.as_ref(), size_px: *size_px, timed: *timed }
    }

    /// Notes the first unusable image, for the end of a refusal.
    pub(crate) fn also(&self) -> String {
        self.first_refusal.as_ref().map_or(String::new(), |why| format!(" (the first unusable frame: {why})"))
    }
}

fn sizes(first: [u32; 2], other: [u32; 2]) -> String {
    let [[a, b], [c, d]] = [first, other];
    format!("its frames have several sizes, {a}×{b} and {c}×{d} pixels; record frames of one size")
}

/// An image for a report's page.
pub(crate) struct StoredImage {
    /// Its number in the recording.
    pub(crate) frame: usize,
    /// Its grey values, row by row.
    pub(crate) grey: Vec<u8>,
}

/// Reads the images with these numbers from a recording.
///
/// # Errors
/// [`Failure`] when it cannot be read.
pub(crate) fn pictures(recorded: &Recorded, frames: &[usize]) -> Result<Vec<StoredImage>, Failure> {
    let mut images = Vec::new();
    recorded.pictures(|picture| {
        let frame = number(picture.frame);
        if frames.contains(&frame) {
            images.push(StoredImage { frame, grey: picture.pixels.to_vec() });
        }
        Ok(())
    })?;
    // In the requested order.
    images.sort_by_key(|image| frames.iter().position(|frame| *frame == image.frame));
    Ok(images)
}

/// Reads a recording.
///
/// # Errors
/// [`Failure`] when it cannot be read, holds no grey images of 8 bits, or has no way from the
/// probe to the reference.
pub(crate) fn observe(
    recorded: &Recorded,
    layout: &Layout,
    frames: &FrameNames,
    clip: Option<ClipRect>,
    steps: Steps<'_>,
) -> Result<Observed, Failure> {
    let tracked = recorded.tracked(&frames.probe, &frames.reference)?;
    let mut finder = WireFinder::new(layout, clip, recorded.bedside().map(|bedside| bedside.mask));
    Observed::new(recorded, &tracked, steps, |image| finder.find(image.size, &image.view()?))
}

/// Searches images, all of one size, for a phantom's wires.
pub(crate) struct WireFinder<'a> {
    layout: &'a Layout,
    clip: Option<ClipRect>,
    mask: Option<MaskSettings>,
    region: Option<Region>,
    dots: DotFinder,
    matcher: Matcher,
}

impl<'a> WireFinder<'a> {
    /// Searches the given part, else the region of data.
    pub(crate) fn new(layout: &'a Layout, clip: Option<ClipRect>, mask: Option<MaskSettings>) -> Self {
        Self { layout, clip, mask, region: None, dots: DotFinder::new(), matcher: Matcher::new() }
    }

    /// Returns the images' size, once there is one.
    pub(crate) fn size_px(&self) -> Option<[u32; 2]> {
        self.region.as_ref().map(|region| region.size)
    }

    /// Finds an image's spots, and matches them with wires.
    ///
    /// # Errors
    /// [`Failure`] for an image of another size than the first.
    pub(crate) fn find(&mut self, size: [u32; 2], view: &GreyView<'_>) -> Result<Dots, Failure> {
        let region = Region::within(&mut self.region, self.mask, self.clip, size)?;
        if size != region.size {
            return Err(Failure::new(sizes(region.size, size)));
        }
        let mut dots = self.dots.find(view, region.clip).to_vec();
        dots.retain(|dot| region.holds(dot.at_px));
        let reading = self.matcher.read(&dots, size, self.layout);
        Ok(Dots { dots, reading })
    }
}

/// Searched region of the images.
pub(crate) struct Region {
    pub(crate) size: [u32; 2],
    pub(crate) clip: Option<ClipRect>,
    /// Image data; pixels outside it are ignored.
    mask: Option<Mask>,
}

impl Region {
    /// Sets the region at the first image: the requested one, else the session's.
    pub(crate) fn within(
        region: &mut Option<Self>,
        settings: Option<MaskSettings>,
        clip: Option<ClipRect>,
        size: [u32; 2],
    ) -> Result<&Self, Failure> {
        if region.is_none() {
            let mask = settings.map_or(Ok(None), |settings| data(&settings, size))?;
            let clip = clip.or(mask.as_ref().and_then(Mask::bounds));
            *region = Some(Self { size, clip, mask });
        }
        Ok(region.get_or_insert(Self { size, clip, mask: None }))
    }

    /// Whether a position is within the mask.
    pub(crate) fn holds(&self, at_px: DVec2) -> bool {
        let [u, v] = at_px.to_array().map(|x| x.round() as u32);
        self.mask.as_ref().is_none_or(|mask| mask.contains(u, v))
    }
}

pub(crate) fn number(frame: u64) -> usize {
    usize::try_from(frame).unwrap_or(usize::MAX)
}
