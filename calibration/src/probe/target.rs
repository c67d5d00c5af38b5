//! Probe calibration with a static target: a point, the tip of a stylus, or a plane.
//!
//! No phantom has to be made or measured. All three are one problem. The unknowns are the image
//! plane in the probe's frame and the target in the reference's frame. The target's position by
//! its images and by the poses must match.
//!
//! - A static **point**, such as crossing wires or a bead, is seen as a dot. Its position is
//!   fitted as well (Detmer et al., Proc. SPIE 1994; Prager et al., Ultrasound Med. Biol. 24,
//!   1998). Without a rotation of the probe the position is undetermined.
//! - The **tip of a tracked stylus** is such a point, too. It is static in the frame of the
//!   stylus's sensor, which is the reference then. Its position and error are known from a
//!   pivot calibration (Muratore & Galloway, Ultrasound Med. Biol. 27, 2001; Hsu et al. 2008).
//! - A static **plane**, such as the floor of a water tank or a membrane, is seen as a line
//!   (Prager et al. 1998). A line gives two numbers per image, and the probe must be tilted
//!   both ways.
//!
//! A target has no left and right. Mirrored images cannot be detected here and are calibrated
//! as they are; the result is valid for images with the same orientation.
//!
//! - [`detection`]: the target's appearance in images.
//! - `points`, `planes`: the start of the fit.
//! - [`refine`](mod@refine), `predicted`: the best fit to all images, and its accuracy.
//! - `motion`: numbers that the probe's motion leaves undetermined.
//! - `validation`: errors of a calibration on images that the fit did not use.
//! - [`calibrate`](mod@calibrate): the whole procedure, or the reason for a refusal.

pub mod calibrate;
pub mod detection;
mod motion;
mod planes;
mod points;
mod predicted;
pub mod refine;
mod validation;

pub use calibrate::{Calibration, calibrate};
pub use detection::Seen;

use glam::{DVec2, DVec3};

use super::plane::ImagePlane;

/// The kinds of target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Target {
    /// A point at an unknown position.
    Point,
    /// A point at a known position in the reference's frame: a stylus's tip.
    Tip {
        /// Its position, mm.
        place_mm: DVec3,
        /// Standard deviation of the position along each axis, mm; above 0.
        error_mm: f64,
    },
    /// A plane at an unknown position.
    Plane,
}

/// Position of the target in the reference's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// A point, mm.
    Point(DVec3),
    /// The points x with n·x = d.
    Plane {
        /// n, of length 1.
        normal: DVec3,
        /// d, mm.
        distance_mm: f64,
    },
}

impl Place {
    /// Returns the distance of a point from it, mm.
    pub fn off_mm(&self, point: DVec3) -> f64 {
        match self {
            Self::Point(place) => point.distance(*place),
            Self::Plane { normal, distance_mm } => (normal.dot(point) - distance_mm).abs(),
        }
    }

    /// Returns the pixel of an image (in the reference's frame) that shows it: the foot of a
    /// point on the image, or the point of a plane's line nearest to a pixel.
    pub(super) fn in_picture(&self, picture: &ImagePlane, near_px: DVec2) -> DVec2 {
        match self {
            Self::Point(place) => picture.affine().inverse().transform_point3(*place).truncate(),
            Self::Plane { normal, distance_mm } => {
                let rise = DVec2::new(normal.dot(picture.u), normal.dot(picture.v));
                near_px - rise * ((normal.dot(picture.point(near_px)) - distance_mm) / rise.length_squared())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn in_picture_returns_nearest_pixel() {
        let picture = ImagePlane {
            u: DVec3::new(0.1, 0.0, 0.0),
            v: DVec3::new(0.0, 0.06, 0.08),
            origin: DVec3::new(5.0, 1.0, -2.0),
        };
        let px = DVec2::new(120.0, 80.0);
        let off = 0.7 * picture.u.cross(picture.v).normalize();
        let point = Place::Point(picture.point(px) + off);
        assert!(point.in_picture(&picture, DVec2::ZERO).distance(px) < 1e-9);
        let normal = DVec3::new(0.3, -0.2, 0.9).normalize();
        let plane = Place::Plane { normal, distance_mm: 4.0 };
        let found = plane.in_picture(&picture, px);
        assert!(plane.off_mm(picture.point(found)) < 1e-12);
        // The pixel is the nearest one of the line.
        let along = DVec2::new(-normal.dot(picture.v), normal.dot(picture.u)).normalize();
        assert!(plane.off_mm(picture.point(found + 9.0 * along)) < 1e-12 && (found - px).dot(along).abs() < 1e-9);
    }
}
