//! A place that the user picks: on a plane, or in the view of the volume, with a depth
//! uncertainty.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use reconstruct::standard_error::Edge;
use render::Picked;

use crate::error::MeasureError;

/// Largest coordinate of a place in the world, mm.
pub(super) const MOST_MM: f64 = 1e5;
/// Largest width of pixels and depths, mm.
pub(super) const MOST_WIDE_MM: f64 = 100.0;

/// A world position, and how it was picked.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "MarkInput")]
pub struct Place {
    /// Position, mm.
    pub point: [f64; 3],
    /// Unit direction of the picking ray in the world; unused if the depth is 0.
    pub along: [f64; 3],
    /// Width along the ray in which it may lie anywhere, mm; 0 for places on a plane.
    pub depth_mm: f64,
    /// Width of a screen pixel at the picked place, mm; `None` if not given.
    pub pixel_mm: Option<f64>,
    /// The volume's values there; `None` if their error is unknown.
    #[serde(skip)]
    pub edge: Option<Edge>,
}

/// Input format: three numbers, or these with all that is known.
#[derive(Deserialize)]
#[serde(untagged)]
enum MarkInput {
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

impl From<MarkInput> for Place {
    fn from(input: MarkInput) -> Self {
        match input {
            MarkInput::Point(point) => point.into(),
            MarkInput::Place(Known { point, along, depth_mm, pixel_mm }) => {
                Self { point, along, depth_mm, pixel_mm, edge: None }
            }
        }
    }
}

impl From<[f64; 3]> for Place {
    fn from(point: [f64; 3]) -> Self {
        Self { point, along: [0.0; 3], depth_mm: 0.0, pixel_mm: None, edge: None }
    }
}

impl From<Picked> for Place {
    fn from(Picked { point, along, depth_mm, pixel_mm }: Picked) -> Self {
        Self { point: point.to_array(), along: along.to_array(), depth_mm, pixel_mm: Some(pixel_mm), edge: None }
    }
}

impl Place {
    /// Checks that the place is valid.
    ///
    /// # Errors
    /// [`MeasureError`] for a position, width or direction that is invalid.
    pub(super) fn check(&self) -> Result<(), MeasureError> {
        let Self { point, depth_mm, pixel_mm, .. } = self;
        if point.iter().any(|x| !x.is_finite() || x.abs() > MOST_MM) {
            return Err(MeasureError::Outside { most_mm: MOST_MM });
        }
        if [*depth_mm, pixel_mm.unwrap_or(0.0)].iter().any(|width| !(0.0..=MOST_WIDE_MM).contains(width)) {
            return Err(MeasureError::Width { what: "a point's depth_mm and pixel_mm", most_mm: MOST_WIDE_MM });
        }
        if *depth_mm > 0.0 && self.along() == DVec3::ZERO {
            return Err(MeasureError::Direction);
        }
        Ok(())
    }

    /// Returns the unit direction of its depth; 0 if it has none.
    pub(super) fn along(&self) -> DVec3 {
        DVec3::from_array(self.along).normalize_or_zero()
    }
}
