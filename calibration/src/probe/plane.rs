//! The image plane in space, and its calculation from the cuts of wires.
//!
//! A plane with its pixels maps (u, v) to u·**u** + v·**v** + **o**. A pixel on a wire gives
//! two equations that are linear in these nine numbers: its offset across the wire is zero in
//! both directions. So any wires will do, in any order and direction, if together they fix all
//! nine. Dots of many images with known poses make one system for the plane in the probe's
//! frame.

use glam::{DAffine3, DMat3, DVec2, DVec3};

use crate::phantom::Wire;

/// Count of numbers of a plane with its pixels.
const UNKNOWN: usize = 9;

/// Names and units of the numbers that a calibration finds: rotations about u, v and the image's
/// normal, position of the pivot pixel in the probe's frame, pixel sizes, the cosine between u and
/// v.
pub const PLANE: [&str; 9] = [
    "turn about x (rad)",
    "turn about y (rad)",
    "turn about z (rad)",
    "place x (mm)",
    "place y (mm)",
    "place z (mm)",
    "pixel along u (relative)",
    "pixel along v (relative)",
    "skew",
];

/// Count of these numbers.
pub const NUMBERS: usize = PLANE.len();

/// Positions of pixels, in mm of some frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImagePlane {
    /// Step from a pixel to the next along u, mm.
    pub u: DVec3,
    /// Step from a pixel to the next along v, mm.
    pub v: DVec3,
    /// The centre of the first pixel, mm.
    pub origin: DVec3,
}

impl ImagePlane {
    /// Returns the plane of an image's transform; the third column is ignored.
    pub fn of(affine: &DAffine3) -> Self {
        let DMat3 { x_axis, y_axis, .. } = affine.matrix3;
        Self { u: x_axis, v: y_axis, origin: affine.translation }
    }

    /// Returns a transform of the plane. Its third column is perpendicular to the others and as
    /// long as their mean, so that it can be inverted.
    pub fn affine(&self) -> DAffine3 {
        let length = 0.5 * (self.u.length() + self.v.length());
        let normal = self.u.cross(self.v).normalize_or_zero() * length;
        DAffine3 { matrix3: DMat3::from_cols(self.u, self.v, normal), translation: self.origin }
    }

    /// Returns the same plane in another frame.
    pub fn seen_by(&self, map: &DAffine3) -> Self {
        Self {
            u: map.transform_vector3(self.u),
            v: map.transform_vector3(self.v),
            origin: map.transform_point3(self.origin),
        }
    }

    /// Returns the position of a pixel, mm.
    pub fn point(&self, px: DVec2) -> DVec3 {
        self.u * px.x + self.v * px.y + self.origin
    }

    /// Returns the size of a pixel along u and v, mm.
    pub fn pixel_mm(&self) -> [f64; 2] {
        [self.u.length(), self.v.length()]
    }

    /// Returns the cosine between u and v: 0 if they are perpendicular.
    pub fn skew(&self) -> f64 {
        self.u.dot(self.v) / (self.u.length() * self.v.length())
    }

    /// Returns the directions of u and of the plane's v perpendicular to it, and the normal.
    pub fn axes(&self) -> DMat3 {
        let x = self.u.normalize();
        let y = (self.v - self.v.dot(x) * x).normalize();
        DMat3::from_cols(x, y, x.cross(y))
    }

    /// Returns the derivatives of a pixel's position by the plane's [numbers](PLANE), of which
    /// rotations are about `pivot_px`.
    pub fn changes(&self, pivot_px: DVec2, px: DVec2) -> [DVec3; NUMBERS] {
        let axes = self.axes();
        let DMat3 { x_axis: x, y_axis: y, z_axis: z } = axes;
        let from = px - pivot_px;
        let (along_u, along_v) = (self.u * from.x, self.v * from.y);
        let lever = along_u + along_v;
        let skewed = x * (self.v.dot(y) * from.y);
        [x.cross(lever), y.cross(lever), z.cross(lever), DVec3::X, DVec3::Y, DVec3::Z, along_u, along_v, skewed]
    }

    /// Returns the pixel where a wire's line cuts the plane, and the position along the wire (0
    /// at its first end, 1 at its second); `None` if they are parallel.
    pub fn cut(&self, wire: &Wire) -> Option<(DVec2, f64)> {
        let along = wire.ends_mm[1] - wire.ends_mm[0];
        let matrix = DMat3::from_cols(self.u, self.v, -along);
        let size = self.u.length() * self.v.length() * along.length();
        if matrix.determinant().abs() <= 1e-6 * size {
            return None;
        }
        let found = matrix.inverse() * (wire.ends_mm[0] - self.origin);
        Some((found.truncate(), found.z))
    }
}

/// Scales image coordinates to numbers about 1, as sums of squares require.
#[derive(Debug, Clone, Copy)]
pub(super) struct Unit {
    centre: DVec2,
    half: f64,
}

impl Unit {
    /// Returns the scaling for images of this size.
    pub(super) fn of(size_px: [u32; 2]) -> Self {
        let size = DVec2::from(size_px.map(f64::from));
        Self { centre: 0.5 * (size - 1.0), half: 0.5 * size.max_element().max(2.0) }
    }

    /// Returns a pixel in scaled coordinates.
    pub(super) fn brought(&self, px: DVec2) -> DVec2 {
        (px - self.centre) / self.half
    }

    /// Returns the plane with these columns in scaled coordinates.
    pub(super) fn plane(&self, u: DVec3, v: DVec3, origin: DVec3) -> ImagePlane {
        let (u, v) = (u / self.half, v / self.half);
        ImagePlane { u, v, origin: origin - u * self.centre.x - v * self.centre.y }
    }
}

/// Sums of the linear equations for a plane.
#[derive(Debug, Clone)]
pub(super) struct PlaneSum {
    unit: Unit,
    matrix: [[f64; UNKNOWN]; UNKNOWN],
    right: [f64; UNKNOWN],
}

impl PlaneSum {
    pub(super) fn new(unit: Unit) -> Self {
        Self { unit, matrix: [[0.0; UNKNOWN]; UNKNOWN], right: [0.0; UNKNOWN] }
    }

    /// Adds the equation that a pixel's coordinate along a direction is this many mm.
    pub(super) fn add(&mut self, px: DVec2, direction: DVec3, mm: f64, weight: f64) {
        let at = self.unit.brought(px);
        let [x, y, z] = direction.to_array();
        let row = [at.x * x, at.x * y, at.x * z, at.y * x, at.y * y, at.y * z, x, y, z];
        for i in 0..UNKNOWN {
            let scaled = weight * row[i];
            for (entry, other) in self.matrix[i].iter_mut().zip(&row[..=i]) {
                *entry += scaled * other;
            }
            self.right[i] += scaled * mm;
        }
    }

    /// Adds the equations of a pixel on a wire. `frame_from_phantom` has no scale and maps the
    /// wire to the frame of the plane.
    pub(super) fn add_dot(&mut self, px: DVec2, wire: &Wire, frame_from_phantom: &DAffine3, weight: f64) {
        let on_it = frame_from_phantom.transform_point3(wire.ends_mm[0]);
        for across in wire.across() {
            let across = frame_from_phantom.transform_vector3(across);
            self.add(px, across, across.dot(on_it), weight);
        }
    }

    /// Adds the prior that u and v have only small components along a direction: `pixel_mm` per
    /// pixel, relative to a dot's accuracy of `dot_mm`.
    pub(super) fn add_tilt(&mut self, along: DVec3, pixel_mm: f64, dot_mm: f64) {
        let weight = (dot_mm / (pixel_mm * self.unit.half)).powi(2);
        for first in [0, 3] {
            let row: [f64; 3] = along.to_array();
            for i in 0..3 {
                (0..=i).for_each(|j| self.matrix[first + i][first + j] += weight * row[i] * row[j]);
            }
        }
    }

    /// Returns the plane that fits best. If `open` is allowed, undetermined numbers are closed
    /// by the shortest u, v and offset.
    pub(super) fn solve(&self, open: bool) -> Option<ImagePlane> {
        let mut matrix = self.matrix;
        let trace: f64 = (0..UNKNOWN).map(|i| matrix[i][i]).sum();
        // 1e-9 of the diagonal's mean: a dot outweighs it a millionfold.
        let ridge = if open { 1e-9 * trace / UNKNOWN as f64 } else { 0.0 };
        (0..UNKNOWN).for_each(|i| matrix[i][i] += ridge);
        let x = solve(matrix, self.right)?;
        let [u, v, origin] = [0, 3, 6].map(|i| DVec3::from_slice(&x[i..]));
        Some(self.unit.plane(u, v, origin))
    }
}

/// Solves A x = b by Cholesky factors; reads the lower triangle of A. `None` if A is not
/// positive definite, or nearly so.
pub(super) fn solve<const N: usize>(mut a: [[f64; N]; N], mut b: [f64; N]) -> Option<[f64; N]> {
    for i in 0..N {
        let diagonal = a[i][i];
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| a[i][k] * a[j][k]).sum();
            if i == j {
                let rest = diagonal - sum;
                if rest.is_nan() || rest <= 1e-13 * diagonal {
                    return None;
                }
                a[i][i] = rest.sqrt();
            } else {
                a[i][j] = (a[i][j] - sum) / a[j][j];
            }
        }
    }
    for i in 0..N {
        b[i] = (b[i] - (0..i).map(|k| a[i][k] * b[k]).sum::<f64>()) / a[i][i];
    }
    for i in (0..N).rev() {
        b[i] = (b[i] - (i + 1..N).map(|k| a[k][i] * b[k]).sum::<f64>()) / a[i][i];
    }
    Some(b)
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::phantom::geometry::tests::three_ns;

    fn plane() -> ImagePlane {
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, -1.4, 0.1, 0.05);
        ImagePlane { u: turn * DVec3::X * -0.08, v: turn * DVec3::Y * 0.075, origin: DVec3::new(66.0, 20.0, 35.0) }
    }

    #[test]
    fn plane_follows_from_wire_cuts() {
        let phantom = three_ns();
        let truth = plane();
        let mut sum = PlaneSum::new(Unit::of([820, 616]));
        for wire in phantom.wires() {
            let (px, share) = truth.cut(wire).unwrap();
            let there = wire.ends_mm[0].lerp(wire.ends_mm[1], share);
            assert!(truth.point(px).distance(there) < 1e-11);
            sum.add_dot(px, wire, &DAffine3::IDENTITY, 1.0);
        }
        let found = sum.solve(false).unwrap();
        let corner = DVec2::new(819.0, 615.0);
        assert!(found.point(corner).distance(truth.point(corner)) < 1e-9);
        assert!(found.origin.distance(truth.origin) < 1e-9);
        assert!(truth.skew().abs() < 1e-12 && (truth.pixel_mm()[1] - 0.075).abs() < 1e-12);
        assert_eq!(ImagePlane::of(&truth.affine()), truth);
    }

    #[test]
    fn parallel_wires_leave_plane_open() {
        let phantom = three_ns();
        let mut sum = PlaneSum::new(Unit::of([820, 616]));
        for wire in [0, 2, 3, 5, 6, 8].map(|i| &phantom.wires()[i]) {
            sum.add_dot(plane().cut(wire).unwrap().0, wire, &DAffine3::IDENTITY, 1.0);
        }
        assert_eq!(sum.solve(false), None);
        // The position across the wires is still found.
        let found = sum.solve(true).unwrap();
        for wire in [0, 2, 3, 5, 6, 8].map(|i| &phantom.wires()[i]) {
            assert!(wire.nearest(found.point(plane().cut(wire).unwrap().0)).0 < 1e-6);
        }
        let along = Wire { name: String::new(), ends_mm: [DVec3::ZERO, plane().u * 100.0] };
        assert_eq!(plane().cut(&along), None);
    }

    #[test]
    fn system_is_solved_or_refused() {
        let a = [[4.0, 0.0, 0.0], [2.0, 5.0, 0.0], [1.0, 1.0, 3.0]];
        let x = solve(a, [9.0, 15.0, 12.0]).unwrap();
        for (row, b) in [[4.0, 2.0, 1.0], [2.0, 5.0, 1.0], [1.0, 1.0, 3.0]].iter().zip([9.0, 15.0, 12.0]) {
            assert!((row.iter().zip(x).map(|(a, x)| a * x).sum::<f64>() - b).abs() < 1e-12);
        }
        assert_eq!(solve([[1.0, 0.0], [1.0, 1.0]], [1.0, 1.0]), None);
    }
}
