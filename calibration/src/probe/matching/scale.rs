//! Tolerances of a match, at the scale of an image.

use crate::probe::dots::Dot;
use crate::probe::plane::Unit;

/// Range of the longer side of an image, mm: from the smallest transducers' near field to the
/// deepest abdomen.
pub const PICTURE_MM: [f64; 2] = [15.0, 450.0];
/// Largest distance of dots from their predicted places, mm. Wires sag and are off their holes'
/// centres by tenths, a dot's centre is off by as much, and an extrapolated guess doubles it.
pub(super) const NEAR_MM: f64 = 0.8;
/// Largest distance of an N's middle dot from the line of the others, mm.
pub(super) const IN_LINE_MM: f64 = 0.6;
/// Largest ratio of a pixel's sides as computed from one image. Scanners' pixels differ by a
/// few per cent, and the plane's angle to the posts is uncertain.
pub(super) const ASPECT: f64 = 1.6;
/// The wires of a phantom are about equally bright. A dot fainter than the others' median by
/// this factor costs as much as a misfit of [`NEAR_MM`].
const FAINT: f64 = 4.0;
/// A wire may be cut beyond its ends by this share of its length.
pub(super) const BEYOND: f64 = 0.05;
/// Steepest cut, as the cosine between the plane's normal and the posts: beyond it a dot is a
/// streak.
pub(in crate::probe) const STEEPEST: f64 = 0.4;

/// An image's scale, and quantities that follow from it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    pub(super) unit: Unit,
    /// Smallest and largest pixel size, mm.
    pub(super) pixel_mm: [f64; 2],
    /// Median contrast of the brightest dots, as many as there are wires.
    pub(super) usual: f64,
}

impl Scale {
    /// Returns a dot's faintness, 1 at a factor of [`FAINT`]: echoes are faint.
    pub(super) fn faint(&self, contrast: f32) -> f64 {
        (self.usual / f64::from(contrast)).ln().max(0.0) / FAINT.ln()
    }

    /// Returns the cost of a dot for a wire: distance over [`NEAR_MM`] plus faintness; `None`
    /// if farther away.
    pub(super) fn against(&self, distance_mm: f64, dot: &Dot) -> Option<f64> {
        (distance_mm <= NEAR_MM).then(|| distance_mm / NEAR_MM + self.faint(dot.contrast))
    }
}

/// Returns the dot of the least cost.
pub(super) fn best(dots: impl Iterator<Item = (usize, Option<f64>)>) -> Option<(usize, f64)> {
    dots.filter_map(|(dot, against)| Some((dot, against?))).min_by(|a, b| a.1.total_cmp(&b.1))
}
