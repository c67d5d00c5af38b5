//! Which joint values take the probe to a pose, in closed form.
//!
//! The last link's heading is the wanted one, so that the chain is a sum of three vectors of which each has a known length, a known direction, or both:
//!
//! | joints | known | left |
//! |---|---|---|
//! | RRR | the third link | two lengths: circles that meet, elbow up or down |
//! | PRR, RRP | one link | a length and a direction: a circle and a line that meet, at two places |
//! | RPR | the third link | the slide as long as the base is away from the wrist, two places; then the turn |
//! | PPR, PRP, RPP | one link | two directions: lines that meet, unless they are parallel |
//! | PPP | the heading, whatever is wanted | nothing turns: not solvable |

use glam::DVec2;

use super::pose::turned_near;
use super::{Arm, JOINTS, Kind, PlanarPose, Values};

/// Which of two solutions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Elbow {
    /// Of three joints that turn: the second joint's value is negative, so that the elbow of an arm that reaches along x is at positive y. Of those with one
    /// that slides: the longer slide.
    Up,
    /// The other one. Where there is one solution only, it is both.
    Down,
}

/// Why no joint values take the probe to a pose, and by how much they miss it.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Unreachable {
    /// Beyond the arm's reach.
    #[error("the pose is beyond the arm's reach by {by_mm:.3} mm; move its base nearer, or use longer links")]
    TooFar {
        /// How much longer the arm would have to be.
        by_mm: f64,
    },
    /// Nearer to the base than the arm can be folded.
    #[error(
        "the pose is nearer to the arm's base than it can be folded, by {by_mm:.3} mm; move its base away, or use links of like lengths"
    )]
    TooNear {
        /// How much farther the pose would have to be.
        by_mm: f64,
    },
    /// The joint's angle does not matter there.
    #[error("joint {joint} of 3 may have any angle there, as what it turns lies on its axis; take a pose beside it")]
    Undetermined {
        /// Which, from 1.
        joint: usize,
    },
    /// Two slides along one line.
    #[error(
        "joints {} and {} of 3 slide along lines that are parallel to {degrees:.4}°, and can do only one slide's work; turn one of them",
        joints[0], joints[1]
    )]
    Parallel {
        /// Which, from 1.
        joints: [usize; 2],
        /// The angle between them.
        degrees: f64,
    },
    /// Three slides.
    #[error("no joint of the arm turns: its heading is {degrees:.3}° from the wanted one whatever its joints do")]
    Untwisted {
        /// From its heading to the wanted one.
        degrees: f64,
    },
}

/// A joint as the inverse sees it: slides by their direction, rad.
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

/// What rounding alone leaves between an arm at full stretch and its pose, mm.
const ROUNDING_MM: f64 = 1e-9;
/// Sine of the least angle between two slides: at less, values are lost to rounding.
const LEAST_SINE: f64 = 1e-4;

/// The angle of a vector that has one.
fn angle(v: DVec2, joint: usize) -> Result<f64, Unreachable> {
    if v.length() > ROUNDING_MM { Ok(v.to_angle()) } else { Err(Unreachable::Undetermined { joint }) }
}

/// Where a vector of length `first` ends from which one of length `second` reaches the target.
fn circles_meet(target: DVec2, [first, second]: [f64; 2], elbow: Elbow) -> Result<DVec2, Unreachable> {
    let distance = target.length();
    let beyond = distance - (first + second);
    if beyond > ROUNDING_MM {
        return Err(Unreachable::TooFar { by_mm: beyond });
    }
    let within = (first - second).abs() - distance;
    if within > ROUNDING_MM {
        return Err(Unreachable::TooNear { by_mm: within });
    }
    if distance <= ROUNDING_MM {
        return Err(Unreachable::Undetermined { joint: 1 });
    }
    let along = target / distance;
    let far = 0.5 * (distance + (first + second) * ((first - second) / distance));
    let aside = (first * first - far * far).max(0.0).sqrt();
    Ok(far * along + along.perp() * if elbow == Elbow::Up { aside } else { -aside })
}

/// How far along a unit vector a point is that is `radius` from the target; two, unless the line just touches the circle. By how much the circle misses the line.
fn circle_meets_line(target: DVec2, along: DVec2, radius: f64, elbow: Elbow) -> Result<f64, f64> {
    let aside = along.perp_dot(target);
    let missing = aside.abs() - radius.abs();
    if missing > ROUNDING_MM {
        return Err(missing);
    }
    let half = ((radius - aside) * (radius + aside)).max(0.0).sqrt();
    Ok(along.dot(target) + if elbow == Elbow::Up { half } else { -half })
}

/// How far along two unit vectors their sum is the target.
fn lines_meet(target: DVec2, [a, b]: [DVec2; 2], joints: [usize; 2]) -> Result<[f64; 2], Unreachable> {
    let sine = a.perp_dot(b);
    if sine.abs() < LEAST_SINE {
        return Err(Unreachable::Parallel { joints, degrees: sine.abs().asin().to_degrees() });
    }
    Ok([target.perp_dot(b) / sine, a.perp_dot(target) / sine])
}

impl Arm {
    /// Joint values at which the last link is at a pose. Turns are between −π and π.
    ///
    /// # Errors
    /// [`Unreachable`] where there are none, or any number.
    pub fn inverse(&self, pose: &PlanarPose, elbow: Elbow) -> Result<Values, Unreachable> {
        use Step::{Slide, Turn};
        let lengths = self.joints().each_ref().map(|joint| joint.length_mm);
        let far = |missing| Unreachable::TooFar { by_mm: missing };
        let heading = pose.heading_rad;
        let third = DVec2::from_angle(heading);
        // Where the last link begins, if it does not slide.
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
                let along = DVec2::from_angle(first);
                let slide = circle_meets_line(wrist, along, lengths[1], elbow).map_err(far)?;
                let second = angle(wrist - slide * along, 2)?;
                [slide - lengths[0], second - first, heading - second]
            }
            [Turn, Slide(bend), Turn] => {
                // As the first link sees it, which lies along x.
                let base = DVec2::new(-lengths[0], 0.0);
                let along = DVec2::from_angle(bend);
                let near = |missing| Unreachable::TooNear { by_mm: missing };
                let slide = circle_meets_line(base, along, wrist.length(), elbow).map_err(near)?;
                let first = angle(wrist, 1)? - angle(slide * along - base, 1)?;
                [first, slide - lengths[1], heading - first - bend]
            }
            [Turn, Turn, Slide(bend)] => {
                let second = heading - bend;
                let target = pose.position_mm - lengths[1] * DVec2::from_angle(second);
                let slide = circle_meets_line(target, third, lengths[0], elbow).map_err(far)?;
                let first = angle(target - slide * third, 1)?;
                [first, second - first, slide - lengths[2]]
            }
            [Slide(first), Slide(bend), Turn] => {
                let both = [first, first + bend];
                let [a, b] = lines_meet(wrist, both.map(DVec2::from_angle), [1, 2])?;
                [a - lengths[0], b - lengths[1], heading - first - bend]
            }
            [Slide(first), Turn, Slide(bend)] => {
                let second = heading - bend;
                let target = pose.position_mm - lengths[1] * DVec2::from_angle(second);
                let [a, c] = lines_meet(target, [DVec2::from_angle(first), third], [1, 3])?;
                [a - lengths[0], second - first, c - lengths[2]]
            }
            [Turn, Slide(bend), Slide(last)] => {
                let (first, second) = (heading - last - bend, heading - last);
                let target = pose.position_mm - lengths[0] * DVec2::from_angle(first);
                let [b, c] = lines_meet(target, [DVec2::from_angle(second), third], [2, 3])?;
                [first, b - lengths[1], c - lengths[2]]
            }
            [Slide(a), Slide(b), Slide(c)] => {
                let off = turned_near(heading - (a + b + c), 0.0);
                return Err(Unreachable::Untwisted { degrees: off.to_degrees() });
            }
        };
        Ok(self.turned(values, &[0.0; JOINTS]))
    }

    /// Of both solutions the one whose counts are nearer to those of other values, by the joint that differs most; turns are within half a turn of theirs. So the values
    /// of a moving arm go on without a jump.
    ///
    /// # Errors
    /// As [`Self::inverse`].
    pub fn inverse_near(&self, pose: &PlanarPose, near: &Values) -> Result<Values, Unreachable> {
        let [up, down] = [Elbow::Up, Elbow::Down].map(|elbow| self.inverse(pose, elbow).map(|v| self.turned(v, near)));
        let (up, down) = (up?, down?);
        let counts = self.counts(near);
        let off =
            |values: &Values| self.counts(values).iter().zip(counts).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        Ok(if off(&down) < off(&up) { down } else { up })
    }

    /// Turns brought within half a turn of others.
    fn turned(&self, values: Values, near: &Values) -> Values {
        std::array::from_fn(|i| match self.joints()[i].kind {
            Kind::Revolute => turned_near(values[i], near[i]),
            Kind::Prismatic { .. } => values[i],
        })
    }
}
