//! Recordings (a sequence or a session) as calibrations read them: images and sensor poses.
//! Images are read one by one and are not kept.

mod sequence;
mod times;
mod tracks;

use std::path::{Path, PathBuf};

use calibration::latency::stamps::Stamps;
use calibration::picture::GreyView;
use calibration::probe::track::{Poses, Track};
use config::bedside::Bedside;
use mask::{Mask, MaskPlan, MaskSettings};
use pipeline::session::{Latencies, RecordedDecisions, walk};
use sonoweave_core::reading::Reading;

use crate::app::input;
use crate::app::live::stages::Kept;
use crate::failure::Failure;
use sequence::OfItem;
pub(super) use sequence::each;
use sonoweave_core::refusal::Refusal;
use sonoweave_core::slice::{Image, Pixels};
use sync::clock::Timed;
use sync::ingest::live::Live;
use sync::ingest::{Ingest, Picture, Sample};
pub(super) use times::{seconds, stamps};
pub(crate) use tracks::Tracks;
pub(super) use tracks::{GRABBER, without_latency};

/// A recording.
pub(crate) enum Recorded {
    /// A sequence, whose images carry their poses.
    Sequence(PathBuf),
    /// A session with its stored configuration. Its poses are a separate stream.
    Session { path: PathBuf, bedside: Box<Bedside> },
}

/// An image in 8 bits and MF orientation.
pub(crate) struct GreyImage<'a> {
    /// Its number in the recording.
    pub(crate) frame: u64,
    /// Its time stamps, if the recording has any.
    pub(crate) stamps: Option<Stamps>,
    pub(crate) size: [u32; 2],
    pub(crate) pixels: &'a [u8],
}

impl GreyImage<'_> {
    /// Returns its time, s. In a recording without times, images are taken as a second apart.
    pub(crate) fn time_s(&self) -> f64 {
        self.stamps.map_or(self.frame as f64, |stamps| stamps.given_s)
    }

    pub(crate) fn view(&self) -> Result<GreyView<'_>, Failure> {
        Ok(GreyView::packed(self.size.map(|side| side as usize), self.pixels)?)
    }
}

/// Images that could not be used.
#[derive(Debug, Default)]
pub(crate) struct Unfit {
    count: u64,
    /// Reason of the first.
    first: Option<String>,
}

impl Unfit {
    fn add(&mut self, refusal: &Refusal) {
        self.count += 1;
        self.first.get_or_insert_with(|| refusal.to_string());
    }

    /// Returns the reason of the first, if there is one.
    pub(crate) fn first(&self) -> Option<&str> {
        self.first.as_deref()
    }

    /// Returns a sentence, if there are any.
    pub(crate) fn notes(&self) -> Vec<String> {
        let note = |first: &String| format!("{} frames cannot be used; the first: {first}", self.count);
        self.first.iter().map(note).collect()
    }
}

/// Poses of a sensor relative to the reference.
pub(crate) enum Tracked {
    /// A sequence's poses, by item.
    Items(Vec<OfItem>),
    /// A session's poses at the sensor's own samples, with the reference interpolated between
    /// its samples; and the number of images.
    Samples { track: Track, sensor: String, pictures: u64 },
}

impl Tracked {
    /// Returns the poses at an image's time, or a sentence with the reason why there are none.
    pub(crate) fn at(&self, image: &GreyImage<'_>) -> Result<Poses, String> {
        match self {
            Self::Items(items) => {
                let found = items.binary_search_by_key(&image.frame, |(item, _)| *item);
                found.map_or_else(|_| Err(format!("item {}: has no poses", image.frame)), |at| items[at].1.clone())
            }
            Self::Samples { track, sensor, .. } => track.at(image.time_s()).ok_or_else(|| {
                format!(
                    "item {}: the tracker has no valid poses of {sensor} and its reference at that time",
                    image.frame
                )
            }),
        }
    }

    /// Returns the whole track, if more is known than the poses at the images' times.
    pub(crate) fn track(&self) -> Option<&Track> {
        match self {
            Self::Items(_) => None,
            Self::Samples { track, .. } => Some(track),
        }
    }

    /// Returns the expected number of images.
    pub(crate) fn pictures(&self) -> u64 {
        match self {
            Self::Items(items) => items.len() as u64,
            Self::Samples { pictures, .. } => *pictures,
        }
    }
}

impl Recorded {
    /// Opens a session with its stored configuration.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read, or holds no configuration.
    pub(crate) fn session(path: &Path) -> Result<Self, Failure> {
        let bedside = Box::new(Kept::bedside(path, &RecordedDecisions::read(path)?)?);
        Ok(Self::Session { path: path.to_owned(), bedside })
    }

    /// Opens a file of either kind, determined by its content.
    ///
    /// # Errors
    /// [`Failure`], as of [`Self::session`].
    pub(crate) fn of(path: &Path) -> Result<Self, Failure> {
        if input::is_session(path)? { Self::session(path) } else { Ok(Self::Sequence(path.to_owned())) }
    }

    /// Returns its file.
    pub(crate) fn path(&self) -> &Path {
        match self {
            Self::Sequence(path) | Self::Session { path, .. } => path,
        }
    }

    /// Returns a session's configuration.
    pub(crate) fn bedside(&self) -> Option<&Bedside> {
        match self {
            Self::Sequence(_) => None,
            Self::Session { bedside, .. } => Some(bedside),
        }
    }

    /// Passes every image to `visit`; returns the unusable ones.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read, or its images are not in 8 bits; and
    /// `visit`'s own.
    pub(crate) fn pictures(
        &self,
        mut visit: impl FnMut(GreyImage<'_>) -> Result<(), Failure>,
    ) -> Result<Unfit, Failure> {
        let (mut unfit, mut failed) = (Unfit::default(), None);
        let mut show = |frame: u64, stamps: Option<Stamps>, image: &Image| {
            let pixels = grey(image).map_err(|kind| {
                Failure::new(format!(
                    "{}: its frames have {kind}, but 8 bits are needed; write it again as MET_UCHAR, black at 0 and \
                    white at 255",
                    self.path().display()
                ))
            })?;
            visit(GreyImage { frame, stamps, size: [image.width(), image.height()], pixels })
        };
        match self {
            Self::Sequence(path) => {
                let mut ingest = Ingest::new();
                each(path, true, |reading| {
                    let Reading::Frame(frame) = &reading else { return Ok(()) };
                    let (item, stamps) = (frame.stamp.item, stamps(&frame.stamp, frame.frame_number));
                    match ingest.take(reading) {
                        Sample::Picture(picture) => show(item, stamps, &picture.image)?,
                        Sample::Refused(refusal) => unfit.add(&refusal),
                        Sample::Transform(_) | Sample::Unused(_) => {}
                    }
                    Ok(())
                })?;
            }
            Self::Session { path, bedside } => {
                walk(path, true, without_latency(bedside)?, Latencies::Given, |source, live| match live {
                    Live::Picture { picture, timed } if source == GRABBER && failed.is_none() => {
                        let stamps = Stamps { given_s: seconds(timed.time_ns), ..Stamps::default() };
                        failed = show(picture.head.stamp.item, Some(stamps), &picture.image).err();
                    }
                    Live::Refused(refusal) if source == GRABBER => unfit.add(&refusal),
                    _ => {}
                })?;
            }
        }
        failed.map_or(Ok(unfit), Err)
    }

    /// Reads the poses of a sensor relative to the reference.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read, or has no way from the one to the other.
    pub(crate) fn tracked(&self, sensor: &str, reference: &str) -> Result<Tracked, Failure> {
        let within = |problem: String| Failure::new(format!("{}: {problem}", self.path().display()));
        match self {
            Self::Sequence(path) => sequence::poses(path, sensor, reference).map(Tracked::Items),
            Self::Session { path, bedside } => {
                let tracks = Tracks::read(path, bedside)?;
                let track = tracks.track(sensor, reference).map_err(within)?;
                Ok(Tracked::Samples { track, sensor: sensor.to_owned(), pictures: tracks.pictures() })
            }
        }
    }
}

/// Returns 8-bit grey values, or a description of the actual format.
fn grey(image: &Image) -> Result<&[u8], &'static str> {
    match image.pixels() {
        Pixels::U8(pixels) => Ok(pixels),
        Pixels::U16(_) => Err("16 bits a pixel"),
        Pixels::F32(_) => Err("pixels that are neither of 8 nor of 16 bits"),
    }
}

/// Returns a grabber's current image.
///
/// # Errors
/// [`Failure`] when it is not of 8 bits.
pub(crate) fn live_image<'a>(picture: &'a Picture, timed: &Timed) -> Result<GreyImage<'a>, Failure> {
    let image = &picture.image;
    let pixels = grey(image).map_err(|kind| {
        Failure::new(format!("the grabber's frames have {kind}; choose a format of 8 bits ([grabber] format)"))
    })?;
    let stamps = Some(Stamps { given_s: seconds(timed.time_ns), ..Stamps::default() });
    Ok(GreyImage { frame: picture.head.stamp.item, stamps, size: [image.width(), image.height()], pixels })
}

/// Returns the mask of the image data, if it is known beforehand.
///
/// # Errors
/// [`Failure`] when the mask is empty.
pub(crate) fn data(settings: &MaskSettings, [width, height]: [u32; 2]) -> Result<Option<Mask>, Failure> {
    Ok(match settings.plan(width, height)? {
        MaskPlan::Fixed(mask) => Some(mask),
        MaskPlan::Auto(_) => None,
    })
}
