//! The image plane in space, and how it follows from where it cuts wires.
//!
//! A plane with its pixels maps (u, v) to u·**u** + v·**v** + **o**. That a pixel lies on a wire says two things, both linear in these nine numbers: nothing is left across the wire, in
//! either direction. So any wires will do, in any order and direction, as long as together they leave no freedom; and dots of many pictures, whose pose is known, make one system
//! for the plane in the probe's frame.

use glam::{DAffine3, DMat3, DVec2, DVec3};

use crate::phantom::Wire;

/// Numbers of a plane with its pixels.
const UNKNOWN: usize = 9;

/// Where pixels lie, in mm of some frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImagePlane {
    /// From a pixel to the next along u, mm.
    pub u: DVec3,
    /// From a pixel to the next along v, mm.
    pub v: DVec3,
    /// The centre of the first pixel, mm.
    pub origin: DVec3,
}

impl ImagePlane {
    /// The plane of an image's transform; its third column says nothing of it.
    pub fn of(affine: &DAffine3) -> Self {
        let DMat3 { x_axis, y_axis, .. } = affine.matrix3;
        Self { u: x_axis, v: y_axis, origin: affine.translation }
    }

    /// A transform of the plane: its third column is at right angles to the others, and as long as they are on average, so that it can be inverted.
    pub fn affine(&self) -> DAffine3 {
        let length = 0.5 * (self.u.length() + self.v.length());
        let normal = self.u.cross(self.v).normalize_or_zero() * length;
        DAffine3 { matrix3: DMat3::from_cols(self.u, self.v, normal), translation: self.origin }
    }

    /// The same plane seen from another frame.
    pub fn seen_by(&self, map: &DAffine3) -> Self {
        Self {
            u: map.transform_vector3(self.u),
            v: map.transform_vector3(self.v),
            origin: map.transform_point3(self.origin),
        }
    }

    /// Where a pixel lies, mm.
    pub fn point(&self, px: DVec2) -> DVec3 {
        self.u * px.x + self.v * px.y + self.origin
    }

    /// Size of a pixel along u and v, mm.
    pub fn pixel_mm(&self) -> [f64; 2] {
        [self.u.length(), self.v.length()]
    }

    /// The cosine between u and v: 0 where they are at right angles.
    pub fn skew(&self) -> f64 {
        self.u.dot(self.v) / (self.u.length() * self.v.length())
    }

    /// The pixel where a wire's line cuts the plane, and where along the wire that is (0 at its first end, 1 at its second); `None` where they are parallel.
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

/// A picture's coordinates brought to numbers about 1, which sums of squares need.
#[derive(Debug, Clone, Copy)]
pub(super) struct Unit {
    centre: DVec2,
    half: f64,
}

impl Unit {
    /// For pictures of that size.
    pub(super) fn of(size_px: [u32; 2]) -> Self {
        let size = DVec2::from(size_px.map(f64::from));
        Self { centre: 0.5 * (size - 1.0), half: 0.5 * size.max_element().max(2.0) }
    }

    /// A pixel in these numbers.
    pub(super) fn brought(&self, px: DVec2) -> DVec2 {
        (px - self.centre) / self.half
    }

    /// The plane that in these numbers has such columns.
    pub(super) fn plane(&self, u: DVec3, v: DVec3, origin: DVec3) -> ImagePlane {
        let (u, v) = (u / self.half, v / self.half);
        ImagePlane { u, v, origin: origin - u * self.centre.x - v * self.centre.y }
    }
}

/// The sum of what dots say of a plane.
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

    /// That the pixel's place, along a direction, is so many mm.
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

    /// That a pixel lies on a wire. `frame_from_phantom` has no scale, and takes the wire to where the plane is asked for.
    pub(super) fn add_dot(&mut self, px: DVec2, wire: &Wire, frame_from_phantom: &DAffine3, weight: f64) {
        let on_it = frame_from_phantom.transform_point3(wire.ends_mm[0]);
        for across in wire.across() {
            let across = frame_from_phantom.transform_vector3(across);
            self.add(px, across, across.dot(on_it), weight);
        }
    }

    /// That u and v have little along a direction, as a guess: of so many mm a pixel, where a dot's word is good to `dot_mm`.
    pub(super) fn add_tilt(&mut self, along: DVec3, pixel_mm: f64, dot_mm: f64) {
        let weight = (dot_mm / (pixel_mm * self.unit.half)).powi(2);
        for first in [0, 3] {
            let row: [f64; 3] = along.to_array();
            for i in 0..3 {
                (0..=i).for_each(|j| self.matrix[first + i][first + j] += weight * row[i] * row[j]);
            }
        }
    }

    /// The plane that fits best. What the dots leave open is closed by the shortest u, v and way to the origin, if `open` is allowed.
    pub(super) fn solve(&self, open: bool) -> Option<ImagePlane> {
        let mut matrix = self.matrix;
        let trace: f64 = (0..UNKNOWN).map(|i| matrix[i][i]).sum();
        // 1e-9 of the diagonal's mean: a dot's word outweighs it a millionfold.
        let ridge = if open { 1e-9 * trace / UNKNOWN as f64 } else { 0.0 };
        (0..UNKNOWN).for_each(|i| matrix[i][i] += ridge);
        let x = solve(matrix, self.right)?;
        let [u, v, origin] = [0, 3, 6].map(|i| DVec3::from_slice(&x[i..]));
        Some(self.unit.plane(u, v, origin))
    }
}

/// x of A x = b by Cholesky's factors; of A the lower triangle is read. `None` where A is not positive definite, or next to it.
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
    use crate::phantom::tests::three_ns;

    fn plane() -> ImagePlane {
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, -1.4, 0.1, 0.05);
        ImagePlane { u: turn * DVec3::X * -0.08, v: turn * DVec3::Y * 0.075, origin: DVec3::new(66.0, 20.0, 35.0) }
    }

    #[test]
    fn a_plane_follows_from_where_it_cuts_wires() {
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
    fn parallel_wires_alone_leave_the_plane_open() {
        let phantom = three_ns();
        let mut sum = PlaneSum::new(Unit::of([820, 616]));
        for wire in [0, 2, 3, 5, 6, 8].map(|i| &phantom.wires()[i]) {
            sum.add_dot(plane().cut(wire).unwrap().0, wire, &DAffine3::IDENTITY, 1.0);
        }
        assert_eq!(sum.solve(false), None);
        // What is across the wires is found all the same.
        let found = sum.solve(true).unwrap();
        for wire in [0, 2, 3, 5, 6, 8].map(|i| &phantom.wires()[i]) {
            assert!(wire.nearest(found.point(plane().cut(wire).unwrap().0)).0 < 1e-6);
        }
        let along = Wire { name: String::new(), ends_mm: [DVec3::ZERO, plane().u * 100.0] };
        assert_eq!(plane().cut(&along), None);
    }

    #[test]
    fn a_system_is_solved_or_refused() {
        let a = [[4.0, 0.0, 0.0], [2.0, 5.0, 0.0], [1.0, 1.0, 3.0]];
        let x = solve(a, [9.0, 15.0, 12.0]).unwrap();
        for (row, b) in [[4.0, 2.0, 1.0], [2.0, 5.0, 1.0], [1.0, 1.0, 3.0]].iter().zip([9.0, 15.0, 12.0]) {
            assert!((row.iter().zip(x).map(|(a, x)| a * x).sum::<f64>() - b).abs() < 1e-12);
        }
        assert_eq!(solve([[1.0, 0.0], [1.0, 1.0]], [1.0, 1.0]), None);
    }
}
