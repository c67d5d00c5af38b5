//! Recommends the next view: of the feasible ones, the one that reduces the largest predicted
//! error most.
//!
//! The candidates start from the middle image: the probe is tilted, turned, rocked and shifted
//! either way. A view must show enough wires within the image region that has shown dots so
//! far. The information of further images of it is added to the present one. Directions are
//! those of the image (MF: u to the probe's marked side, v away from its face). The advice
//! addresses an operator ("you") who sees the probe with its marked side at the right and its
//! face below.

use std::fmt;

use glam::{DAffine3, DQuat, DVec2, DVec3};

use sonoweave_core::frames::{Phantom, Probe, Reference, Transform};

use super::calibrate::{Calibration, Outcome};
use super::layout::Layout;
use super::matching::{Mark, STEEPEST};
use super::plane::ImagePlane;
use super::recording::Recording;
use super::refine::{Refined, View};
use super::track::{Poses, Track};
use crate::statistics::median;

/// Rotations that keep the wires in the image, deg.
const TURNS_DEG: [f64; 2] = [15.0, 30.0];
/// Shifts, mm.
const SHIFTS_MM: [f64; 2] = [10.0, 20.0];
/// Dots are also expected beyond the observed region, by this share of the image's width and
/// height.
const BEYOND: f64 = 0.1;
/// A smaller relative gain is not worth the effort.
pub const LEAST_GAIN: f64 = 0.05;
/// Number of further images: as recorded when a view is held for half a second.
pub const PICTURES: usize = 10;
/// Long scans need more images for an effect: this share of the present number.
const LONGER: f64 = 0.2;

/// Returns the number of further images to request, given the number used.
pub fn pictures(used: usize) -> usize {
    PICTURES.max((LONGER * used as f64) as usize)
}

/// A motion of the probe from its middle position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// No motion.
    Held,
    /// Rotation about the image's u, at the dots: above 0 the probe's top comes towards you.
    Tilt,
    /// Rotation about the image's v, the probe's long axis: above 0 the marked side comes
    /// towards you.
    Turn,
    /// Rotation in the image plane: above 0 the probe's top goes to the marked side.
    Rock,
    /// Shift along u.
    AlongU,
    /// Shift along v.
    AlongV,
    /// Shift across the image: above 0 away from you.
    Across,
}

impl Way {
    /// All single motions.
    pub const MOVES: [Self; 6] = [Self::Tilt, Self::Turn, Self::Rock, Self::AlongU, Self::AlongV, Self::Across];

    /// Returns its name in files, and the unit of its amount.
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

    /// Returns the amounts to try, in one direction.
    fn amounts(self) -> &'static [f64] {
        match self {
            Self::Held => &[],
            Self::Tilt | Self::Turn | Self::Rock => &TURNS_DEG,
            Self::AlongU | Self::AlongV | Self::Across => &SHIFTS_MM,
        }
    }

    /// Returns the motion about a point in the phantom's frame, for an image at this pose.
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

/// A view, and the predicted error with further images of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The motion to it …
    pub way: Way,
    /// … and its amount, deg or mm.
    pub by: f64,
    /// The largest predicted error afterwards, mm.
    pub after_mm: f64,
    /// Pose of the probe there.
    pub phantom_from_probe: Transform<Phantom, Probe>,
}

impl fmt::Display for Candidate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let by = self.by;
        let side = |above: &'static str, below: &'static str| if by > 0.0 { above } else { below };
        match self.way {
            Way::Held => write!(f, "hold the probe as before"),
            Way::Tilt => write!(
                f,
                "tilt the probe about the image's u axis by {by:+.0}° (its top {} you)",
                side("towards", "away from")
            ),
            Way::Turn => write!(
                f,
                "turn the probe about its long axis, the image's v, by {by:+.0}° (its marked side {} you)",
                side("towards", "away from")
            ),
            Way::Rock => write!(
                f,
                "rock the probe in the image's plane by {by:+.0}° (its top {} the marked side)",
                side("to", "away from")
            ),
            Way::AlongU => write!(
                f,
                "shift the probe by {by:+.0} mm along the image's u ({} the marked side)",
                side("to", "away from")
            ),
            Way::AlongV => write!(
                f,
                "shift the probe by {by:+.0} mm along the image's v ({} the phantom)",
                side("towards", "away from")
            ),
            Way::Across => {
                write!(f, "shift the probe by {by:+.0} mm across the image ({} you)", side("away from", "towards"))
            }
        }
    }
}

/// Ranked views.
#[derive(Debug, Clone, PartialEq)]
pub struct NextView {
    /// The largest predicted error at present, at the image's corners and centre, mm.
    pub now_mm: f64,
    /// Number of further images per view.
    pub pictures: usize,
    /// All visible candidates, by the remaining error, the best first.
    pub ranked: Vec<Candidate>,
}

impl NextView {
    /// Returns the best view: `None` if no view gains [`LEAST_GAIN`].
    pub fn best(&self) -> Option<&Candidate> {
        self.ranked.first().filter(|best| best.after_mm <= (1.0 - LEAST_GAIN) * self.now_mm)
    }
}

impl fmt::Display for NextView {
    /// Writes the advice in one sentence.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (now, pictures) = (self.now_mm, self.pictures);
        match (self.best(), self.ranked.first()) {
            (Some(best), _) => {
                write!(
                    f,
                    "{best}: {pictures} frames of this view reduce the largest error from {now:.2} to {:.2} mm",
                    best.after_mm
                )
            }
            (None, Some(first)) => write!(
                f,
                "no view helps much: {pictures} more frames of the best one reduce the largest error from {now:.2} to {:.2} mm",
                first.after_mm
            ),
            (None, None) => write!(f, "no view shows the wires; record more frames of the present view"),
        }
    }
}

/// An image used by the calibration: poses of the sensors, and positions of the dots.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    /// Poses at the image's time plus the tracker's lag.
    pub poses: Poses,
    /// Pixels.
    pub dots_px: Vec<DVec2>,
}

/// Ranks the views from the middle one of those seen. It takes one or two milliseconds, fast
/// enough for advice during scanning. `None` if nothing was seen.
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
    /// Ranks the views that would improve the calibration ([`next_view`]); `recording` is the
    /// one it was made from. `None` if that recording contains none of its images.
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

/// Returns the image nearest to the middle: by three corners, each compared with the medians of
/// its coordinates.
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

/// Returns the poses of the same moment for another pose of the probe.
fn moved(poses: &Poses, reference_from_probe: Transform<Reference, Probe>) -> Poses {
    let tracker_from_reference = poses.tracker_from_reference.unwrap_or(Transform::IDENTITY);
    Poses { tracker_from_probe: tracker_from_reference * reference_from_probe, ..*poses }
}

/// A region of the image, pixels.
#[derive(Debug, Clone, Copy)]
struct Region {
    low: DVec2,
    high: DVec2,
}

impl Region {
    /// Returns the region of the observed dots, slightly enlarged.
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

/// Returns the dots of an image at this pose in the phantom; `None` if too few are visible or
/// they are streaks.
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
