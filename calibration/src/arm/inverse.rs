//! Inverse kinematics in closed form: the joint values for a pose.
//!
//! The pose fixes the last link's heading. The chain is then a sum of three vectors, and each
//! has a known length, a known direction, or both:
//!
//! | joints | known | left |
//! |---|---|---|
//! | RRR | the third link | two lengths: circles that meet, elbow up or down |
//! | PRR, RRP | one link | a length and a direction: a circle and a line that meet, at two places |
//! | RPR | the third link | the slide's length from the distance of base and wrist, two
//! solutions; then the turn |
//! | PPR, PRP, RPP | one link | two directions: lines that meet, unless they are parallel |
//! | PPP | the heading, regardless of the requested one | nothing turns: not solvable |

use glam::DVec2;

use sonoweave_core::rotation::direction;

use super::planar_pose::turned_near;
use super::{Arm, JOINTS, Kind, PlanarPose, Values};
use crate::error::{ArmError, CalibrationError};

/// Choice between two solutions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Elbow {
    /// For three revolute joints: the second joint's value is negative. The elbow of an arm
    /// that reaches along x is then at positive y. For arms with one prismatic joint: the
    /// longer slide.
    Up,
    /// The other solution. If there is only one, both choices return it.
    Down,
}

/// A joint's type for the inverse; slides with their direction, rad.
#[derive(Clone, Copy)]
enum Step {
    Turn,
    Slide(f64),
}

impl Step {
    fn of(kind: Kind) -> Self {
        match kind {
            Kind::Revolute => Self::Turn,
            Kind::Prismatic { direction_deg } => Self::Slide(direction_deg.to_radians()),
        }
    }
}

/// Error that rounding alone leaves between an arm at full stretch and its pose, mm.
const ROUNDING_MM: f64 = 1e-9;
/// Sine of the smallest angle between two slides; below it, rounding spoils the values.
const LEAST_SINE: f64 = 1e-4;

/// Returns the angle of a vector, if it has one.
fn angle(v: DVec2, joint: usize) -> Result<f64, ArmError> {
    if v.length() > ROUNDING_MM { Ok(v.to_angle()) } else { Err(ArmError::AnyAngle { joint }) }
}

/// Returns the end of a vector of length `first` from which one of length `second` reaches the
/// target.
fn circles_meet(target: DVec2, [first, second]: [f64; 2], elbow: Elbow) -> Result<DVec2, ArmError> {
    let distance = target.length();
    let beyond = distance - (first + second);
    if beyond > ROUNDING_MM {
        return Err(ArmError::TooFar { by_mm: beyond });
    }
    let within = (first - second).abs() - distance;
    if within > ROUNDING_MM {
        return Err(ArmError::TooNear { by_mm: within });
    }
    if distance <= ROUNDING_MM {
        return Err(ArmError::AnyAngle { joint: 1 });
    }
    let along = target / distance;
    let far = 0.5 * (distance + (first + second) * ((first - second) / distance));
    let aside = (first * first - far * far).max(0.0).sqrt();
    Ok(far * along + along.perp() * if elbow == Elbow::Up { aside } else { -aside })
}

/// Returns the distance along a unit vector to a point `radius` from the target. There are two
/// such points unless the line just touches the circle. The error is the distance by which the
/// circle misses the line.
fn circle_meets_line(target: DVec2, along: DVec2, radius: f64, elbow: Elbow) -> Result<f64, f64> {
    let aside = along.perp_dot(target);
    let missing = aside.abs() - radius.abs();
    if missing > ROUNDING_MM {
        return Err(missing);
    }
    let half = ((radius - aside) * (radius + aside)).max(0.0).sqrt();
    Ok(along.dot(target) + if elbow == Elbow::Up { half } else { -half })
}

/// Returns the distances along two unit vectors whose sum is the target.
fn lines_meet(target: DVec2, [a, b]: [DVec2; 2], joints: [usize; 2]) -> Result<[f64; 2], ArmError> {
    let sine = a.perp_dot(b);
    if sine.abs() < LEAST_SINE {
        return Err(ArmError::Parallel { joints, degrees: sine.abs().asin().to_degrees() });
    }
    Ok([target.perp_dot(b) / sine, a.perp_dot(target) / sine])
}

impl Arm {
    /// Returns joint values at which the last link has this pose. Turns are between −π and π.
    ///
    /// # Errors
    /// [`ArmError`] if no joint values, or infinitely many, reach the pose.
    pub fn inverse(&self, pose: &PlanarPose, elbow: Elbow) -> Result<Values, CalibrationError> {
        use Step::{Slide, Turn};
        let lengths = self.joints().each_ref().map(|joint| joint.length_mm);
        let far = |missing| ArmError::TooFar { by_mm: missing };
        let heading = pose.heading_rad;
        let third = direction(heading);
        // Start of the last link, if it does not slide.
        let wrist = pose.position_mm - lengths[2] * third;
        let kinds = self.joints().each_ref().map(|joint| Step::of(joint.kind));
        let values = match kinds {
            [Turn, Turn, Turn] => {
                let elbow = circles_meet(wrist, [lengths[0], lengths[1]], elbow)?;
                let first = angle(elbow, 1)?;
                let second = angle(wrist - elbow, 2)?;
                [first, second - first, heading - second]
            }
            [Slide(first), Turn, Turn] => {
                let along = direction(first);
                let slide = circle_meets_line(wrist, along, lengths[1], elbow).map_err(far)?;
                let second = angle(wrist - slide * along, 2)?;
                [slide - lengths[0], second - first, heading - second]
            }
            [Turn, Slide(bend), Turn] => {
                // In the frame of the first link, which lies along x.
                let base = DVec2::new(-lengths[0], 0.0);
                let along = direction(bend);
                let near = |missing| ArmError::TooNear { by_mm: missing };
                let slide = circle_meets_line(base, along, wrist.length(), elbow).map_err(near)?;
                let first = angle(wrist, 1)? - angle(slide * along - base, 1)?;
                [first, slide - lengths[1], heading - first - bend]
            }
            [Turn, Turn, Slide(bend)] => {
                let second = heading - bend;
                let target = pose.position_mm - lengths[1] * direction(second);
                let slide = circle_meets_line(target, third, lengths[0], elbow).map_err(far)?;
                let first = angle(target - slide * third, 1)?;
                [first, second - first, slide - lengths[2]]
            }
            [Slide(first), Slide(bend), Turn] => {
                let both = [first, first + bend];
                let [a, b] = lines_meet(wrist, both.map(direction), [1, 2])?;
                [a - lengths[0], b - lengths[1], heading - first - bend]
            }
            [Slide(first), Turn, Slide(bend)] => {
                let second = heading - bend;
                let target = pose.position_mm - lengths[1] * direction(second);
                let [a, c] = lines_meet(target, [direction(first), third], [1, 3])?;
                [a - lengths[0], second - first, c - lengths[2]]
            }
            [Turn, Slide(bend), Slide(last)] => {
                let (first, second) = (heading - last - bend, heading - last);
                let target = pose.position_mm - lengths[0] * direction(first);
                let [b, c] = lines_meet(target, [direction(second), third], [2, 3])?;
                [first, b - lengths[1], c - lengths[2]]
            }
            [Slide(a), Slide(b), Slide(c)] => {
                let off = turned_near(heading - (a + b + c), 0.0);
                return Err(ArmError::Untwisted { degrees: off.to_degrees() }.into());
            }
        };
        Ok(self.turned(values, &[0.0; JOINTS]))
    }

    /// Returns the solution whose counts are nearer to those of `near`, judged by the joint
    /// that differs most. Turns are within half a turn of those in `near`, so the values of a
    /// moving arm do not jump.
    ///
    /// # Errors
    /// The same as for [`Self::inverse`].
    pub fn inverse_near(&self, pose: &PlanarPose, near: &Values) -> Result<Values, CalibrationError> {
        let [up, down] = [Elbow::Up, Elbow::Down].map(|elbow| self.inverse(pose, elbow).map(|v| self.turned(v, near)));
        let (up, down) = (up?, down?);
        let counts = self.counts(near);
        let off =
            |values: &Values| self.counts(values).iter().zip(counts).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        Ok(if off(&down) < off(&up) { down } else { up })
    }

    /// Brings turns within half a turn of others.
    fn turned(&self, values: Values, near: &Values) -> Values {
        std::array::from_fn(|i| match self.joints()[i].kind {
            Kind::Revolute => turned_near(values[i], near[i]),
            Kind::Prismatic { .. } => values[i],
        })
    }
}
