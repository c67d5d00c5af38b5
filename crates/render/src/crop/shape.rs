//! Whether an operation hides a point, or all or nothing of a ball.

use glam::{DVec2, DVec3};

use super::Operation;

/// An operation, in a form that tests points.
pub(super) enum Shape {
    /// Hides the outside of a box.
    Box { low: DVec3, high: DVec3 },
    /// Hides where the product with the normal is above a distance.
    Plane { normal: DVec3, distance: f64 },
    /// Hides below the heights over a sheet.
    Surface { origin: DVec3, across: DVec3, along: DVec3, normal: DVec3, heights: [[f64; 3]; 3], bounds: [f64; 2] },
    /// Hides a ball.
    Ball { centre: DVec3, radius: f64 },
    /// Hides the inside or outside of an outline.
    Lasso(Box<Lasso>),
}

/// An outline in a plane, seen from an eye.
pub(super) struct Lasso {
    origin: DVec3,
    right: DVec3,
    down: DVec3,
    forward: DVec3,
    eye: Option<f64>,
    outline: Vec<DVec2>,
    outside: bool,
    depth: f64,
}

impl Shape {
    /// Returns the shape of an operation; `None` if it hides nothing.
    pub(super) fn new(operation: &Operation) -> Option<Self> {
        Some(match operation {
            Operation::OutsideBox { low, high } => Self::Box { low: (*low).into(), high: (*high).into() },
            Operation::BeyondPlane { point, normal } => {
                let normal = DVec3::from(*normal).normalize_or_zero();
                Self::Plane { normal, distance: normal.dot((*point).into()) }
            }
            Operation::BeforeSurface { origin, across, along, heights } => {
                let (across, along) = (DVec3::from(*across), DVec3::from(*along));
                let normal = across.cross(along).normalize_or_zero();
                let all = heights.as_flattened();
                let [least, most] = [
                    all.iter().copied().fold(f64::INFINITY, f64::min),
                    all.iter().copied().fold(f64::NEG_INFINITY, f64::max),
                ];
                // The weights of three heights along an edge are 5/4 at most, taken absolutely:
                // beyond their mean, all nine reach (5/4)² of half their range.
                let (middle, reach) = (0.5 * (least + most), 0.5 * (most - least) * 1.5625);
                let bounds = [middle - reach, middle + reach];
                Self::Surface { origin: (*origin).into(), across, along, normal, heights: *heights, bounds }
            }
            Operation::Ball { centre, radius } => Self::Ball { centre: (*centre).into(), radius: *radius },
            Operation::Lasso { origin, right, down, eye, outline, outside, depth } => {
                let right = DVec3::from(*right).normalize_or_zero();
                let forward = right.cross((*down).into()).normalize_or_zero();
                Self::Lasso(Box::new(Lasso {
                    origin: (*origin).into(),
                    right,
                    down: forward.cross(right),
                    forward,
                    eye: *eye,
                    outline: outline.iter().map(|at| DVec2::from(*at)).collect(),
                    outside: *outside,
                    depth: depth.unwrap_or(f64::INFINITY),
                }))
            }
            Operation::Nothing {} => return None,
        })
    }

    /// Returns whether a point is hidden, mm of the world.
    pub(super) fn hides(&self, at: DVec3) -> bool {
        match self {
            Self::Box { low, high } => !(at.cmpge(*low).all() && at.cmple(*high).all()),
            Self::Plane { normal, distance } => normal.dot(at) > *distance,
            Self::Surface { origin, across, along, normal, heights, .. } => {
                let from = at - *origin;
                let [u, v] = [across, along].map(|edge| (from.dot(*edge) / edge.length_squared()).clamp(0.0, 1.0));
                let rows = heights.map(|row| quadratic(row, u));
                from.dot(*normal) < quadratic(rows, v)
            }
            Self::Ball { centre, radius } => at.distance_squared(*centre) < radius * radius,
            Self::Lasso(lasso) => lasso.hides(at),
        }
    }

    /// Returns whether all (`true`) or nothing (`false`) of a ball is hidden; `None` if part of it
    /// may be.
    pub(super) fn hides_ball(&self, centre: DVec3, radius: f64) -> Option<bool> {
        match self {
            Self::Box { low, high } => {
                let inside = (centre - *low).min(*high - centre).min_element();
                decided(-inside, radius)
            }
            Self::Plane { normal, distance } => decided(normal.dot(centre) - distance, radius),
            Self::Surface { origin, normal, bounds: [least, most], .. } => {
                let height = (centre - *origin).dot(*normal);
                if height > most + radius { Some(false) } else { (height < least - radius).then_some(true) }
            }
            Self::Ball { centre: own, radius: reach } => decided(reach - centre.distance(*own), radius),
            Self::Lasso(lasso) => lasso.hides_ball(centre, radius),
        }
    }
}

/// Returns whether all or nothing of a ball is hidden. A point is hidden where a function is above
/// 0, which changes by at most 1 a mm and has this value at the centre.
fn decided(value: f64, radius: f64) -> Option<bool> {
    if value > radius { Some(true) } else { (value < -radius).then_some(false) }
}

/// Interpolates between three numbers at 0, ½ and 1.
fn quadratic([a, b, c]: [f64; 3], at: f64) -> f64 {
    let (from, to) = (1.0 - at, 2.0 * at - 1.0);
    -from * to * a + 4.0 * at * from * b + at * to * c
}

impl Lasso {
    /// Returns the place of a point in the plane, and its depth behind it; `None` behind the eye.
    fn project(&self, at: DVec3) -> Option<(DVec2, f64)> {
        let from = at - self.origin;
        let depth = from.dot(self.forward);
        let scale = match self.eye {
            None => 1.0,
            Some(eye) if eye + depth > 0.0 => eye / (eye + depth),
            Some(_) => return None,
        };
        Some((scale * DVec2::new(from.dot(self.right), from.dot(self.down)), depth))
    }

    fn hides(&self, at: DVec3) -> bool {
        let Some((place, depth)) = self.project(at) else { return false };
        depth <= self.depth && self.encloses(place) != self.outside
    }

    fn encloses(&self, at: DVec2) -> bool {
        let crosses = |from: DVec2, to: DVec2| {
            (from.y > at.y) != (to.y > at.y) && at.x < from.x + (at.y - from.y) / (to.y - from.y) * (to.x - from.x)
        };
        self.edges().filter(|[from, to]| crosses(*from, *to)).count() % 2 == 1
    }

    fn hides_ball(&self, centre: DVec3, radius: f64) -> Option<bool> {
        let depth = (centre - self.origin).dot(self.forward);
        if depth > self.depth + radius {
            return Some(false);
        }
        // Nearer than the eye, the picture of the ball has no bounds.
        let nearest = depth - radius;
        if self.eye.is_some_and(|eye| eye + nearest <= 0.0) {
            return None;
        }
        let (place, _) = self.project(centre)?;
        // The ball's points lie within its radius beside the centre, enlarged as at its nearest
        // point; and what lies at another depth moves towards the middle of the picture or away.
        let reach = match self.eye {
            None => radius,
            Some(eye) => {
                let enlarged = eye / (eye + nearest);
                radius * enlarged + place.length() * (enlarged * (eye + depth) / eye - 1.0)
            }
        };
        if self.edges().any(|[from, to]| distance(place, from, to) <= reach) {
            return None;
        }
        match self.encloses(place) != self.outside {
            false => Some(false),
            true => (depth + radius <= self.depth).then_some(true),
        }
    }

    fn edges(&self) -> impl Iterator<Item = [DVec2; 2]> + '_ {
        let next = self.outline.iter().cycle().skip(1);
        self.outline.iter().zip(next).map(|(from, to)| [*from, *to])
    }
}

/// Returns the distance of a point from a piece of a line.
fn distance(at: DVec2, from: DVec2, to: DVec2) -> f64 {
    let edge = to - from;
    let along = if edge.length_squared() > 0.0 { (at - from).dot(edge) / edge.length_squared() } else { 0.0 };
    at.distance(from + along.clamp(0.0, 1.0) * edge)
}
