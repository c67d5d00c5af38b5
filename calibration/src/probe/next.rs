//! Which view to take next: of those that a hand can bring about, the one that shrinks the largest predicted error most.
//!
//! Begun from the picture in the middle of all, the probe is tilted, turned, rocked and shifted either way. A view in which enough wires can be seen, where in the picture dots were seen so far, says what
//! further pictures of it would tell: their information adds to what there is. Directions are the picture's (MF: u to the probe's marked side, v away from its face), and said as one sees the probe who
//! has its marked side at the right and its face below: *you*.

use std::fmt;

use glam::{DAffine3, DQuat, DVec2, DVec3};

use super::calibrate::{Calibration, Outcome, Recording};
use super::layout::Layout;
use super::matching::{Mark, STEEPEST};
use super::plane::ImagePlane;
use super::refine::{Refined, View};
use super::track::{Poses, Track};
use crate::frames::{Phantom, Probe, Reference, Transform};
use crate::statistics::median;

/// What a hand tilts and turns by while the wires stay in the picture, deg.
const TURNS_DEG: [f64; 2] = [15.0, 30.0];
/// What it shifts by, mm.
const SHIFTS_MM: [f64; 2] = [10.0, 20.0];
/// Beyond where dots were seen the picture shows them, too, for this part of its width and height.
const BEYOND: f64 = 0.1;
/// What gains less than this part of the error is not worth a hand's while.
pub const LEAST_GAIN: f64 = 0.05;
/// Further pictures: what a recording has of a view that is held for half a second.
pub const PICTURES: usize = 10;
/// Of a scan that has many already ten more change little: then as many as make it longer by this part.
const LONGER: f64 = 0.2;

/// Further pictures to ask for, beside so many that are used.
pub fn pictures(used: usize) -> usize {
    PICTURES.max((LONGER * used as f64) as usize)
}

/// How the probe is moved, from where it was held in the middle of all pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// Not at all.
    Held,
    /// Turned about the picture's u, where the dots are: above 0 its top comes towards you.
    Tilt,
    /// Turned about the picture's v, the probe's long axis: above 0 the marked side comes towards you.
    Turn,
    /// Turned in the picture's plane: above 0 its top goes to the marked side.
    Rock,
    /// Shifted along u.
    AlongU,
    /// Shifted along v.
    AlongV,
    /// Shifted across the picture: above 0 away from you.
    Across,
}

impl Way {
    /// Those that are one move.
    pub const MOVES: [Self; 6] = [Self::Tilt, Self::Turn, Self::Rock, Self::AlongU, Self::AlongV, Self::Across];

    /// Its name in files, and the unit of what it is moved by.
    pub fn name(self) -> (&'static str, &'static str) {
        match self {
            Self::Held => ("held", ""),
            Self::Tilt => ("tilt", "deg"),
            Self::Turn => ("turn", "deg"),
            Self::Rock => ("rock", "deg"),
            Self::AlongU => ("along u", "mm"),
            Self::AlongV => ("along v", "mm"),
            Self::Across => ("across", "mm"),
        }
    }

    /// The amounts that are tried, one way.
    fn amounts(self) -> &'static [f64] {
        match self {
            Self::Held => &[],
            Self::Tilt | Self::Turn | Self::Rock => &TURNS_DEG,
            Self::AlongU | Self::AlongV | Self::Across => &SHIFTS_MM,
        }
    }

    /// The motion in the phantom's frame of a picture that lies there, about a point.
    fn motion(self, by: f64, picture: &ImagePlane, about: DVec3) -> DAffine3 {
        let (u, v) = (picture.u.normalize(), picture.v.normalize());
        let across = u.cross(v).normalize();
        let turned = |axis: DVec3| {
            let turn = DQuat::from_axis_angle(axis, by.to_radians());
            DAffine3::from_rotation_translation(turn, about - turn * about)
        };
        match self {
            Self::Held => DAffine3::IDENTITY,
            Self::Tilt => turned(u),
            Self::Turn => turned(v),
            Self::Rock => turned(across),
            Self::AlongU => DAffine3::from_translation(u * by),
            Self::AlongV => DAffine3::from_translation(v * by),
            Self::Across => DAffine3::from_translation(across * by),
        }
    }
}

/// A view, and how far off the calibration would be with further pictures of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// How the probe is moved there …
    pub way: Way,
    /// … by how much, deg or mm.
    pub by: f64,
    /// The largest predicted error then, mm.
    pub after_mm: f64,
    /// Where the probe is then.
    pub phantom_from_probe: Transform<Phantom, Probe>,
}

impl fmt::Display for Candidate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let by = self.by;
        let side = |above: &'static str, below: &'static str| if by > 0.0 { above } else { below };
        match self.way {
            Way::Held => write!(f, "hold the probe as it was held"),
            Way::Tilt => write!(
                f,
                "tilt the probe about the picture's u axis by {by:+.0}° (its top {} you)",
                side("towards", "away from")
            ),
            Way::Turn => write!(
                f,
                "turn the probe about its long axis, the picture's v, by {by:+.0}° (its marked side {} you)",
                side("towards", "away from")
            ),
            Way::Rock => write!(
                f,
                "rock the probe in the picture's plane by {by:+.0}° (its top {} the marked side)",
                side("to", "away from")
            ),
            Way::AlongU => write!(
                f,
                "shift the probe by {by:+.0} mm along the picture's u ({} the marked side)",
                side("to", "away from")
            ),
            Way::AlongV => write!(
                f,
                "shift the probe by {by:+.0} mm along the picture's v ({} the phantom)",
                side("towards", "away from")
            ),
            Way::Across => {
                write!(f, "shift the probe by {by:+.0} mm across the picture ({} you)", side("away from", "towards"))
            }
        }
    }
}

/// Views, the best first.
#[derive(Debug, Clone, PartialEq)]
pub struct NextView {
    /// The largest predicted error at the picture's corners and in its middle, as it is, mm.
    pub now_mm: f64,
    /// How many further pictures of a view are meant.
    pub pictures: usize,
    /// All that were tried and could be seen, by what they leave of the error.
    pub ranked: Vec<Candidate>,
}

impl NextView {
    /// The view to take: `None` where none gains [`LEAST_GAIN`].
    pub fn best(&self) -> Option<&Candidate> {
        self.ranked.first().filter(|best| best.after_mm <= (1.0 - LEAST_GAIN) * self.now_mm)
    }
}

impl fmt::Display for NextView {
    /// In one sentence.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (now, pictures) = (self.now_mm, self.pictures);
        match (self.best(), self.ranked.first()) {
            (Some(best), _) => {
                write!(f, "{best}: with {pictures} pictures of it the largest error {now:.2} → {:.2} mm", best.after_mm)
            }
            (None, Some(first)) => write!(
                f,
                "no view helps much: with {pictures} more pictures of any the largest error {now:.2} → {:.2} mm at best",
                first.after_mm
            ),
            (None, None) => write!(f, "no view was found in which the wires would be seen"),
        }
    }
}

/// A picture that has a part: where the sensors were, and where in it dots were seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    /// Of the picture's time, by the tracker's lag.
    pub poses: Poses,
    /// Pixels.
    pub dots_px: Vec<DVec2>,
}

/// Ranks the views from the middle one of those that were seen. It takes a thousandth of a second or two: an operator can be told while he scans. `None` where nothing was seen.
pub fn next_view(
    layout: &Layout,
    refined: &Refined,
    seen: &[Seen],
    size_px: [u32; 2],
    pictures: usize,
) -> Option<NextView> {
    let reference_from_phantom = refined.registration.reference_from_phantom;
    let phantom_from_probe = |poses: &Poses| reference_from_phantom.inverse() * poses.reference_from_probe();
    let middle = &seen[middle(seen, &refined.plane, size_px, phantom_from_probe)?];
    let region = Region::of(seen, size_px)?;
    let held = phantom_from_probe(&middle.poses).affine();
    let picture = refined.plane.seen_by(&held);
    let about = picture.point(middle.dots_px.iter().sum::<DVec2>() / middle.dots_px.len().max(1) as f64);
    let moves = Way::MOVES.iter().flat_map(|way| way.amounts().iter().flat_map(|by| [(*way, *by), (*way, -by)]));
    let candidate = |(way, by): (Way, f64)| {
        let there = Transform::from_affine(way.motion(by, &picture, about) * held);
        let marks = marks(layout, &refined.plane.seen_by(&there.affine()), region)?;
        let poses = moved(&middle.poses, reference_from_phantom * there);
        let after_mm = refined.foreseen_mm(layout, &View { poses, marks }, pictures, size_px)?;
        Some(Candidate { way, by, after_mm, phantom_from_probe: there })
    };
    let mut ranked: Vec<Candidate> = [(Way::Held, 0.0)].into_iter().chain(moves).filter_map(candidate).collect();
    ranked.sort_by(|a, b| a.after_mm.total_cmp(&b.after_mm));
    Some(NextView { now_mm: refined.largest_mm(size_px), pictures, ranked })
}

impl Calibration {
    /// Ranks the views that would add to it ([`next_view`]); `recording` is the one that it was made from. `None` where none of its pictures is found there.
    pub fn next_view(&self, layout: &Layout, recording: Recording<'_>, pictures: usize) -> Option<NextView> {
        let track = Track::new(recording.observations.iter().filter_map(|observation| observation.poses).collect());
        let both = recording.observations.iter().zip(&self.pictures);
        let used = both.filter(|(_, picture)| picture.outcome == Outcome::Used);
        let seen = used.filter_map(|(observation, picture)| {
            let poses = track.at(observation.time_s + self.refined.lag_s)?;
            let dots_px = picture.dots.iter().filter(|dot| dot.used).map(|dot| dot.seen_px).collect();
            Some(Seen { poses, dots_px })
        });
        next_view(layout, &self.refined, &seen.collect::<Vec<_>>(), self.size_px, pictures)
    }
}

/// The picture that lies nearest to the middle of all: by three of its corners, each against the medians of its coordinates.
fn middle(
    seen: &[Seen],
    plane: &ImagePlane,
    size_px: [u32; 2],
    phantom_from_probe: impl Fn(&Poses) -> Transform<Phantom, Probe>,
) -> Option<usize> {
    let [u, v] = size_px.map(f64::from);
    let corners = [DVec2::ZERO, DVec2::new(u, 0.0), DVec2::new(0.0, v)];
    let place = |seen: &Seen| {
        let map = phantom_from_probe(&seen.poses);
        corners.map(|px| map.point(plane.point(px)).to_array()).concat()
    };
    let places: Vec<Vec<f64>> = seen.iter().map(place).collect();
    let middle: Vec<f64> =
        (0..9).map(|k| median(&mut places.iter().map(|place| place[k]).collect::<Vec<_>>())).collect();
    let off = |place: &Vec<f64>| place.iter().zip(&middle).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    (0..seen.len()).min_by(|&a, &b| off(&places[a]).total_cmp(&off(&places[b])))
}

/// The same moment with the probe elsewhere.
fn moved(poses: &Poses, reference_from_probe: Transform<Reference, Probe>) -> Poses {
    let tracker_from_reference = poses.tracker_from_reference.unwrap_or(Transform::IDENTITY);
    Poses { tracker_from_probe: tracker_from_reference * reference_from_probe, ..*poses }
}

/// A part of the picture, pixels.
#[derive(Debug, Clone, Copy)]
struct Region {
    low: DVec2,
    high: DVec2,
}

impl Region {
    /// Where dots were seen, and a little more.
    fn of(seen: &[Seen], size_px: [u32; 2]) -> Option<Self> {
        let dots = || seen.iter().flat_map(|seen| &seen.dots_px).copied();
        let (low, high) = (dots().reduce(DVec2::min)?, dots().reduce(DVec2::max)?);
        let size = DVec2::from(size_px.map(f64::from));
        Some(Self { low: (low - size * BEYOND).max(DVec2::ZERO), high: (high + size * BEYOND).min(size - 1.0) })
    }

    fn has(self, px: DVec2) -> bool {
        px.cmpge(self.low).all() && px.cmple(self.high).all()
    }
}

/// The dots of a picture that lies in the phantom so; `None` where too few are seen to be told apart, or they are streaks.
fn marks(layout: &Layout, picture: &ImagePlane, region: Region) -> Option<Vec<Mark>> {
    let wires = layout.geometry().wires();
    let across = picture.u.cross(picture.v).normalize();
    let is_steep = layout.ns().iter().any(|n| {
        let post = &wires[layout.posts()[n.outer[0]].wire];
        post.direction().dot(across).abs() < STEEPEST
    });
    let mark = |(wire, about)| {
        let (at_px, share) = picture.cut(about)?;
        ((0.0..=1.0).contains(&share) && region.has(at_px)).then_some(Mark { wire, at_px, contrast: 0.0 })
    };
    let marks: Vec<Mark> = wires.iter().enumerate().filter_map(mark).collect();
    (!is_steep && marks.len() >= layout.least_dots()).then_some(marks)
}

#[cfg(test)]
mod tests;
