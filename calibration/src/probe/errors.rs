//! Errors of a calibration, in mm, by two definitions.
//!
//! The error **of middle wires** is PLUS's 3D reprojection error. The position of a middle
//! wire's dot between its N's outer dots gives a point on the wire. The error is the distance,
//! in the probe's frame, from that point to the dot by the calibration. It includes the dots'
//! scatter along the wire, enlarged two or three times by the N's slant, and the poses' errors.
//! PLUS prints mean and standard deviation of the best 95 %.
//!
//! The error **of wires** is the distance of a dot from its wire's line, for all wires.

use sonoweave_core::frames::{Phantom, Probe, Reference, Transform};

use super::layout::Layout;
use super::matching::Mark;
use super::plane::ImagePlane;
use super::sighting::Sighting;
use super::track::Track;
use crate::statistics::Spread;

/// Share of the errors that PLUS evaluates, the smallest ones.
const PLUS_PART: f64 = 0.95;

/// Errors of many images, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct Errors {
    /// Mean of all.
    pub mean: f64,
    /// Standard deviation of all.
    pub sd: f64,
    /// Root mean square of all.
    pub rms: f64,
    /// The largest.
    pub max: f64,
    /// Mean of the smallest 95 %, as PLUS prints it.
    pub mean_of_95: f64,
    /// Number of errors.
    pub count: usize,
    /// Each image's mean, with its number; images without errors are not listed.
    pub per_frame: Vec<(usize, f64)>,
}

impl Errors {
    /// Summarises the errors of images, given with their numbers. `None` without any.
    pub fn of(pictures: impl IntoIterator<Item = (usize, Vec<f64>)>) -> Option<Self> {
        let (mut all, mut per_frame) = (Vec::new(), Vec::new());
        for (frame, errors) in pictures {
            if !errors.is_empty() {
                per_frame.push((frame, Spread::of(errors.iter().copied()).mean));
                all.extend(errors);
            }
        }
        if all.is_empty() {
            return None;
        }
        all.sort_by(f64::total_cmp);
        let Spread { mean, sd, rms, max, count, .. } = Spread::of(all.iter().copied());
        let kept = (PLUS_PART * count as f64).round().max(1.0) as usize;
        let mean_of_95 = Spread::of(all[..kept].iter().copied()).mean;
        Some(Self { mean, sd, rms, max, mean_of_95, count, per_frame })
    }
}

/// The data for testing a calibration: images, poses, and the pose of the phantom.
#[derive(Debug, Clone, Copy)]
pub struct Evidence<'a> {
    /// The phantom.
    pub layout: &'a Layout,
    /// Images with recognised dots.
    pub sightings: &'a [Sighting],
    /// Poses.
    pub track: &'a Track,
    /// Lag of the poses behind the images, s.
    pub lag_s: f64,
    /// Pose of the phantom.
    pub reference_from_phantom: Transform<Reference, Phantom>,
}

impl Evidence<'_> {
    /// Returns the errors of middle wires.
    pub fn of_middle_wires(&self, plane: &ImagePlane) -> Option<Errors> {
        Errors::of(
            self.posed().map(|(sighting, map)| (sighting.frame, middles(self.layout, &sighting.marks, &map, plane))),
        )
    }

    /// Returns the errors of all wires.
    pub fn of_wires(&self, plane: &ImagePlane) -> Option<Errors> {
        let wires = self.layout.geometry().wires();
        Errors::of(self.posed().map(|(sighting, map)| {
            let back = map.inverse();
            let off = |mark: &Mark| wires[mark.wire].nearest(back.point(plane.point(mark.at_px))).0;
            (sighting.frame, sighting.marks.iter().map(off).collect())
        }))
    }

    fn posed(&self) -> impl Iterator<Item = (&Sighting, Transform<Probe, Phantom>)> {
        let map = |s: &Sighting| s.probe_from_phantom(self.track, self.lag_s, &self.reference_from_phantom);
        self.sightings.iter().filter_map(move |sighting| Some((sighting, map(sighting)?)))
    }
}

/// Returns the errors of one image's middle wires.
fn middles(layout: &Layout, marks: &[Mark], map: &Transform<Probe, Phantom>, plane: &ImagePlane) -> Vec<f64> {
    let dot = |wire: usize| marks.iter().find(|mark| mark.wire == wire).map(|mark| mark.at_px);
    let error = |n: &crate::phantom::Nwire| {
        let (first, middle, last) = (dot(n.outer[0])?, dot(n.middle)?, dot(n.outer[1])?);
        let share = first.distance(middle) / first.distance(last);
        Some(map.point(n.middle_mm(share)).distance(plane.point(middle)))
    };
    layout.geometry().nwires().iter().filter_map(error).collect()
}
