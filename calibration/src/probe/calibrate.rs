//! From observed pictures to a calibration, or to the reason why there is none.

use glam::{DAffine3, DVec2};

use super::dots::Dot;
use super::errors::{Errors, Evidence};
use super::layout::Layout;
use super::linear::{Start, start};
use super::matching::{Match, Matcher, Reading};
use super::plane::ImagePlane;
use super::refine::{Refined, Sought, refine};
use super::refused::{Refused, Units};
use super::reread::reread;
use super::sighting::Sighting;
use super::track::{Poses, Track};
use crate::frames::{Phantom, Reference, Transform};
use crate::phantom::file::Registration;

/// Pictures with recognised dots and poses at least. PLUS asks for as many.
pub const LEAST_PICTURES: usize = 10;
/// The probe has to move by this much at least, mm, …
const LEAST_WAY_MM: f64 = 2.0;
/// … or to turn by this much, rad.
const LEAST_TURN_RAD: f64 = 0.02;
/// Median distance of dots from their wires, along a direction, beyond which poses, registration and phantom do not belong together, mm: several times what any tracker scatters.
const WORST_SPREAD_MM: f64 = 2.0;
/// Other units have to explain the dots better by this factor to be named.
const CLEARLY: f64 = 3.0;
/// Part of the brightest dots, as many as there are wires, that is the phantom's in the median picture at least: of other phantoms' dots some lie alike.
const EXPLAINED: f64 = 0.7;

/// A picture and its poses, as observed.
#[derive(Debug, Clone)]
pub struct Observation {
    /// Which picture.
    pub frame: usize,
    /// When, s, by the clock of the poses.
    pub time_s: f64,
    /// Spots in it.
    pub dots: Vec<Dot>,
    /// What they are.
    pub reading: Option<Reading>,
    /// Where the sensors were at that time; `None` where the tracker did not vouch for them.
    pub poses: Option<Poses>,
}

/// What a recording's pictures are.
#[derive(Debug, Clone, Copy)]
pub struct Recording<'a> {
    /// In the order in which they were taken.
    pub observations: &'a [Observation],
    /// Where the sensors were at all times, by the tracker's own samples; `None` where no more is known than the pictures' poses.
    pub track: Option<&'a Track>,
    /// Pixels along u and v.
    pub size_px: [u32; 2],
    /// Whether its times are times, not numbers that stand for them.
    pub timed: bool,
}

/// What became of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// It has a part in the calibration.
    Used,
    /// The tracker did not vouch for a pose.
    NoPose,
    /// What was scanned is not seen in it: of a phantom, too few dots lie as its wires do.
    Unseen,
    /// There is no pose at the time of the picture and the lag after it.
    NoPoseAtLag,
    /// The other pictures contradict it.
    Contradicted,
}

/// A picture's part.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Which.
    pub frame: usize,
    /// What became of it.
    pub outcome: Outcome,
    /// Its dots, and where the calibration has their wires; empty unless it was used.
    pub dots: Vec<Explained>,
}

/// A dot and its wire.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Explained {
    /// Among the phantom's wires.
    pub wire: usize,
    /// Where it was seen, pixels.
    pub seen_px: DVec2,
    /// Where the calibration has the wire, pixels.
    pub expected_px: DVec2,
    /// How far the dot's place is from the wire's line, mm.
    pub off_mm: f64,
    /// Whether it had a part; if not, the picture's other dots contradict it.
    pub used: bool,
}

/// A probe's calibration.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// The plane, the registration, the lag, and how sure they are.
    pub refined: Refined,
    /// Where it began.
    pub start: ImagePlane,
    /// Pixels along u and v of the pictures that it holds for.
    pub size_px: [u32; 2],
    /// What became of each picture.
    pub pictures: Vec<Picture>,
    /// Errors of middle wires (PLUS's definition) and of all wires, at the lag and with the registration that were found.
    pub errors: [Errors; 2],
    /// The same, of pictures that had no part in the calibration.
    pub validation: Option<[Errors; 2]>,
    /// Errors of middle wires of those pictures, with poses of the pictures' own times and the registration as given.
    pub validation_as_given: Option<Errors>,
    /// Whether the validation's pictures are of the same recording: of a calibration from its first two thirds.
    pub split: bool,
}

/// Calibrates.
///
/// # Errors
/// [`Refused`] says why there is no calibration, and what to do.
pub fn calibrate(
    layout: &Layout,
    registration: &Registration,
    recording: Recording<'_>,
    validation: Option<Recording<'_>>,
) -> Result<Calibration, Refused> {
    let (sightings, track) = sight(layout, registration, recording, Side::Right)?;
    let (first, begun) = fit(layout, registration, &sightings, &track, recording).map_err(|refused| {
        // Of a row of dots only the poses tell from which side it is seen.
        let other = || sight(layout, registration, recording, Side::Left);
        let fits = |(sightings, track): (Vec<Sighting>, Track)| {
            fit(layout, registration, &sightings, &track, recording).ok().map(|_| sightings.len())
        };
        let mirrored = if layout.is_flat() { other().ok().and_then(fits) } else { None };
        mirrored.map_or(refused, |pictures| Refused::Mirrored { pictures })
    })?;
    let (sightings, misread) = reread(layout, &first, &track, recording.observations, &sightings);
    let (refined, begun) =
        if misread > 0 { fit(layout, registration, &sightings, &track, recording)? } else { (first, begun) };
    let evidence = |refined: &Refined| Evidence {
        layout,
        sightings: &[],
        track: &track,
        lag_s: refined.lag_s,
        reference_from_phantom: refined.registration.reference_from_phantom,
    };
    let own = evidence(&refined);
    let used: Vec<Sighting> = part(&sightings, &refined);
    let errors = both(Evidence { sightings: &used, ..own }, &refined.plane).ok_or(Refused::TooFew { pictures: 0 })?;

    let (mut held, mut as_given, mut split) = (None, None, false);
    if let Some(validation) = validation {
        let (sightings, track) = sight(layout, registration, validation, Side::Right)?;
        let (sightings, _) = reread(layout, &refined, &track, validation.observations, &sightings);
        let evidence = Evidence { sightings: &sightings, track: &track, ..own };
        held = both(evidence, &refined.plane);
        let given = Evidence { lag_s: 0.0, reference_from_phantom: registration.reference_from_phantom, ..evidence };
        as_given = given.of_middle_wires(&refined.plane);
    } else if let Some((first, rest)) = sightings.split_at_checked(2 * sightings.len() / 3)
        && first.len() >= LEAST_PICTURES
        && let Ok((of_first, _)) = fit(layout, registration, first, &track, recording)
    {
        // Neighbouring pictures are alike: what is held back is a stretch, not every third.
        split = true;
        let evidence = Evidence { sightings: rest, ..evidence(&of_first) };
        held = both(evidence, &of_first.plane);
        let given = Evidence { lag_s: 0.0, reference_from_phantom: registration.reference_from_phantom, ..evidence };
        as_given = given.of_middle_wires(&of_first.plane);
    }
    let pictures = pictures(layout, recording, &sightings, &track, &refined);
    Ok(Calibration {
        refined,
        start: begun.plane,
        size_px: recording.size_px,
        pictures,
        errors,
        validation: held,
        validation_as_given: as_given,
        split,
    })
}

fn both(evidence: Evidence<'_>, plane: &ImagePlane) -> Option<[Errors; 2]> {
    Some([evidence.of_middle_wires(plane)?, evidence.of_wires(plane)?])
}

/// The sightings' dots that had a part.
fn part(sightings: &[Sighting], refined: &Refined) -> Vec<Sighting> {
    let kept = |(sighting, used): (&Sighting, &Vec<bool>)| {
        let marks = sighting.marks.iter().zip(used).filter_map(|(mark, used)| used.then_some(*mark)).collect();
        Sighting { marks, ..sighting.clone() }
    };
    sightings.iter().zip(&refined.used).map(kept).collect()
}

/// From which side the phantom is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    /// As its file has it.
    Right,
    /// Mirrored.
    Left,
}

/// The pictures whose dots are recognised and whose poses are known, all from one side.
fn sight(
    layout: &Layout,
    registration: &Registration,
    recording: Recording<'_>,
    side: Side,
) -> Result<(Vec<Sighting>, Track), Refused> {
    let Recording { observations, track, .. } = recording;
    let total = observations.len();
    let posed = observations.iter().filter(|observation| observation.poses.is_some()).count();
    if posed == 0 {
        return Err(Refused::NoPoses { pictures: total });
    }
    let read = observations.iter().filter_map(|observation| observation.reading.as_ref());
    let (mut right, mut left) = (0_usize, 0_usize);
    for reading in read.filter(|reading| reading.mirrored.is_none()) {
        *(if reading.best.rightwards { &mut right } else { &mut left }) += 1;
    }
    let wires = layout.looked_for();
    let share = |observation: &Observation| {
        let of = observation.dots.len().min(wires) as f64;
        Some(observation.reading.as_ref()?.best.marks.len() as f64 / of)
    };
    let mut shares: Vec<f64> = observations.iter().filter_map(share).collect();
    shares.sort_by(f64::total_cmp);
    if shares.get(shares.len() / 2).is_none_or(|median| *median < EXPLAINED) {
        return Err(unread(layout, recording));
    }
    if left > right {
        return Err(Refused::Mirrored { pictures: left });
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
        let marks = from_that_side(observation.reading.as_ref()?)?.marks;
        Some(Sighting { frame: observation.frame, time_s: observation.time_s, marks })
    };
    let sightings: Vec<Sighting> = observations.iter().filter_map(sighting).collect();
    if sightings.is_empty() {
        return Err(unread(layout, recording));
    }
    if sightings.len() < LEAST_PICTURES {
        return Err(Refused::TooFew { pictures: sightings.len() });
    }
    let own = || Track::new(observations.iter().filter_map(|observation| observation.poses).collect());
    let track = track.cloned().unwrap_or_else(own);
    let map = |s: &Sighting| s.probe_from_phantom(&track, 0.0, &registration.reference_from_phantom);
    moved(&sightings.iter().filter_map(map).map(|map| map.affine()).collect::<Vec<_>>())?;
    Ok((sightings, track))
}

/// Whether the probe moved: maps between its frame and one that rests.
pub(super) fn moved(maps: &[DAffine3]) -> Result<(), Refused> {
    let Some(first) = maps.first() else { return Ok(()) };
    let (mut way, mut turn) = (0.0_f64, 0.0_f64);
    for map in maps {
        way = way.max(map.translation.distance(first.translation));
        let between = glam::DQuat::from_mat3(&(map.matrix3 * first.matrix3.transpose()));
        turn = turn.max(between.to_scaled_axis().length());
    }
    if way < LEAST_WAY_MM && turn < LEAST_TURN_RAD {
        return Err(Refused::Still { way_mm: way, turn_deg: turn.to_degrees() });
    }
    Ok(())
}

/// Why no picture's dots are the phantom's.
fn unread(layout: &Layout, recording: Recording<'_>) -> Refused {
    let Recording { observations, size_px, .. } = recording;
    let pictures = observations.len();
    let mut counts: Vec<usize> = observations.iter().map(|observation| observation.dots.len()).collect();
    counts.sort_unstable();
    let median = counts.get(pictures / 2).copied().unwrap_or(0);
    if median < layout.least_dots() {
        return Refused::NoWires { pictures, dots: median, least: layout.least_dots() };
    }
    // The same pattern in other units?
    let mut matcher = Matcher::new();
    for units in Units::ALL {
        let Some(scaled) = layout.scaled(units.factor()) else { continue };
        let some = observations.iter().step_by(pictures.div_ceil(8).max(1));
        if some.filter(|observation| matcher.read(&observation.dots, size_px, &scaled).is_some()).count() >= 2 {
            return Refused::PhantomUnits { units };
        }
    }
    Refused::OtherPhantom { pictures, dots: median, phantom: layout.geometry().name().to_owned() }
}

/// The plane of the sightings.
fn fit(
    layout: &Layout,
    registration: &Registration,
    sightings: &[Sighting],
    track: &Track,
    recording: Recording<'_>,
) -> Result<(Refined, Start), Refused> {
    let begin = |track: &Track, reference_from_phantom: &Transform<Reference, Phantom>| {
        start(layout, sightings, |s| s.probe_from_phantom(track, 0.0, reference_from_phantom), recording.size_px)
    };
    let given = &registration.reference_from_phantom;
    let begun = begin(track, given).ok_or(Refused::Open)?;
    if begun.spread_mm > WORST_SPREAD_MM {
        let better = |spread: f64| spread < WORST_SPREAD_MM && spread * CLEARLY < begun.spread_mm;
        for units in Units::ALL {
            let poses = track.scaled(units.factor());
            if begin(&poses, given).is_some_and(|start| better(start.spread_mm)) {
                return Err(Refused::PoseUnits { units });
            }
            let mut affine = given.affine();
            affine.translation *= units.factor();
            if begin(track, &Transform::from_affine(affine)).is_some_and(|start| better(start.spread_mm)) {
                return Err(Refused::RegistrationUnits { units });
            }
        }
        return Err(Refused::Contradictory { mm: begun.spread_mm });
    }
    let sought = Sought { skew: false, registration: true, lag: recording.timed };
    let refined = refine(layout, sightings, track, registration, &begun, sought)?;
    let used = refined.pictures.iter().filter(|(_, components)| *components > 0).count();
    if used < LEAST_PICTURES {
        return Err(Refused::TooFew { pictures: used });
    }
    Ok((refined, begun))
}

/// What became of all pictures.
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
    /// Pictures that have a part.
    pub fn used(&self) -> usize {
        self.pictures.iter().filter(|picture| picture.outcome == Outcome::Used).count()
    }

    /// Predicted error of where a pixel lies (one standard deviation, mm) on a lattice over the picture: rows of `count` numbers, from its first pixels to its last.
    pub fn predicted_mm(&self, count: usize) -> Vec<Vec<f64>> {
        lattice(self.size_px, count, |px| self.refined.predicted_mm(px))
    }
}

/// Numbers of pixels on a lattice over a picture: rows of `count`, from its first pixels to its last.
pub(super) fn lattice(size_px: [u32; 2], count: usize, of: impl Fn(DVec2) -> f64) -> Vec<Vec<f64>> {
    let last = size_px.map(|n| f64::from(n) - 1.0);
    let at = |i: usize, axis: usize| last[axis] * i as f64 / (count.max(2) - 1) as f64;
    (0..count).map(|v| (0..count).map(|u| of(DVec2::new(at(u, 0), at(v, 1)))).collect()).collect()
}

#[cfg(test)]
mod tests;
