//! Reads images again once the wires' approximate positions are known.
//!
//! In phantoms with similar layers, dots may be assigned to the layer below, if a layer is not
//! visible or an echo resembles one. Once the other images have fixed the plane, each dot
//! belongs to the nearest wire. Images that were read correctly stay unchanged, even by a
//! slightly wrong calibration.

use glam::DVec2;

use super::layout::Layout;
use super::matching::Mark;
use super::plane::ImagePlane;
use super::recording::Observation;
use super::refine::Refined;
use super::sighting::Sighting;
use super::track::Track;
use crate::phantom::Wire;

/// A dot belongs to a wire if it is nearer to it than this share of the distance to the next
/// wire.
const NEAR: f64 = 0.4;

/// The predicted dot of a wire.
struct Expected {
    wire: usize,
    at_px: DVec2,
    /// Dots within this radius belong to it.
    radius_px: f64,
}

/// Returns a recording's sightings, with misread or unread images read again, and the number of
/// these.
pub(super) fn reread(
    layout: &Layout,
    refined: &Refined,
    track: &Track,
    observations: &[Observation],
    sightings: &[Sighting],
) -> (Vec<Sighting>, usize) {
    let wires = layout.geometry().wires();
    let mut earlier = sightings.iter().peekable();
    let (mut all, mut count) = (Vec::new(), 0);
    for observation in observations {
        let own = earlier.next_if(|sighting| sighting.frame == observation.frame);
        if observation.poses.is_none() {
            continue;
        }
        let (frame, time_s) = (observation.frame, observation.time_s);
        let unread = Sighting { frame, time_s, marks: Vec::new() };
        let sighting = own.unwrap_or(&unread);
        let map = sighting.probe_from_phantom(track, refined.lag_s, &refined.registration.reference_from_phantom);
        let expected = map.map_or(Vec::new(), |map| expected(wires, &refined.plane.seen_by(&map.inverse().affine())));
        let marks = read(observation, &expected);
        // Wires not used for recognition could not be read at first.
        let is_more = layout.is_flat() && marks.len() > sighting.marks.len();
        if own.is_some() && !is_misread(sighting, &expected) && !is_more {
            all.push(sighting.clone());
            continue;
        }
        if marks.len() >= layout.least_dots() {
            all.push(Sighting { frame, time_s, marks });
            count += 1;
        } else if let (Some(own), true) = (own, expected.is_empty()) {
            all.push(own.clone());
        }
    }
    (all, count)
}

/// Returns the wires that an image should show.
fn expected(wires: &[Wire], plane: &ImagePlane) -> Vec<Expected> {
    let cuts: Vec<(usize, DVec2)> = wires
        .iter()
        .enumerate()
        .filter_map(|(wire, about)| plane.cut(about).map(|(at_px, along)| (wire, at_px, along)))
        .filter(|(_, _, along)| (0.0..=1.0).contains(along))
        .map(|(wire, at_px, _)| (wire, at_px))
        .collect();
    let next = |wire: usize, at_px: DVec2| {
        let others = cuts.iter().filter(|(other, _)| *other != wire);
        others.map(|(_, other)| other.distance(at_px)).fold(f64::INFINITY, f64::min)
    };
    cuts.iter().map(|&(wire, at_px)| Expected { wire, at_px, radius_px: NEAR * next(wire, at_px) }).collect()
}

/// Returns whether most of its dots lie far from their assigned wires.
fn is_misread(sighting: &Sighting, expected: &[Expected]) -> bool {
    let is_far = |mark: &&Mark| {
        let own = expected.iter().find(|expected| expected.wire == mark.wire);
        own.is_none_or(|own| own.at_px.distance(mark.at_px) > own.radius_px)
    };
    !expected.is_empty() && 2 * sighting.marks.iter().filter(is_far).count() > sighting.marks.len()
}

/// Assigns the nearest dot to each wire, if near.
fn read(observation: &Observation, expected: &[Expected]) -> Vec<Mark> {
    let nearest = |own: &Expected| {
        let dots = observation.seen.dots.iter().filter(|dot| dot.at_px.distance(own.at_px) <= own.radius_px);
        let dot = dots.min_by(|a, b| a.at_px.distance(own.at_px).total_cmp(&b.at_px.distance(own.at_px)))?;
        Some(Mark { wire: own.wire, at_px: dot.at_px, contrast: dot.contrast })
    };
    expected.iter().filter_map(nearest).collect()
}
