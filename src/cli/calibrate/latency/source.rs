//! Where pictures and poses come from: a sequence or two, or a session. Pictures pass one by one and are not kept.

use std::path::{Path, PathBuf};

use calibration::frames::{affine_from_rows, nearest_rigid};
use calibration::latency::floor::FloorPose;
use calibration::latency::motion::PoseSample;
use calibration::latency::poses::Poses;
use calibration::latency::stamps::Stamps;
use calibration::picture::GreyView;
use drivers::reading::{NamedTransform, Reading, Stamp, Status, transform_name};
use drivers::recording::SequenceSettings;
use drivers::{Next, OpenSettings};
use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::cli::Failure;
use crate::cli::live::stages::{Kept, instruments};
use crate::config::Settings;
use crate::config::bedside::Bedside;
use crate::config::bedside::devices::{PROBE_FRAME, REFERENCE_FRAME, TRACKER_FRAME};
use crate::ingest::live::Live;
use crate::ingest::{Ingest, Sample};
use crate::mask::MaskSettings;
use crate::pipeline::live::{Instrument, Precedent, walk};
use crate::refusal::Refusal;
use crate::slice::Pixels;
use crate::sync::history::PoseSample as Measured;
use crate::sync::pairing::RIGID_TOLERANCE;
use crate::sync::{PairingOptions, survey};

/// Pictures and poses.
pub(super) enum Source {
    /// Of two sequences, or twice the same.
    Sequences { video: PathBuf, tracker: PathBuf },
    /// Of a session, by the configuration that it holds.
    Session { path: PathBuf, bedside: Box<Bedside> },
}

/// A picture in 8 bits and MF orientation.
pub(super) struct Shown<'a> {
    pub(super) stamps: Stamps,
    pub(super) size: [u32; 2],
    pub(super) pixels: &'a [u8],
}

impl Shown<'_> {
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

    /// A sentence, where there are any.
    pub(super) fn notes(&self) -> Vec<String> {
        let note = |first: &String| format!("{} pictures cannot be used; the first: {first}", self.count);
        self.first.iter().map(note).collect()
    }
}

/// The place of the grabber among a session's instruments.
const GRABBER: usize = 1;

impl Source {
    /// A session, and what it was configured by.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read, or holds no configuration.
    pub(super) fn session(path: &Path) -> Result<Self, Failure> {
        let bedside = Box::new(Kept::bedside(path, &Precedent::read(path)?)?);
        Ok(Self::Session { path: path.to_owned(), bedside })
    }

    /// Its files.
    pub(super) fn paths(&self) -> Vec<&Path> {
        match self {
            Self::Sequences { video, tracker } if video == tracker => vec![video],
            Self::Sequences { video, tracker } => vec![video, tracker],
            Self::Session { path, .. } => vec![path],
        }
    }

    /// The calibration that a session was woven by.
    pub(super) fn calibration(&self) -> Option<&Settings> {
        match self {
            Self::Sequences { .. } => None,
            Self::Session { bedside, .. } => Some(&bedside.calibration),
        }
    }

    /// What of the pictures is data, where a session says it.
    pub(super) fn mask(&self) -> Option<MaskSettings> {
        match self {
            Self::Sequences { .. } => None,
            Self::Session { bedside, .. } => Some(bedside.mask),
        }
    }

    /// What the video's latency was configured to be, ms.
    pub(super) fn video_ms(&self) -> Option<f64> {
        match self {
            Self::Sequences { .. } => None,
            Self::Session { bedside, .. } => Some(bedside.grabber.latency_ns as f64 * 1e-6),
        }
    }

    /// The difference of the latencies that a session was paired by, ms.
    pub(super) fn paired_ms(&self) -> Option<f64> {
        match self {
            Self::Sequences { .. } => None,
            Self::Session { bedside, .. } => {
                Some((bedside.tracking.latency_ns() - bedside.grabber.latency_ns) as f64 * 1e-6)
            }
        }
    }

    /// The session's devices, as if they had no latency: what is looked for is all of it.
    fn instruments(bedside: &Bedside) -> Result<Vec<Instrument>, Failure> {
        let instruments = instruments(bedside)?;
        Ok(instruments.into_iter().map(|instrument| Instrument { latency_ns: 0, ..instrument }).collect())
    }

    /// Every picture in turn; those that could not be used.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read, or its pictures are not in 8 bits.
    pub(super) fn pictures(&self, mut take: impl FnMut(Shown<'_>) -> Result<(), Failure>) -> Result<Unfit, Failure> {
        let (mut unfit, mut failed) = (Unfit::default(), None);
        let path = self.paths()[0];
        let mut show = |stamps: Stamps, image: &crate::slice::Image| {
            let Pixels::U8(pixels) = image.pixels() else {
                return Err(Failure(format!("{}: its pictures are not in 8 bits; convert them first", path.display())));
            };
            take(Shown { stamps, size: [image.width(), image.height()], pixels })
        };
        match self {
            Self::Sequences { video, .. } => {
                let mut ingest = Ingest::new();
                each(video, true, |reading| {
                    let Reading::Frame(frame) = &reading else { return Ok(()) };
                    let Some(stamps) = stamps(&frame.stamp, frame.frame_number) else {
                        return Err(Failure(format!("{}: its pictures have no times", video.display())));
                    };
                    match ingest.take(reading) {
                        Sample::Picture(picture) => show(stamps, &picture.image)?,
                        Sample::Refused(refusal) => unfit.add(&refusal),
                        Sample::Transform(_) | Sample::Unused(_) => {}
                    }
                    Ok(())
                })?;
            }
            Self::Session { path, bedside } => {
                walk(path, true, Self::instruments(bedside)?, |source, live| match live {
                    Live::Picture { picture, timed } if source == GRABBER && failed.is_none() => {
                        let stamps = Stamps { given_s: seconds(timed.time_ns), ..Stamps::default() };
                        failed = show(stamps, &picture.image).err();
                    }
                    Live::Refused(refusal) if source == GRABBER => unfit.add(&refusal),
                    _ => {}
                })?;
            }
        }
        failed.map_or(Ok(unfit), Err)
    }

    /// The probe's poses in the tracker's frame.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read or has no such poses.
    pub(super) fn poses(&self) -> Result<Vec<FloorPose>, Failure> {
        match self {
            Self::Sequences { tracker, .. } => {
                let mut found = Vec::new();
                let names = transforms(tracker, |transform, number| {
                    if transform.from == PROBE_FRAME
                        && transform.to == TRACKER_FRAME
                        && let (Some(pose), Some(stamps)) = (rigid(transform), stamps(&transform.stamp, number))
                    {
                        let rotation = DQuat::from_mat3(&pose.matrix3).normalize();
                        found.push(FloorPose { stamps, rotation, position_mm: pose.translation });
                    }
                })?;
                if found.is_empty() {
                    return Err(Failure(format!(
                        "{}: holds no valid ProbeToTracker; it holds {}",
                        tracker.display(),
                        if names.is_empty() { "no transform".to_owned() } else { names.join(", ") }
                    )));
                }
                Ok(found)
            }
            Self::Session { path, bedside } => {
                let [probe, _] = measured(path, bedside)?;
                let pose = |sample: &PoseSample| {
                    let stamps = Stamps { given_s: sample.time_s, ..Stamps::default() };
                    FloorPose { stamps, rotation: sample.rotation, position_mm: sample.position_mm }
                };
                Ok(probe.iter().map(pose).collect())
            }
        }
    }

    /// The probe's poses where the volume lives, and where the picture lies against the probe.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read, has no such poses, or nothing relates the picture to the probe.
    pub(super) fn placed(&self, calibration: &Settings) -> Result<(Vec<PoseSample>, DAffine3), Failure> {
        let of_image = || {
            let image = calibration.image_frame.as_deref().unwrap_or("Image");
            let found = calibration.transforms.iter().find(|t| t.from == image && t.to == PROBE_FRAME);
            found.map(|transform| transform.affine).ok_or_else(|| {
                Failure("where slices cross hangs on where the picture lies against the probe: give --config with its ImageToProbe".into())
            })
        };
        match self {
            Self::Sequences { video, tracker } if video == tracker => along(video, calibration),
            Self::Sequences { tracker, .. } => {
                let (mut probe, mut reference) = (Vec::new(), Vec::new());
                transforms(tracker, |transform, _| {
                    let into = match transform.from.as_str() {
                        PROBE_FRAME => &mut probe,
                        REFERENCE_FRAME => &mut reference,
                        _ => return,
                    };
                    if transform.to == TRACKER_FRAME
                        && let (Some(pose), Some(time_s)) = (rigid(transform), transform.stamp.source_s)
                    {
                        into.push(sample(time_s, &pose));
                    }
                })?;
                Ok((against(&probe, &reference)?, of_image()?))
            }
            Self::Session { path, bedside } => {
                let [probe, reference] = measured(path, bedside)?;
                Ok((against(&probe, &reference)?, of_image()?))
            }
        }
    }
}

/// Poses of the probe and of the reference, as a session has them; invalid ones are left out.
fn measured(path: &Path, bedside: &Bedside) -> Result<[Vec<PoseSample>; 2], Failure> {
    let instruments = Source::instruments(bedside)?;
    let frames: Vec<String> = instruments[0].frames.iter().map(|[from, _]| from.clone()).collect();
    let mut found = [Vec::new(), Vec::new()];
    walk(path, false, instruments, |_, live| {
        if let Live::Pose { source, sample: Measured { time_ns, pose, invalid: None, .. }, .. } = live {
            let into = match frames.get(source).map(String::as_str) {
                Some(PROBE_FRAME) => &mut found[0],
                Some(REFERENCE_FRAME) => &mut found[1],
                _ => return,
            };
            let time_s = seconds(time_ns);
            into.push(PoseSample { time_s, rotation: pose.rotation, position_mm: pose.position_mm });
        }
    })?;
    Ok(found)
}

/// The probe against the reference where there is one, at the times of the probe's own samples.
fn against(probe: &[PoseSample], reference: &[PoseSample]) -> Result<Vec<PoseSample>, Failure> {
    if reference.is_empty() {
        return Ok(probe.to_vec());
    }
    let reference = Poses::new(reference)?;
    let of = |own: &PoseSample| {
        let turned =
            reference.at(own.time_s)?.inverse() * DAffine3::from_rotation_translation(own.rotation, own.position_mm);
        Some(sample(own.time_s, &turned))
    };
    Ok(probe.iter().filter_map(of).collect())
}

/// Poses of a sequence's own pictures, by whatever transforms it holds, and what is left of them that is no pose: the pixels' size and skew.
fn along(path: &Path, calibration: &Settings) -> Result<(Vec<PoseSample>, DAffine3), Failure> {
    let settings = SequenceSettings { images: false, ..SequenceSettings::new(path) };
    let mut device = drivers::open(&OpenSettings::Sequence(settings))?;
    let found = survey(device.as_mut(), &PairingOptions::new(calibration, None))?;
    let Some(first) = found.poses.first() else {
        return Err(Failure(format!("{}: no picture has a place", path.display())));
    };
    let first = first.world_from_image.affine();
    // The frame of the first picture: u along x, v in the plane of x and y.
    let m = first.matrix3;
    let x = m.x_axis.normalize();
    let z = m.x_axis.cross(m.y_axis).normalize();
    let frame = DAffine3 { matrix3: DMat3::from_cols(x, z.cross(x), z), translation: DVec3::ZERO };
    let of_pixels = DAffine3 { translation: DVec3::ZERO, ..frame.inverse() * first };
    let back = of_pixels.inverse();
    let pose = |pose: &crate::sync::FramePose| {
        let rigid = nearest_rigid(&(pose.world_from_image.affine() * back), RIGID_TOLERANCE);
        let (rigid, _) = rigid.map_err(|e| Failure(format!("{}: picture {}: {e}", path.display(), pose.item)))?;
        Ok::<_, Failure>(sample(seconds(pose.time_ns), &rigid))
    };
    Ok((found.poses.iter().map(pose).collect::<Result<_, _>>()?, of_pixels))
}

fn sample(time_s: f64, pose: &DAffine3) -> PoseSample {
    PoseSample { time_s, rotation: DQuat::from_mat3(&pose.matrix3).normalize(), position_mm: pose.translation }
}

fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

fn stamps(stamp: &Stamp, number: Option<u64>) -> Option<Stamps> {
    let given_s = stamp.host_ns.map(seconds).or(stamp.source_s)?;
    Some(Stamps { given_s, raw_s: stamp.unfiltered_s, number })
}

/// A valid transform as a rigid one.
fn rigid(transform: &NamedTransform) -> Option<DAffine3> {
    let affine = (transform.status == Status::Ok).then(|| affine_from_rows(&transform.matrix))?.ok()?;
    nearest_rigid(&affine, RIGID_TOLERANCE).ok().map(|(rigid, _)| rigid)
}

/// Every transform of a sequence, with the number of its item where the source counts; the names of all.
fn transforms(path: &Path, mut take: impl FnMut(&NamedTransform, Option<u64>)) -> Result<Vec<String>, Failure> {
    let mut numbers = std::collections::HashMap::new();
    each(path, false, |reading| {
        if let Reading::Frame(frame) = &reading
            && let Some(number) = frame.frame_number
        {
            numbers.insert(frame.stamp.item, number);
        }
        Ok(())
    })?;
    let mut names: Vec<String> = Vec::new();
    each(path, false, |reading| {
        if let Reading::NamedTransform(transform) = &reading {
            let name = transform_name(&transform.from, &transform.to);
            if !names.contains(&name) {
                names.push(name);
            }
            take(transform, numbers.get(&transform.stamp.item).copied());
        }
        Ok(())
    })?;
    Ok(names)
}

/// Every reading of a sequence.
fn each(path: &Path, images: bool, mut take: impl FnMut(Reading) -> Result<(), Failure>) -> Result<(), Failure> {
    let settings = SequenceSettings { images, ..SequenceSettings::new(path) };
    let mut device = drivers::open(&OpenSettings::Sequence(settings))?;
    device.start()?;
    loop {
        match device.next(drivers::NO_DEADLINE)? {
            Next::Reading(reading) => take(reading)?,
            Next::Pending => {}
            Next::End => break,
        }
    }
    Ok(device.stop()?)
}
