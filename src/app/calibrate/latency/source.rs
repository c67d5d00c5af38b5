//! Sources of video frames and poses: one sequence or two, or a session. Video frames are read
//! one by one and are not kept.

use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DQuat, DVec3};

use calibration::latency::floor::FloorPose;
use calibration::latency::stamps::Stamps;
use calibration::trajectory::PoseSample;
use calibration::trajectory::pose_spline::PoseSpline;
use config::Settings;
use config::bedside::devices::{PROBE_FRAME, REFERENCE_FRAME, TRACKER_FRAME};
use drivers::OpenSettings;
use drivers::replay::SequenceSettings;
use mask::MaskSettings;
use sonoweave_core::frames::{affine_from_rows, nearest_rigid};
use sonoweave_core::reading::{NamedTransform, Reading, Status, transform_name};
use sync::clock::TimeFlags;
use sync::history::{PoseHistory, PoseSample as Measured, Rigid};
use sync::ingest::RIGID_TOLERANCE;
use sync::smoothing::{Smoothing, smoothed};
use sync::survey;

use super::super::recorded::{GreyImage, Recorded, Tracks, Unfit, each, seconds, stamps};
use crate::failure::Failure;

/// Video frames and poses.
pub(crate) struct Source {
    video: Recorded,
    /// A separate sequence with the poses. Without it, they are the video's.
    tracker: Option<PathBuf>,
}

impl Source {
    /// Uses a recording, and a sequence for the poses unless the recording contains them.
    pub(in crate::app::calibrate) fn new(video: Recorded, tracker: Option<PathBuf>) -> Self {
        Self { video, tracker }
    }

    /// Returns its files.
    pub(crate) fn paths(&self) -> Vec<&Path> {
        std::iter::once(self.video.path()).chain(self.tracker.as_deref()).collect()
    }

    /// Returns the calibration that a session was reconstructed with.
    pub(in crate::app::calibrate) fn calibration(&self) -> Option<&Settings> {
        Some(&self.video.bedside()?.calibration)
    }

    /// Returns the session's image mask, if there is one.
    pub(in crate::app::calibrate) fn mask(&self) -> Option<MaskSettings> {
        Some(self.video.bedside()?.mask)
    }

    /// Returns the configured latency of the video, ms.
    pub(in crate::app::calibrate) fn video_ms(&self) -> Option<f64> {
        Some(self.video.bedside()?.grabber.latency_ns as f64 * 1e-6)
    }

    /// Returns the difference of the latencies that a session was paired by, ms.
    pub(crate) fn paired_ms(&self) -> Option<f64> {
        let bedside = self.video.bedside()?;
        Some((bedside.tracking.latency_ns() - bedside.grabber.latency_ns) as f64 * 1e-6)
    }

    /// Passes every video frame with its time stamps to `visit`; returns the unusable ones.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read, or its video frames are not in 8 bits or
    /// have no times.
    pub(in crate::app::calibrate) fn pictures(
        &self,
        mut visit: impl FnMut(GreyImage<'_>, Stamps) -> Result<(), Failure>,
    ) -> Result<Unfit, Failure> {
        self.video.pictures(|image| match image.stamps {
            Some(stamps) => visit(image, stamps),
            None => Err(Failure::new(format!(
                "{}: its frames have no time stamps; record them with time stamps",
                self.video.path().display()
            ))),
        })
    }

    /// Reads the probe's poses in the tracker's frame.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read or has no such poses.
    pub(super) fn poses(&self) -> Result<Vec<FloorPose>, Failure> {
        match &self.video {
            Recorded::Sequence(video) => {
                let tracker = self.tracker.as_ref().unwrap_or(video);
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
                    fail!(
                        "{}: holds no valid ProbeToTracker ({}); record the probe's poses",
                        tracker.display(),
                        if names.is_empty() {
                            "it holds no transform".to_owned()
                        } else {
                            format!("it holds {}", names.join(", "))
                        }
                    );
                }
                Ok(found)
            }
            Recorded::Session { path, bedside } => {
                let [probe, _] = measured(&Tracks::read(path, bedside)?);
                let pose = |sample: &PoseSample| {
                    let stamps = Stamps { given_s: sample.time_s, ..Stamps::default() };
                    FloorPose { stamps, rotation: sample.rotation, position_mm: sample.position_mm }
                };
                Ok(probe.iter().map(pose).collect())
            }
        }
    }

    /// Reads the probe's poses in the volume's frame, and the transform from image to probe.
    /// Sentences for the user go to `notes`.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read, has no such poses, or nothing relates the
    /// image to the probe.
    pub(in crate::app::calibrate) fn placed(
        &self,
        calibration: &Settings,
        poses: Poses,
        notes: &mut Vec<String>,
    ) -> Result<(Vec<PoseSample>, DAffine3), Failure> {
        if let (Recorded::Sequence(video), None, Poses::OfImages) = (&self.video, &self.tracker, poses) {
            return along(video, calibration);
        }
        let [mut probe, mut reference] = self.sensors()?;
        if poses == Poses::Smoothed {
            for (name, samples) in [(PROBE_FRAME, &mut probe), (REFERENCE_FRAME, &mut reference)] {
                notes.extend(smooth(name, samples));
            }
        }
        Ok((against(&probe, &reference)?, probe_from_image(calibration)?))
    }

    /// Reads the poses of the probe and of the reference, without the invalid ones.
    fn sensors(&self) -> Result<[Vec<PoseSample>; 2], Failure> {
        let (video, tracker) = match (&self.video, &self.tracker) {
            (Recorded::Session { path, bedside }, _) => return Ok(measured(&Tracks::read(path, bedside)?)),
            (Recorded::Sequence(video), tracker) => (video, tracker),
        };
        let (mut probe, mut reference) = (Vec::new(), Vec::new());
        transforms(tracker.as_ref().unwrap_or(video), |transform, _| {
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
        Ok([probe, reference])
    }
}

/// Poses that slices are placed by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::app::calibrate) enum Poses {
    /// Those of the images, if a sequence has them; else the sensors', as measured.
    OfImages,
    /// The sensors', each smoothed for itself by local regression.
    Smoothed,
}

/// Half of the longest window of smoothing, ns.
const HALF_WIDTH_NS: i64 = 300_000_000;
/// Share of the poses that may stay as measured without a note.
const AS_MEASURED: f64 = 0.1;

/// Smooths a sensor's poses. Returns a sentence if many stay as they are.
fn smooth(name: &str, samples: &mut [PoseSample]) -> Option<String> {
    let time_ns = |sample: &PoseSample| (sample.time_s * 1e9).round() as i64;
    let mut history = PoseHistory::new(samples.len(), HALF_WIDTH_NS);
    for sample in samples.iter() {
        let pose = Rigid { rotation: sample.rotation, position_mm: sample.position_mm };
        let (bound_ns, flags) = (0, TimeFlags::NONE);
        history.insert(Measured { time_ns: time_ns(sample), bound_ns, flags, pose, invalid: None });
    }
    let (mut left, mut why) = (0, None);
    for sample in samples.iter_mut() {
        match smoothed(&history, time_ns(sample), &Smoothing::offline(HALF_WIDTH_NS)) {
            Ok(found) => (sample.rotation, sample.position_mm) = (found.pose.rotation, found.pose.position_mm),
            Err(reason) => (left, why) = (left + 1, Some(reason)),
        }
    }
    let many = f64::from(left) > AS_MEASURED * samples.len() as f64;
    why.filter(|_| many).map(|why| format!("{left} of {} poses of {name} are not smoothed: {why}", samples.len()))
}

/// Returns the transform from image to probe.
///
/// # Errors
/// [`Failure`] when the calibration has none.
pub(in crate::app::calibrate) fn probe_from_image(calibration: &Settings) -> Result<DAffine3, Failure> {
    let image = calibration.image_frame.as_deref().unwrap_or("Image");
    let found = calibration.transforms.iter().find(|t| t.from == image && t.to == PROBE_FRAME);
    found.map(|transform| transform.affine).ok_or_else(|| {
        Failure::new("crossing slices need the image's position relative to the probe: give --config with ImageToProbe")
    })
}

/// Returns the session's poses of the probe and of the reference, without the invalid ones.
fn measured(tracks: &Tracks) -> [Vec<PoseSample>; 2] {
    [PROBE_FRAME, REFERENCE_FRAME].map(|name| {
        let valid = tracks.of(name).unwrap_or_default().iter().filter(|sample| sample.invalid.is_none());
        let sample = |Measured { time_ns, pose, .. }: &Measured| PoseSample {
            time_s: seconds(*time_ns),
            rotation: pose.rotation,
            position_mm: pose.position_mm,
        };
        valid.map(sample).collect()
    })
}

/// Returns the probe's poses relative to the reference, if there is one, at the times of the
/// probe's samples.
fn against(probe: &[PoseSample], reference: &[PoseSample]) -> Result<Vec<PoseSample>, Failure> {
    if reference.is_empty() {
        return Ok(probe.to_vec());
    }
    let reference = PoseSpline::new(reference)?;
    let of = |own: &PoseSample| {
        let turned =
            reference.at(own.time_s)?.inverse() * DAffine3::from_rotation_translation(own.rotation, own.position_mm);
        Some(sample(own.time_s, &turned))
    };
    Ok(probe.iter().filter_map(of).collect())
}

/// Returns a sequence's image poses, from whatever transforms it holds. The second value is the
/// non-rigid remainder: the pixels' size and skew.
fn along(path: &Path, calibration: &Settings) -> Result<(Vec<PoseSample>, DAffine3), Failure> {
    let settings = SequenceSettings { images: false, ..SequenceSettings::new(path) };
    let mut device = drivers::open(&OpenSettings::Sequence(settings))?;
    let found = survey(device.as_mut(), &calibration.pairing_options(None), None)?;
    let Some(first) = found.poses.first() else {
        fail!("{}: no frame has a pose; record a tracked sequence", path.display());
    };
    let first = first.world_from_image.affine();
    // The frame of the first image: u along x, v in the plane of x and y.
    let m = first.matrix3;
    let x = m.x_axis.normalize();
    let z = m.x_axis.cross(m.y_axis).normalize();
    let frame = DAffine3 { matrix3: DMat3::from_cols(x, z.cross(x), z), translation: DVec3::ZERO };
    let of_pixels = DAffine3 { translation: DVec3::ZERO, ..frame.inverse() * first };
    let back = of_pixels.inverse();
    let pose = |pose: &sync::FramePose| {
        let rigid = nearest_rigid(&(pose.world_from_image.affine() * back), RIGID_TOLERANCE);
        let (rigid, _) = rigid.map_err(|e| Failure::new(format!("{}: frame {}: {e}", path.display(), pose.item)))?;
        Ok::<_, Failure>(sample(seconds(pose.time_ns), &rigid))
    };
    Ok((found.poses.iter().map(pose).collect::<Result<_, _>>()?, of_pixels))
}

fn sample(time_s: f64, pose: &DAffine3) -> PoseSample {
    PoseSample { time_s, rotation: DQuat::from_mat3(&pose.matrix3).normalize(), position_mm: pose.translation }
}

/// Returns a valid transform as a rigid one.
fn rigid(transform: &NamedTransform) -> Option<DAffine3> {
    let affine = (transform.status == Status::Ok).then(|| affine_from_rows(&transform.matrix))?.ok()?;
    nearest_rigid(&affine, RIGID_TOLERANCE).ok().map(|(rigid, _)| rigid)
}

/// Reads every transform of a sequence, with its item's number if the source counts items.
/// Returns all names.
fn transforms(path: &Path, mut visit: impl FnMut(&NamedTransform, Option<u64>)) -> Result<Vec<String>, Failure> {
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
            visit(transform, numbers.get(&transform.stamp.item).copied());
        }
        Ok(())
    })?;
    Ok(names)
}
