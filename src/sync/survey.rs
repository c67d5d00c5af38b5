//! A walk over a recording's transforms before its pictures are looked at.
//!
//! Some decisions need all poses: which transforms there are at all, and how far neighbouring slices lie apart. A recording's device
//! opened without images delivers them from its header in a moment.

use calibration::frames::{Image, Transform, World};
use drivers::{Device, Next, Reading};
use glam::DVec3;

use super::graph::{Names, NoPath, Route};
use super::pairing::{Pairing, PairingOptions};
use crate::ingest::Ingest;
use crate::ledger::Ledger;

/// Part of the gaps between neighbouring slices that the automatic σ covers with its full width.
const GAP_QUANTILE: f64 = 0.9;

/// Where a frame lies.
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

/// What a recording holds beside its pixels.
#[derive(Debug, Clone)]
pub struct Survey {
    /// Names of all transforms, in the order of their first delivery: for [`Pairing::with_names`].
    pub names: Vec<Names>,
    /// The way from the image to the world.
    pub route: Route,
    /// The frames that have a place, in order. Their pixels may still be unfit.
    pub poses: Vec<FramePose>,
    /// What became of the frames; `used` are those of `poses`.
    pub ledger: Ledger,
}

/// Why a survey failed.
#[derive(Debug, thiserror::Error)]
pub enum SurveyError {
    /// The device.
    #[error(transparent)]
    Device(#[from] drivers::Error),
    /// The image cannot be placed in the world.
    #[error(transparent)]
    NoPath(#[from] NoPath),
}

/// Walks twice over a device (once for the names, once for the poses), which should be one of a recording, opened without images. The
/// device is stopped before and after.
///
/// # Errors
/// [`SurveyError`]: the device's error, or there is no way to the world.
pub fn survey(device: &mut dyn Device, options: &PairingOptions) -> Result<Survey, SurveyError> {
    let mut names: Vec<Names> = Vec::new();
    walk(device, |reading| {
        if let Reading::NamedTransform(t) = reading
            && !names.iter().any(|(from, to)| *from == t.from && *to == t.to)
            // One more than the pairing stage takes, so that it can say that there are too many.
            && names.len() <= super::pairing::MAX_NAMES
        {
            names.push((t.from, t.to));
        }
    })?;

    let mut pairing = Pairing::with_names(options.clone(), &names)?;
    let mut ingest = Ingest::new();
    let mut ledger = Ledger::default();
    let mut poses = Vec::new();
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
                Err(refusal) => ledger.refused(&refusal),
            }
        }
        _ => {}
    })?;
    let route = pairing.route().cloned().unwrap_or_else(|| Route { steps: Vec::new(), frames: Vec::new() });
    Ok(Survey { names, route, poses, ledger })
}

fn walk(device: &mut dyn Device, mut take: impl FnMut(Reading)) -> Result<(), drivers::Error> {
    device.start()?;
    let end = loop {
        match device.next(drivers::NO_DEADLINE) {
            Ok(Next::Reading(reading)) => take(reading),
            Ok(Next::Pending) => {}
            Ok(Next::End) => break Ok(()),
            Err(error) => break Err(error),
        }
    };
    // The first error is the one that matters.
    end.and(device.stop())
}

/// The slices' distance from their neighbours: the 90th percentile of [`gaps`], mm. `None` when there is no distance.
pub fn gap(poses: &[FramePose]) -> Option<f64> {
    let gaps = gaps(poses);
    let at = (GAP_QUANTILE * (gaps.len() as f64 - 1.0)).round();
    gaps.get(at as usize).copied().filter(|g| *g > 0.0 && g.is_finite())
}

/// Distances between neighbouring slices, mm, in ascending order: over pairs of consecutive slices and five points of the picture (centre and
/// corners), of the second slice's point from the first slice's plane.
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

    use drivers::Description;
    use drivers::reading::{Frame, NamedTransform, PixelType, Stamp, Status};

    use super::*;

    /// Plays readings, from the beginning after every start.
    struct Scripted {
        readings: Vec<Reading>,
        left: VecDeque<Reading>,
        running: bool,
        description: Description,
        health: drivers::Health,
    }

    impl Device for Scripted {
        fn start(&mut self) -> Result<(), drivers::Error> {
            assert!(!std::mem::replace(&mut self.running, true), "started twice");
            self.left = self.readings.clone().into();
            Ok(())
        }
        fn next(&mut self, _: i64) -> Result<Next, drivers::Error> {
            Ok(self.left.pop_front().map_or(Next::End, Next::Reading))
        }
        fn stop(&mut self) -> Result<(), drivers::Error> {
            self.running = false;
            Ok(())
        }
        fn describe(&self) -> &Description {
            &self.description
        }
        fn health(&self) -> &drivers::Health {
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
            health: drivers::Health::default(),
        }
    }

    #[test]
    fn poses_are_found_without_pixels_and_the_world_does_not_hang_on_the_first_frame() {
        // Reference turns up with the second frame only: the first is refused, not placed in Tracker.
        let mut device = device(vec![
            transform(0, "Image", "Tracker", 1.0),
            frame(0),
            transform(1, "Image", "Tracker", 2.0),
            transform(1, "Reference", "Tracker", 10.0),
            frame(1),
        ]);
        let survey = survey(&mut device, &PairingOptions::default()).unwrap();
        assert!(!device.running);
        assert_eq!(survey.route.world(), "Reference");
        assert_eq!((survey.ledger.frames.used, survey.ledger.refused_total()), (1, 1));
        let pose = survey.poses[0];
        assert_eq!((pose.item, pose.time_ns, pose.size), (1, 100_000_000, [3, 4]));
        assert_eq!(pose.world_from_image.point(glam::DVec3::ZERO), glam::DVec3::new(-8.0, 0.0, 0.0));
        assert_eq!(survey.names.len(), 2);
    }

    #[test]
    fn projected_poses_and_untimed_frames_are_counted() {
        let mut probe = transform(0, "Probe", "Tracker", 1.0);
        let mut picture = frame(0);
        if let (Reading::NamedTransform(t), Reading::Frame(f)) = (&mut probe, &mut picture) {
            t.matrix[0] = 1.001;
            (t.stamp.source_s, f.stamp.source_s) = (None, None);
        }
        let rows = [0.1, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let statics = vec![calibration::named::StaticTransform::new("Image", "Probe", &rows).unwrap()];
        let options = PairingOptions { statics, ..PairingOptions::default() };
        let ledger = survey(&mut device(vec![probe, picture]), &options).unwrap().ledger;
        assert_eq!((ledger.frames.used, ledger.poses_projected, ledger.untimed), (1, 1, 1));
        assert!((ledger.worst_projection - 2.001e-3).abs() < 1e-9);
    }

    #[test]
    fn a_recording_without_a_way_is_refused_before_any_picture() {
        let mut device = device(vec![transform(0, "Probe", "Tracker", 1.0), frame(0)]);
        let error = survey(&mut device, &PairingOptions::default()).unwrap_err().to_string();
        assert!(error.contains("no way from Image to Tracker") && error.contains("--image-to-probe"), "{error}");
        assert!(!device.running);
    }
}
