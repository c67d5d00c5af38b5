//! What is marked in the picture of the volume: where the present slice lies, and what the scan has left out.

use glam::DVec3;
use serde_json::{Value, json};

use super::sight::Sight;
use crate::coach::outlines::Outlines;

/// Corners in a picture, in pixels from its upper left corner.
type Corners = [[f64; 2]; 4];

/// The marks of one picture.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Marks {
    /// The picture's number.
    sequence: u32,
    size: [u32; 2],
    present: Option<Corners>,
    holes: Vec<Corners>,
}

impl Marks {
    /// Where the outlines are in the last picture, of which this is the number; `None` before the first.
    pub(super) fn of(outlines: &Outlines, sight: &Sight, sequence: u32) -> Option<Self> {
        let size = sight.size()?;
        let corners = |quad: [DVec3; 4]| -> Option<Corners> {
            let mut corners = [[0.0; 2]; 4];
            for (corner, at) in corners.iter_mut().zip(quad) {
                // Tenths of a pixel; what is more is not seen. A pixel's place is its centre's.
                *corner = sight.project(at)?.map(|place| (10.0 * (place + 0.5)).round() / 10.0);
            }
            Some(corners)
        };
        let present = outlines.present.and_then(corners);
        Some(Self { sequence, size, present, holes: outlines.quads().filter_map(corners).collect() })
    }

    /// Whether others are to be drawn. Another picture with the same marks is none.
    pub(super) fn differ(&self, other: &Self) -> bool {
        (self.size, self.present, &self.holes) != (other.size, other.present, &other.holes)
    }

    /// To a page.
    pub(super) fn told(&self) -> Value {
        let Self { sequence, size, present, holes } = self;
        json!({ "marks": { "sequence": sequence, "size": size, "present": present, "holes": holes } })
    }
}
