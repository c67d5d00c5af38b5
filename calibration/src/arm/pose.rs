//! A pose in the plane.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DMat3, DVec2, DVec3};

use crate::frames::{Probe, Tracker, Transform};

/// Where the arm's last link is, in the x-y plane of its base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarPose {
    /// Its end, mm.
    pub position_mm: DVec2,
    /// Its direction against the base's x axis, rad, positive from x to y; any number of turns.
    pub heading_rad: f64,
}

/// How far a pose is from the plane that an arm moves in.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "the pose lies {mm:.3} mm out of the arm's plane and is tilted by {degrees:.3}° against it, beyond {most_mm} mm and {most_degrees}°; an arm of three joints moves in its base's x-y plane and turns about z"
)]
pub struct NotPlanar {
    /// Distance of the probe's origin from the plane, mm.
    pub mm: f64,
    /// Angle between the probe's z axis and the base's.
    pub degrees: f64,
    /// What would have been taken, mm.
    pub most_mm: f64,
    /// What would have been taken.
    pub most_degrees: f64,
}

impl PlanarPose {
    /// The pose in space.
    pub fn tracker_from_probe(&self) -> Transform<Tracker, Probe> {
        Transform::from_affine(DAffine3 {
            matrix3: DMat3::from_rotation_z(self.heading_rad),
            translation: self.position_mm.extend(0.0),
        })
    }

    /// The pose in the plane that is nearest to one in space.
    ///
    /// # Errors
    /// [`NotPlanar`] where its origin is farther than `most_mm` from the plane, or its z axis more than `most_degrees` from the base's.
    pub fn nearest(
        tracker_from_probe: &Transform<Tracker, Probe>,
        most_mm: f64,
        most_degrees: f64,
    ) -> Result<Self, NotPlanar> {
        let DAffine3 { matrix3, translation } = tracker_from_probe.affine();
        let z = matrix3.z_axis;
        // Small angles by their sine: the cosine of one knows nothing below 1e-8.
        let degrees = z.cross(DVec3::Z).length().atan2(z.z).to_degrees();
        let mm = translation.z.abs();
        // Not a number is beyond everything.
        if !(mm <= most_mm && degrees <= most_degrees) {
            return Err(NotPlanar { mm, degrees, most_mm, most_degrees });
        }
        // Of both axes in the plane, so that a small tilt about either changes nothing to first order.
        let (x, y) = (matrix3.x_axis, matrix3.y_axis);
        let heading_rad = (x.y - y.x).atan2(x.x + y.y);
        Ok(Self { position_mm: translation.truncate(), heading_rad })
    }

    /// Where a point of the probe's x-y plane is, mm.
    pub fn point(&self, point_mm: DVec2) -> DVec2 {
        self.position_mm + DVec2::from_angle(self.heading_rad).rotate(point_mm)
    }
}

/// The same direction, within half a turn of another.
pub(super) fn turned_near(angle: f64, near: f64) -> f64 {
    near + (angle - near + PI).rem_euclid(TAU) - PI
}
