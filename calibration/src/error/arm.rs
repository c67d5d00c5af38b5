//! Errors of an arm.

/// Reasons why numbers do not describe an arm, a pose is out of reach, or touches do not
/// determine an arm.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ArmError {
    /// A number is NaN or infinite.
    #[error("the {what} of joint {joint} is not a finite number; correct it")]
    NotFinite {
        /// Number of the joint, from 1.
        joint: usize,
        /// Name of the parameter.
        what: &'static str,
    },
    /// The number of counts per unit is 0 or negative.
    #[error(
        "joint {joint} has {counts} counts a turn or a mm; give a number above 0, and sign = -1 for a joint that \
        counts backwards"
    )]
    Counts {
        /// Number of the joint, from 1.
        joint: usize,
        /// The given number.
        counts: f64,
    },
    /// A revolute joint's link has a negative length.
    #[error("the link of joint {joint} is {mm} mm long; give a length above 0, and turn the link by the joint's zero")]
    Length {
        /// Number of the joint, from 1.
        joint: usize,
        /// The given length.
        mm: f64,
    },
    /// A pose deviates from the plane that an arm moves in.
    #[error(
        "the pose is {mm:.3} mm out of the arm's plane and tilted by {degrees:.3}° against it, more than {most_mm} mm \
        and {most_degrees}°; choose a pose in the x-y plane of its base, \
        turned about z"
    )]
    NotPlanar {
        /// Distance of the probe's origin from the plane, mm.
        mm: f64,
        /// Angle between the probe's z axis and the base's.
        degrees: f64,
        /// Tolerance, mm.
        most_mm: f64,
        /// Tolerance, degrees.
        most_degrees: f64,
    },
    /// The pose is beyond the arm's reach.
    #[error("the pose is beyond the arm's reach by {by_mm:.3} mm; move the base nearer, or use longer links")]
    TooFar {
        /// Missing length of the arm, mm.
        by_mm: f64,
    },
    /// The pose is nearer to the base than the arm can fold.
    #[error(
        "the pose is nearer to the base than the arm can fold, by {by_mm:.3} mm; move the base away, or use links of \
        similar lengths"
    )]
    TooNear {
        /// Missing distance of the pose from the base, mm.
        by_mm: f64,
    },
    /// The joint's angle is undetermined at a pose.
    #[error("any angle of joint {joint} gives the pose, as the pose lies on the joint's axis; move the pose aside")]
    AnyAngle {
        /// Number of the joint, from 1.
        joint: usize,
    },
    /// Two joints slide along one line.
    #[error(
        "joints {} and {} slide along lines that are parallel to {degrees:.4}°; turn one of them",
        joints[0], joints[1]
    )]
    Parallel {
        /// Numbers of the joints, from 1.
        joints: [usize; 2],
        /// The angle between the slides, degrees.
        degrees: f64,
    },
    /// All three joints slide.
    #[error("no joint of the arm turns, and the pose is turned by {degrees:.3}°; use an arm with a revolute joint")]
    Untwisted {
        /// Angle from the arm's heading to the requested one, degrees.
        degrees: f64,
    },
    /// The plate has no such divot, or there is no such distance.
    #[error("touch {touch} is of {what} {of}, but there are {count}; correct its number")]
    Unknown {
        /// Number of the touch, from 1.
        touch: usize,
        /// Divot or distance.
        what: &'static str,
        /// Number of the divot or distance, from 1.
        of: usize,
        /// Number of known divots or distances.
        count: usize,
    },
    /// A distance needs two touches, one of either end.
    #[error("distance {distance} has {touches} touches, but needs two; touch each end once")]
    Ends {
        /// Number of the distance, from 1.
        distance: usize,
        /// Number of its touches.
        touches: usize,
    },
    /// No distance is known: an arm twice as large would explain the touches as well.
    #[error(
        "all touches are of one divot, which does not determine the arm's size; touch two divots of known distance, or \
        keep the length of one link"
    )]
    OneDivot,
    /// The arm did not move.
    #[error(
        "all {touches} touches are in one pose of the arm; bend the arm differently for each touch, with the elbow to \
        the left and to the right"
    )]
    OnePose {
        /// Number of touches.
        touches: usize,
    },
    /// The touches do not determine a combination of parameters.
    #[error("the touches do not determine {what}; {why}")]
    Undetermined {
        /// The combination of parameters.
        what: String,
        /// Advice for the user.
        why: String,
    },
    /// Too few touches.
    #[error("{touches} touches are too few for {numbers} numbers; touch each place from at least three sides")]
    Few {
        /// Number of touches.
        touches: usize,
        /// Number of parameters.
        numbers: usize,
    },
    /// The numbers are inconsistent.
    #[error(
        "the touches contradict the arm and the known places ({0}); check the arm's start values, the units, and the \
        touches' order"
    )]
    Senseless(String),
    /// The plate or the arm is in other units.
    #[error(
        "the known places fit an arm {factor:.4} times as large as the given one: either their numbers are in {unit} \
        and must be in mm, or the arm's lengths are in {arm_unit}"
    )]
    Units {
        /// Ratio of the fitted lengths to the given ones: about 10, 25.4 or one over them.
        factor: f64,
        /// Apparent unit of the plate or the distances, if not mm.
        unit: &'static str,
        /// Apparent unit of the arm's lengths otherwise.
        arm_unit: &'static str,
    },
}
