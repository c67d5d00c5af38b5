//! Grey values of a slice, predicted by its neighbours.
//!
//! A neighbour is read where the normal of a point meets its plane, at a signed distance q. A line
//! over q through these values, weighted by a Gaussian, has the prediction at q = 0. Between uneven
//! gaps a mean would belong to another place.

use glam::{DAffine3, DVec2, DVec3};

/// Distance beyond which a neighbour counts for nothing, in widths of the weights.
pub(super) const FARTHEST: f64 = 3.0;
/// Least variance of the distances, in squares of the weights' width: values at one place determine
/// no line.
const LEAST_SPREAD: f64 = 0.05;

/// Weighted sums over the neighbours of a point.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    /// Σ g·qᵏ for k of 0, 1, 2.
    moments: [f64; 3],
    /// Σ g·qᵏ·I for k of 0, 1.
    greys: [f64; 2],
    /// Whether neighbours lie behind and before the plane.
    sides: [bool; 2],
}

impl Sums {
    /// Adds a neighbour's grey value at a distance in mm.
    pub(super) fn add(&mut self, q: f64, weight: f64, grey: f64) {
        let first = weight * q;
        self.moments[0] += weight;
        self.moments[1] += first;
        self.moments[2] += first * q;
        self.greys[0] += weight * grey;
        self.greys[1] += first * grey;
        self.sides[usize::from(q > 0.0)] = true;
    }

    /// Returns the line's value at the plane; `None` without neighbours on both sides.
    pub(super) fn predicted(&self, width_mm: f64) -> Option<f64> {
        let ([m0, m1, m2], [b0, b1]) = (self.moments, self.greys);
        let determinant = m0 * m2 - m1 * m1;
        let is_line = self.sides == [true; 2] && determinant > LEAST_SPREAD * (m0 * width_mm).powi(2);
        is_line.then(|| (m2 * b0 - m1 * b1) / determinant)
    }
}

/// Where normals of a slice meet the plane of another one: affine functions of (x, y, 1), mm of the
/// slice's image.
pub(super) struct Across {
    /// Signed distance along the normal, mm.
    distance: DVec3,
    /// Column and row of the other slice's image.
    pixel: [DVec3; 2],
}

impl Across {
    /// Both slices are given by their maps from mm of the image to the world.
    pub(super) fn of([from, to]: [&DAffine3; 2], pixel_from_picture: &DAffine3) -> Self {
        let at = to.inverse() * *from;
        let normal = at.matrix3.z_axis;
        let row = |k: usize| DVec3::new(at.matrix3.x_axis[k], at.matrix3.y_axis[k], at.translation[k]);
        let distance = row(2) * (-1.0 / normal.z);
        let [x, y] = [0, 1].map(|k| row(k) + distance * normal[k]);
        let m = pixel_from_picture;
        let pixel = [0, 1].map(|k| x * m.matrix3.x_axis[k] + y * m.matrix3.y_axis[k] + DVec3::Z * m.translation[k]);
        Self { distance, pixel }
    }

    /// Returns the distance along the normal of a point, mm.
    pub(super) fn distance_mm(&self, point: DVec2) -> f64 {
        self.distance.dot(point.extend(1.0))
    }

    /// Returns the place at which the normal of a point meets the other image, pixels.
    pub(super) fn pixel(&self, point: DVec2) -> DVec2 {
        DVec2::from(self.pixel.map(|row| row.dot(point.extend(1.0))))
    }
}
