//! Convex solids: containment, distance to the surface, and intersection with a straight line.

use glam::{DMat3, DVec3};

/// A convex solid, mm in the body's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Everything behind a plane.
    HalfSpace {
        /// A point of the plane.
        point: DVec3,
        /// Unit vector out of the solid.
        normal: DVec3,
    },
    /// An ellipsoid; a sphere if the radii are equal.
    Ellipsoid {
        /// Its middle.
        centre: DVec3,
        /// Its axes, orthonormal columns.
        axes: DMat3,
        /// Half of its length along each axis.
        radii: DVec3,
    },
    /// All points within a distance of a line segment: a rod with round ends.
    Capsule {
        /// One end of the segment.
        from: DVec3,
        /// The other end.
        to: DVec3,
        /// The distance.
        radius: f64,
    },
}

impl Shape {
    /// Returns a sphere.
    pub fn sphere(centre: DVec3, radius: f64) -> Self {
        Self::ellipsoid(centre, DVec3::splat(radius))
    }

    /// Returns an ellipsoid along the body's axes.
    pub fn ellipsoid(centre: DVec3, radii: DVec3) -> Self {
        Self::Ellipsoid { centre, axes: DMat3::IDENTITY, radii }
    }

    /// Returns an ellipsoid of revolution whose longest axis leads from one point to another.
    pub fn spindle(from: DVec3, to: DVec3, radius: f64) -> Self {
        let along = (to - from).normalize();
        let (second, third) = along.any_orthonormal_pair();
        Self::Ellipsoid {
            centre: 0.5 * (from + to),
            axes: DMat3::from_cols(along, second, third),
            radii: DVec3::new(0.5 * from.distance(to), radius, radius),
        }
    }

    /// Whether a point lies inside; the surface counts as inside.
    pub fn contains(&self, p: DVec3) -> bool {
        match self {
            Self::HalfSpace { point, normal } => (p - *point).dot(*normal) <= 0.0,
            Self::Ellipsoid { centre, axes, radii } => {
                (axes.transpose() * (p - *centre) / *radii).length_squared() <= 1.0
            }
            Self::Capsule { from, to, radius } => {
                (p - nearest_on_line(*from, *to, p)).length_squared() <= radius * radius
            }
        }
    }

    /// Returns the distance to the surface, on either side, mm: exact except for ellipsoids,
    /// for which it is a lower bound.
    pub fn clearance(&self, p: DVec3) -> f64 {
        match self {
            Self::HalfSpace { point, normal } => (p - *point).dot(*normal).abs(),
            Self::Ellipsoid { centre, axes, radii } => {
                // The scaled length changes by at most 1/(smallest radius) per mm.
                ((axes.transpose() * (p - *centre) / *radii).length() - 1.0).abs() * radii.min_element()
            }
            Self::Capsule { from, to, radius } => (p.distance(nearest_on_line(*from, *to, p)) - radius).abs(),
        }
    }

    /// Returns the unit vector out of the solid at a point of its surface.
    pub fn normal(&self, p: DVec3) -> DVec3 {
        match self {
            Self::HalfSpace { normal, .. } => *normal,
            Self::Ellipsoid { centre, axes, radii } => {
                (*axes * (axes.transpose() * (p - *centre) / (*radii * *radii))).normalize_or_zero()
            }
            Self::Capsule { from, to, .. } => (p - nearest_on_line(*from, *to, p)).normalize_or_zero(),
        }
    }

    /// Returns the interval of t in which the line `origin + t·direction` (a unit vector) runs
    /// inside. t is in mm and may be infinite. `None` if the line misses.
    pub fn span(&self, origin: DVec3, direction: DVec3) -> Option<[f64; 2]> {
        match self {
            Self::HalfSpace { point, normal } => {
                let (height, slope) = ((origin - *point).dot(*normal), direction.dot(*normal));
                if slope.abs() < 1e-12 {
                    return (height <= 0.0).then_some([f64::NEG_INFINITY, f64::INFINITY]);
                }
                let at = -height / slope;
                Some(if slope > 0.0 { [f64::NEG_INFINITY, at] } else { [at, f64::INFINITY] })
            }
            Self::Ellipsoid { centre, axes, radii } => {
                let o = axes.transpose() * (origin - *centre) / *radii;
                let d = axes.transpose() * direction / *radii;
                roots(d.length_squared(), o.dot(d), o.length_squared() - 1.0)
            }
            Self::Capsule { from, to, radius } => {
                let ends = [*from, *to].map(|end| {
                    let o = origin - end;
                    roots(1.0, o.dot(direction), o.length_squared() - radius * radius)
                });
                let whole = ends.into_iter().chain([rod(*from, *to, *radius, origin, direction)]).flatten();
                // The solid is convex: the spans of the three pieces overlap and form one.
                whole.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
            }
        }
    }
}

/// Returns the point of a segment nearest to `p`.
fn nearest_on_line(from: DVec3, to: DVec3, p: DVec3) -> DVec3 {
    let along = to - from;
    let part = (p - from).dot(along) / along.length_squared();
    // A segment without length is a point.
    if part.is_nan() { from } else { from + along * part.clamp(0.0, 1.0) }
}

/// Returns the span of a line in a cylinder without its round ends.
fn rod(from: DVec3, to: DVec3, radius: f64, origin: DVec3, direction: DVec3) -> Option<[f64; 2]> {
    let length = from.distance(to);
    let axis = (to - from).normalize_or_zero();
    let (o, along) = (origin - from, direction.dot(axis));
    let across = direction - axis * along;
    let aside = o - axis * o.dot(axis);
    let [mut first, mut last] = if across.length_squared() < 1e-18 {
        (aside.length_squared() <= radius * radius).then_some([f64::NEG_INFINITY, f64::INFINITY])?
    } else {
        roots(across.length_squared(), aside.dot(across), aside.length_squared() - radius * radius)?
    };
    if along.abs() < 1e-12 {
        return (0.0..=length).contains(&o.dot(axis)).then_some([first, last]);
    }
    let ends = [-o.dot(axis) / along, (length - o.dot(axis)) / along];
    first = first.max(ends[0].min(ends[1]));
    last = last.min(ends[0].max(ends[1]));
    (first < last).then_some([first, last])
}

/// Returns the interval in which a t² + 2 b t + c ≤ 0, for a above 0.
fn roots(a: f64, b: f64, c: f64) -> Option<[f64; 2]> {
    let discriminant = b * b - a * c;
    if discriminant <= 0.0 {
        return None;
    }
    let root = discriminant.sqrt();
    Some([(-b - root) / a, (-b + root) / a])
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;

    fn shapes() -> Vec<Shape> {
        let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::ZYX, 0.4, -0.7, 0.2));
        vec![
            Shape::HalfSpace { point: DVec3::new(1.0, 2.0, -1.0), normal: DVec3::new(0.6, -0.8, 0.0) },
            Shape::Ellipsoid { centre: DVec3::new(-1.0, 2.0, 0.5), axes: turn, radii: DVec3::new(6.0, 2.5, 4.0) },
            Shape::Capsule { from: DVec3::new(-4.0, 1.0, 2.0), to: DVec3::new(5.0, -2.0, 1.0), radius: 2.2 },
            Shape::spindle(DVec3::new(0.0, -6.0, 0.0), DVec3::new(1.0, 6.0, 2.0), 1.5),
            Shape::sphere(DVec3::ONE, 3.0),
        ]
    }

    fn vector(range: f64) -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-range..range).prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn line_is_inside_exactly_within_its_span(
            origin in vector(9.0), direction in vector(1.0), at in -25.0..25.0_f64,
        ) {
            prop_assume!(direction.length() > 1e-3);
            let direction = direction.normalize();
            for shape in shapes() {
                let span = shape.span(origin, direction);
                let [first, last] = span.unwrap_or([f64::INFINITY, f64::NEG_INFINITY]);
                prop_assume!((at - first).abs() > 1e-6 && (at - last).abs() > 1e-6);
                prop_assert_eq!(shape.contains(origin + direction * at), at > first && at < last, "{:?}", shape);
                for end in [first, last].into_iter().filter(|t| t.is_finite()) {
                    let p = origin + direction * end;
                    prop_assert!(shape.clearance(p) < 1e-6, "{:?}", shape);
                    // The normal points out: a step along it leaves, a step against it does
                    // not.
                    prop_assert!(!shape.contains(p + 1e-4 * shape.normal(p)), "{:?}", shape);
                    prop_assert!(shape.contains(p - 1e-4 * shape.normal(p)), "{:?}", shape);
                }
            }
        }

        #[test]
        fn points_within_clearance_lie_on_same_side(p in vector(9.0), aside in vector(1.0)) {
            for shape in shapes() {
                let q = p + aside.normalize_or_zero() * (0.999 * shape.clearance(p));
                prop_assert_eq!(shape.contains(p), shape.contains(q), "{:?}", shape);
            }
        }
    }
}
