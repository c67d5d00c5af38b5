//! Noise of a tracker's poses as it is known beforehand, and the error of places by it.

use glam::{DAffine3, DVec3};

/// Noise of a tracker's sensors, with the calibration by which it moves an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseNoise {
    /// Standard deviation of a sensor's position along each axis, mm.
    pub position_mm: f64,
    /// Standard deviation of its rotation about each axis, degrees.
    pub rotation_deg: f64,
    /// Maps pixels to mm at the probe's sensor.
    pub probe_from_image: DAffine3,
}

/// The frame of reference of a sensor on the patient (PLUS).
const REFERENCE: &str = "Reference";

/// Part of a pose's variance that interpolation between two leaves: the mean of (1 − a)² + a².
const INTERPOLATED: f64 = 2.0 / 3.0;

impl PoseNoise {
    /// Returns the root mean square error of places in an image of `size` pixels, mm, with
    /// interpolated poses. If the world is that of a sensor, too, the error of its position counts,
    /// but not that of its rotation, as its distance is not known.
    pub fn error_mm(&self, size: [u32; 2], world: &str) -> f64 {
        let sensors = if world == REFERENCE { 2.0 } else { 1.0 };
        let [width, height] = size.map(f64::from);
        let middle = DVec3::new(0.5 * (width - 1.0), 0.5 * (height - 1.0), 0.0);
        let lever = self.probe_from_image.transform_point3(middle);
        // The mean over a rectangle's points is the middle's square and a twelfth of the edges'.
        let edges = self.probe_from_image.matrix3.x_axis.length_squared() * width * width
            + self.probe_from_image.matrix3.y_axis.length_squared() * height * height;
        let lever_squared = lever.length_squared() + edges / 12.0;
        let shift = 3.0 * sensors * self.position_mm.powi(2);
        // A rotation about an axis moves a place by the part of its lever across that axis.
        let turn = 2.0 * self.rotation_deg.to_radians().powi(2) * lever_squared;
        (INTERPOLATED * (shift + turn)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_match_drawn_poses() {
        let noise = PoseNoise {
            position_mm: 0.3,
            rotation_deg: 0.4,
            probe_from_image: DAffine3::from_scale_rotation_translation(
                DVec3::new(0.2, 0.3, 1.0),
                glam::DQuat::from_rotation_y(0.7),
                DVec3::new(10.0, -20.0, 90.0),
            ),
        };
        let size = [160, 140];
        let mut state = 1_u64;
        // Sums of twelve uniform numbers are all but normal.
        let mut normal = || {
            let uniform = (0..12).map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 33) as f64 / f64::from(1 << 30) / 2.0
            });
            uniform.sum::<f64>() - 6.0
        };
        let mut squares = 0.0;
        for draw in 0..4000 {
            let part = f64::from(draw % 40) / 40.0;
            let mut drawn = || DVec3::new(normal(), normal(), normal());
            // Two samples of the probe's sensor and of the reference's position.
            let mut between = |sd: f64| (drawn() * (1.0 - part) + drawn() * part) * sd;
            let shift = between(0.3) + between(0.3);
            let turn = between(0.4_f64.to_radians());
            let pixel = DVec3::new(f64::from(draw * 37 % 160), f64::from(draw * 53 % 140), 0.0);
            squares += (shift + turn.cross(noise.probe_from_image.transform_point3(pixel))).length_squared();
        }
        let found = (squares / 4000.0).sqrt();
        let said = noise.error_mm(size, "Reference");
        assert!((said / found - 1.0).abs() < 0.03, "{said} and {found}");
        let alone = said.powi(2) - noise.error_mm(size, "Tracker").powi(2);
        assert!((alone - 2.0 * 0.3_f64.powi(2)).abs() < 1e-9, "{alone}");
    }
}
