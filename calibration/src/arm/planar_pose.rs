//! A pose in the plane.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DMat3, DVec2, DVec3};

use sonoweave_core::frames::{Probe, Tracker, Transform};
use sonoweave_core::rotation::direction;

use crate::error::{ArmError, CalibrationError};

/// Pose of the arm's last link, in the x-y plane of its base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarPose {
    /// Position of its end, mm.
    pub position_mm: DVec2,
    /// Direction against the base's x axis, rad, positive from x to y; may exceed one turn.
    pub heading_rad: f64,
}

impl PlanarPose {
    /// Returns the pose in space.
    pub fn tracker_from_probe(&self) -> Transform<Tracker, Probe> {
        let x = direction(self.heading_rad);
        Transform::from_affine(DAffine3 {
            matrix3: DMat3::from_cols(x.extend(0.0), x.perp().extend(0.0), DVec3::Z),
            translation: self.position_mm.extend(0.0),
        })
    }

    /// Returns the planar pose nearest to a pose in space.
    ///
    /// # Errors
    /// [`ArmError`] if the origin is farther than `most_mm` from the plane, or the z axis is
    /// tilted by more than `most_degrees` against the base's.
    pub fn nearest(
        tracker_from_probe: &Transform<Tracker, Probe>,
        most_mm: f64,
        most_degrees: f64,
    ) -> Result<Self, CalibrationError> {
        let DAffine3 { matrix3, translation } = tracker_from_probe.affine();
        let z = matrix3.z_axis;
        // Small angles need the sine: the cosine does not resolve angles below 1e-8.
        let degrees = z.cross(DVec3::Z).length().atan2(z.z).to_degrees();
        let mm = translation.z.abs();
        // The negated comparison refuses NaN.
        if !(mm <= most_mm && degrees <= most_degrees) {
            return Err(ArmError::NotPlanar { mm, degrees, most_mm, most_degrees }.into());
        }
        // Uses both axes in the plane, so that a small tilt about either changes nothing to
        // first order.
        let (x, y) = (matrix3.x_axis, matrix3.y_axis);
        let heading_rad = (x.y - y.x).atan2(x.x + y.y);
        Ok(Self { position_mm: translation.truncate(), heading_rad })
    }

    /// Returns the position of a point of the probe's x-y plane, mm.
    pub fn point(&self, point_mm: DVec2) -> DVec2 {
        self.position_mm + direction(self.heading_rad).rotate(point_mm)
    }
}

/// Returns the same direction, within half a turn of another.
pub(super) fn turned_near(angle: f64, near: f64) -> f64 {
    near + (angle - near + PI).rem_euclid(TAU) - PI
}
