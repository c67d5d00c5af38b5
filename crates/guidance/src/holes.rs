//! Holes in the scan: gaps between consecutive slices, until later slices close them.
//!
//! If consecutive slices within [`PAUSE_NS`] show one place and are farther apart than the
//! kernel closes ([`gap::between`](super::gap::between)), the space between them is a gap. Gaps
//! that touch, as in a sweep that was too fast for a while, are one hole. These are not gaps:
//!
//! - Space seen before: a fast motion back over scanned tissue misses nothing. The planes of
//!   earlier slices are kept for this test, thinned to half a reach.
//! - The way from one place to another: slices that do not face each other, are too much turned
//!   or more than [`MOST_MM`](super::gap::MOST_MM) apart, or a motion faster than any sweep by
//!   hand.
//! - The space after a pause, if the sweep returns towards it. It becomes a gap only if the
//!   sweep continues away from it, so that there is scanned tissue on both sides.
//!
//! A slice closes the points of gaps that it sees. The cost of a slice is bounded. There are at
//! most [`MOST_GAPS`] gaps with fixed grids of points, of which only those near the slice's
//! plane are tested. There are at most [`MOST_PLANES`] planes, of which those near a new gap are
//! tested up to [`MOST_POINTS`] points. Anything beyond a bound is counted.

use glam::DVec3;
use serde::Serialize;

use mask::Mask;
use sonoweave_core::clock::SECOND;

use super::gap::{Between, Gap, between};
use super::slice_plane::SlicePlane;
use super::spacing::Spacing;

/// Time between slices above which they belong to two sweeps, ns.
pub const PAUSE_NS: i64 = SECOND;
/// Largest number of stored gaps.
pub const MOST_GAPS: usize = 96;
/// Largest number of stored planes of earlier slices.
pub const MOST_PLANES: usize = 1024;
/// Largest number of points tested to decide whether a gap was seen before.
pub const MOST_POINTS: u64 = 20_000;
/// Largest speed of a sweep by hand, mm/s.
const MOST_SPEED: f64 = 500.0;
/// Distance within the plane beyond which both of two planes are stored, mm.
const BESIDE_MM: f64 = 4.0;
/// Distance below which a hole counts as at the probe's position, mm.
const HERE_MM: f64 = 2.0;

#[derive(Debug)]
struct Hole {
    number: u64,
    gaps: Vec<Gap>,
}

/// A possible gap after a pause, while the direction of the sweep is unknown.
#[derive(Debug)]
struct PossibleGap {
    gap: Gap,
    from: DVec3,
    away: DVec3,
}

/// The holes so far.
#[derive(Debug)]
pub struct Holes {
    spacing: Spacing,
    holes: Vec<Hole>,
    last: Option<(SlicePlane, i64)>,
    /// The hole that the last two slices left, if any.
    touching: Option<u64>,
    doubt: Option<PossibleGap>,
    planes: Vec<SlicePlane>,
    /// Index for the next plane, which replaces the oldest.
    next: usize,
    numbered: u64,
    closed: u64,
    beyond: u64,
    forgotten: u64,
    points: u64,
}

/// Report of the holes.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct HolesStatus {
    /// Open holes.
    pub open: usize,
    /// Holes closed by later slices.
    pub closed: u64,
    /// Gaps not stored, because there were too many, or because the test for earlier slices took
    /// too long.
    pub beyond: u64,
    /// Planes of earlier slices discarded because there were too many. A fast sweep over that
    /// tissue may then count as a hole.
    pub forgotten: u64,
    /// Largest distance between slices in the holes, mm.
    pub widest_mm: Option<f64>,
    /// Directions from the probe to the nearest hole, in words.
    pub nearest: Option<String>,
    /// Tested points of gaps so far: the work.
    pub points: u64,
}

impl Holes {
    /// Creates an empty set for slices with this allowed spacing.
    pub fn new(spacing: Spacing) -> Self {
        Self {
            spacing,
            holes: Vec::new(),
            last: None,
            touching: None,
            doubt: None,
            planes: Vec::new(),
            next: 0,
            numbered: 0,
            closed: 0,
            beyond: 0,
            forgotten: 0,
            points: 0,
        }
    }

    /// Adds a slice taken at a time, ns.
    pub fn add(&mut self, plane: &SlicePlane, mask: &Mask, time_ns: i64) {
        self.close(plane, mask);
        let touching = self.touching.take();
        if let Some((last, last_ns)) = self.last
            && let passed @ 1.. = time_ns - last_ns
            && let Between::Apart(gap) = between(&last, plane, mask, self.spacing.reach_mm())
            && gap.width_mm() / (passed as f64 / 1e9) <= MOST_SPEED
            && let Some(gap) = self.unseen(*gap, mask)
        {
            if passed <= PAUSE_NS {
                self.touching = self.keep(gap, touching);
            } else {
                let across = plane.normal() * -plane.distance(last.middle()).signum();
                self.doubt = Some(PossibleGap { gap, from: plane.middle(), away: across });
            }
        }
        self.decide(plane);
        self.remember(plane);
        self.last = Some((*plane, time_ns));
    }

    /// Returns all open gaps.
    pub fn gaps(&self) -> impl Iterator<Item = &Gap> {
        self.holes.iter().flat_map(|hole| &hole.gaps)
    }

    /// Returns the report, given the present slice and the current or last direction of the
    /// sweep.
    pub fn status(&self, present: Option<&SlicePlane>, travel: Option<DVec3>) -> HolesStatus {
        let nearest = present.and_then(|plane| {
            let centres = self.gaps().map(Gap::centre);
            let nearest =
                centres.min_by(|a, b| rectangle_distance(plane, *a).total_cmp(&rectangle_distance(plane, *b)))?;
            Some(direction(plane, nearest, travel))
        });
        HolesStatus {
            open: self.holes.len(),
            closed: self.closed,
            beyond: self.beyond,
            forgotten: self.forgotten,
            widest_mm: self.gaps().map(Gap::width_mm).reduce(f64::max),
            nearest,
            points: self.points,
        }
    }

    fn close(&mut self, plane: &SlicePlane, mask: &Mask) {
        let reach_mm = self.spacing.reach_mm();
        for hole in &mut self.holes {
            for gap in &mut hole.gaps {
                self.points += gap.see(plane, mask, reach_mm);
            }
            hole.gaps.retain(|gap| !gap.is_closed());
        }
        let before = self.holes.len();
        self.holes.retain(|hole| !hole.gaps.is_empty());
        self.closed += (before - self.holes.len()) as u64;
        if let Some(doubt) = &mut self.doubt {
            self.points += doubt.gap.see(plane, mask, reach_mm);
        }
        self.doubt.take_if(|doubt| doubt.gap.is_closed());
    }

    /// Returns the part of a gap that no earlier slice has seen.
    fn unseen(&mut self, mut gap: Gap, mask: &Mask) -> Option<Gap> {
        let mut points = 0;
        for plane in &self.planes {
            points += gap.see(plane, mask, self.spacing.reach_mm());
            if gap.is_closed() || points > MOST_POINTS {
                break;
            }
        }
        self.points += points;
        self.beyond += u64::from(points > MOST_POINTS);
        if gap.is_closed() || points > MOST_POINTS {
            return None;
        }
        Some(gap)
    }

    /// Decides whether the sweep continues after a pause.
    fn decide(&mut self, plane: &SlicePlane) {
        let Some(doubt) = &self.doubt else { return };
        let gone = (plane.middle() - doubt.from).dot(doubt.away);
        if gone.abs() < self.spacing.reach_mm() {
            return;
        }
        if let Some(doubt) = self.doubt.take().filter(|_| gone > 0.0) {
            self.keep(doubt.gap, None);
        }
    }

    /// Stores a gap, in the hole that it touches if there is one; returns that hole.
    fn keep(&mut self, gap: Gap, touching: Option<u64>) -> Option<u64> {
        if self.gaps().count() >= MOST_GAPS {
            self.beyond += 1;
            return None;
        }
        let touched = self.holes.iter_mut().find(|hole| Some(hole.number) == touching);
        if let Some(hole) = touched {
            hole.gaps.push(gap);
            return touching;
        }
        self.numbered += 1;
        self.holes.push(Hole { number: self.numbered, gaps: vec![gap] });
        Some(self.numbered)
    }

    fn remember(&mut self, plane: &SlicePlane) {
        let near_mm = 0.5 * self.spacing.reach_mm();
        let is_near = |known: &SlicePlane| {
            plane.corners().iter().all(|corner| known.distance(*corner).abs() <= near_mm)
                && known.beside(plane.middle()).abs().max_element() <= BESIDE_MM
        };
        // The newest planes are the most likely matches.
        let (later, earlier) = self.planes.split_at(self.next.min(self.planes.len()));
        if later.iter().rev().chain(earlier.iter().rev()).any(is_near) {
            return;
        }
        if self.planes.len() < MOST_PLANES {
            self.planes.push(*plane);
        } else {
            self.planes[self.next] = *plane;
            self.forgotten += 1;
        }
        self.next = (self.next + 1) % MOST_PLANES;
    }
}

/// Returns the distance to a place, across the image's plane and beyond its sides, mm.
fn rectangle_distance(plane: &SlicePlane, place: DVec3) -> f64 {
    plane.distance(place).hypot((plane.beside(place).x.abs() - plane.half_mm().x).max(0.0))
}

/// Returns directions to a place in words. The marker is at the side of the image's first
/// column.
pub fn direction(plane: &SlicePlane, place: DVec3, travel: Option<DVec3>) -> String {
    let across = plane.distance(place);
    let beside = plane.beside(place).x;
    let aside = (beside.abs() - plane.half_mm().x).max(0.0);
    let side = if beside < 0.0 { "to the marker's side" } else { "away from the marker" };
    let on = travel.map(|travel| travel.dot(plane.normal()) * across > 0.0);
    let across = match on {
        _ if across.abs() < HERE_MM => None,
        Some(true) => Some(format!("go on {:.0} mm", across.abs())),
        Some(false) => Some(format!("go back {:.0} mm", across.abs())),
        None => Some(format!("it is {:.0} mm off the picture's plane", across.abs())),
    };
    let aside = (aside >= HERE_MM).then(|| format!("{aside:.0} mm {side}"));
    match (across, aside) {
        (Some(across), Some(aside)) => format!("{across} and {aside}"),
        (Some(way), None) => way,
        (None, Some(aside)) => format!("move {aside}"),
        (None, None) => "it is here: sweep slowly over it".into(),
    }
}
