//! Wires of calibration phantoms, and their crossings with an image plane.

use glam::{DAffine3, DVec2, DVec3};

/// A straight wire between two holes of a phantom.
#[derive(Debug, Clone, PartialEq)]
pub struct Wire {
    /// Its name.
    pub name: String,
    /// One end, mm in the phantom's axes.
    pub from: DVec3,
    /// The other end.
    pub to: DVec3,
    /// Its diameter, mm.
    pub diameter_mm: f64,
    /// Its echo across the beam, dB above the mean echo of the reference tissue.
    pub echo_db: f64,
}

impl Wire {
    /// Returns a nylon wire of 0.35 mm.
    pub fn nylon(name: impl Into<String>, from: [f64; 3], to: [f64; 3]) -> Self {
        let [from, to] = [from, to].map(DVec3::from_array);
        Self { name: name.into(), from, to, diameter_mm: 0.35, echo_db: 22.0 }
    }

    /// Returns the pixel (u, v) at which the axis crosses an image plane. It may lie outside
    /// the image. `None` if both ends lie on one side.
    ///
    /// `body_from_image` maps (u, v, n) to mm in the body's axes, as
    /// [`Scan::true_world_from_image`](crate::Scan::true_world_from_image) does for
    /// the world.
    pub fn crossing(&self, body_from_image: &DAffine3) -> Option<DVec2> {
        let image_from_body = body_from_image.inverse();
        let [a, b] = [self.from, self.to].map(|end| image_from_body.transform_point3(end));
        // An end on the plane counts as a crossing; a wire within the plane has none.
        if a.z == b.z || a.z.signum() * b.z.signum() > 0.0 && a.z * b.z != 0.0 {
            return None;
        }
        let part = a.z / (a.z - b.z);
        Some((a + (b - a) * part).truncate())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DQuat};

    #[test]
    fn crossing_lies_on_wire_and_plane() {
        let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::ZYX, 0.1, 0.3, -0.2));
        let pixel = DMat3::from_diagonal(DVec3::new(0.2, 0.3, 1.0));
        let plane = DAffine3 { matrix3: turn * pixel, translation: DVec3::new(-20.0, -5.0, 3.0) };
        let wire = Wire::nylon("a", [3.0, 10.0, -30.0], [8.0, 14.0, 25.0]);
        let at = wire.crossing(&plane).unwrap();
        let point = plane.transform_point3(at.extend(0.0));
        let part = (point - wire.from).dot(wire.to - wire.from) / wire.from.distance_squared(wire.to);
        assert!((wire.from + (wire.to - wire.from) * part).distance(point) < 1e-9 && (0.0..1.0).contains(&part));
        // There is no crossing beyond either end, or within the plane.
        for (from, to) in [([3.0, 10.0, -30.0], [3.0, 10.0, -20.0]), ([3.0, 10.0, 20.0], [8.0, 14.0, 25.0])] {
            assert_eq!(Wire::nylon("b", from, to).crossing(&plane), None);
        }
        let [p, q] = [[1.0, 2.0], [50.0, 60.0]].map(|[u, v]| plane.transform_point3(DVec3::new(u, v, 0.0)));
        let level = Wire { from: p, to: q, ..wire };
        let identity = Wire { from: DVec3::ZERO, to: DVec3::X, ..level };
        assert_eq!(identity.crossing(&DAffine3::IDENTITY), None);
    }
}
