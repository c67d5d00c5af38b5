//! Calibrates a probe from observed images, or gives the reason for a refusal.

use glam::{DAffine3, DVec2};

use sonoweave_core::frames::{Phantom, Reference, Transform};

use super::errors::{Errors, Evidence};
use super::layout::Layout;
use super::linear::{Start, start};
use super::matching::{Match, Matcher, Reading};
use super::plane::ImagePlane;
use super::recording::{Observation, Recording};
use super::refine::{OptionalUnknowns, Refined, refine};
use super::reread::reread;
use super::sighting::Sighting;
use super::track::Track;
use crate::error::{CalibrationError, ProbeError, Units};
use crate::phantom::file::Registration;

/// Minimum number of images with recognised dots and poses. PLUS requires as many.
pub const LEAST_PICTURES: usize = 10;
/// The probe must move by this much, mm, …
const LEAST_WAY_MM: f64 = 2.0;
/// … or turn by this much, rad.
const LEAST_TURN_RAD: f64 = 0.02;
/// Limit of the dots' median distance from their wires along a direction, mm: several times any
/// tracker's scatter. Beyond it poses, registration and phantom do not match.
const WORST_SPREAD_MM: f64 = 2.0;
/// Other units are named if they explain the dots better by this factor.
const CLEARLY: f64 = 3.0;
/// Minimum share of the brightest dots, as many as there are wires, that match the phantom in
/// the median image. Dots of other phantoms match in part.
const EXPLAINED: f64 = 0.7;

/// Outcome of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The calibration used it.
    Used,
    /// The tracker reported a pose as invalid.
    NoPose,
    /// The target is not visible: too few dots match the phantom's wires.
    Unseen,
    /// There is no pose at the image's time plus the lag.
    NoPoseAtLag,
    /// The other images contradict it.
    Contradicted,
}

/// The role of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Number of the frame.
    pub frame: usize,
    /// Its outcome.
    pub outcome: Outcome,
    /// Its dots, and the calculated positions of their wires; empty unless it was used.
    pub dots: Vec<Explained>,
}

/// A dot and its wire.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Explained {
    /// Index of the phantom's wire.
    pub wire: usize,
    /// Observed position, pixels.
    pub seen_px: DVec2,
    /// Calculated position of the wire, pixels.
    pub expected_px: DVec2,
    /// Distance of the dot from the wire's line, mm.
    pub off_mm: f64,
    /// Whether the fit used it; otherwise the image's other dots contradict it.
    pub used: bool,
}

/// A probe's calibration.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// The plane, the registration, the lag, and their covariance.
    pub refined: Refined,
    /// The start of the fit.
    pub start: ImagePlane,
    /// Pixels along u and v of the images that it is valid for.
    pub size_px: [u32; 2],
    /// Outcome of each image.
    pub pictures: Vec<Picture>,
    /// Errors of middle wires (PLUS's definition) and of all wires, at the fitted lag and
    /// registration.
    pub errors: [Errors; 2],
    /// The same for images that the calibration did not use.
    pub validation: Option<[Errors; 2]>,
    /// Errors of middle wires of those images, with poses at the images' own times and the
    /// given registration.
    pub validation_as_given: Option<Errors>,
    /// Whether the validation images are of the same recording, with a calibration from its
    /// first two thirds.
    pub split: bool,
}

/// Calibrates a probe.
///
/// # Errors
/// [`ProbeError`] gives the reason and advice.
pub fn calibrate(
    layout: &Layout,
    registration: &Registration,
    recording: Recording<'_>,
    validation: Option<Recording<'_>>,
) -> Result<Calibration, CalibrationError> {
    let (sightings, track) = sight(layout, registration, recording, Side::Right)?;
    let (first, initial) = fit(layout, registration, &sightings, &track, recording).map_err(|refused| {
        // For a single row of dots only the poses tell the side from which it is seen.
        let other = || sight(layout, registration, recording, Side::Left);
        let fits = |(sightings, track): (Vec<Sighting>, Track)| {
            fit(layout, registration, &sightings, &track, recording).ok().map(|_| sightings.len())
        };
        let mirrored = if layout.is_flat() { other().ok().and_then(fits) } else { None };
        mirrored.map_or(refused, |pictures| ProbeError::Mirrored { pictures })
    })?;
    let (sightings, misread) = reread(layout, &first, &track, recording.observations, &sightings);
    let (refined, initial) =
        if misread > 0 { fit(layout, registration, &sightings, &track, recording)? } else { (first, initial) };
    let evidence = |refined: &Refined| Evidence {
        layout,
        sightings: &[],
        track: &track,
        lag_s: refined.lag_s,
        reference_from_phantom: refined.registration.reference_from_phantom,
    };
    let own = evidence(&refined);
    let used: Vec<Sighting> = part(&sightings, &refined);
    let errors =
        both(Evidence { sightings: &used, ..own }, &refined.plane).ok_or(ProbeError::TooFew { pictures: 0 })?;

    let (mut validated, mut as_given, mut split) = (None, None, false);
    if let Some(validation) = validation {
        let (sightings, track) = sight(layout, registration, validation, Side::Right)?;
        let (sightings, _) = reread(layout, &refined, &track, validation.observations, &sightings);
        let evidence = Evidence { sightings: &sightings, track: &track, ..own };
        validated = both(evidence, &refined.plane);
        let given = Evidence { lag_s: 0.0, reference_from_phantom: registration.reference_from_phantom, ..evidence };
        as_given = given.of_middle_wires(&refined.plane);
    } else if let Some((first, rest)) = sightings.split_at_checked(2 * sightings.len() / 3)
        && first.len() >= LEAST_PICTURES
        && let Ok((of_first, _)) = fit(layout, registration, first, &track, recording)
    {
        // Neighbouring images are alike, so a contiguous stretch is held out and not every
        // third image.
        split = true;
        let evidence = Evidence { sightings: rest, ..evidence(&of_first) };
        validated = both(evidence, &of_first.plane);
        let given = Evidence { lag_s: 0.0, reference_from_phantom: registration.reference_from_phantom, ..evidence };
        as_given = given.of_middle_wires(&of_first.plane);
    }
    let pictures = pictures(layout, recording, &sightings, &track, &refined);
    Ok(Calibration {
        refined,
        start: initial.plane,
        size_px: recording.size_px,
        pictures,
        errors,
        validation: validated,
        validation_as_given: as_given,
        split,
    })
}

fn both(evidence: Evidence<'_>, plane: &ImagePlane) -> Option<[Errors; 2]> {
    Some([evidence.of_middle_wires(plane)?, evidence.of_wires(plane)?])
}

/// Returns the sightings' dots that the fit used.
fn part(sightings: &[Sighting], refined: &Refined) -> Vec<Sighting> {
    let kept = |(sighting, used): (&Sighting, &Vec<bool>)| {
        let marks = sighting.marks.iter().zip(used).filter_map(|(mark, used)| used.then_some(*mark)).collect();
        Sighting { marks, ..sighting.clone() }
    };
    sightings.iter().zip(&refined.used).map(kept).collect()
}

/// The side from which the phantom is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    /// The same as in its file.
    Right,
    /// Mirrored.
    Left,
}

/// Returns the images with recognised dots and known poses, all from one side.
fn sight(
    layout: &Layout,
    registration: &Registration,
    recording: Recording<'_>,
    side: Side,
) -> Result<(Vec<Sighting>, Track), ProbeError> {
    let observations = recording.observations;
    let total = observations.len();
    let posed = observations.iter().filter(|observation| observation.poses.is_some()).count();
    if posed == 0 {
        return Err(ProbeError::NoPoses { pictures: total });
    }
    let read = observations.iter().filter_map(|observation| observation.seen.reading.as_ref());
    let (mut right, mut left) = (0_usize, 0_usize);
    for reading in read.filter(|reading| reading.mirrored.is_none()) {
        *(if reading.best.rightwards { &mut right } else { &mut left }) += 1;
    }
    let wires = layout.searched_wires();
    let share = |observation: &Observation| {
        let of = observation.seen.dots.len().min(wires) as f64;
        Some(observation.seen.reading.as_ref()?.best.marks.len() as f64 / of)
    };
    let mut shares: Vec<f64> = observations.iter().filter_map(share).collect();
    shares.sort_by(f64::total_cmp);
    if shares.get(shares.len() / 2).is_none_or(|median| *median < EXPLAINED) {
        return Err(unread(layout, recording));
    }
    if left > right {
        return Err(ProbeError::Mirrored { pictures: left });
    }
    let from_that_side = |reading: &Reading| -> Option<Match> {
        [Some(&reading.best), reading.mirrored.as_ref()]
            .into_iter()
            .flatten()
            .find(|reading| reading.rightwards == (side == Side::Right))
            .cloned()
    };
    let sighting = |observation: &Observation| {
        observation.poses?;
        let marks = from_that_side(observation.seen.reading.as_ref()?)?.marks;
        Some(Sighting { frame: observation.frame, time_s: observation.time_s, marks })
    };
    let sightings: Vec<Sighting> = observations.iter().filter_map(sighting).collect();
    if sightings.is_empty() {
        return Err(unread(layout, recording));
    }
    if sightings.len() < LEAST_PICTURES {
        return Err(ProbeError::TooFew { pictures: sightings.len() });
    }
    let track = recording.poses();
    let map = |s: &Sighting| s.probe_from_phantom(&track, 0.0, &registration.reference_from_phantom);
    moved(&sightings.iter().filter_map(map).map(|map| map.affine()).collect::<Vec<_>>())?;
    Ok((sightings, track))
}

/// Checks that the probe moved, from maps between its frame and a static one.
pub(super) fn moved(maps: &[DAffine3]) -> Result<(), ProbeError> {
    let Some(first) = maps.first() else { return Ok(()) };
    let (mut way, mut turn) = (0.0_f64, 0.0_f64);
    for map in maps {
        way = way.max(map.translation.distance(first.translation));
        let between = glam::DQuat::from_mat3(&(map.matrix3 * first.matrix3.transpose()));
        turn = turn.max(between.to_scaled_axis().length());
    }
    if way < LEAST_WAY_MM && turn < LEAST_TURN_RAD {
        return Err(ProbeError::Still { way_mm: way, turn_deg: turn.to_degrees() });
    }
    Ok(())
}

/// Returns the reason why no image's dots match the phantom.
fn unread(layout: &Layout, recording: Recording<'_>) -> ProbeError {
    let Recording { observations, size_px, .. } = recording;
    let pictures = observations.len();
    let mut counts: Vec<usize> = observations.iter().map(|observation| observation.seen.dots.len()).collect();
    counts.sort_unstable();
    let median = counts.get(pictures / 2).copied().unwrap_or(0);
    if median < layout.least_dots() {
        return ProbeError::NoWires { pictures, dots: median, least: layout.least_dots() };
    }
    // Tries the same pattern in other units.
    let mut matcher = Matcher::new();
    for units in Units::ALL {
        let Some(scaled) = layout.scaled(units.factor()) else { continue };
        let some = observations.iter().step_by(pictures.div_ceil(8).max(1));
        if some.filter(|observation| matcher.read(&observation.seen.dots, size_px, &scaled).is_some()).count() >= 2 {
            return ProbeError::PhantomUnits { units };
        }
    }
    ProbeError::OtherPhantom { pictures, dots: median, phantom: layout.geometry().name().to_owned() }
}

/// Fits the plane to the sightings.
fn fit(
    layout: &Layout,
    registration: &Registration,
    sightings: &[Sighting],
    track: &Track,
    recording: Recording<'_>,
) -> Result<(Refined, Start), ProbeError> {
    let begin = |track: &Track, reference_from_phantom: &Transform<Reference, Phantom>| {
        start(layout, sightings, |s| s.probe_from_phantom(track, 0.0, reference_from_phantom), recording.size_px)
    };
    let given = &registration.reference_from_phantom;
    let initial = begin(track, given).ok_or(ProbeError::Open)?;
    if initial.spread_mm > WORST_SPREAD_MM {
        let better = |spread: f64| spread < WORST_SPREAD_MM && spread * CLEARLY < initial.spread_mm;
        for units in Units::ALL {
            let poses = track.scaled(units.factor());
            if begin(&poses, given).is_some_and(|start| better(start.spread_mm)) {
                return Err(ProbeError::PoseUnits { units });
            }
            let mut affine = given.affine();
            affine.translation *= units.factor();
            if begin(track, &Transform::from_affine(affine)).is_some_and(|start| better(start.spread_mm)) {
                return Err(ProbeError::RegistrationUnits { units });
            }
        }
        return Err(ProbeError::Contradictory { mm: initial.spread_mm });
    }
    let optional = OptionalUnknowns { skew: false, registration: true, lag: recording.timed };
    let refined = refine(layout, sightings, track, registration, &initial, optional)?;
    let used = refined.pictures.iter().filter(|(_, components)| *components > 0).count();
    if used < LEAST_PICTURES {
        return Err(ProbeError::TooFew { pictures: used });
    }
    Ok((refined, initial))
}

/// Returns the outcomes of all images.
fn pictures(
    layout: &Layout,
    recording: Recording<'_>,
    sightings: &[Sighting],
    track: &Track,
    refined: &Refined,
) -> Vec<Picture> {
    let wires = layout.geometry().wires();
    let picture = |observation: &Observation| {
        let frame = observation.frame;
        let Some(number) = sightings.iter().position(|sighting| sighting.frame == frame) else {
            let outcome = if observation.poses.is_none() { Outcome::NoPose } else { Outcome::Unseen };
            return Picture { frame, outcome, dots: Vec::new() };
        };
        let sighting = &sightings[number];
        let map = sighting.probe_from_phantom(track, refined.lag_s, &refined.registration.reference_from_phantom);
        let Some(map) = map else { return Picture { frame, outcome: Outcome::NoPoseAtLag, dots: Vec::new() } };
        let used = &refined.used[number];
        if !used.iter().any(|used| *used) {
            return Picture { frame, outcome: Outcome::Contradicted, dots: Vec::new() };
        }
        let plane = refined.plane.seen_by(&map.inverse().affine());
        let dots = sighting.marks.iter().zip(used).filter_map(|(mark, used)| {
            let (expected_px, _) = plane.cut(&wires[mark.wire])?;
            let (off_mm, _) = wires[mark.wire].nearest(plane.point(mark.at_px));
            Some(Explained { wire: mark.wire, seen_px: mark.at_px, expected_px, off_mm, used: *used })
        });
        Picture { frame, outcome: Outcome::Used, dots: dots.collect() }
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
}

/// Evaluates a function of pixels on a lattice over an image: rows of `count`, from its first
/// pixels to its last.
pub(super) fn lattice(size_px: [u32; 2], count: usize, of: impl Fn(DVec2) -> f64) -> Vec<Vec<f64>> {
    let last = size_px.map(|n| f64::from(n) - 1.0);
    let at = |i: usize, axis: usize| last[axis] * i as f64 / (count.max(2) - 1) as f64;
    (0..count).map(|v| (0..count).map(|u| of(DVec2::new(at(u, 0), at(v, 1)))).collect()).collect()
}

#[cfg(test)]
mod tests;
