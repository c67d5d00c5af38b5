//! Calibrates a probe from observed images of a target, or gives the reason for a refusal.

use glam::{DAffine3, DMat3, DVec2};

use super::detection::{Detection, Seen};
use super::refine::{Refined, refine};
use super::{Place, Target, motion, planes, points, validation};
use crate::error::{CalibrationError, ProbeError, Units};
use crate::least_squares::Direction;
use crate::probe::calibrate::{LEAST_PICTURES, Outcome, lattice, moved};
use crate::probe::errors::Errors;
use crate::probe::recording::{Observation, Recording};
use crate::probe::track::Track;

/// Range of ultrasound pixel sizes, mm: from high-frequency probes to whole abdomens.
const PIXELS_MM: [f64; 2] = [0.01, 2.0];
/// Minimum share of the images showing something that must agree. With insufficient motion a
/// wrong plane can match half of them and reject the rest.
const AGREEING: f64 = 0.65;
/// Limit of a corner's standard deviation, mm; beyond it the result is useless.
const UNSURE_MM: f64 = 3.0;

/// The role of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Number of the frame.
    pub frame: usize,
    /// Its outcome.
    pub outcome: Outcome,
    /// Observed position of the target, pixels: a dot, or two points of a line.
    pub seen_px: Vec<DVec2>,
    /// Positions by the calibration, pixels: the target's own place, or the nearest point of a
    /// plane's line; empty without a pose.
    pub expected_px: Vec<DVec2>,
    /// Distance of each from the target, mm; empty without a pose.
    pub off_mm: Vec<f64>,
}

/// A probe's calibration.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// The plane, the target, the lag, and their covariance.
    pub refined: Refined,
    /// Pixels along u and v of the images that it is valid for.
    pub size_px: [u32; 2],
    /// Outcome of each image.
    pub pictures: Vec<Picture>,
    /// Distances of the observed points from the target, at the fitted lag.
    pub errors: Errors,
    /// The same for images that the calibration did not use.
    pub validation: Option<Errors>,
    /// Whether the validation images are of the same recording, with a calibration from its
    /// first two thirds.
    pub split: bool,
}

/// Calibrates a probe.
///
/// # Errors
/// [`ProbeError`] gives the reason and advice.
pub fn calibrate(
    target: Target,
    recording: Recording<'_, Seen>,
    validation: Option<Recording<'_, Seen>>,
) -> Result<Calibration, CalibrationError> {
    let (mut detections, track) = observed(target, recording)?;
    let refined = fit(target, &mut detections, &track, recording)?;
    let (mut validated, mut split) = (None, false);
    if let Some(validation) = validation {
        let (mut detections, track) = observed(target, validation)?;
        let known = matches!(target, Target::Tip { .. }).then_some(refined.place);
        validated = validation::errors(&refined, &mut detections, &track, known);
    } else if let Some((first, rest)) = detections.split_at_checked(2 * detections.len() / 3)
        && let (mut first, mut rest) = (first.to_vec(), rest.to_vec())
        && let Ok(of_first) = fit(target, &mut first, &track, recording)
    {
        // Neighbouring images are alike, so a contiguous stretch is held out and not every
        // third image.
        split = true;
        validated = validation::errors(&of_first, &mut rest, &track, Some(of_first.place));
    }
    let pictures = pictures(recording, &detections, &track, &refined);
    let used = |picture: &&Picture| picture.outcome == Outcome::Used;
    let errors = Errors::of(pictures.iter().filter(used).map(|picture| (picture.frame, picture.off_mm.clone())))
        .ok_or(ProbeError::Disagree { agreeing: 0, pictures: detections.len() })?;
    Ok(Calibration { refined, size_px: recording.size_px, pictures, errors, validation: validated, split })
}

/// Returns the images that show the target and have poses, if the probe moved.
fn observed(target: Target, recording: Recording<'_, Seen>) -> Result<(Vec<Detection>, Track), ProbeError> {
    let pictures = recording.observations.len();
    if recording.observations.iter().all(|observation| observation.poses.is_none()) {
        return Err(ProbeError::NoPoses { pictures });
    }
    let is_plane = target == Target::Plane;
    let detections = recording.detections(is_plane);
    if detections.len() < LEAST_PICTURES {
        return Err(ProbeError::Unseen { line: is_plane, seen: detections.len(), pictures, least: LEAST_PICTURES });
    }
    let track = recording.poses();
    let maps: Vec<DAffine3> =
        detections.iter().filter_map(|detection| detection.reference_from_probe(&track, 0.0)).collect();
    moved(&maps)?;
    Ok((detections, track))
}

/// Fits the plane and the target to the detections, each of which selects its spot of the target.
fn fit(
    target: Target,
    detections: &mut [Detection],
    track: &Track,
    recording: Recording<'_, Seen>,
) -> Result<Refined, ProbeError> {
    let Recording { size_px, timed, .. } = recording;
    let map = |detection: &Detection| detection.reference_from_probe(track, 0.0);
    let turns: Vec<DMat3> = detections.iter().filter_map(map).map(|map| map.matrix3).collect();
    let refined = if target == Target::Plane {
        motion::turned_over_plane(&turns, detections)?;
        let refined = planes::find(detections, track, size_px, timed).ok_or(ProbeError::Open)??;
        if let Place::Plane { normal, .. } = refined.place {
            motion::saw_plane(&turns, &refined.plane, normal)?;
        }
        refined
    } else {
        let initial = points::start(target, detections, track, size_px, timed).ok_or(ProbeError::Open)?;
        motion::spread(detections, &initial.agrees, size_px)?;
        if target == Target::Point {
            motion::turned_about_point(&turns, &initial.plane)?;
        }
        refine(target, detections, track, initial, timed)?
    };
    let agreeing = refined.used.iter().filter(|used| **used).count();
    if agreeing < LEAST_PICTURES || (agreeing as f64) < AGREEING * detections.len() as f64 {
        return Err(ProbeError::Disagree { agreeing, pictures: detections.len() });
    }
    let pixel_mm = refined.plane.pixel_mm();
    let possible = |factor: f64| pixel_mm.iter().all(|mm| (PIXELS_MM[0]..=PIXELS_MM[1]).contains(&(mm * factor)));
    if !possible(1.0) {
        let units = Units::ALL.into_iter().find(|units| possible(units.factor()));
        return Err(ProbeError::PixelSize { pixel_mm, units });
    }
    let [u, v] = size_px.map(|n| f64::from(n) - 1.0);
    let corners = [[0.0, 0.0], [u, 0.0], [0.0, v], [u, v]].map(DVec2::from_array);
    let mm = corners.map(|px| refined.predicted_mm(px)).into_iter().fold(0.0, f64::max);
    if mm.is_nan() || mm > UNSURE_MM {
        let weakest = refined.solution().directions().first().map_or(String::new(), Direction::leading);
        return Err(ProbeError::Unsure { mm, weakest });
    }
    Ok(refined)
}

/// Returns the outcomes of all images.
fn pictures(
    recording: Recording<'_, Seen>,
    detections: &[Detection],
    track: &Track,
    refined: &Refined,
) -> Vec<Picture> {
    let mut of_detections = detections.iter().zip(&refined.used).peekable();
    let picture = |observation: &Observation<Seen>| {
        let frame = observation.frame;
        let Some((detection, used)) = of_detections.next_if(|(detection, _)| detection.frame == frame) else {
            let posed = observation.poses.is_some() || observation.seen == Seen::Nothing;
            let outcome = if posed { Outcome::Unseen } else { Outcome::NoPose };
            return Picture { frame, outcome, seen_px: Vec::new(), expected_px: Vec::new(), off_mm: Vec::new() };
        };
        let seen_px = detection.marks.clone();
        let Some(map) = detection.reference_from_probe(track, refined.lag_s) else {
            let (expected_px, off_mm) = (Vec::new(), Vec::new());
            return Picture { frame, outcome: Outcome::NoPoseAtLag, seen_px, expected_px, off_mm };
        };
        let off = |px: &DVec2| refined.place.off_mm(map.transform_point3(refined.plane.point(*px)));
        let off_mm = detection.marks.iter().map(off).collect();
        let seen_by = refined.plane.seen_by(&map);
        let expected_px = detection.marks.iter().map(|px| refined.place.in_picture(&seen_by, *px)).collect();
        let outcome = if *used { Outcome::Used } else { Outcome::Contradicted };
        Picture { frame, outcome, seen_px, expected_px, off_mm }
    };
    recording.observations.iter().map(picture).collect()
}

impl Calibration {
    /// Returns the number of images used.
    pub fn used(&self) -> usize {
        self.pictures.iter().filter(|picture| picture.outcome == Outcome::Used).count()
    }

    /// Returns the predicted error of a pixel's position (one standard deviation, mm) on a
    /// lattice over the image: rows of `count` numbers, from its first pixels to its last.
    pub fn predicted_mm(&self, count: usize) -> Vec<Vec<f64>> {
        lattice(self.size_px, count, |px| self.refined.predicted_mm(px))
    }

    /// Returns the target's position in the reference's frame.
    pub fn place(&self) -> Place {
        self.refined.place
    }
}

#[cfg(test)]
mod tests;
