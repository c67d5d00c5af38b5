//! Refusals: parameters that the touches do not determine, and the touches to add.

use super::model::{self, Model};
use super::number::Number;
use super::options::Options;
use super::touches::{Known, Touch};
use crate::arm::{Arm, JOINTS, Kind};
use crate::error::ArmError;
use crate::least_squares::{Direction, Solution, Unsolved};

/// Touches are in one pose if no joint moves the tip by more than this, mm.
const ONE_POSE_MM: f64 = 5.0;
/// A revolute joint with a smaller range is nearly undetermined, rad.
const HARDLY_TURNED: f64 = 0.1;
/// A prismatic joint with a smaller range is nearly undetermined, mm.
const HARDLY_SLID_MM: f64 = 5.0;
/// The measured numbers must exceed the parameters by this many, or nothing is left to check
/// agreement.
const LEAST_FREEDOM: usize = 4;

/// Makes the checks that need no fit.
pub(super) fn check(start: &Arm, known: &Known<'_>, touches: &[Touch], options: &Options) -> Result<(), ArmError> {
    let (what, count) = match known {
        Known::Divots(_) => ("divot", known.count()),
        Known::Distances(_) => ("distance", known.count()),
    };
    if let Some((index, touch)) = touches.iter().enumerate().find(|(_, touch)| touch.of >= count) {
        return Err(ArmError::Unknown { touch: index + 1, what, of: touch.of + 1, count });
    }
    let slides = start.joints().iter().any(|joint| joint.kind != Kind::Revolute);
    match known {
        Known::Divots(plate_mm) => {
            let is_sized = slides || !options.lengths.iter().all(|is_fitted| *is_fitted);
            if !is_sized && model::is_one(plate_mm, touches) {
                return Err(ArmError::OneDivot);
            }
        }
        Known::Distances(distances) => {
            for distance in 0..distances.len() {
                let own = touches.iter().filter(|touch| touch.of == distance).count();
                if own != 2 {
                    return Err(ArmError::Ends { distance: distance + 1, touches: own });
                }
            }
        }
    }
    let model = Model::new(start, known, touches, options);
    let numbers = model.parameters.steps();
    if touches.is_empty() || (!model.numbers.is_empty() && model.measured() < numbers + LEAST_FREEDOM) {
        return Err(ArmError::Few { touches: touches.len(), numbers });
    }
    let mut reach_mm = 0.0;
    let ranges = model::ranges(start, touches);
    let mut most_mm = 0.0_f64;
    for (joint, [least, most]) in start.joints().iter().zip(ranges).rev() {
        reach_mm += joint.length_mm.abs();
        most_mm = most_mm.max((most - least) * if joint.kind == Kind::Revolute { reach_mm } else { 1.0 });
    }
    if !model.numbers.is_empty() && most_mm < ONE_POSE_MM {
        return Err(ArmError::OnePose { touches: touches.len() });
    }
    Ok(())
}

/// Returns the refusal of touches for which the solver found no solution.
pub(super) fn of(model: &Model<'_>, unsolved: Unsolved) -> ArmError {
    match unsolved {
        Unsolved::TooFew { parameters, .. } => ArmError::Few { touches: model.touches.len(), numbers: parameters },
        Unsolved::NotFinite { .. } => ArmError::Senseless("a number is not finite".into()),
        Unsolved::Undetermined { directions } => unseen(model, &directions),
    }
}

/// Returns the refusal for undetermined directions, with advice.
pub(super) fn unseen(model: &Model<'_>, directions: &[Direction]) -> ArmError {
    let what = directions.first().map(ToString::to_string).unwrap_or_default();
    let share = |kind: Number| -> f64 {
        let own = directions.first().into_iter().flat_map(|direction| {
            model
                .numbers
                .iter()
                .filter(|(_, number, _)| *number == kind)
                .map(|(_, _, place)| direction.share(*place)[0])
        });
        own.map(|share| share * share).sum()
    };
    let why = match hardly_moved(model) {
        Some(sentence) => sentence,
        None if share(Number::CountsPerUnit) > 0.3 => {
            "touch places that are far apart from all sides, or keep the maker's counts a turn".into()
        }
        None if share(Number::Direction) > 0.3 => "touch from more places along the slide".into(),
        None => "touch each place with the elbow to the left and to the right, near the base and far from it".into(),
    };
    ArmError::Undetermined { what, why }
}

/// Returns a sentence about a joint that hardly moved, and so is not determined.
fn hardly_moved(model: &Model<'_>) -> Option<String> {
    let arm = Arm { joints: model.joints(&model.parameters.start()) };
    let ranges = model::ranges(&arm, model.touches);
    let of = |joint: usize| -> Option<String> {
        let moved = ranges[joint][1] - ranges[joint][0];
        match arm.joints()[joint].kind {
            Kind::Revolute if moved < HARDLY_TURNED => {
                Some(format!("joint {} has turned by {:.1}° only; turn it further", joint + 1, moved.to_degrees()))
            }
            Kind::Prismatic { .. } if moved < HARDLY_SLID_MM => {
                Some(format!("joint {} has slid by {moved:.1} mm only; move it further", joint + 1))
            }
            _ => None,
        }
    };
    (0..JOINTS).find_map(of)
}

/// Refuses a fit that scales all links alike: the plate's units differ from the arm's.
pub(super) fn check_scale(near: &Solution, model: &Model<'_>, start: &Arm) -> Result<(), ArmError> {
    let after = model.joints(&near.state);
    let sum = |joints: &[crate::arm::Joint; JOINTS]| -> f64 {
        let lengths = model.numbers.iter().filter(|(_, number, _)| *number == Number::Length);
        lengths.map(|(joint, ..)| joints[*joint].length_mm.abs()).sum()
    };
    let (before, after) = (sum(start.joints()), sum(&after));
    if before <= 0.0 {
        return Ok(());
    }
    let ratio = after / before;
    for (factor, unit, arm_unit) in [
        (0.1, "cm", "tenths of mm"),
        (10.0, "tenths of mm", "cm"),
        (1.0 / 25.4, "inches", "1/25.4 mm"),
        (25.4, "1/25.4 mm", "inches"),
        (0.001, "m", "µm"),
        (1000.0, "µm", "m"),
    ] {
        if (ratio / factor - 1.0).abs() < 0.15 {
            return Err(ArmError::Units { factor: ratio, unit, arm_unit });
        }
    }
    if !(0.5..=2.0).contains(&ratio) {
        return Err(ArmError::Senseless(format!("links of {after:.0} mm in all instead of {before:.0} mm")));
    }
    Ok(())
}
