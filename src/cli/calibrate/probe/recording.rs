//! Wire images and poses from a recording.

use glam::DVec2;

use calibration::picture::GreyView;
use calibration::probe::dots::Dot;
use calibration::probe::matching::Reading;
use calibration::probe::track::Track;
use calibration::probe::{DotFinder, Layout, Matcher, Observation, Recording};
use config::phantom::FrameNames;
use mask::{Mask, MaskSettings};
use sonoweave_core::region::ClipRect;

use super::super::super::{Failure, input};
use super::super::recorded::{Recorded, data};

/// Observations from a recording.
pub(super) struct Observed {
    pub(super) observations: Vec<Observation>,
    /// Sensor poses between the images, if the recording has them.
    track: Option<Track>,
    pub(super) size_px: [u32; 2],
    /// Whether all images have a time.
    timed: bool,
    /// Reason of the first image without poses.
    pub(super) first_refusal: Option<String>,
}

impl Observed {
    /// Returns the form that the calibration takes.
    pub(super) fn recording(&self) -> Recording<'_> {
        let Self { observations, track, size_px, timed, .. } = self;
        Recording { observations, track: track.as_ref(), size_px: *size_px, timed: *timed }
    }
}

/// An image to show.
pub(super) struct Shown {
    /// Its number in the recording.
    pub(super) frame: usize,
    /// Its grey values, row by row.
    pub(super) grey: Vec<u8>,
}

/// Reads the images with these numbers from a recording.
///
/// # Errors
/// [`Failure`] when it cannot be read.
pub(super) fn pictures(recorded: &Recorded, frames: &[usize]) -> Result<Vec<Shown>, Failure> {
    let mut shown = Vec::new();
    recorded.pictures(|picture| {
        let frame = number(picture.frame);
        if frames.contains(&frame) {
            shown.push(Shown { frame, grey: picture.pixels.to_vec() });
        }
        Ok(())
    })?;
    // In the requested order.
    shown.sort_by_key(|shown| frames.iter().position(|frame| *frame == shown.frame));
    Ok(shown)
}

/// Reads a recording.
///
/// # Errors
/// [`Failure`] when it cannot be read, holds no grey images of 8 bits, or has no way from the
/// probe to the reference.
pub(super) fn observe(
    recorded: &Recorded,
    layout: &Layout,
    frames: &FrameNames,
    clip: Option<ClipRect>,
) -> Result<Observed, Failure> {
    let within = |problem: String| Failure(format!("{}: {problem}", recorded.path().display()));
    let tracked = recorded.tracked(&frames.probe, &frames.reference)?;
    let bar = input::progress("looking", tracked.pictures());
    let mut looker = Looker::new(layout, clip, recorded.bedside().map(|bedside| bedside.mask));
    let (mut observations, mut timed, mut first_refusal) = (Vec::new(), true, None);
    let unfit = recorded.pictures(|shown| {
        bar.inc(1);
        let (dots, reading) = looker.look(shown.size, &shown.view()?).map_err(|Failure(why)| within(why))?;
        timed &= shown.stamps.is_some();
        let poses = tracked.at(&shown);
        let poses = poses.map_err(|why| first_refusal.get_or_insert(why)).ok();
        observations.push(Observation { frame: number(shown.frame), time_s: shown.time_s(), dots, reading, poses });
        Ok(())
    })?;
    bar.finish_and_clear();
    let first_refusal = unfit.first().map(str::to_owned).or(first_refusal);
    let Some(size_px) = looker.size_px() else {
        let why = first_refusal.map_or(String::new(), |why| format!("; the first: {why}"));
        return Err(within(format!("holds no picture that can be used{why}")));
    };
    let track = tracked.track().cloned();
    Ok(Observed { observations, track, size_px, timed, first_refusal })
}

/// Searches images, all of one size, for a phantom's wires.
pub(super) struct Looker<'a> {
    layout: &'a Layout,
    clip: Option<ClipRect>,
    mask: Option<MaskSettings>,
    region: Option<Region>,
    finder: DotFinder,
    matcher: Matcher,
}

impl<'a> Looker<'a> {
    /// Searches the given part, else the region of data.
    pub(super) fn new(layout: &'a Layout, clip: Option<ClipRect>, mask: Option<MaskSettings>) -> Self {
        Self { layout, clip, mask, region: None, finder: DotFinder::new(), matcher: Matcher::new() }
    }

    /// Returns the images' size, once there is one.
    pub(super) fn size_px(&self) -> Option<[u32; 2]> {
        self.region.as_ref().map(|region| region.size)
    }

    /// Finds an image's spots, and matches them with wires.
    ///
    /// # Errors
    /// [`Failure`] for an image of another size than the first.
    pub(super) fn look(&mut self, size: [u32; 2], view: &GreyView<'_>) -> Result<(Vec<Dot>, Option<Reading>), Failure> {
        let region = Region::within(&mut self.region, self.mask, self.clip, size)?;
        if size != region.size {
            return Err(Failure(format!("its pictures are of different sizes, {:?} and {size:?}", region.size)));
        }
        let mut dots = self.finder.find(view, region.clip).to_vec();
        dots.retain(|dot| region.holds(dot.at_px));
        let reading = self.matcher.read(&dots, size, self.layout);
        Ok((dots, reading))
    }
}

/// Searched region of the images.
pub(super) struct Region {
    pub(super) size: [u32; 2],
    pub(super) clip: Option<ClipRect>,
    /// Image data; pixels outside it are ignored.
    mask: Option<Mask>,
}

impl Region {
    /// Sets the region at the first image: the requested one, else the session's.
    pub(super) fn within(
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
    pub(super) fn holds(&self, at_px: DVec2) -> bool {
        let [u, v] = at_px.to_array().map(|x| x.round() as u32);
        self.mask.as_ref().is_none_or(|mask| mask.contains(u, v))
    }
}

pub(super) fn number(frame: u64) -> usize {
    usize::try_from(frame).unwrap_or(usize::MAX)
}
