//! What calibrations read of a recording, a sequence or a session: pictures, and where sensors were. Pictures pass one by one and are not kept.

mod sequence;
mod tracks;

use std::path::{Path, PathBuf};

use calibration::latency::stamps::Stamps;
use calibration::picture::GreyView;
use calibration::probe::track::{Poses, Track};
use drivers::reading::{Reading, Stamp};

use super::super::{Failure, input};
use crate::cli::live::stages::{Kept, instruments};
use crate::config::bedside::Bedside;
use crate::ingest::live::Live;
use crate::ingest::{Ingest, Picture, Sample};
use crate::mask::{Mask, MaskPlan, MaskSettings};
use crate::pipeline::live::{Instrument, Latencies, Precedent, walk};
use crate::refusal::Refusal;
use crate::slice::{Image, Pixels};
use crate::sync::clock::Timed;
pub(super) use sequence::each;
pub(super) use tracks::Tracks;

/// The place of the grabber among a session's instruments.
pub(super) const GRABBER: usize = 1;

/// A recording.
pub(super) enum Recorded {
    /// A sequence, whose pictures have their poses with them.
    Sequence(PathBuf),
    /// A session, by the configuration that it holds: poses are a stream of their own.
    Session { path: PathBuf, bedside: Box<Bedside> },
}

/// A picture in 8 bits and MF orientation.
pub(super) struct Shown<'a> {
    /// Which of the recording's.
    pub(super) frame: u64,
    /// When, where the recording says it.
    pub(super) stamps: Option<Stamps>,
    pub(super) size: [u32; 2],
    pub(super) pixels: &'a [u8],
}

impl Shown<'_> {
    /// When, s. In a recording without times pictures are a second apart.
    pub(super) fn time_s(&self) -> f64 {
        self.stamps.map_or(self.frame as f64, |stamps| stamps.given_s)
    }

    pub(super) fn view(&self) -> Result<GreyView<'_>, Failure> {
        Ok(GreyView::packed(self.size.map(|side| side as usize), self.pixels)?)
    }
}

/// Pictures that could not be used.
#[derive(Debug, Default)]
pub(super) struct Unfit {
    count: u64,
    /// Why the first was not.
    first: Option<String>,
}

impl Unfit {
    fn add(&mut self, refusal: &Refusal) {
        self.count += 1;
        self.first.get_or_insert_with(|| refusal.to_string());
    }

    /// Why the first was not, where there is one.
    pub(super) fn first(&self) -> Option<&str> {
        self.first.as_deref()
    }

    /// A sentence, where there are any.
    pub(super) fn notes(&self) -> Vec<String> {
        let note = |first: &String| format!("{} pictures cannot be used; the first: {first}", self.count);
        self.first.iter().map(note).collect()
    }
}

/// An item of a sequence and its poses, or why it has none.
type OfItem = (u64, Result<Poses, String>);

/// Where a sensor was against the reference.
pub(super) enum Tracked {
    /// A sequence's: by its items.
    Items(Vec<OfItem>),
    /// A session's: at the sensor's own samples, the reference's between its own; and how many pictures there are.
    Samples { track: Track, sensor: String, pictures: u64 },
}

impl Tracked {
    /// Where it was when a picture was taken, or a sentence that says why nobody knows.
    pub(super) fn at(&self, shown: &Shown<'_>) -> Result<Poses, String> {
        match self {
            Self::Items(items) => {
                let found = items.binary_search_by_key(&shown.frame, |(item, _)| *item);
                found.map_or_else(|_| Err(format!("item {}: has no poses", shown.frame)), |at| items[at].1.clone())
            }
            Self::Samples { track, sensor, .. } => track.at(shown.time_s()).ok_or_else(|| {
                format!(
                    "item {}: the tracker has no valid poses of {sensor} and its reference about its time",
                    shown.frame
                )
            }),
        }
    }

    /// All that is known, where it is more than the poses at pictures' times.
    pub(super) fn track(&self) -> Option<&Track> {
        match self {
            Self::Items(_) => None,
            Self::Samples { track, .. } => Some(track),
        }
    }

    /// How many pictures are to be expected.
    pub(super) fn pictures(&self) -> u64 {
        match self {
            Self::Items(items) => items.len() as u64,
            Self::Samples { pictures, .. } => *pictures,
        }
    }
}

impl Recorded {
    /// A session, and what it was configured by.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read, or holds no configuration.
    pub(super) fn session(path: &Path) -> Result<Self, Failure> {
        let bedside = Box::new(Kept::bedside(path, &Precedent::read(path)?)?);
        Ok(Self::Session { path: path.to_owned(), bedside })
    }

    /// A file of either kind, by its content.
    ///
    /// # Errors
    /// As of [`Self::session`].
    pub(super) fn of(path: &Path) -> Result<Self, Failure> {
        if input::is_session(path)? { Self::session(path) } else { Ok(Self::Sequence(path.to_owned())) }
    }

    /// Its file.
    pub(super) fn path(&self) -> &Path {
        match self {
            Self::Sequence(path) | Self::Session { path, .. } => path,
        }
    }

    /// What a session was configured by.
    pub(super) fn bedside(&self) -> Option<&Bedside> {
        match self {
            Self::Sequence(_) => None,
            Self::Session { bedside, .. } => Some(bedside),
        }
    }

    /// Every picture in turn; those that could not be used.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read, or its pictures are not in 8 bits; and `take`'s own.
    pub(super) fn pictures(&self, mut take: impl FnMut(Shown<'_>) -> Result<(), Failure>) -> Result<Unfit, Failure> {
        let (mut unfit, mut failed) = (Unfit::default(), None);
        let mut show = |frame: u64, stamps: Option<Stamps>, image: &Image| {
            let pixels = grey(image).map_err(|kind| {
                Failure(format!(
                    "{}: its pictures have {kind}, and 8 bits are wanted here: write it again as MET_UCHAR, black at 0 and white at 255",
                    self.path().display()
                ))
            })?;
            take(Shown { frame, stamps, size: [image.width(), image.height()], pixels })
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

    /// Where a sensor was against the reference.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read, or has no way from the one to the other.
    pub(super) fn tracked(&self, sensor: &str, reference: &str) -> Result<Tracked, Failure> {
        let within = |problem: String| Failure(format!("{}: {problem}", self.path().display()));
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

/// Grey levels of 8 bits, or what there is instead.
fn grey(image: &Image) -> Result<&[u8], &'static str> {
    match image.pixels() {
        Pixels::U8(pixels) => Ok(pixels),
        Pixels::U16(_) => Err("16 bits a pixel"),
        Pixels::F32(_) => Err("pixels that are neither of 8 nor of 16 bits"),
    }
}

/// A picture that a grabber shows now.
///
/// # Errors
/// [`Failure`] where it is not of 8 bits.
pub(super) fn shown_now<'a>(picture: &'a Picture, timed: &Timed) -> Result<Shown<'a>, Failure> {
    let image = &picture.image;
    let pixels = grey(image).map_err(|kind| {
        Failure(format!("the grabber's pictures have {kind}; choose a format of 8 bits ([grabber] format)"))
    })?;
    let stamps = Some(Stamps { given_s: seconds(timed.time_ns), ..Stamps::default() });
    Ok(Shown { frame: picture.head.stamp.item, stamps, size: [image.width(), image.height()], pixels })
}

/// What of pictures is data, as far as it is known beforehand.
///
/// # Errors
/// [`Failure`] when nothing is.
pub(super) fn data(settings: &MaskSettings, [width, height]: [u32; 2]) -> Result<Option<Mask>, Failure> {
    Ok(match settings.plan(width, height)? {
        MaskPlan::Fixed(mask) => Some(mask),
        MaskPlan::Auto(_) => None,
    })
}

/// A session's devices, as if they had no latency: what is looked for is all of it.
pub(super) fn without_latency(bedside: &Bedside) -> Result<Vec<Instrument>, Failure> {
    let instruments = instruments(bedside)?;
    Ok(instruments.into_iter().map(|instrument| Instrument { latency_ns: 0, ..instrument }).collect())
}

pub(super) fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

/// When something was measured, where its source says it.
pub(super) fn stamps(stamp: &Stamp, number: Option<u64>) -> Option<Stamps> {
    let given_s = stamp.host_ns.map(seconds).or(stamp.source_s)?;
    Some(Stamps { given_s, raw_s: stamp.unfiltered_s, number })
}
