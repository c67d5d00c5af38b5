//! Outlines of the holes and the present slice, for drawing over a view of the volume, and in
//! planes through it.

use glam::DVec3;

/// Outlines to draw; world mm.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Outlines {
    /// The corners of the present slice's data, in order; `None` while none arrives.
    pub present: Option<[DVec3; 4]>,
    /// For each gap, the corners on the slice before it and on the one behind it, in order.
    pub holes: Vec<[[DVec3; 4]; 2]>,
}

/// A rectangle of a plane in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneRect {
    /// Its upper left corner, mm.
    pub origin: DVec3,
    /// Unit direction of its upper side.
    pub right: DVec3,
    /// Unit direction of its left side, perpendicular to the upper one.
    pub down: DVec3,
    /// Lengths of both, mm.
    pub size: [f64; 2],
}

impl Outlines {
    /// Returns the middle quadrilaterals of the gaps, half way between their slices.
    pub fn quads(&self) -> impl Iterator<Item = [DVec3; 4]> {
        self.holes.iter().map(|[a, b]| [0, 1, 2, 3].map(|corner| a[corner].midpoint(b[corner])))
    }

    /// Returns the intersection of a plane with the present slice: a segment within the
    /// rectangle, like those of [`Self::in_plane`].
    pub fn present_in(&self, plane: &PlaneRect) -> Option<[[f64; 2]; 2]> {
        clipped(cut(self.present?, plane)?, plane.size)
    }

    /// Returns the intersections of a plane with the gaps' surfaces: segments within the
    /// rectangle, from its upper left corner, mm to the right and down.
    pub fn in_plane(&self, plane: &PlaneRect) -> Vec<[[f64; 2]; 2]> {
        self.holes.iter().flat_map(faces).filter_map(|face| clipped(cut(face, plane)?, plane.size)).collect()
    }
}

/// Returns the six sides of a gap.
fn faces([a, b]: &[[DVec3; 4]; 2]) -> [[DVec3; 4]; 6] {
    let side = |n: usize| [a[n], a[(n + 1) % 4], b[(n + 1) % 4], b[n]];
    [*a, *b, side(0), side(1), side(2), side(3)]
}

/// Returns the intersection of a plane with a quadrilateral.
fn cut(face: [DVec3; 4], plane: &PlaneRect) -> Option<[[f64; 2]; 2]> {
    let normal = plane.right.cross(plane.down);
    let height = face.map(|corner| (corner - plane.origin).dot(normal));
    let mut crossings = (0..4).filter_map(|n| {
        let (from, to) = (height[n], height[(n + 1) % 4]);
        // Points in the plane count as above it.
        ((from < 0.0) != (to < 0.0)).then(|| {
            let at = face[n].lerp(face[(n + 1) % 4], from / (from - to)) - plane.origin;
            [at.dot(plane.right), at.dot(plane.down)]
        })
    });
    Some([crossings.next()?, crossings.next()?])
}

/// Clips a segment to a rectangle (Liang and Barsky).
fn clipped([from, to]: [[f64; 2]; 2], size: [f64; 2]) -> Option<[[f64; 2]; 2]> {
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for axis in 0..2 {
        let step = to[axis] - from[axis];
        if step == 0.0 {
            if !(0.0..=size[axis]).contains(&from[axis]) {
                return None;
            }
            continue;
        }
        let (low, high) = (-from[axis] / step, (size[axis] - from[axis]) / step);
        enter = enter.max(low.min(high));
        leave = leave.min(low.max(high));
    }
    let at = |share: f64| [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]));
    (enter < leave).then(|| [at(enter), at(leave)])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gap of 10 × 8 mm, from z = 0 to z = 6.
    fn outlines() -> Outlines {
        let quad = |z: f64| [[0.0, 0.0], [10.0, 0.0], [10.0, 8.0], [0.0, 8.0]].map(|[x, y]| DVec3::new(x, y, z));
        Outlines { present: None, holes: vec![[quad(0.0), quad(6.0)]] }
    }

    fn length(segments: &[[[f64; 2]; 2]]) -> f64 {
        segments.iter().map(|[a, b]| (a[0] - b[0]).hypot(a[1] - b[1])).sum()
    }

    #[test]
    fn plane_across_gap_shows_its_outline() {
        let outlines = outlines();
        // Across: 10 mm by 6 mm.
        let across =
            PlaneRect { origin: DVec3::new(-5.0, 4.0, -7.0), right: DVec3::X, down: DVec3::Z, size: [40.0, 40.0] };
        let segments = outlines.in_plane(&across);
        assert_eq!(segments.len(), 4);
        assert!((length(&segments) - 32.0).abs() < 1e-9, "{segments:?}");
        let all: Vec<[f64; 2]> = segments.iter().flatten().copied().collect();
        let bound = |axis: usize, pick: fn(f64, f64) -> f64| all.iter().map(|at| at[axis]).reduce(pick).unwrap();
        assert_eq!([bound(0, f64::min), bound(0, f64::max)], [5.0, 15.0]);
        assert_eq!([bound(1, f64::min), bound(1, f64::max)], [7.0, 13.0]);
        // The same plane with a smaller rectangle: it shows half of each long side, and one
        // short one.
        let part = PlaneRect { size: [10.0, 40.0], ..across };
        assert!((length(&outlines.in_plane(&part)) - 16.0).abs() < 1e-9);
        let beside = PlaneRect { origin: DVec3::new(-5.0, 9.0, -7.0), ..across };
        assert!(outlines.in_plane(&beside).is_empty());
        let [quad] = outlines.quads().collect::<Vec<_>>()[..] else { panic!() };
        assert!(quad.iter().all(|corner| corner.z == 3.0));
    }

    #[test]
    fn oblique_plane_cut_has_exact_length() {
        let slope = DVec3::new(1.0, 0.0, 1.0).normalize();
        let plane = PlaneRect { origin: DVec3::new(-2.0, 0.0, -2.0), right: slope, down: DVec3::Y, size: [50.0, 50.0] };
        // From (0, ·, 0) to (6, ·, 6): 6√2 by 8.
        let segments = outlines().in_plane(&plane);
        assert!((length(&segments) - 2.0 * (6.0 * 2.0_f64.sqrt() + 8.0)).abs() < 1e-9, "{segments:?}");
    }
}
