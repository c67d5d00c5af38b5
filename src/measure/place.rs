//! A place that somebody points at: on a plane, or in the view of the volume, where it is seen at some depth.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{MOST_MM, MOST_WIDE_MM};
use crate::render::Picked;

/// A place of the world, and how it was pointed at.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "Said")]
pub struct Place {
    /// Where it lies, mm.
    pub point: [f64; 3],
    /// The direction in the world, of length 1, along which it was looked for; of no use where the depth is 0.
    pub along: [f64; 3],
    /// The width along it in which it may lie anywhere, mm; 0 of places on a plane.
    pub depth_mm: f64,
    /// Width of a pixel where it was pointed at, mm; `None` where nobody says.
    pub pixel_mm: Option<f64>,
}

/// As it is said: three numbers, or these with all that is known.
#[derive(Deserialize)]
#[serde(untagged)]
enum Said {
    Point([f64; 3]),
    Place(Known),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Known {
    point: [f64; 3],
    #[serde(default)]
    along: [f64; 3],
    #[serde(default)]
    depth_mm: f64,
    #[serde(default)]
    pixel_mm: Option<f64>,
}

impl From<Said> for Place {
    fn from(said: Said) -> Self {
        match said {
            Said::Point(point) => point.into(),
            Said::Place(Known { point, along, depth_mm, pixel_mm }) => Self { point, along, depth_mm, pixel_mm },
        }
    }
}

impl From<[f64; 3]> for Place {
    fn from(point: [f64; 3]) -> Self {
        Self { point, along: [0.0; 3], depth_mm: 0.0, pixel_mm: None }
    }
}

impl From<Picked> for Place {
    fn from(Picked { point, along, depth_mm, pixel_mm }: Picked) -> Self {
        Self { point: point.to_array(), along: along.to_array(), depth_mm, pixel_mm: Some(pixel_mm) }
    }
}

impl Place {
    /// Whether there can be such a place.
    ///
    /// # Errors
    /// A sentence.
    pub(super) fn check(&self) -> Result<(), String> {
        let Self { point, depth_mm, pixel_mm, .. } = self;
        if point.iter().any(|x| !x.is_finite() || x.abs() > MOST_MM) {
            return Err(format!("a point is no place within {MOST_MM} mm of the world's origin"));
        }
        if [*depth_mm, pixel_mm.unwrap_or(0.0)].iter().any(|width| !(0.0..=MOST_WIDE_MM).contains(width)) {
            return Err(format!("a place's depth_mm and pixel_mm are 0 to {MOST_WIDE_MM}"));
        }
        if *depth_mm > 0.0 && self.along() == DVec3::ZERO {
            return Err("a place that has a depth_mm says by along which way that goes".into());
        }
        Ok(())
    }

    /// The direction of its depth, of length 1; 0 where it has none.
    pub(super) fn along(&self) -> DVec3 {
        DVec3::from_array(self.along).normalize_or_zero()
    }
}
