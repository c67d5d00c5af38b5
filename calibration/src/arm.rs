//! The 3-DOF arm: forward kinematics from joint counts to the probe's pose.
//!
//! The arm is a planar chain of three joints, base first, in the x-y plane of the base
//! ([`Tracker`](sonoweave_core::frames::Tracker)). Each joint turns or slides, and the next one
//! sits at the end of its link:
//!
//! ```text
//! tracker_from_probe = Π  turn(aᵢ) · shift(lᵢ, 0)
//!                      i
//! a revolute joint:   aᵢ = its value, rad      lᵢ = its link's length
//! a prismatic joint:  aᵢ = its direction       lᵢ = its link's length + its value, mm
//! value = sign · (count − zero_counts) / counts_per_unit      a unit is a turn, or a mm
//! ```
//!
//! The probe's frame has its origin at the end of the last link, with x along that link and z
//! along the base's z. Image axis u is meant to lie along that z. Slices then move in the plane
//! and turn about z, so they all stay perpendicular to one plane.
//!
//! - `kinematics`: the pose of the last link at given joint values or counts.
//! - [`planar_pose`]: that pose, in the plane and in space.
//! - [`inverse`]: the joint values for a given pose.
//! - [`plate`]: known places on a plate.
//! - [`rest`]: the moments at which the joints rest, which are touches.
//! - [`mod@fit`], [`reach`], [`mod@check`]: its parameters fitted to touches of known places,
//!   the resulting accuracy of the tip, and a check that a running arm still has these
//!   parameters.
//! - [`accuracy`]: derivatives by values and by parameters, and the effect of count errors on a
//!   point of the image.

use std::f64::consts::TAU;
use std::fmt;

use glam::DVec2;
use serde::Serialize;

use crate::error::{ArmError, CalibrationError};

pub mod accuracy;
pub mod check;
pub mod fit;
pub mod inverse;
mod kinematics;
pub mod planar_pose;
pub mod plate;
pub mod reach;
pub mod rest;
#[cfg(test)]
mod tests;

pub use accuracy::{Derivatives, Displacement};
pub use inverse::Elbow;
pub use planar_pose::PlanarPose;

/// Number of joints of an arm.
pub const JOINTS: usize = 3;

/// Values of the joints, base first: rad for revolute joints, mm for prismatic ones.
pub type Values = [f64; JOINTS];

/// The type of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum Kind {
    /// Turns about the base's z; positive from x to y.
    Revolute,
    /// Slides.
    Prismatic {
        /// Direction against the link before it, degrees; positive from x to y.
        direction_deg: f64,
    },
}

/// The direction in which a joint's count grows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(into = "i8")]
pub enum Sign {
    /// The count grows with the value.
    #[default]
    Plus,
    /// The count grows against the value.
    Minus,
}

impl Sign {
    /// Returns 1 or −1.
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
    /// Its type.
    #[serde(flatten)]
    pub kind: Kind,
    /// Length of its link, mm; for a prismatic joint, the length at value 0.
    pub length_mm: f64,
    /// Count at value 0; in general not a whole number.
    pub zero_counts: f64,
    /// Counts per turn, or per mm. Above 0.
    pub counts_per_unit: f64,
    /// The direction in which its count grows.
    pub sign: Sign,
}

impl Joint {
    /// Returns a revolute joint with `counts_per_turn`, which counts from 0 at the position in
    /// line with the previous link.
    pub fn revolute(length_mm: f64, counts_per_turn: f64) -> Self {
        Self { kind: Kind::Revolute, length_mm, zero_counts: 0.0, counts_per_unit: counts_per_turn, sign: Sign::Plus }
    }

    /// Returns a prismatic joint that slides along `direction_deg` against the link before it
    /// and counts from 0 at `length_mm`.
    pub fn prismatic(direction_deg: f64, length_mm: f64, counts_per_mm: f64) -> Self {
        let kind = Kind::Prismatic { direction_deg };
        Self { kind, length_mm, zero_counts: 0.0, counts_per_unit: counts_per_mm, sign: Sign::Plus }
    }

    /// Returns the change of the value per count, rad or mm.
    pub fn value_per_count(&self) -> f64 {
        let unit = if self.kind == Kind::Revolute { TAU } else { 1.0 };
        self.sign.factor() * unit / self.counts_per_unit
    }

    /// Returns the value at a count; the count need not be whole.
    pub fn value(&self, count: f64) -> f64 {
        (count - self.zero_counts) * self.value_per_count()
    }

    /// Returns the count at a value; not rounded.
    pub fn count(&self, value: f64) -> f64 {
        value / self.value_per_count() + self.zero_counts
    }
}

impl fmt::Display for Joint {
    /// Describes the joint in one line, for people.
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

/// An arm with valid parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arm {
    joints: [Joint; JOINTS],
}

/// A link at given joint values.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Link {
    /// Position of its joint, mm in the base's plane.
    joint: DVec2,
    /// Unit vector along it.
    along: DVec2,
    /// Position of its end, mm.
    end: DVec2,
}

impl Arm {
    /// Returns an arm of three joints, base first.
    ///
    /// # Errors
    /// [`ArmError`] names the joint and the invalid number.
    pub fn new(joints: [Joint; JOINTS]) -> Result<Self, CalibrationError> {
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
                return Err(ArmError::NotFinite { joint: number, what }.into());
            }
            if joint.counts_per_unit <= 0.0 {
                return Err(ArmError::Counts { joint: number, counts: joint.counts_per_unit }.into());
            }
            if joint.kind == Kind::Revolute && joint.length_mm < 0.0 {
                return Err(ArmError::Length { joint: number, mm: joint.length_mm }.into());
            }
        }
        Ok(Self { joints })
    }

    /// Returns its joints, base first.
    pub fn joints(&self) -> &[Joint; JOINTS] {
        &self.joints
    }

    /// Returns the same arm with zeros such that its counts are 0 at these values, as after
    /// setting its encoders in the home position.
    pub fn zeroed_at(&self, values: &Values) -> Self {
        let mut arm = *self;
        for (joint, value) in arm.joints.iter_mut().zip(values) {
            joint.zero_counts = 0.0;
            joint.zero_counts = -joint.count(*value);
        }
        arm
    }

    /// Returns the joint values at these counts.
    pub fn values(&self, counts: &[i64; JOINTS]) -> Values {
        // Exact: no counter of an arm reaches 2⁵³.
        std::array::from_fn(|i| self.joints[i].value(counts[i] as f64))
    }

    /// Returns the counts at these values; not rounded.
    pub fn counts(&self, values: &Values) -> [f64; JOINTS] {
        std::array::from_fn(|i| self.joints[i].count(values[i]))
    }

    /// Returns poses spread over its working range: every combination of three values of each
    /// joint, 0.5 rad or 100 mm apart.
    pub fn spread(&self) -> Vec<PlanarPose> {
        let combinations = (0..3_usize.pow(JOINTS as u32)).map(|number| {
            let values = std::array::from_fn(|joint| {
                let step = if self.joints[joint].kind == Kind::Revolute { 0.5 } else { 100.0 };
                step * ((number / 3_usize.pow(joint as u32) % 3) as f64 - 1.0)
            });
            self.pose(&values)
        });
        combinations.collect()
    }
}
