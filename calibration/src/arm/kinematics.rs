//! Forward kinematics: from joint values and counts to the pose of the last link.

use glam::DVec2;

use sonoweave_core::frames::{Probe, Tracker, Transform};
use sonoweave_core::rotation::direction;

use super::{Arm, JOINTS, Kind, Link, PlanarPose, Values};

impl Arm {
    /// Returns the turn and length of each joint's link against the one before.
    pub(super) fn steps(&self, values: &Values) -> [(f64, f64); JOINTS] {
        std::array::from_fn(|i| match self.joints[i].kind {
            Kind::Revolute => (values[i], self.joints[i].length_mm),
            Kind::Prismatic { direction_deg } => (direction_deg.to_radians(), self.joints[i].length_mm + values[i]),
        })
    }

    /// Returns its links, base first, and the heading of the last one.
    pub(super) fn links(&self, values: &Values) -> ([Link; JOINTS], f64) {
        let (mut joint, mut heading) = (DVec2::ZERO, 0.0);
        let links = self.steps(values).map(|(turn, length)| {
            heading += turn;
            let along = direction(heading);
            let link = Link { joint, along, end: joint + length * along };
            joint = link.end;
            link
        });
        (links, heading)
    }

    /// Returns the pose of its last link.
    pub fn pose(&self, values: &Values) -> PlanarPose {
        let (links, heading_rad) = self.links(values);
        PlanarPose { position_mm: links[JOINTS - 1].end, heading_rad }
    }

    /// Returns the probe's pose at these joint counts.
    pub fn tracker_from_probe(&self, counts: &[i64; JOINTS]) -> Transform<Tracker, Probe> {
        self.pose(&self.values(counts)).tracker_from_probe()
    }
}
