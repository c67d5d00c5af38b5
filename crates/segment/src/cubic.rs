//! Cubic interpolation between unequal steps.

use glam::DVec4;

/// Weights of four successive values, and of the derivative by the place, at the share `t` of the
/// middle step. Steps are the distances between the values' places.
///
/// It is the cubic with the slopes of the parabolas through three values each (Catmull & Rom 1974,
/// for unequal steps). Without the first value, or the last, it is the parabola through the others;
/// without both, the straight line.
pub(crate) fn weights(before: Option<f64>, step: f64, after: Option<f64>, t: f64) -> [DVec4; 2] {
    let chord = |a: DVec4, b: DVec4, step: f64| (b - a) / step;
    let middle = chord(DVec4::Y, DVec4::Z, step);
    let first = before.map(|before| (before * middle + step * chord(DVec4::X, DVec4::Y, before)) / (before + step));
    let last = after.map(|after| (after * middle + step * chord(DVec4::Z, DVec4::W, after)) / (after + step));
    let opposite = |slope: DVec4| 2.0 * middle - slope;
    let [first, last] = match (first, last) {
        (Some(first), Some(last)) => [first, last],
        (Some(first), None) => [first, opposite(first)],
        (None, Some(last)) => [opposite(last), last],
        (None, None) => [middle; 2],
    };
    // The cubic of Hermite, by its departure from the straight line.
    let (begin, end) = (first - middle, middle - last);
    let value = DVec4::Y.lerp(DVec4::Z, t) + step * t * (1.0 - t) * ((1.0 - t) * begin + t * end);
    let derivative = middle + (1.0 - t) * (1.0 - 3.0 * t) * begin + t * (2.0 - 3.0 * t) * end;
    [value, derivative]
}
