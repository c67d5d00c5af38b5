//! Poses of a stylus from a tracked sequence.

use std::path::Path;

use sonoweave_core::frames::{Reference, Stylus, Transform};
use sonoweave_core::reading::{Reading, Stamp, transform_name};
use sonoweave_core::refusal::{Reason, Refusal};
use sync::ingest::RIGID_TOLERANCE;
use sync::{PairingOptions, StampedPairing};

use super::super::recorded::each;
use super::options::Recording;
use super::samples::Poses;
use crate::failure::Failure;

/// Reads the stylus's poses from a sequence.
pub(super) fn read(recording: &Recording, path: &Path) -> Result<Poses, Failure> {
    let within = |problem: String| Failure::new(format!("{}: {problem}", path.display()));
    let mut taken = recording.taken()?;
    let mut readings = Vec::new();
    each(path, false, |reading| {
        readings.push(reading);
        Ok(())
    })?;
    let mut names: Vec<(String, String)> = Vec::new();
    for reading in &readings {
        if let Reading::NamedTransform(t) = reading
            && !names.iter().any(|(from, to)| *from == t.from && *to == t.to)
        {
            names.push((t.from.clone(), t.to.clone()));
        }
    }
    let known = |name: &str| names.iter().any(|(from, to)| from == name || to == name);
    if !known(&recording.stylus) {
        let listed: Vec<String> = names.iter().map(|(from, to)| transform_name(from, to)).collect();
        let listed = if listed.is_empty() { "no transform".to_owned() } else { listed.join(", ") };
        return Err(within(format!(
            "holds no frame {}, only {listed}; name the stylus's frame with --stylus",
            recording.stylus
        )));
    }
    let options =
        PairingOptions { image: recording.stylus.clone(), world: recording.reference.clone(), statics: Vec::new() };
    let mut pairing = StampedPairing::with_names(options, &names).map_err(|_| {
        within(format!(
            "no transforms lead from {} to {}; name another frame with --reference",
            recording.stylus,
            match &recording.reference {
                Some(name) => name.as_str(),
                None => "Reference or Tracker",
            }
        ))
    })?;

    let mut first_s = None;
    for reading in readings {
        let stamp = match reading {
            Reading::NamedTransform(transform) => {
                pairing.transform(transform);
                continue;
            }
            Reading::Frame(frame) => frame.stamp,
            _ => continue,
        };
        // Items without times are taken as a second apart.
        let time_s = stamp.source_s.unwrap_or(stamp.item as f64);
        taken.put(time_s - *first_s.get_or_insert(time_s), pose(&mut pairing, &stamp));
    }
    let route = pairing.route().map(|route| (route.world().to_owned(), route.describe()));
    let (frame, route) = route.unwrap_or_default();
    let (poses, counts) = taken.all(path)?;
    Ok(Poses { frame, route, poses, counts })
}

/// Returns the stylus's pose at a stamp.
fn pose(pairing: &mut StampedPairing, stamp: &Stamp) -> Result<Transform<Reference, Stylus>, Refusal> {
    let affine = pairing.pose_of(stamp)?.world_from_image.affine();
    let pose = Transform::<Reference, Stylus>::from_affine(affine);
    let rigid = pose.nearest_rigid(RIGID_TOLERANCE);
    rigid.map(|(rigid, _)| rigid).map_err(|bad| Refusal::new(stamp.item, Reason::PoseNotRigid, bad.to_string()))
}
