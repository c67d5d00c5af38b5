//! Poses of a session's frames by other settings, and their hash.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DAffine3, DVec3};
use serde_json::{Map, json};
use sha2::{Digest as _, Sha256};

use config::Settings;
use config::bedside::devices::PROBE_FRAME;
use config::bedside::{Bedside, SettingsOverride};
use drivers::replay::Pace;
use pipeline::SmoothingStatus;
use pipeline::session::{Paired, RecordedDecisions};
use sonoweave_core::frames::{Image, Transform, World, affine_from_rows};

use crate::app::live::resume::Chain;
use crate::app::live::stages::{Kept, stages};
use crate::app::sha256;
use crate::failure::Failure;

/// Key of the image's pose at the probe.
pub(super) const IMAGE_TO_PROBE: &str = "calibration.image_to_probe";

/// Pixels to world mm by the frame's number: three rows of four.
pub(super) type Poses = BTreeMap<u64, [f64; 12]>;

/// Corrected poses of a session.
pub(super) struct Computed {
    pub(super) poses: Poses,
    /// Width and height of a frame, pixels.
    pub(super) size: [u32; 2],
    pub(super) smoothing: Option<SmoothingStatus>,
}

/// Pairs the frames of a session by its configuration with these settings changed.
///
/// # Errors
/// [`Failure`] if a setting is invalid, or the session cannot be read.
pub(super) fn poses(session: &Path, settings: &SettingsOverride) -> Result<Computed, Failure> {
    let decisions = RecordedDecisions::read(session)?;
    let mut settings = settings.clone();
    let image_to_probe = settings.remove(IMAGE_TO_PROBE);
    let folder = session.parent().unwrap_or(Path::new("."));
    let bedside = Kept::bedside(session, &decisions)?;
    let mut bedside = bedside.tried(&settings, folder).map_err(Failure::configuration)?;
    if let Some(rows) = image_to_probe {
        place_image(&mut bedside, &serde_json::from_value(rows)?)?;
    }
    // By itself, the session begins with the latencies of its beginning.
    let is_other = settings.keys().any(|key| key.ends_with(".latency_ms"));
    let chain = Chain::of(session, decisions);
    let mut recorded = chain.recorded(is_other.then_some(&bedside), Pace::Unpaced)?;
    let Some(recorded) = recorded.pop() else { unreachable!("the chain is this session") };
    let Paired { frames, size, smoothing } = stages(&bedside, None)?.pair(recorded)?;
    let poses: Poses = frames.iter().filter_map(|(frame, found)| Some((*frame, rows(&found.ok()?.1)))).collect();
    let Some(size) = size else { fail!("{}: no frame has a pose; record another session", session.display()) };
    Ok(Computed { poses, size, smoothing })
}

/// Replaces the image's pose at the probe. All else of the calibration file stays.
fn place_image(bedside: &mut Bedside, rows: &[f64; 16]) -> Result<(), Failure> {
    let Settings { image_frame, transforms, .. } = &mut bedside.calibration;
    let image = image_frame.as_deref().unwrap_or("Image");
    let found = transforms.iter_mut().find(|found| found.from == image && found.to == PROBE_FRAME);
    let Some(found) = found else {
        fail!("no correction: the calibration has no {image}ToProbe; give a session that was recorded with one")
    };
    found.affine = affine_from_rows(rows).map_err(|why| Failure::new(format!("ImageToProbe {why}")))?;
    Ok(())
}

/// Returns the hash of poses.
pub(super) fn hash(poses: &Poses) -> String {
    let mut hasher = Sha256::new();
    for (frame, rows) in poses {
        hasher.update(frame.to_le_bytes());
        rows.iter().for_each(|number| hasher.update(number.to_bits().to_le_bytes()));
    }
    sha256::text(hasher)
}

/// Returns a pose's rows without the last, which is (0, 0, 0, 1).
fn rows(pose: &Transform<World, Image>) -> [f64; 12] {
    std::array::from_fn(|at| pose.to_rows()[at])
}

/// Returns a map's rows without the last.
pub(super) fn rows_of(world_from_image: DAffine3) -> [f64; 12] {
    rows(&Transform::from_affine(world_from_image))
}

/// Returns the transform of three rows.
///
/// # Errors
/// [`Failure`] if it cannot be inverted, or is not finite.
pub(super) fn transform(frame: u64, rows: &[f64; 12]) -> Result<Transform<World, Image>, Failure> {
    let all = std::array::from_fn(|at| rows.get(at).copied().unwrap_or(if at == 15 { 1.0 } else { 0.0 }));
    Transform::from_rows(&all).map_err(|why| Failure::new(format!("frame {frame}: its corrected pose {why}")))
}

impl Computed {
    /// Returns the numbers by which a correction is judged: frames with a pose before and after
    /// it, and the distance by which the corners of the images moved.
    pub(super) fn moved(&self, before: &Poses) -> Result<Map<String, serde_json::Value>, Failure> {
        let [right, bottom] = self.size.map(|pixels| f64::from(pixels) - 1.0);
        let corners = [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]];
        let (mut squares, mut most, mut count) = (0.0, 0.0_f64, 0.0);
        for (frame, rows) in &self.poses {
            let Some(before) = before.get(frame) else { continue };
            let [before, after] = [transform(*frame, before)?, transform(*frame, rows)?];
            let distance = |[u, v]: [f64; 2]| {
                let pixel = DVec3::new(u, v, 0.0);
                after.point(pixel).distance(before.point(pixel))
            };
            let moved = corners.map(distance).into_iter().fold(0.0, f64::max);
            squares += moved * moved;
            most = most.max(moved);
            count += 1.0;
        }
        let evidence = json!({
            "frames_before": before.len(),
            "frames": self.poses.len(),
            "moved_rms_mm": (squares / f64::max(count, 1.0)).sqrt(),
            "moved_most_mm": most,
        });
        Ok(evidence.as_object().cloned().unwrap_or_default())
    }
}
