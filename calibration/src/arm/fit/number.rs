//! The numbers of a joint that a fit may change.

use super::options::Options;
use crate::arm::{Joint, Kind};

/// One fitted number of a joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Number of the joint, base first, from 1.
    pub joint: usize,
    /// The fitted parameter, which also gives the unit.
    pub what: Number,
    /// Value before the fit.
    pub before: f64,
    /// Fitted value.
    pub value: f64,
    /// Its standard deviation.
    pub sd: f64,
}

/// One of a joint's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Number {
    /// Length of its link, mm.
    Length,
    /// The count at its zero.
    Zero,
    /// Counts per turn or per mm.
    CountsPerUnit,
    /// Direction of a prismatic joint, degrees.
    Direction,
}

impl Number {
    pub(super) const ALL: [Self; 4] = [Self::Length, Self::Zero, Self::CountsPerUnit, Self::Direction];

    /// Returns its name, for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Length => "length",
            Self::Zero => "zero",
            Self::CountsPerUnit => "counts a unit",
            Self::Direction => "direction",
        }
    }

    /// Returns its unit, for people.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Length => "mm",
            Self::Zero | Self::CountsPerUnit => "counts",
            Self::Direction => "degrees",
        }
    }

    pub(super) fn of(self, joint: &mut Joint) -> Option<&mut f64> {
        match (self, &mut joint.kind) {
            (Self::Length, _) => Some(&mut joint.length_mm),
            (Self::Zero, _) => Some(&mut joint.zero_counts),
            (Self::CountsPerUnit, _) => Some(&mut joint.counts_per_unit),
            (Self::Direction, Kind::Prismatic { direction_deg }) => Some(direction_deg),
            (Self::Direction, Kind::Revolute) => None,
        }
    }

    pub(super) fn is_fitted(self, joint: usize, options: &Options) -> bool {
        match self {
            Self::Length => options.lengths[joint],
            Self::Zero => options.zeros[joint],
            Self::CountsPerUnit => options.counts_per_unit,
            Self::Direction => options.directions[joint],
        }
    }

    /// Returns a step of this parameter that moves the tip by about a millimetre.
    pub(super) fn typical(self, joint: &Joint, reach_mm: f64) -> f64 {
        let mm = match (self, joint.kind) {
            (Self::Length, _) => return 1.0,
            (Self::Direction, _) => return (1.0 / reach_mm).to_degrees(),
            (_, Kind::Revolute) => 1.0 / reach_mm,
            (_, Kind::Prismatic { .. }) => 1.0,
        };
        let counts = mm / joint.value_per_count().abs();
        match self {
            Self::CountsPerUnit => joint.counts_per_unit * mm,
            _ => counts,
        }
    }
}
