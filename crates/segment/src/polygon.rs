//! Polygons in a plane.

use glam::DVec2;

/// Places along each edge of the first search of the largest disc.
const GRID: usize = 16;
/// Precision of its centre, as a share of the polygon's extent.
const PRECISION: f64 = 1e-4;

/// Returns the edges, the last of which ends at the first corner.
fn edges(polygon: &[DVec2]) -> impl Iterator<Item = [DVec2; 2]> + Clone {
    polygon.iter().zip(polygon.iter().cycle().skip(1)).map(|(a, b)| [*a, *b])
}

/// Returns the area, which is never negative, and its centroid.
pub(crate) fn area(polygon: &[DVec2]) -> (f64, DVec2) {
    let origin = polygon[0];
    let (twice, sum) = edges(polygon).fold((0.0, DVec2::ZERO), |(twice, sum), [a, b]| {
        let (a, b) = (a - origin, b - origin);
        let cross = a.perp_dot(b);
        (twice + cross, sum + (a + b) * cross)
    });
    (0.5 * f64::abs(twice), origin + sum / (3.0 * twice))
}

/// Returns the distance to the polygon, positive inside.
pub(crate) fn distance(polygon: &[DVec2], p: DVec2) -> f64 {
    let (mut least, mut is_inside) = (f64::INFINITY, false);
    for [a, b] in edges(polygon) {
        let (edge, to) = (b - a, p - a);
        let share = (to.dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
        least = least.min((to - edge * share).length_squared());
        let is_left = p.x < edge.x * (to.y / edge.y) + a.x;
        is_inside ^= ((a.y > p.y) != (b.y > p.y)) && is_left;
    }
    if is_inside { least.sqrt() } else { -least.sqrt() }
}

/// Whether two edges without a common corner cross or touch.
pub(crate) fn crosses_itself(polygon: &[DVec2]) -> bool {
    let all: Vec<[DVec2; 2]> = edges(polygon).collect();
    let last = all.len() - 1;
    let others = |first: usize| first + 2..if first == 0 { last } else { last + 1 };
    (0..all.len()).any(|first| others(first).any(|second| cross(all[first], all[second])))
}

fn cross([a, b]: [DVec2; 2], [c, d]: [DVec2; 2]) -> bool {
    let are_apart = a.max(b).cmplt(c.min(d)).any() || c.max(d).cmplt(a.min(b)).any();
    let sides = |from: DVec2, to: DVec2, p: DVec2, q: DVec2| {
        let side = |p: DVec2| (to - from).perp_dot(p - from);
        let [p, q] = [side(p), side(q)];
        !((p > 0.0 && q > 0.0) || (p < 0.0 && q < 0.0))
    };
    !are_apart && sides(a, b, c, d) && sides(c, d, a, b)
}

/// Returns the centre and the radius of the largest disc within the polygon, by a search that
/// begins on a grid and narrows around the best place.
pub(crate) fn largest_disc(polygon: &[DVec2]) -> (DVec2, f64) {
    let (low, high) = polygon.iter().fold((polygon[0], polygon[0]), |(low, high), p| (low.min(*p), high.max(*p)));
    let grid = (0..=GRID * GRID + 2 * GRID).map(|n| {
        let share = DVec2::new((n % (GRID + 1)) as f64, (n / (GRID + 1)) as f64) / GRID as f64;
        low + (high - low) * share
    });
    let better = |best: (DVec2, f64), p: DVec2| {
        let radius = distance(polygon, p);
        if radius > best.1 { (p, radius) } else { best }
    };
    let mut best = grid.fold((low, f64::NEG_INFINITY), better);
    let mut step = (high - low).max_element() / GRID as f64;
    while step > PRECISION * (high - low).max_element() {
        let around = (0..9).map(|n| best.0 + step * DVec2::new(f64::from(n % 3 - 1), f64::from(n / 3 - 1)));
        let next = around.fold(best, better);
        if next.1 <= best.1 {
            step *= 0.5;
        }
        best = next;
    }
    best
}
