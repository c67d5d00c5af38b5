//! The closed curve through the points of a contour, as a polygon.

use glam::DVec2;

/// Edges of the polygon between two points.
pub(crate) const EDGES: usize = 8;

/// Returns the closed centripetal Catmull–Rom spline through points (Yuksel, Schaefer & Keyser
/// 2011), as a polygon of [`EDGES`] edges from each point to the next. Successive points must
/// differ.
pub(crate) fn closed(points: &[DVec2]) -> Vec<DVec2> {
    let at = |n: usize| points[n % points.len()];
    let piece = |n: usize| {
        let four = [at(n + points.len() - 1), at(n), at(n + 1), at(n + 2)];
        (0..EDGES).map(move |edge| between(four, edge as f64 / EDGES as f64))
    };
    (0..points.len()).flat_map(piece).collect()
}

/// Returns the point at a share of the way from the second of four points to the third (Barry &
/// Goldman 1988).
fn between(four: [DVec2; 4], share: f64) -> DVec2 {
    let [a, b, c] = [0, 1, 2].map(|n| four[n].distance(four[n + 1]).sqrt());
    let knots = [-a, 0.0, b, b + c];
    let t = share * b;
    let blend = |p: DVec2, q: DVec2, from: usize, to: usize| p.lerp(q, (t - knots[from]) / (knots[to] - knots[from]));
    let first = [0, 1, 2].map(|n| blend(four[n], four[n + 1], n, n + 1));
    let second = [0, 1].map(|n| blend(first[n], first[n + 1], n, n + 2));
    blend(second[0], second[1], 1, 2)
}
