//! The 3-DOF arm: what its joints' counts say of where the probe is.
//!
//! A planar chain of three joints, base first, in the x-y plane of the base ([`Tracker`]). Each joint turns or slides, and the next one sits at the end of its link:
//!
//! ```text
//! tracker_from_probe = Π  turn(aᵢ) · shift(lᵢ, 0)
//!                      i
//! a revolute joint:   aᵢ = its value, rad      lᵢ = its link's length
//! a prismatic joint:  aᵢ = its direction       lᵢ = its link's length + its value, mm
//! value = sign · (count − zero_counts) / counts_per_unit      a unit is a turn, or a mm
//! ```
//!
//! So the probe's frame has its origin at the end of the last link, x along it, and z is the base's. Image axis u is to lie along that z; slices then move in the
//! plane and turn about z, and stay perpendicular to one plane however the arm is moved.
//!
//! - [`pose`]: where the last link is, in the plane.
//! - [`inverse`]: which joint values take it there.
//! - [`plate`]: places on a plate that are known.
//! - [`rest`]: the moments at which its joints rest, which are touches.
//! - [`mod@fit`], [`reach`], [`mod@check`]: its parameters from touches of what is known, how well the tip is known by them, and whether a running arm still has them.
//! - [`accuracy`]: derivatives by values and by parameters, and what counts that are off do to a point of the picture.

use std::f64::consts::TAU;
use std::fmt;

use glam::DVec2;
use serde::Serialize;

use crate::frames::{Probe, Tracker, Transform};

pub mod accuracy;
pub mod check;
pub mod fit;
pub mod inverse;
pub mod plate;
pub mod pose;
pub mod reach;
pub mod rest;
#[cfg(test)]
mod tests;

pub use accuracy::{Derivatives, Displacement};
pub use inverse::{Elbow, Unreachable};
pub use pose::{NotPlanar, PlanarPose};

/// Joints of an arm.
pub const JOINTS: usize = 3;

/// Values of the joints, base first: rad of those that turn, mm of those that slide.
pub type Values = [f64; JOINTS];

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum Kind {
    /// It turns about the base's z; positive from x to y.
    Revolute,
    /// It slides.
    Prismatic {
        /// Its direction against the link before it, degrees; positive from x to y.
        direction_deg: f64,
    },
}

/// Which way a joint's count grows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(into = "i8")]
pub enum Sign {
    /// With its value.
    #[default]
    Plus,
    /// Against it.
    Minus,
}

impl Sign {
    /// 1 or −1.
    pub fn factor(self) -> f64 {
        i8::from(self).into()
    }
}

impl From<Sign> for i8 {
    fn from(sign: Sign) -> Self {
        match sign {
            Sign::Plus => 1,
            Sign::Minus => -1,
        }
    }
}

/// A joint and the link that it moves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Joint {
    /// How it moves.
    #[serde(flatten)]
    pub kind: Kind,
    /// Length of its link, mm; of one that slides, at value 0.
    pub length_mm: f64,
    /// The count at value 0; not whole as a rule.
    pub zero_counts: f64,
    /// Counts a turn, or a mm. Above 0.
    pub counts_per_unit: f64,
    /// Which way its count grows.
    pub sign: Sign,
}

impl Joint {
    /// One that turns, and counts so many times a turn, from 0 where the links are in line.
    pub fn revolute(length_mm: f64, counts_per_turn: f64) -> Self {
        Self { kind: Kind::Revolute, length_mm, zero_counts: 0.0, counts_per_unit: counts_per_turn, sign: Sign::Plus }
    }

    /// One that slides in a direction (degrees) against the link before it, and counts so many times a mm, from 0 at the given length.
    pub fn prismatic(direction_deg: f64, length_mm: f64, counts_per_mm: f64) -> Self {
        let kind = Kind::Prismatic { direction_deg };
        Self { kind, length_mm, zero_counts: 0.0, counts_per_unit: counts_per_mm, sign: Sign::Plus }
    }

    /// Rad or mm of one count more.
    pub fn value_per_count(&self) -> f64 {
        let unit = if self.kind == Kind::Revolute { TAU } else { 1.0 };
        self.sign.factor() * unit / self.counts_per_unit
    }

    /// The value that a count means; a count need not be whole.
    pub fn value(&self, count: f64) -> f64 {
        (count - self.zero_counts) * self.value_per_count()
    }

    /// The count at a value; not whole.
    pub fn count(&self, value: f64) -> f64 {
        value / self.value_per_count() + self.zero_counts
    }
}

impl fmt::Display for Joint {
    /// For people: what it is, in a row.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kind, length_mm, zero_counts, counts_per_unit, sign } = self;
        match kind {
            Kind::Revolute => write!(f, "revolute, link of {length_mm} mm, {counts_per_unit} counts a turn")?,
            Kind::Prismatic { direction_deg } => {
                write!(f, "prismatic at {direction_deg}°, {length_mm} mm at zero, {counts_per_unit} counts a mm")?;
            }
        }
        let backwards = if *sign == Sign::Minus { " backwards" } else { "" };
        write!(f, "{backwards}, zero at {zero_counts}")
    }
}

/// An arm whose numbers make sense.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arm {
    joints: [Joint; JOINTS],
}

/// Why numbers are no arm.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BadArm {
    /// NaN or infinity.
    #[error("joint {joint} of 3: its {what} is not a finite number")]
    NotFinite {
        /// Which, from 1.
        joint: usize,
        /// Which of its numbers.
        what: &'static str,
    },
    /// No counts, or fewer.
    #[error(
        "joint {joint} of 3: {counts} counts a turn or a mm; give a number above 0, and sign = -1 for one that counts the other way"
    )]
    Counts {
        /// Which, from 1.
        joint: usize,
        /// As given.
        counts: f64,
    },
    /// A link that points backwards.
    #[error("joint {joint} of 3: a link of {mm} mm; give its length, and turn it by the joint's zero")]
    Length {
        /// Which, from 1.
        joint: usize,
        /// As given.
        mm: f64,
    },
}

/// A link as it lies.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Link {
    /// Where its joint is, mm in the base's plane.
    joint: DVec2,
    /// Unit vector along it.
    along: DVec2,
    /// Where it ends.
    end: DVec2,
}

impl Arm {
    /// Of three joints, base first.
    ///
    /// # Errors
    /// [`BadArm`] names the joint and the number that makes no sense.
    pub fn new(joints: [Joint; JOINTS]) -> Result<Self, BadArm> {
        for (joint, number) in joints.iter().zip(1..) {
            let direction = match joint.kind {
                Kind::Revolute => 0.0,
                Kind::Prismatic { direction_deg } => direction_deg,
            };
            let numbers = [
                (joint.length_mm, "length"),
                (joint.zero_counts, "zero"),
                (joint.counts_per_unit, "number of counts a turn or a mm"),
                (direction, "direction"),
            ];
            if let Some((_, what)) = numbers.into_iter().find(|(x, _)| !x.is_finite()) {
                return Err(BadArm::NotFinite { joint: number, what });
            }
            if joint.counts_per_unit <= 0.0 {
                return Err(BadArm::Counts { joint: number, counts: joint.counts_per_unit });
            }
            if joint.kind == Kind::Revolute && joint.length_mm < 0.0 {
                return Err(BadArm::Length { joint: number, mm: joint.length_mm });
            }
        }
        Ok(Self { joints })
    }

    /// Its joints, base first.
    pub fn joints(&self) -> &[Joint; JOINTS] {
        &self.joints
    }

    /// The same arm, whose counts are 0 at these values: as when its encoders are set there, in its home position.
    pub fn zeroed_at(&self, values: &Values) -> Self {
        let mut arm = *self;
        for (joint, value) in arm.joints.iter_mut().zip(values) {
            joint.zero_counts = 0.0;
            joint.zero_counts = -joint.count(*value);
        }
        arm
    }

    /// What counts mean.
    pub fn values(&self, counts: &[i64; JOINTS]) -> Values {
        // Exact: no counter of an arm reaches 2⁵³.
        std::array::from_fn(|i| self.joints[i].value(counts[i] as f64))
    }

    /// The counts at these values; not whole.
    pub fn counts(&self, values: &Values) -> [f64; JOINTS] {
        std::array::from_fn(|i| self.joints[i].count(values[i]))
    }

    /// Turn and length of each joint's link against the one before.
    fn steps(&self, values: &Values) -> [(f64, f64); JOINTS] {
        std::array::from_fn(|i| match self.joints[i].kind {
            Kind::Revolute => (values[i], self.joints[i].length_mm),
            Kind::Prismatic { direction_deg } => (direction_deg.to_radians(), self.joints[i].length_mm + values[i]),
        })
    }

    /// Its links, base first, and the last one's heading.
    fn links(&self, values: &Values) -> ([Link; JOINTS], f64) {
        let (mut joint, mut heading) = (DVec2::ZERO, 0.0);
        let links = self.steps(values).map(|(turn, length)| {
            heading += turn;
            let along = DVec2::from_angle(heading);
            let link = Link { joint, along, end: joint + length * along };
            joint = link.end;
            link
        });
        (links, heading)
    }

    /// Where its last link is.
    pub fn pose(&self, values: &Values) -> PlanarPose {
        let (links, heading_rad) = self.links(values);
        PlanarPose { position_mm: links[JOINTS - 1].end, heading_rad }
    }

    /// Where the probe is by its joints' counts.
    pub fn tracker_from_probe(&self, counts: &[i64; JOINTS]) -> Transform<Tracker, Probe> {
        self.pose(&self.values(counts)).tracker_from_probe()
    }
}
