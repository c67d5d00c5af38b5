//! An image's recognised dots, with its time.

use glam::DVec3;

use sonoweave_core::frames::{Phantom, Probe, Reference, Transform};

use super::matching::Mark;
use super::track::Track;
use crate::phantom::Wire;

/// An image whose dots are recognised.
#[derive(Debug, Clone, PartialEq)]
pub struct Sighting {
    /// Number of the frame, with a meaning defined by the caller.
    pub frame: usize,
    /// Time, s, by the clock of the poses.
    pub time_s: f64,
    /// Its dots.
    pub marks: Vec<Mark>,
}

impl Sighting {
    /// Returns the phantom's pose in the probe's frame, for poses that lag images by `lag_s`.
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

/// Returns the offset of a point of the phantom's frame from a wire's line, along two
/// directions across it, mm.
pub(super) fn off_wire(wire: &Wire, point_mm: DVec3) -> [f64; 2] {
    wire.across().map(|across| across.dot(point_mm - wire.ends_mm[0]))
}
