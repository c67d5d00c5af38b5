//! What a picture says of the image plane: its dots, and when it was taken.

use glam::DVec3;

use super::matching::Mark;
use super::track::Track;
use crate::frames::{Phantom, Probe, Reference, Transform};
use crate::phantom::Wire;

/// A picture whose dots are recognised.
#[derive(Debug, Clone, PartialEq)]
pub struct Sighting {
    /// Which picture: whoever made it knows what the number means.
    pub frame: usize,
    /// When, s, by the clock of the poses.
    pub time_s: f64,
    /// Its dots.
    pub marks: Vec<Mark>,
}

impl Sighting {
    /// Where the phantom was for the probe, by poses that come so much later than pictures.
    pub fn probe_from_phantom(
        &self,
        track: &Track,
        lag_s: f64,
        reference_from_phantom: &Transform<Reference, Phantom>,
    ) -> Option<Transform<Probe, Phantom>> {
        let poses = track.at(self.time_s + lag_s)?;
        Some(poses.reference_from_probe().inverse() * *reference_from_phantom)
    }
}

/// How far a point of the phantom's frame is from a wire's line, along two directions across it, mm.
pub(super) fn off_wire(wire: &Wire, point_mm: DVec3) -> [f64; 2] {
    wire.across().map(|across| across.dot(point_mm - wire.ends_mm[0]))
}
