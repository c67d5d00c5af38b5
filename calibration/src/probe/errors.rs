//! How far a calibration is off, in mm.
//!
//! Two definitions. **Of middle wires**, which is PLUS's 3D reprojection error: the share of the way between its N's outer dots at which a middle wire's dot lies says where on the wire it is; the error is how far
//! from there, in the probe's frame, the calibration puts the dot. It holds the dots' scatter along the wire, two or three times enlarged by the N's slant, and the poses'. PLUS prints mean and
//! standard deviation of the best 95 %. **Of wires**: how far a dot's place is from its wire's line, for all wires.

use super::layout::Layout;
use super::matching::Mark;
use super::plane::ImagePlane;
use super::sighting::Sighting;
use super::track::Track;
use crate::frames::{Phantom, Probe, Reference, Transform};
use crate::statistics::Spread;

/// Part of the errors that PLUS looks at, the least ones.
const PLUS_PART: f64 = 0.95;

/// Errors of many pictures, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct Errors {
    /// Of all.
    pub mean: f64,
    /// Standard deviation of all.
    pub sd: f64,
    /// Root mean square of all.
    pub rms: f64,
    /// The largest.
    pub max: f64,
    /// Mean of the least 95 %, as PLUS prints it.
    pub mean_of_95: f64,
    /// How many there are.
    pub count: usize,
    /// Each picture's mean, by its number; pictures without any are not listed.
    pub per_frame: Vec<(usize, f64)>,
}

impl Errors {
    /// Of what each picture's are, with its number. `None` without any.
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

/// What a calibration is held against: pictures, poses, and where the phantom is held.
#[derive(Debug, Clone, Copy)]
pub struct Evidence<'a> {
    /// The phantom.
    pub layout: &'a Layout,
    /// Pictures with recognised dots.
    pub sightings: &'a [Sighting],
    /// Poses.
    pub track: &'a Track,
    /// How much later poses come than pictures, s.
    pub lag_s: f64,
    /// Where the phantom is held.
    pub reference_from_phantom: Transform<Reference, Phantom>,
}

impl Evidence<'_> {
    /// Errors of middle wires.
    pub fn of_middle_wires(&self, plane: &ImagePlane) -> Option<Errors> {
        Errors::of(
            self.posed().map(|(sighting, map)| (sighting.frame, middles(self.layout, &sighting.marks, &map, plane))),
        )
    }

    /// Errors of wires.
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

/// Errors of one picture's middle wires.
fn middles(layout: &Layout, marks: &[Mark], map: &Transform<Probe, Phantom>, plane: &ImagePlane) -> Vec<f64> {
    let dot = |wire: usize| marks.iter().find(|mark| mark.wire == wire).map(|mark| mark.at_px);
    let error = |n: &crate::phantom::Nwire| {
        let (first, middle, last) = (dot(n.outer[0])?, dot(n.middle)?, dot(n.outer[1])?);
        let share = first.distance(middle) / first.distance(last);
        Some(map.point(n.middle_mm(share)).distance(plane.point(middle)))
    };
    layout.geometry().nwires().iter().filter_map(error).collect()
}
