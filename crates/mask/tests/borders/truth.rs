//! Distances between a found shape and the true one.

use mask::MaskShape;
use sonoweave_core::region::{ClipRect, Fan};

use crate::painter::{Scene, Truth};

/// Returns the accuracy of a found shape, pixels: of a rectangle, the largest error of a side;
/// of a fan, the largest distance from either outline to the other within the frame. `None` for
/// another kind of shape.
pub(crate) fn error_px(scene: &Scene, found: MaskShape) -> Option<f64> {
    match (scene.truth, found) {
        (Truth::Rectangle(truth), MaskShape::Rectangle(found)) => Some(sides(truth, found)),
        (Truth::Fan(truth), MaskShape::Fan(found)) => {
            let [truth, found] = [truth, found].map(|fan| outline(&fan, scene.size));
            Some(farthest(&truth, &found).max(farthest(&found, &truth)))
        }
        _ => None,
    }
}

fn sides(a: ClipRect, b: ClipRect) -> f64 {
    let sides = |r: ClipRect| [r.x, r.x + r.width, r.y, r.y + r.height];
    sides(a).iter().zip(sides(b)).map(|(a, b)| f64::from(a.abs_diff(b))).fold(0.0, f64::max)
}

/// Points of a fan's outline in the frame, half a pixel apart. The frame cuts it at its border.
fn outline(fan: &Fan, size: [u32; 2]) -> Vec<[f64; 2]> {
    let ([u, v], [r0, r1], angles) = (fan.origin_px(), fan.radii_px(), fan.angles_deg().map(f64::to_radians));
    let at = |radius: f64, angle: f64| [u + radius * angle.sin(), v + radius * angle.cos()];
    let mut points = Vec::new();
    for angle in angles {
        let count = (2.0 * (r1 - r0)) as usize;
        points.extend((0..=count).map(|i| at(r0 + (r1 - r0) * i as f64 / count as f64, angle)));
    }
    for radius in [r0, r1] {
        let count = (2.0 * radius * (angles[1] - angles[0])) as usize + 1;
        points.extend((0..=count).map(|i| at(radius, angles[0] + (angles[1] - angles[0]) * i as f64 / count as f64)));
    }
    let most = size.map(|n| f64::from(n) - 1.0);
    points.retain(|[u, v]| (0.0..=most[0]).contains(u) && (0.0..=most[1]).contains(v));
    points
}

/// The largest distance from points to the nearest of others.
fn farthest(points: &[[f64; 2]], others: &[[f64; 2]]) -> f64 {
    let nearest = |p: &[f64; 2]| {
        let squares = others.iter().map(|q| (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2));
        squares.fold(f64::INFINITY, f64::min).sqrt()
    };
    points.iter().map(nearest).fold(0.0, f64::max)
}
