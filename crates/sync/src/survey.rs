//! A pass over a recording's transforms before its images are read.
//!
//! Some decisions need all poses: which transforms exist, and the distance between neighbouring
//! slices. A recording opened without images delivers them from its header quickly.

use std::sync::Arc;

use glam::DVec3;

use sonoweave_core::frames::{Image, Transform, World};
use sonoweave_core::ledger::Ledger;
use sonoweave_core::refusal::Refusal;
use sonoweave_core::{Device, Next, Reading};

use super::graph::{Names, NoPath, Route};
use super::pairing::PairingOptions;
use super::pairing::stamped::{MAX_NAMES, StampedPairing};
use crate::ingest::Ingest;
use crate::smoothing::Smoothing;
use crate::smoothing::recorded::{RecordedPoses, SmoothedTransforms};

/// Fraction of the gaps between neighbouring slices that the automatic σ must cover fully.
const GAP_QUANTILE: f64 = 0.9;

/// Pose of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FramePose {
    /// Position in the stream, from 0.
    pub item: u64,
    /// Measurement time, ns.
    pub time_ns: i64,
    /// Width and height in MF orientation, pixels.
    pub size: [u32; 2],
    /// Maps pixels to world mm.
    pub world_from_image: Transform<World, Image>,
}

/// A recording's transforms, poses and frame ledger, without pixels.
#[derive(Debug, Clone)]
pub struct Survey {
    /// Names of all transforms, in the order of their first delivery: for
    /// [`StampedPairing::with_names`].
    pub names: Vec<Names>,
    /// The chain of transforms from the image to the world.
    pub route: Route,
    /// The frames that have a pose, in order. Their pixels may still be unfit.
    pub poses: Vec<FramePose>,
    /// The others, in order.
    pub refused: Vec<Refusal>,
    /// Frames by outcome; `used` are those of `poses`.
    pub ledger: Ledger,
    /// The sensors' poses for smoothing: for [`StampedPairing::with_smoothed`].
    pub smoothed: Option<Arc<SmoothedTransforms>>,
}

/// Reason why a survey failed.
#[derive(Debug, thiserror::Error)]
pub enum SurveyError {
    /// The device.
    #[error(transparent)]
    Device(#[from] sonoweave_core::Error),
    /// The image cannot be placed in the world.
    #[error(transparent)]
    NoPath(#[from] NoPath),
}

/// Reads a device twice, once for the names and once for the poses, which are smoothed if that is
/// asked for. It should be a recording opened without images. The device is stopped before and
/// after.
///
/// # Errors
/// [`SurveyError`]: the device's error, or no chain of transforms to the world.
pub fn survey(
    device: &mut dyn Device,
    options: &PairingOptions,
    smoothing: Option<Smoothing>,
) -> Result<Survey, SurveyError> {
    let mut names: Vec<Names> = Vec::new();
    let mut recorded = RecordedPoses::default();
    walk(device, |reading| {
        let Reading::NamedTransform(t) = reading else { return };
        if smoothing.is_some() {
            recorded.take(&t, &options.image);
        }
        if !names.iter().any(|(from, to)| *from == t.from && *to == t.to)
            // One more than the pairing stage accepts, so that it can report the excess.
            && names.len() <= MAX_NAMES
        {
            names.push((t.from, t.to));
        }
    })?;

    let smoothed = smoothing.map(|settings| Arc::new(recorded.smoothed(settings)));
    let mut pairing = StampedPairing::with_names(options.clone(), &names)?.with_smoothed(smoothed.clone());
    let mut ingest = Ingest::new();
    let mut ledger = Ledger::default();
    let (mut poses, mut refused) = (Vec::new(), Vec::new());
    walk(device, |reading| match reading {
        Reading::NamedTransform(transform) => pairing.transform(transform),
        Reading::Frame(frame) => {
            ledger.arrived();
            match ingest.head(&frame).and_then(|head| Ok((head, pairing.pose(&head)?))) {
                Ok((head, pose)) => {
                    ledger.used();
                    ledger.projected(pose.projected, pose.deviation);
                    ledger.untimed += u64::from(head.untimed);
                    poses.push(FramePose {
                        item: head.stamp.item,
                        time_ns: head.time_ns,
                        size: head.size,
                        world_from_image: pose.world_from_image,
                    });
                }
                Err(refusal) => {
                    ledger.refused(&refusal);
                    refused.push(refusal);
                }
            }
        }
        _ => {}
    })?;
    let route = pairing.route().cloned().unwrap_or_else(|| Route { steps: Vec::new(), frames: Vec::new() });
    Ok(Survey { names, route, poses, refused, ledger, smoothed })
}

fn walk(device: &mut dyn Device, mut take: impl FnMut(Reading)) -> Result<(), sonoweave_core::Error> {
    device.start()?;
    let end = loop {
        match device.next(sonoweave_core::NO_DEADLINE) {
            Ok(Next::Reading(reading)) => take(reading),
            Ok(Next::Pending) => {}
            Ok(Next::End) => break Ok(()),
            Err(error) => break Err(error),
        }
    };
    // The first error is the one that matters.
    end.and(device.stop())
}

/// Returns the slices' distance from their neighbours: the 90th percentile of [`gaps`], mm.
/// `None` when there is no distance.
pub fn gap(poses: &[FramePose]) -> Option<f64> {
    let gaps = gaps(poses);
    let at = (GAP_QUANTILE * (gaps.len() as f64 - 1.0)).round();
    gaps.get(at as usize).copied().filter(|g| *g > 0.0 && g.is_finite())
}

/// Returns the distances between neighbouring slices, mm, in ascending order. For each pair of
/// consecutive slices, five points of the second (centre and corners) are measured from the
/// first slice's plane.
pub fn gaps(poses: &[FramePose]) -> Vec<f64> {
    let mut gaps = Vec::new();
    for pair in poses.windows(2) {
        let [a, b] = [&pair[0], &pair[1]];
        let to = a.world_from_image;
        let normal = to.vector(DVec3::X).cross(to.vector(DVec3::Y)).normalize_or_zero();
        let [right, bottom] = a.size.map(|n| f64::from(n) - 1.0);
        for [u, v] in [[0.5 * right, 0.5 * bottom], [0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]] {
            let point = DVec3::new(u, v, 0.0);
            let distance = normal.dot(b.world_from_image.point(point) - to.point(point)).abs();
            gaps.push(distance);
        }
    }
    gaps.sort_by(f64::total_cmp);
    gaps
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;
    use std::sync::Arc;

    use sonoweave_core::Description;
    use sonoweave_core::reading::{Frame, NamedTransform, PixelType, Stamp, Status};

    use super::*;

    /// Plays readings, from the beginning after every start.
    struct Scripted {
        readings: Vec<Reading>,
        left: VecDeque<Reading>,
        running: bool,
        description: Description,
        health: sonoweave_core::Health,
    }

    impl Device for Scripted {
        fn start(&mut self) -> Result<(), sonoweave_core::Error> {
            assert!(!std::mem::replace(&mut self.running, true), "started twice");
            self.left = self.readings.clone().into();
            Ok(())
        }
        fn next(&mut self, _: i64) -> Result<Next, sonoweave_core::Error> {
            Ok(self.left.pop_front().map_or(Next::End, Next::Reading))
        }
        fn stop(&mut self) -> Result<(), sonoweave_core::Error> {
            self.running = false;
            Ok(())
        }
        fn describe(&self) -> &Description {
            &self.description
        }
        fn health(&self) -> &sonoweave_core::Health {
            &self.health
        }
    }

    fn stamp(item: u64) -> Stamp {
        Stamp { item, source_s: Some(0.1), ..Stamp::default() }
    }

    fn transform(item: u64, from: &str, to: &str, x: f64) -> Reading {
        let matrix = [1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let (from, to) = (from.to_owned(), to.to_owned());
        Reading::NamedTransform(NamedTransform { stamp: stamp(item), from, to, matrix, status: Status::Ok })
    }

    fn frame(item: u64) -> Reading {
        Reading::Frame(Frame {
            stamp: stamp(item),
            frame_number: None,
            status: Status::Ok,
            size: [4, 3],
            channels: 1,
            pixel: PixelType::U8,
            orientation: "FM".into(),
            image_type: String::new(),
            pixels: Arc::from([].as_slice()),
            fields: Vec::new(),
        })
    }

    fn device(readings: Vec<Reading>) -> Scripted {
        Scripted {
            readings,
            left: VecDeque::new(),
            running: false,
            description: Description::default(),
            health: sonoweave_core::Health::default(),
        }
    }

    #[test]
    fn survey_finds_poses_and_world_despite_first_frame() {
        // Reference first appears with the second frame: the first frame is refused, not placed
        // in Tracker.
        let mut device = device(vec![
            transform(0, "Image", "Tracker", 1.0),
            frame(0),
            transform(1, "Image", "Tracker", 2.0),
            transform(1, "Reference", "Tracker", 10.0),
            frame(1),
        ]);
        let survey = survey(&mut device, &PairingOptions::default(), None).unwrap();
        assert!(!device.running);
        assert_eq!(survey.route.world(), "Reference");
        assert_eq!((survey.ledger.frames.used, survey.ledger.refused_total()), (1, 1));
        let pose = survey.poses[0];
        assert_eq!((pose.item, pose.time_ns, pose.size), (1, 100_000_000, [3, 4]));
        assert_eq!(pose.world_from_image.point(glam::DVec3::ZERO), glam::DVec3::new(-8.0, 0.0, 0.0));
        assert_eq!(survey.names.len(), 2);
    }

    #[test]
    fn projected_poses_and_untimed_frames_counted() {
        let mut probe = transform(0, "Probe", "Tracker", 1.0);
        let mut picture = frame(0);
        if let (Reading::NamedTransform(t), Reading::Frame(f)) = (&mut probe, &mut picture) {
            t.matrix[0] = 1.001;
            (t.stamp.source_s, f.stamp.source_s) = (None, None);
        }
        let rows = [0.1, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let statics = vec![sonoweave_core::named::StaticTransform::new("Image", "Probe", &rows).unwrap()];
        let options = PairingOptions { statics, ..PairingOptions::default() };
        let ledger = survey(&mut device(vec![probe, picture]), &options, None).unwrap().ledger;
        assert_eq!((ledger.frames.used, ledger.poses_projected, ledger.untimed), (1, 1, 1));
        assert!((ledger.worst_projection - 2.001e-3).abs() < 1e-9);
    }

    #[test]
    fn recording_without_chain_refused_before_images() {
        let mut device = device(vec![transform(0, "Probe", "Tracker", 1.0), frame(0)]);
        let error = survey(&mut device, &PairingOptions::default(), None).unwrap_err().to_string();
        assert!(error.contains("no way from Image to Tracker") && error.contains("with ImageToProbe"), "{error}");
        assert!(!device.running);
    }
}
