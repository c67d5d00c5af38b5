//! The part of the image that holds the scanner's data: a rectangle or a fan, in pixels of the
//! image in MF orientation.
//!
//! Coordinates are those of [`crate::frames::Image`]: pixel (0, 0) has its centre at the
//! origin. A pixel belongs to a region when its centre does; borders belong to the region.

use serde::{Deserialize, Serialize};

use crate::rotation::sin_cos;

/// Tolerance, in pixels, for centres on a fan's border: trigonometry in f64 is off by some
/// 1e-13 there.
const ON_BORDER: f64 = 1e-9;

/// A rectangle of whole pixels: columns `x..x + width`, rows `y..y + height`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClipRect {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Number of columns, at least 1.
    pub width: u32,
    /// Number of rows, at least 1.
    pub height: u32,
}

impl ClipRect {
    /// Builds a rectangle.
    ///
    /// # Errors
    /// [`BadRegion`] when the rectangle holds no pixel.
    pub fn new(x: u32, y: u32, width: u32, height: u32) -> Result<Self, BadRegion> {
        if width == 0 || height == 0 {
            return Err(BadRegion::Empty { width, height });
        }
        Ok(Self { x, y, width, height })
    }

    /// Returns whether every pixel of a `width`×`height` image lies inside.
    pub fn covers(&self, width: u32, height: u32) -> bool {
        self.x == 0 && self.y == 0 && self.width >= width && self.height >= height
    }
}

/// The sector shown by a curvilinear or phased array.
///
/// Angles are in degrees from the +v (down) axis, positive towards +u: the direction of angle a
/// is (sin a, cos a). This is PLUS's convention. IGSIO's `vtkIGSIOPasteSliceIntoVolume` keeps a
/// pixel at offset (x, y) from the origin under three conditions. x/y lies between the angles'
/// tangents, y is at least 0, and the distance lies between the two radii.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Fan {
    origin_px: [f64; 2],
    radii_px: [f64; 2],
    angles_deg: [f64; 2],
}

impl Fan {
    /// Builds a sector about `origin_px` (u, v; may lie outside the image), between two radii
    /// (px) and two angles (degrees).
    ///
    /// # Errors [`BadRegion`] unless all numbers are finite, 0 ≤ first radius < second,
    /// and −180 ≤ first angle < second ≤ 180.
    pub fn new(origin_px: [f64; 2], radii_px: [f64; 2], angles_deg: [f64; 2]) -> Result<Self, BadRegion> {
        if [origin_px, radii_px, angles_deg].iter().flatten().any(|x| !x.is_finite()) {
            return Err(BadRegion::NotFinite);
        }
        if !(radii_px[0] >= 0.0 && radii_px[0] < radii_px[1]) {
            return Err(BadRegion::Radii(radii_px));
        }
        if !(angles_deg[0] >= -180.0 && angles_deg[0] < angles_deg[1] && angles_deg[1] <= 180.0) {
            return Err(BadRegion::Angles(angles_deg));
        }
        Ok(Self { origin_px, radii_px, angles_deg })
    }

    /// Returns the apex, u and v in pixels.
    pub fn origin_px(&self) -> [f64; 2] {
        self.origin_px
    }

    /// Returns the nearest and farthest distance from the apex, pixels.
    pub fn radii_px(&self) -> [f64; 2] {
        self.radii_px
    }

    /// Returns the first and last angle, degrees from +v towards +u.
    pub fn angles_deg(&self) -> [f64; 2] {
        self.angles_deg
    }

    /// Returns a test for points, with its trigonometry done once.
    pub fn test(&self) -> FanTest {
        let [first, last] = self.angles_deg.map(f64::to_radians);
        FanTest {
            origin: self.origin_px,
            radii: self.radii_px,
            first: sin_cos(first),
            last: sin_cos(last),
            wide: last - first > std::f64::consts::PI,
        }
    }
}

/// A [`Fan`], ready to test points.
#[derive(Debug, Clone, Copy)]
pub struct FanTest {
    origin: [f64; 2],
    radii: [f64; 2],
    first: [f64; 2],
    last: [f64; 2],
    wide: bool,
}

impl FanTest {
    /// Returns whether the point (u, v), in pixels, lies in the sector.
    #[inline]
    pub fn contains(&self, u: f64, v: f64) -> bool {
        let (x, y) = (u - self.origin[0], v - self.origin[1]);
        let radius = x.hypot(y);
        if !(radius >= self.radii[0] - ON_BORDER && radius <= self.radii[1] + ON_BORDER) {
            return false;
        }
        // Distances to the lines of both edges, positive towards growing angles: (x, y) = r
        // (sin t, cos t) gives r sin(t − a).
        let after_first = x * self.first[1] - y * self.first[0] >= -ON_BORDER;
        let before_last = x * self.last[1] - y * self.last[0] <= ON_BORDER;
        if self.wide { after_first || before_last } else { after_first && before_last }
    }
}

/// Reason why numbers do not describe a region of an image.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BadRegion {
    /// The rectangle has no pixels.
    #[error("a clip rectangle of {width}×{height} pixels is empty; give a width and a height of at least 1")]
    Empty {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A number of a fan is NaN or infinite.
    #[error("a fan's numbers must be finite")]
    NotFinite,
    /// The radii do not grow, px.
    #[error("a fan's radii must grow from at least 0, not {} to {}", .0[0], .0[1])]
    Radii([f64; 2]),
    /// The angles do not grow, or leave their range, degrees.
    #[error("a fan's angles must grow between -180 and 180 degrees (0 is down, positive to the right), not {} to {}", .0[0], .0[1])]
    Angles([f64; 2]),
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn contains_checks_radius_and_angle(
            radius in 0.1..900.0_f64, angle in -179.0..179.0_f64,
            inner in 0.0..300.0_f64, depth in 10.0..500.0_f64, first in -179.0..170.0_f64, width in 1.0..340.0_f64,
        ) {
            let last = (first + width).min(180.0);
            let fan = Fan::new([380.5, -20.25], [inner, inner + depth], [first, last]).unwrap();
            let near = (radius - inner).abs().min((radius - inner - depth).abs()) < 1e-6
                || radius * (angle - first).abs().min((angle - last).abs()).to_radians() < 1e-6
                // The edge of 180 is also that of -180.
                || radius * (180.0 - angle.abs()).to_radians() < 1e-6;
            prop_assume!(!near);
            let t = angle.to_radians();
            let inside = fan.test().contains(380.5 + radius * t.sin(), -20.25 + radius * t.cos());
            prop_assert_eq!(inside, radius > inner && radius < inner + depth && angle > first && angle < last);
        }
    }

    #[test]
    fn positive_angles_are_right_and_borders_are_inside() {
        let test = Fan::new([100.0, 10.0], [0.0, 50.0], [0.0, 45.0]).unwrap().test();
        assert!(test.contains(110.0, 30.0));
        assert!(!test.contains(90.0, 30.0));
        assert!(test.contains(100.0, 60.0), "the lowest point at angle 0");
        assert!(test.contains(120.0, 30.0), "on the 45 degree edge");
        assert!(!test.contains(121.0, 30.0));
        assert!(!test.contains(100.0, 9.0), "above the apex");
        assert!(!test.contains(100.0, 60.5));
    }

    #[test]
    fn bad_fans_and_empty_rectangles_are_refused() {
        assert_eq!(Fan::new([0.0, 0.0], [10.0; 2], [-1.0, 1.0]), Err(BadRegion::Radii([10.0; 2])));
        assert_eq!(Fan::new([0.0, 0.0], [-1.0, 10.0], [-1.0, 1.0]), Err(BadRegion::Radii([-1.0, 10.0])));
        assert_eq!(Fan::new([0.0, 0.0], [0.0, 10.0], [1.0, -1.0]), Err(BadRegion::Angles([1.0, -1.0])));
        assert_eq!(Fan::new([0.0, f64::NAN], [0.0, 10.0], [-1.0, 1.0]), Err(BadRegion::NotFinite));
        assert_eq!(ClipRect::new(0, 0, 0, 5), Err(BadRegion::Empty { width: 0, height: 5 }));
        assert!(ClipRect::new(0, 0, 820, 616).unwrap().covers(820, 616));
        assert!(!ClipRect::new(0, 0, 819, 616).unwrap().covers(820, 616));
    }
}
