//! Pictures of wires and poses from a recording.

use std::path::Path;

use calibration::frames::{Probe, Reference, Tracker, Transform};
use calibration::picture::GreyView;
use calibration::probe::track::Poses;
use calibration::probe::{DotFinder, Layout, Matcher, Observation, Recording};
use calibration::region::ClipRect;
use drivers::reading::{NamedTransform, Reading, Stamp};
use drivers::recording::SequenceSettings;
use drivers::{Next, OpenSettings};
use glam::DAffine3;

use super::super::super::{Failure, input};
use crate::config::phantom::FrameNames;
use crate::ingest::{Ingest, Sample};
use crate::slice::Pixels;
use crate::sync::pairing::RIGID_TOLERANCE;
use crate::sync::{Pairing, PairingOptions};

/// What was observed.
pub(super) struct Observed {
    pub(super) observations: Vec<Observation>,
    pub(super) size_px: [u32; 2],
    /// Whether all pictures have a time.
    pub(super) timed: bool,
    /// Why the first of the pictures without poses has none.
    pub(super) first_refusal: Option<String>,
}

impl Observed {
    /// For the calibration.
    pub(super) fn recording(&self) -> Recording<'_> {
        Recording { observations: &self.observations, size_px: self.size_px, timed: self.timed }
    }
}

/// A picture to look at.
pub(super) struct Shown {
    /// Which of the recording.
    pub(super) frame: usize,
    /// Its grey levels, row by row.
    pub(super) grey: Vec<u8>,
}

/// Reads some of a sequence's pictures once more: those of these numbers.
///
/// # Errors
/// [`Failure`] when it cannot be read.
pub(super) fn pictures(path: &Path, frames: &[usize]) -> Result<Vec<Shown>, Failure> {
    let mut device = drivers::open(&OpenSettings::Sequence(SequenceSettings::new(path)))?;
    let mut ingest = Ingest::new();
    let mut shown = Vec::new();
    device.start()?;
    while shown.len() < frames.len() {
        match device.next(drivers::NO_DEADLINE)? {
            Next::Reading(reading @ Reading::Frame(_)) => {
                let frame = usize::try_from(reading.stamp().item).unwrap_or(usize::MAX);
                if let Sample::Picture(picture) = ingest.take(reading)
                    && frames.contains(&frame)
                    && let Pixels::U8(grey) = picture.image.pixels()
                {
                    shown.push(Shown { frame, grey: grey.to_vec() });
                }
            }
            Next::Reading(_) | Next::Pending => {}
            Next::End => break,
        }
    }
    device.stop()?;
    // As they were asked for.
    shown.sort_by_key(|shown| frames.iter().position(|frame| *frame == shown.frame));
    Ok(shown)
}

/// How poses come about.
struct Ways {
    /// From the probe to what both sensors are tracked in, or to the reference itself.
    probe: Pairing,
    /// From the reference likewise.
    reference: Option<Pairing>,
}

/// Reads a sequence.
///
/// # Errors
/// [`Failure`] when it cannot be read, holds no grey pictures of 8 bits, or no way from the probe to the reference.
pub(super) fn observe(
    path: &Path,
    layout: &Layout,
    frames: &FrameNames,
    clip: Option<ClipRect>,
) -> Result<Observed, Failure> {
    let within = |problem: String| Failure(format!("{}: {problem}", path.display()));
    let mut ways = Ways::of(&names(path)?, frames).map_err(within)?;
    let mut device = drivers::open(&OpenSettings::Sequence(SequenceSettings::new(path)))?;
    let bar = input::progress("looking", device.describe().items.unwrap_or(0));
    let (mut finder, mut matcher, mut ingest) = (DotFinder::new(), Matcher::new(), Ingest::new());
    let mut seen = Observed { observations: Vec::new(), size_px: [0; 2], timed: true, first_refusal: None };
    device.start()?;
    loop {
        match device.next(drivers::NO_DEADLINE)? {
            Next::Reading(Reading::NamedTransform(transform)) => ways.take(&transform),
            Next::Reading(reading @ Reading::Frame(_)) => {
                bar.inc(1);
                let stamp = *reading.stamp();
                let picture = match ingest.take(reading) {
                    Sample::Picture(picture) => picture,
                    Sample::Refused(refusal) => {
                        seen.first_refusal.get_or_insert(refusal.to_string());
                        continue;
                    }
                    _ => continue,
                };
                let image = &picture.image;
                let Pixels::U8(pixels) = image.pixels() else {
                    return Err(within("its pictures are not of 8 bits; convert them first".into()));
                };
                let size = [image.width(), image.height()];
                if seen.size_px == [0; 2] {
                    seen.size_px = size;
                } else if seen.size_px != size {
                    return Err(within(format!(
                        "its pictures are of different sizes, {:?} and {size:?}",
                        seen.size_px
                    )));
                }
                let [width, height] = size.map(|n| n as usize);
                let view = GreyView::new(width, height, width, pixels).map_err(|e| within(e.to_string()))?;
                let dots = finder.find(&view, clip).to_vec();
                let reading = matcher.read(&dots, size, layout);
                seen.timed &= stamp.source_s.is_some();
                let time_s = stamp.source_s.unwrap_or(stamp.item as f64);
                // A picture's transforms come before it.
                let poses = match ways.poses(&stamp, time_s) {
                    Ok(poses) => Some(poses),
                    Err(why) => {
                        seen.first_refusal.get_or_insert(why);
                        None
                    }
                };
                let frame = usize::try_from(stamp.item).unwrap_or(usize::MAX);
                seen.observations.push(Observation { frame, time_s, dots, reading, poses });
            }
            Next::Reading(_) | Next::Pending => {}
            Next::End => break,
        }
    }
    device.stop()?;
    bar.finish_and_clear();
    if seen.observations.is_empty() {
        let why = seen.first_refusal.map_or(String::new(), |why| format!("; the first: {why}"));
        return Err(within(format!("holds no picture that can be used{why}")));
    }
    Ok(seen)
}

/// Names of a sequence's transforms.
fn names(path: &Path) -> Result<Vec<(String, String)>, Failure> {
    let settings = SequenceSettings { images: false, ..SequenceSettings::new(path) };
    let mut device = drivers::open(&OpenSettings::Sequence(settings))?;
    let mut names: Vec<(String, String)> = Vec::new();
    device.start()?;
    loop {
        match device.next(drivers::NO_DEADLINE)? {
            Next::Reading(Reading::NamedTransform(t)) => {
                if !names.iter().any(|(from, to)| *from == t.from && *to == t.to) {
                    names.push((t.from, t.to));
                }
            }
            Next::Reading(_) | Next::Pending => {}
            Next::End => break,
        }
    }
    device.stop()?;
    Ok(names)
}

impl Ways {
    fn of(names: &[(String, String)], frames: &FrameNames) -> Result<Self, String> {
        let FrameNames { probe, reference, .. } = frames;
        let beside = |name: &str| -> Vec<String> {
            let other = |(from, to): &'_ (String, String)| match (from == name, to == name) {
                (true, false) => Some(to.clone()),
                (false, true) => Some(from.clone()),
                _ => None,
            };
            names.iter().filter_map(other).collect()
        };
        let way = |image: &str, world: &str| {
            let options =
                PairingOptions { image: image.to_owned(), world: Some(world.to_owned()), statics: Vec::new() };
            Pairing::with_names(options, names).ok()
        };
        let of_reference = beside(reference);
        let both = beside(probe).into_iter().find(|name| name != reference && of_reference.contains(name));
        if let Some(tracker) = both
            && let (Some(probe), Some(reference)) = (way(probe, &tracker), way(reference, &tracker))
        {
            return Ok(Self { probe, reference: Some(reference) });
        }
        let Some(direct) = way(probe, reference) else {
            let listed: Vec<String> = names.iter().map(|(from, to)| format!("{from}To{to}")).collect();
            return Err(format!(
                "no way leads from {probe} to {reference}, which the phantom is held on; it holds {}",
                if listed.is_empty() { "no transform".to_owned() } else { listed.join(", ") }
            ));
        };
        Ok(Self { probe: direct, reference: None })
    }

    fn take(&mut self, transform: &NamedTransform) {
        self.probe.transform(transform.clone());
        if let Some(reference) = &mut self.reference {
            reference.transform(transform.clone());
        }
    }

    fn poses(&mut self, stamp: &Stamp, time_s: f64) -> Result<Poses, String> {
        let tracker_from_probe = rigid::<Tracker, Probe>(&mut self.probe, stamp)?;
        let reference = self.reference.as_mut().map(|way| rigid::<Tracker, Reference>(way, stamp)).transpose()?;
        Ok(Poses { time_s, tracker_from_probe, tracker_from_reference: reference })
    }
}

fn rigid<To, From>(way: &mut Pairing, stamp: &Stamp) -> Result<Transform<To, From>, String> {
    let affine: DAffine3 = way.pose_of(stamp).map_err(|refusal| refusal.to_string())?.world_from_image.affine();
    let pose = Transform::<To, From>::from_affine(affine);
    pose.nearest_rigid(RIGID_TOLERANCE).map(|(rigid, _)| rigid).map_err(|bad| format!("item {}: {bad}", stamp.item))
}
