//! Choice of the parameters that a fit changes.

use glam::DVec2;

use super::touches::Known;
use crate::arm::{Arm, JOINTS, Kind};

/// Choice of the fitted parameters, and known values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Position of the tip in the last link's frame (origin at the link's end, x along it), mm.
    /// If neither the tip nor that link's length is known, the fit expresses the tip as length.
    pub tip_mm: DVec2,
    /// Fit the lengths of these links.
    pub lengths: [bool; JOINTS],
    /// Fit the zeros of these joints. The first joint's zero turns the whole arm, as the
    /// position of the plate does, so touches never determine it.
    pub zeros: [bool; JOINTS],
    /// Fit counts per turn or mm. An encoder disc's counts are known better than touches can
    /// measure them.
    pub counts_per_unit: bool,
    /// Fit the directions of these prismatic joints. The direction of the first joint turns the
    /// whole arm.
    pub directions: [bool; JOINTS],
    /// Repeatability of the tip in a divot, mm, one standard deviation along each axis.
    pub tip_sd_mm: f64,
}

impl Default for Options {
    /// For three revolute joints and a plate.
    fn default() -> Self {
        Self {
            tip_mm: DVec2::ZERO,
            lengths: [true; JOINTS],
            zeros: [false, true, true],
            counts_per_unit: false,
            directions: [false; JOINTS],
            tip_sd_mm: 0.1,
        }
    }
}

impl Options {
    /// Returns the parameters that touches can determine for this arm. For revolute joints
    /// these are the link lengths and, except for the first joint, the zeros. For prismatic
    /// joints after the first they are the directions. The length and the zero of a prismatic
    /// joint are one number, and the neighbouring links' lengths already cover its effect.
    ///
    /// Touches of one point determine no scale unless there is a prismatic joint, whose counts
    /// are mm. The length of the longest link is kept in that case.
    pub fn of(start: &Arm, known: &Known<'_>) -> Self {
        let turns = start.joints().map(|joint| joint.kind == Kind::Revolute);
        let past_first = |joints: [bool; JOINTS]| std::array::from_fn(|joint| joint > 0 && joints[joint]);
        let mut lengths = turns;
        if matches!(known, Known::Divots([_])) && turns == [true; JOINTS] {
            let longest = (0..JOINTS)
                .max_by(|a, b| start.joints()[*a].length_mm.total_cmp(&start.joints()[*b].length_mm))
                .unwrap_or_default();
            lengths[longest] = false;
        }
        let directions = past_first(turns.map(|turns| !turns));
        Self { lengths, zeros: past_first(turns), directions, ..Self::default() }
    }
}
