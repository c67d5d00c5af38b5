//! A fan: two straight edges that meet in an apex, and two arcs about it. The straight edges are
//! found first, among lines through pairs of outline points; then the arcs, along rays from the
//! apex; then all of them are fitted together by least squares.

use calibration::least_squares::{Loss, Parameters, Settings, Whitening, solve};
use sonoweave_core::region::Fan;

use super::edges::{EdgeFinder, Place, Segment, segments};
use super::outline::Outline;
use super::plane::Map;
use super::rectangle::densest;

/// Outline points from which lines are drawn, and their least distance, pixels.
const PAIRED: usize = 64;
const LEAST_APART: f64 = 10.0;
/// Distance of outline points that count for a line, pixels.
const NEAR_LINE: f64 = 1.5;
/// Angles of the left edge, degrees from down; those of the right one are mirrored.
const LEFT: [f64; 2] = [-88.0, 25.0];
/// Least angle of a fan, degrees: lines of a rectangle meet far away.
const LEAST_ANGLE: f64 = 10.0;
/// Rays on which arcs are looked for, and the least share of them that must meet one.
const RAYS: usize = 160;
const LEAST_RAYS: f64 = 0.2;
/// Consecutive pixels on a ray that begin a picture.
const SUSTAINED: usize = 3;
/// Pixels at the ends of an edge that do not count: corners are blurred.
const CORNER: f64 = 6.0;
/// Reach of the measurements, pixels.
const REACHES: [usize; 5] = [8, 8, 6, 4, 4];

/// Edges of a fan as numbers of segments: left and right, top and bottom.
const STRAIGHT: [usize; 2] = [0, 1];
const ARCS: [usize; 2] = [2, 3];

/// A fan's numbers: pixels and radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sector {
    apex: [f64; 2],
    radii: [f64; 2],
    angles: [f64; 2],
}

/// A line, by a point and its angle from down.
#[derive(Debug, Clone, Copy)]
struct Line {
    point: [f64; 2],
    angle: f64,
}

impl Line {
    /// Returns a point's distances across the line, positive towards growing angles, and along.
    fn across_and_along(&self, point: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.angle.sin_cos();
        let (x, y) = (point[0] - self.point[0], point[1] - self.point[1]);
        [x * cos - y * sin, x * sin + y * cos]
    }

    /// Returns the line through two of the points with the most points near it.
    fn through(points: &[[f64; 2]], angles_deg: [f64; 2]) -> Option<Self> {
        let stride = points.len().div_ceil(PAIRED).max(1);
        let chosen: Vec<[f64; 2]> = points.iter().step_by(stride).copied().collect();
        let [least, most] = angles_deg.map(f64::to_radians);
        let mut best: Option<(usize, Self)> = None;
        for (at, &a) in chosen.iter().enumerate() {
            for &b in &chosen[at + 1..] {
                let [upper, lower] = if a[1] <= b[1] { [a, b] } else { [b, a] };
                let (x, y) = (lower[0] - upper[0], lower[1] - upper[1]);
                let angle = x.atan2(y);
                if x.hypot(y) < LEAST_APART || !(least..=most).contains(&angle) {
                    continue;
                }
                let line = Self { point: upper, angle };
                let near = points.iter().filter(|point| line.across_and_along(**point)[0].abs() <= NEAR_LINE).count();
                if best.is_none_or(|(most, _)| near > most) {
                    best = Some((near, line));
                }
            }
        }
        best.map(|(_, line)| line)
    }

    /// Returns the place where two lines meet; `None` if they are nearly parallel.
    fn meets(&self, other: &Self) -> Option<[f64; 2]> {
        let turn = (other.angle - self.angle).sin();
        if other.angle - self.angle < LEAST_ANGLE.to_radians() {
            return None;
        }
        let [across, _] = other.across_and_along(self.point);
        // Each pixel along this line changes the distance across the other by −sin(turn).
        let along = across / turn;
        let (sin, cos) = self.angle.sin_cos();
        Some([self.point[0] + along * sin, self.point[1] + along * cos])
    }
}

impl Sector {
    /// Returns the fan of a component, by its outline and its map. `fine` is the map of
    /// everything solid, with its narrow parts.
    pub(super) fn of_outline(outline: &Outline, coarse: &Map, fine: &Map) -> Option<Self> {
        let place = |a: usize, b: usize| [a as f64, b as f64];
        let top = || outline.top.ends.iter().map(|&[u, v]| place(u, v));
        let left: Vec<[f64; 2]> = outline.left.ends.iter().map(|&[v, u]| place(u, v)).chain(top()).collect();
        let right: Vec<[f64; 2]> = outline.right.ends.iter().map(|&[v, u]| place(u, v)).chain(top()).collect();
        let left = Line::through(&left, LEFT)?;
        let right = Line::through(&right, [-LEFT[1], -LEFT[0]])?;
        let apex = left.meets(&right)?;
        let is_below = |line: &Line| Line { point: apex, ..*line }.across_and_along(line.point)[1] > -CORNER;
        if !is_below(&left) || !is_below(&right) {
            return None;
        }
        let angles = [left.angle, right.angle];
        let radii = radii(apex, angles, coarse, fine)?;
        Some(Self { apex, radii, angles })
    }

    /// Moves the fan to the edges that are seen.
    pub(super) fn fit(mut self, finder: &EdgeFinder<'_>) -> Option<Self> {
        for (round, reach) in REACHES.into_iter().enumerate() {
            let mut seen: [Vec<[f64; 2]>; 4] = Default::default();
            for segment in self.segments() {
                let Place::At(away) = finder.locate(&segment, reach) else { continue };
                let middle = segment.points.len() / 2;
                let (point, normal) = (segment.points[middle], segment.normals[middle]);
                seen[segment.edge].push([point[0] + away * normal[0], point[1] + away * normal[1]]);
            }
            // Far outliers are weighed down first, and left out once the fan is near.
            let loss = if round < 2 { Loss::Cauchy } else { Loss::Tukey };
            self = self.solved(&seen, loss)?;
        }
        Some(self)
    }

    /// Returns the fan nearest to points of its edges; an edge without points stays.
    fn solved(&self, seen: &[Vec<[f64; 2]>; 4], loss: Loss) -> Option<Self> {
        let mut parameters = Parameters::new();
        let apex = parameters.vector("apex", ["u", "v"], "px", 10.0, self.apex);
        let angles = self.angles.map(|angle| parameters.vector("edge", [""], "rad", 0.02, [angle]));
        let radii = self.radii.map(|radius| parameters.vector("arc", [""], "px", 5.0, [radius]));
        for side in 0..2 {
            if seen[STRAIGHT[side]].is_empty() {
                parameters.hold(angles[side]);
            }
            if seen[ARCS[side]].is_empty() {
                parameters.hold(radii[side]);
            }
        }
        let pixel = Whitening::sd(1.0);
        let solution = solve(&parameters, &Settings::robust(loss), |state, blocks| {
            let [x, y] = state.vector(apex);
            for side in 0..2 {
                let [angle] = state.vector(angles[side]);
                let (sin, cos) = angle.sin_cos();
                for point in &seen[STRAIGHT[side]] {
                    let [across, along] = Line { point: [x, y], angle }.across_and_along(*point);
                    blocks.add([across], &pixel).by(apex, [[-cos, sin]]).by(angles[side], [[-along]]);
                }
                let [radius] = state.vector(radii[side]);
                for point in &seen[ARCS[side]] {
                    let (u, v) = (point[0] - x, point[1] - y);
                    let away = u.hypot(v).max(f64::MIN_POSITIVE);
                    let residual = blocks.add([away - radius], &pixel);
                    residual.by(apex, [[-u / away, -v / away]]).by(radii[side], [[-1.0]]);
                }
            }
        });
        let state = solution.ok()?.state;
        let one = |parameter| state.vector::<1>(parameter)[0];
        let radii = radii.map(one);
        Some(Self { apex: state.vector(apex), radii: [radii[0].max(0.0), radii[1]], angles: angles.map(one) })
    }

    /// Returns the outline as segments.
    pub(super) fn segments(&self) -> Vec<Segment> {
        let [x, y] = self.apex;
        let mut all = Vec::new();
        for (side, angle) in self.angles.into_iter().enumerate() {
            let (sin, cos) = angle.sin_cos();
            let outwards = if side == 0 { -1.0 } else { 1.0 };
            let normal = [outwards * cos, -outwards * sin];
            let count = (self.radii[1] - self.radii[0] - 2.0 * CORNER).clamp(0.0, 1e5) as usize;
            let radii = (0..count).map(|at| self.radii[0] + CORNER + at as f64);
            let line: Vec<_> = radii.map(|radius| ([x + radius * sin, y + radius * cos], normal)).collect();
            all.extend(segments(STRAIGHT[side], &line));
        }
        for (side, radius) in self.radii.into_iter().enumerate() {
            let length = radius * (self.angles[1] - self.angles[0]);
            // An arc as short as two corners has no other part.
            let corner = CORNER.min(0.25 * length);
            let count = (length - 2.0 * corner).clamp(0.0, 1e5) as usize;
            let outwards = if side == 0 { -1.0 } else { 1.0 };
            let line = (0..count).map(|at| {
                let (sin, cos) = (self.angles[0] + (corner + at as f64 + 0.5) / radius).sin_cos();
                ([x + radius * sin, y + radius * cos], [outwards * sin, outwards * cos])
            });
            all.extend(segments(ARCS[side], &line.collect::<Vec<_>>()));
        }
        all.retain(|segment| !segment.points.is_empty());
        all
    }

    /// Returns the fan in the whole frame, of which this one's coordinates are a part that
    /// begins at `offset`.
    pub(super) fn fan(&self, offset: [usize; 2]) -> Option<Fan> {
        let round = |value: f64, by: f64| (value * by).round() / by;
        let apex = [0, 1].map(|axis| round(self.apex[axis] + offset[axis] as f64, 100.0));
        let angles = self.angles.map(|angle| round(angle.to_degrees(), 1000.0));
        Fan::new(apex, self.radii.map(|radius| round(radius, 100.0)), angles).ok()
    }
}

/// Returns the distances from the apex at which most rays enter what is solid, and leave the
/// component. An arc
/// beyond the frame is that of the frame's nearest or farthest pixel.
fn radii(apex: [f64; 2], angles: [f64; 2], coarse: &Map, fine: &Map) -> Option<[f64; 2]> {
    let far = [0.0, coarse.width as f64]
        .into_iter()
        .flat_map(|u| [0.0, coarse.height as f64].map(|v| (u - apex[0]).hypot(v - apex[1])))
        .fold(0.0, f64::max);
    let (mut first, mut last, mut nearest) = (Vec::new(), Vec::new(), f64::INFINITY);
    for ray in 0..RAYS {
        // Rays close to the straight edges are left out.
        let part = 0.04 + 0.92 * ray as f64 / (RAYS - 1) as f64;
        let (sin, cos) = (angles[0] + part * (angles[1] - angles[0])).sin_cos();
        let pixel = |radius: usize| {
            let (u, v) = (apex[0] + radius as f64 * sin, apex[1] + radius as f64 * cos);
            (u.round() as i64, v.round() as i64)
        };
        let is_inside = |radius: &usize| {
            let (u, v) = pixel(*radius);
            (0..coarse.width as i64).contains(&u) && (0..coarse.height as i64).contains(&v)
        };
        let inside: Vec<usize> = (0..far.min(1e5) as usize).filter(is_inside).collect();
        let (Some(&enters), Some(&leaves)) = (inside.first(), inside.last()) else { continue };
        if enters > 0 {
            nearest = nearest.min(enters as f64);
        } else {
            nearest = 0.0;
        }
        let is_set = |map: &Map, radius: usize| {
            let (u, v) = pixel(radius);
            map.at(u, v)
        };
        let begin = inside.windows(SUSTAINED).find(|radii| radii.iter().all(|&radius| is_set(fine, radius)));
        first.extend(begin.map(|radii| radii[0]).filter(|&begin| begin > enters || enters == 0).map(|r| r as f64));
        let end = inside.iter().rev().find(|&&radius| is_set(coarse, radius));
        last.extend(end.filter(|&&end| end + 1 < leaves).map(|&r| r as f64));
    }
    let least = LEAST_RAYS * RAYS as f64;
    let chosen = |values: &[f64], frame: f64| {
        if (values.len() as f64) < least { Some(frame) } else { densest(values) }
    };
    let radii = [chosen(&first, nearest)?, chosen(&last, far)?];
    (radii[0].is_finite() && radii[0] + LEAST_APART < radii[1]).then_some(radii)
}
