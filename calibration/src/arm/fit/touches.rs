//! Touches, and the known facts about the touched places.

use glam::DVec2;

use crate::arm::JOINTS;

/// One touch: the tip set down and kept still.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// Mean counts of the joints, base first.
    pub counts: [f64; JOINTS],
    /// Index of the touched divot or distance among the known ones.
    pub of: usize,
}

/// Known facts about the touched places.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Known<'a> {
    /// Divots of a plate that lies anywhere, mm, in the plane that the arm moves in. A single
    /// divot is a fixed point, whatever its coordinates.
    Divots(&'a [DVec2]),
    /// Distances, mm. Each has two touches, one of either end.
    Distances(&'a [f64]),
}

impl Known<'_> {
    /// Returns their number.
    pub fn count(&self) -> usize {
        match self {
            Self::Divots(divots) => divots.len(),
            Self::Distances(distances) => distances.len(),
        }
    }
}
