//! Contours of one body, in the order of a sweep.

use glam::DVec3;

use crate::contour::Contour;
use crate::error::SegmentError;

/// Contours on planes that do not cross within them, one a plane, in the order of a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct Contours {
    list: Vec<Contour>,
    /// Frame of reference of their numbers.
    frame: String,
}

impl Contours {
    /// Puts the planes' perpendiculars along the sweep, and checks the order.
    ///
    /// # Errors
    /// [`SegmentError::FewContours`], [`SegmentError::Order`], [`SegmentError::Planes`].
    pub fn new(mut list: Vec<Contour>, frame: String) -> Result<Self, SegmentError> {
        if list.len() < 2 {
            return Err(SegmentError::FewContours { count: list.len() });
        }
        let mut direction = list[1].centroid() - list[0].centroid();
        for contour in &mut list {
            if contour.normal().dot(direction) < 0.0 {
                contour.turn();
            }
            direction = contour.normal();
        }
        for (at, contour) in list.iter().enumerate() {
            for (before, other) in list[..at].iter().enumerate().rev() {
                check(contour, other, at + 1, before + 1)?;
            }
        }
        Ok(Self { list, frame })
    }

    /// The contours, in order.
    pub fn list(&self) -> &[Contour] {
        &self.list
    }

    /// Frame of reference of their numbers.
    pub fn frame(&self) -> &str {
        &self.frame
    }

    /// Returns the lowest and the highest coordinates, world mm.
    pub fn bounds(&self) -> [DVec3; 2] {
        let ends = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        self.list.iter().flat_map(Contour::corners).fold(ends, |[low, high], p| [low.min(p), high.max(p)])
    }
}

/// Checks that a contour lies behind another's plane, and that one before its own.
fn check(contour: &Contour, other: &Contour, number: usize, before: usize) -> Result<(), SegmentError> {
    let behind = contour.corners().filter(|p| other.height(*p) > 0.0).count();
    let ahead = other.corners().filter(|p| contour.height(*p) < 0.0).count();
    match (behind, ahead) {
        (0, _) | (_, 0) => Err(SegmentError::Order { number, before }),
        _ if behind == contour.corners().count() && ahead == other.corners().count() => Ok(()),
        _ => Err(SegmentError::Planes { number, before }),
    }
}
