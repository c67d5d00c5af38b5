//! The transducer's shape, and the positions of its beams.

use glam::DVec2;

use crate::elementary::sin_cos;

/// Margin above and below the field, as part of the image's height.
pub(super) const MARGIN: f64 = 0.03;

/// The transducer's shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Transducer {
    /// Elements on an arc: the beams diverge from its centre.
    Curvilinear {
        /// The arc's radius, mm.
        radius_mm: f64,
        /// Angle from the first beam to the last, degrees, at most 90.
        opening_deg: f64,
    },
    /// Elements in a row: the beams are parallel.
    Linear {
        /// Distance from the first beam to the last, mm.
        width_mm: f64,
    },
}

impl Transducer {
    /// Returns the lateral coordinate of the last beam; that of the first is its negative.
    pub fn half_opening(&self) -> f64 {
        match self {
            Self::Curvilinear { opening_deg, .. } => 0.5 * opening_deg.to_radians(),
            Self::Linear { width_mm } => 0.5 * width_mm,
        }
    }

    /// Returns the position of a beam at a range.
    pub fn place(&self, lateral: f64, range: f64) -> DVec2 {
        let (origin, direction) = self.beam(lateral);
        origin + direction * range
    }

    /// Returns a beam's origin on the face, and its direction.
    pub fn beam(&self, lateral: f64) -> (DVec2, DVec2) {
        match self {
            Self::Curvilinear { radius_mm, .. } => {
                let (sin, cos) = sin_cos(lateral);
                (DVec2::new(radius_mm * sin, radius_mm * (cos - 1.0)), DVec2::new(sin, cos))
            }
            Self::Linear { .. } => (DVec2::new(lateral, 0.0), DVec2::Y),
        }
    }

    /// Returns lateral coordinate and range of a position, within a quarter turn of the middle.
    pub fn locate(&self, at: DVec2) -> [f64; 2] {
        match self {
            Self::Curvilinear { radius_mm, .. } => {
                let from_centre = at + DVec2::new(0.0, *radius_mm);
                // The result of libm is the same on every machine.
                [libm::atan2(from_centre.x, from_centre.y), from_centre.length() - radius_mm]
            }
            Self::Linear { .. } => [at.x, at.y],
        }
    }

    /// Returns mm across the beams per unit of the lateral coordinate, at a range.
    pub fn mm_per_lateral(&self, range: f64) -> f64 {
        match self {
            Self::Curvilinear { radius_mm, .. } => radius_mm + range,
            Self::Linear { .. } => 1.0,
        }
    }

    /// Returns width and height of the field down to a depth, mm.
    pub fn extent_mm(&self, depth: f64) -> [f64; 2] {
        let half = self.half_opening();
        match self {
            Self::Curvilinear { radius_mm, .. } => {
                let (sin, cos) = sin_cos(half);
                [2.0 * (radius_mm + depth) * sin, depth + radius_mm * (1.0 - cos)]
            }
            Self::Linear { width_mm } => [*width_mm, depth],
        }
    }
}
