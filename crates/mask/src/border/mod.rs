//! Detection of the picture in a border that is not exactly zero: level and noise of the border
//! from the frame's rim, the largest region that differs from it, and the rectangle or fan whose
//! edges are there.
//!
//! Letters, rulers, traces and clocks are thin or apart from the picture: they are left out by
//! their width, by their connection, or as outliers of an edge. A shape is accepted if its edges
//! are seen, its inside differs from the border, and little does outside. Otherwise the frame
//! counts as a whole.

mod edges;
mod fan;
mod level;
mod outline;
mod plane;
mod rectangle;
mod statistics;

use std::sync::Arc;

use sonoweave_core::region::ClipRect;

use self::edges::{EdgeFinder, NEAR, Place, Segment};
use self::fan::Sector;
use self::level::BorderLevel;
use self::outline::Outline;
use self::rectangle::Sides;
use super::Mask;
use super::found::{Border, MaskFound, MaskShape, UnsureReason};
use super::shape::largest_component;

pub(super) use self::plane::Map;
pub(super) use self::statistics::FrameSums;

/// Gaps in the picture that are closed, radius in pixels of a frame of 480 rows. None at first:
/// that would join things beside a picture to it. A dim, frozen picture has gaps.
const GAPS: [usize; 2] = [0, 3];
/// Thin things that are removed, radius as a part of the frame's shorter side.
const THIN: usize = 60;
/// Least fraction of the frame that a picture covers.
const LEAST_AREA: f64 = 0.08;
/// Least share of an edge that must be seen, and of the whole outline.
const LEAST_EDGE: f64 = 0.2;
const LEAST_SEEN: f64 = 0.45;
/// Least share of the inside that differs from the border.
const LEAST_INSIDE: f64 = 0.3;
/// Largest share of all that differs from the border outside of the shape.
const MOST_OUTSIDE: f64 = 0.15;
/// Names of the edges of a rectangle, and of a fan.
const SIDES: [&str; 4] = ["left", "right", "top", "bottom"];

/// Outcome of a search.
pub(super) struct Search {
    /// The border, if it is even.
    pub(super) border: Option<Border>,
    /// The picture, or the reasons about it.
    pub(super) picture: Result<(MaskShape, f64), UnsureReason>,
}

/// A shape with its outline.
struct Candidate {
    shape: MaskShape,
    mask: Mask,
    segments: Vec<Segment>,
}

/// Looks for a picture in a part of frames `size` pixels large.
pub(super) fn search(sums: &FrameSums, size: [u32; 2], part: ClipRect) -> Search {
    let offset = [part.x, part.y].map(|at| at as usize);
    let moments = sums.moments(size[0] as usize, offset, [part.width, part.height].map(|count| count as usize));
    let smooth = moments.mean.smoothed();
    let smooth_change = moments.variance.as_ref().map(plane::Plane::smoothed);
    let border = match BorderLevel::estimate(&moments, &smooth, smooth_change.as_ref()) {
        Ok(border) => border,
        Err(reason) => return Search { border: None, picture: Err(reason) },
    };
    let active = border.active(&smooth, smooth_change.as_ref());
    let finder = EdgeFinder::new(&moments.mean, &border);
    let picture = picture(&active, &finder, size, part);
    Search { border: Some(Border { level: border.level, noise: border.noise }), picture }
}

/// Returns the shape that the active pixels and the edges support, and its confidence.
fn picture(
    active: &Map,
    finder: &EdgeFinder<'_>,
    size: [u32; 2],
    part: ClipRect,
) -> Result<(MaskShape, f64), UnsureReason> {
    let mut found = Err(UnsureReason::Nothing);
    for gap in GAPS {
        found = picture_with_gaps(active, gap, finder, size, part);
        if found.is_ok() {
            break;
        }
    }
    found
}

/// The same, with gaps up to this radius closed.
fn picture_with_gaps(
    active: &Map,
    gap: usize,
    finder: &EdgeFinder<'_>,
    size: [u32; 2],
    part: ClipRect,
) -> Result<(MaskShape, f64), UnsureReason> {
    let shorter = active.width.min(active.height);
    let thin = (shorter / THIN).max(3);
    let closed = active.closed((gap * shorter).div_ceil(480));
    let filled = closed.filled();
    let solid = filled.opened(thin);
    let coarse = component(&solid);
    // A bright near field may be apart from the rest, and narrow at the apex; letters are not
    // connected to anything solid.
    let fine = filled.opened(2).connected_to(&solid);
    let covered = coarse.set.iter().filter(|set| **set).count();
    let share = covered as f64 / (f64::from(size[0]) * f64::from(size[1]));
    if covered == 0 {
        return Err(UnsureReason::Nothing);
    }
    if share < LEAST_AREA {
        return Err(UnsureReason::Small { share });
    }
    let outline = Outline::new(&coarse);
    let everything = closed.opened(thin);
    let assess = |candidate: &Candidate| assess(candidate, finder, active, &everything);
    let rectangle = rectangle(&outline, finder, size, part).map(|candidate| (assess(&candidate), candidate.shape));
    let fan = fan(&outline, &coarse, &fine, finder, size, part).map(|candidate| (assess(&candidate), candidate.shape));
    let mut best = Err(UnsureReason::NoShape);
    for (assessed, shape) in [fan, rectangle].into_iter().flatten() {
        match (assessed, &best) {
            (Ok(confidence), Ok((_, most))) if confidence <= *most => {}
            (Ok(confidence), _) => best = Ok((shape, confidence)),
            (Err(reason), Err(UnsureReason::NoShape)) => best = Err(reason),
            (Err(_), _) => {}
        }
    }
    best
}

/// Returns the largest component of a map.
fn component(map: &Map) -> Map {
    Map::of_runs(map.width, map.height, &largest_component(&map.runs()))
}

fn rectangle(outline: &Outline, finder: &EdgeFinder<'_>, size: [u32; 2], part: ClipRect) -> Option<Candidate> {
    let extent = [part.width, part.height].map(|count| count as usize);
    let sides = Sides::of_outline(outline, extent)?.fit(finder);
    let rect = sides.rect(extent)?;
    let rect = ClipRect { x: rect.x + part.x, y: rect.y + part.y, ..rect };
    let mask = Mask::rect(size[0], size[1], rect);
    Some(Candidate { shape: MaskShape::Rectangle(rect), mask: cropped(&mask, part), segments: sides.segments() })
}

fn fan(
    outline: &Outline,
    coarse: &Map,
    fine: &Map,
    finder: &EdgeFinder<'_>,
    size: [u32; 2],
    part: ClipRect,
) -> Option<Candidate> {
    let sector = Sector::of_outline(outline, coarse, fine)?.fit(finder)?;
    let fan = sector.fan([part.x, part.y].map(|at| at as usize))?;
    let mask = cropped(&Mask::fan(size[0], size[1], &fan), part);
    (mask.area() > 0).then(|| Candidate { shape: MaskShape::Fan(fan), mask, segments: sector.segments() })
}

/// Returns the part of a mask.
fn cropped(mask: &Mask, part: ClipRect) -> Mask {
    Mask::from_fn(part.width, part.height, |u, v| mask.contains(u + part.x, v + part.y))
}

/// Returns the confidence in a shape: the share of its outline that is seen, times the share of
/// all that differs from the border inside of it.
fn assess(
    Candidate { shape, mask, segments }: &Candidate,
    finder: &EdgeFinder<'_>,
    active: &Map,
    everything: &Map,
) -> Result<f64, UnsureReason> {
    let shape = *shape;
    let share = |part: usize, whole: usize| if whole == 0 { 0.0 } else { part as f64 / whole as f64 };
    let (mut outside, mut all, mut inside) = (0, 0, 0);
    for v in 0..mask.height() {
        for u in 0..mask.width() {
            let at = v as usize * active.width + u as usize;
            let contained = mask.contains(u, v);
            all += usize::from(everything.set[at]);
            outside += usize::from(everything.set[at] && !contained);
            inside += usize::from(active.set[at] && contained);
        }
    }
    let outside = share(outside, all);
    if outside > MOST_OUTSIDE {
        return Err(UnsureReason::Outside { shape, share: outside });
    }
    let inside = share(inside, usize::try_from(mask.area()).unwrap_or(usize::MAX));
    if inside < LEAST_INSIDE {
        return Err(UnsureReason::Dark { shape, share: inside });
    }
    let (mut seen, mut looked) = ([0_usize; 4], [0_usize; 4]);
    for segment in segments {
        let place = finder.locate(segment, 4);
        looked[segment.edge] += usize::from(place != Place::OffFrame);
        seen[segment.edge] += usize::from(matches!(place, Place::At(away) if away.abs() <= NEAR));
    }
    for edge in 0..4 {
        // A short arc has too few segments to be judged by itself.
        if looked[edge] >= 3 && share(seen[edge], looked[edge]) < LEAST_EDGE {
            return Err(UnsureReason::Edge { shape, edge: SIDES[edge] });
        }
    }
    let seen = share(seen.iter().sum(), looked.iter().sum());
    if seen < LEAST_SEEN {
        return Err(UnsureReason::Edges { shape, seen });
    }
    Ok(seen * (1.0 - outside))
}

/// Returns the mask of a recognised picture.
pub(super) fn found(size: [u32; 2], part: ClipRect, shape: MaskShape, confidence: f64, border: Border) -> MaskFound {
    let [width, height] = size;
    let mask = match shape {
        MaskShape::Fan(fan) => Mask::fan(width, height, &fan).intersect(&Mask::rect(width, height, part)),
        MaskShape::Rectangle(rect) => Mask::rect(width, height, rect),
        MaskShape::Whole | MaskShape::Outline => Mask::rect(width, height, part),
    };
    MaskFound { mask: Arc::new(mask), shape, recognised: true, confidence, border: Some(border), reasons: Vec::new() }
}
