//! Readings of a sequence, and sensor poses at its images.

use std::path::Path;

use calibration::probe::track::Poses;
use drivers::OpenSettings;
use drivers::replay::SequenceSettings;
use sonoweave_core::Next;
use sonoweave_core::frames::{Probe, Reference, Tracker, Transform};
use sonoweave_core::reading::{NamedTransform, Reading, Stamp, transform_name};
use sync::ingest::RIGID_TOLERANCE;
use sync::{PairingOptions, StampedPairing};

use super::times::stamps;
use crate::failure::Failure;

/// An item of a sequence and its poses, or the reason why it has none.
pub(super) type OfItem = (u64, Result<Poses, String>);

/// Passes every reading of a sequence to `visit`.
pub(crate) fn each(
    path: &Path,
    images: bool,
    mut visit: impl FnMut(Reading) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let settings = SequenceSettings { images, ..SequenceSettings::new(path) };
    let mut device = drivers::open(&OpenSettings::Sequence(settings))?;
    device.start()?;
    loop {
        match device.next(sonoweave_core::NO_DEADLINE)? {
            Next::Reading(reading) => visit(reading)?,
            Next::Pending => {}
            Next::End => break,
        }
    }
    Ok(device.stop()?)
}

/// Returns the poses of a sensor and the reference, item by item in their order, or the reason
/// why there are none.
pub(super) fn poses(path: &Path, sensor: &str, reference: &str) -> Result<Vec<OfItem>, Failure> {
    let mut names: Vec<(String, String)> = Vec::new();
    each(path, false, |reading| {
        if let Reading::NamedTransform(t) = reading
            && !names.iter().any(|(from, to)| *from == t.from && *to == t.to)
        {
            names.push((t.from, t.to));
        }
        Ok(())
    })?;
    let mut ways = Ways::of(&names, sensor, reference)
        .map_err(|problem| Failure::new(format!("{}: {problem}", path.display())))?;
    let mut all = Vec::new();
    each(path, false, |reading| {
        match reading {
            Reading::NamedTransform(transform) => ways.add(&transform),
            // An image's transforms come before it.
            Reading::Frame(frame) => all.push((frame.stamp.item, ways.poses(&frame.stamp))),
            _ => {}
        }
        Ok(())
    })?;
    Ok(all)
}

/// Transform chains to the poses.
struct Ways {
    /// From the sensor to the frame in which both are tracked, or to the reference itself.
    sensor: StampedPairing,
    /// The same from the reference.
    reference: Option<StampedPairing>,
}

impl Ways {
    fn of(names: &[(String, String)], sensor: &str, reference: &str) -> Result<Self, String> {
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
            StampedPairing::with_names(options, names).ok()
        };
        let of_reference = beside(reference);
        let both = beside(sensor).into_iter().find(|name| name != reference && of_reference.contains(name));
        if let Some(tracker) = both
            && let (Some(sensor), Some(reference)) = (way(sensor, &tracker), way(reference, &tracker))
        {
            return Ok(Self { sensor, reference: Some(reference) });
        }
        let Some(direct) = way(sensor, reference) else {
            let listed: Vec<String> = names.iter().map(|(from, to)| transform_name(from, to)).collect();
            return Err(format!(
                "no transforms lead from {sensor} to {reference}, the frame of the phantom; it holds {}",
                if listed.is_empty() { "no transform".to_owned() } else { listed.join(", ") }
            ));
        };
        Ok(Self { sensor: direct, reference: None })
    }

    fn add(&mut self, transform: &NamedTransform) {
        self.sensor.transform(transform.clone());
        if let Some(reference) = &mut self.reference {
            reference.transform(transform.clone());
        }
    }

    fn poses(&mut self, stamp: &Stamp) -> Result<Poses, String> {
        let tracker_from_probe = rigid::<Tracker, Probe>(&mut self.sensor, stamp)?;
        let reference = self.reference.as_mut().map(|way| rigid::<Tracker, Reference>(way, stamp)).transpose()?;
        let time_s = stamps(stamp, None).map_or(stamp.item as f64, |stamps| stamps.given_s);
        Ok(Poses { time_s, tracker_from_probe, tracker_from_reference: reference })
    }
}

fn rigid<To, From>(way: &mut StampedPairing, stamp: &Stamp) -> Result<Transform<To, From>, String> {
    let affine = way.pose_of(stamp).map_err(|refusal| refusal.to_string())?.world_from_image.affine();
    let pose = Transform::<To, From>::from_affine(affine);
    pose.nearest_rigid(RIGID_TOLERANCE).map(|(rigid, _)| rigid).map_err(|bad| format!("item {}: {bad}", stamp.item))
}
