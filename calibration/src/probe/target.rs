//! The probe's calibration by a target that rests: a point, the tip of a stylus, or a plane.
//!
//! No phantom has to be made or measured. All three are one problem: where the picture lies in the probe's frame, and where the target lies in the reference's, so that what pictures show of it
//! is where poses have it.
//!
//! - A **point** that rests, where wires cross or a bead is, is seen as a dot. Where it is has to be found with the rest (Detmer et al., Proc. SPIE 1994; Prager et al., Ultrasound Med. Biol. 24,
//!   1998). Without a turn of the probe its place could be anywhere.
//! - The **tip of a stylus** that is tracked is such a point, too, which rests in the frame of the stylus's sensor: that is the reference then, and where the tip is in it is known from a pivot
//!   calibration, as well as that was (Muratore & Galloway, Ultrasound Med. Biol. 27, 2001; Hsu et al. 2008).
//! - A **plane** that rests, the floor of a water tank or a membrane, is seen as a line (Prager et al. 1998). A line tells two numbers a picture, and the probe has to be tilted both ways.
//!
//! A target has no left and right. Pictures that are mirrored are calibrated as they are, and nothing here can tell: what is found holds for pictures with the same orientation.
//!
//! - [`glimpse`]: what of the target pictures show.
//! - `points`, `planes`: where to begin.
//! - [`refine`](mod@refine), `predicted`: what explains all of it best, and how sure that is.
//! - `motion`: what the probe's motion leaves open.
//! - `held`: how far a calibration is off on pictures that had no part in it.
//! - [`calibrate`](mod@calibrate): all of it in turn, or the reason why there is none.

pub mod calibrate;
pub mod glimpse;
mod held;
mod motion;
mod planes;
mod points;
mod predicted;
pub mod refine;
#[cfg(test)]
mod simulated;

pub use calibrate::{Calibration, calibrate};
pub use glimpse::{Observation, Recording, Seen};
pub use motion::Axis;

use glam::{DVec2, DVec3};

use super::plane::ImagePlane;

/// What rests.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Target {
    /// A point somewhere.
    Point,
    /// A point whose place in the reference's frame is known: a stylus's tip.
    Tip {
        /// Where it is, mm.
        place_mm: DVec3,
        /// Standard deviation of that along each axis, mm; above 0.
        error_mm: f64,
    },
    /// A plane somewhere.
    Plane,
}

/// Where the target is in the reference's frame.
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
    /// How far a point is from it, mm.
    pub fn off_mm(&self, point: DVec3) -> f64 {
        match self {
            Self::Point(place) => point.distance(*place),
            Self::Plane { normal, distance_mm } => (normal.dot(point) - distance_mm).abs(),
        }
    }

    /// The pixel of a picture (in the reference's frame) that shows it: a point's foot on the picture, or the place on a plane's line that is nearest to a pixel.
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
    fn a_place_is_in_the_picture_where_it_is_nearest() {
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
        // Nothing of the line is nearer.
        let along = DVec2::new(-normal.dot(picture.v), normal.dot(picture.u)).normalize();
        assert!(plane.off_mm(picture.point(found + 9.0 * along)) < 1e-12 && (found - px).dot(along).abs() < 1e-9);
    }
}
