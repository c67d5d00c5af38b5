//! The view of a picture, and the limits of pictures.

use glam::DVec3;

/// Largest number of pixels along a side of the picture.
pub const MOST_PIXELS: u32 = 8192;
/// Largest number of samples along a ray; their numbers are kept in 16 bits.
pub const MOST_SAMPLES: u32 = 65_000;

/// The viewing direction, degrees. Azimuth 0 looks along the world's +y, 90 along −x; elevation
/// 90 looks down along −z. Up in the picture is the world's +z, turned clockwise by the roll.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct View {
    /// About the world's z axis.
    pub azimuth: f64,
    /// Above the world's xy plane.
    pub elevation: f64,
    /// Rotation of the picture about its centre.
    pub roll: f64,
    /// Field of view along the picture's smaller side, degrees in (0, 170]; `None` for parallel
    /// rays.
    pub perspective: Option<f64>,
    /// Whether the picture belongs to a turntable sequence; then all its pictures have one
    /// scale. Otherwise parallel rays show the box as large as it fits.
    pub turns: bool,
    /// Additional magnification, as a power of two.
    pub zoom: f64,
    /// World position in the middle of the picture, mm; `None` for the middle of the box.
    pub aim: Option<DVec3>,
}
