//! An arm's parameters from touches: its tip is set down where something is known of the place, each time from as many sides as can be.
//!
//! Known may be the places of divots on a plate that lies anywhere, that all touches are of one divot, or how far pairs of places are apart. What is found: lengths of the links,
//! zeros of the encoders and, if asked for, counts a turn or a mm and directions of slides; and where the plate lies. What the touches do not say is refused by name. The zero of
//! the first joint says only which way the base's x axis points, and the plate's own place takes it: it is kept as it was.

mod model;
mod refusal;

use glam::DVec2;

use super::{Arm, JOINTS, Joint, Kind, Values};
use crate::least_squares::{Loss, Noise, Solution};
use model::Model;
pub use refusal::NoFit;

/// The tip set down, still.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// Mean counts of the joints, base first.
    pub counts: [f64; JOINTS],
    /// Of which divot, or of which distance, by its place among what is known.
    pub of: usize,
}

/// What is known of the places that were touched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Known<'a> {
    /// Divots of a plate that lies anywhere, mm, in the plane that the arm moves in. One alone is a fixed point, wherever it is said to be.
    Divots(&'a [DVec2]),
    /// Distances, mm. Of each there are two touches, one of either end.
    Distances(&'a [f64]),
}

impl Known<'_> {
    /// How many there are.
    pub fn count(&self) -> usize {
        match self {
            Self::Divots(divots) => divots.len(),
            Self::Distances(distances) => distances.len(),
        }
    }
}

/// What is found, and what is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Where the tip is in the last link's frame (its origin at the link's end, x along it), mm. A tip of which neither this nor the link's length is known is found as length.
    pub tip_mm: DVec2,
    /// Of which links to find the lengths.
    pub lengths: [bool; JOINTS],
    /// Of which joints to find the zeros. The first one's turns all there is, as the plate's place does: touches never tell it.
    pub zeros: [bool; JOINTS],
    /// Find counts a turn or a mm. Those of an encoder's disc are known better than they can be measured.
    pub counts_per_unit: bool,
    /// Of which slides to find the directions. The first joint's turns all there is.
    pub directions: [bool; JOINTS],
    /// How exactly the tip sits in a divot, mm, one standard deviation along each axis.
    pub seat_mm: f64,
}

impl Default for Options {
    /// Of three joints that turn, and a plate.
    fn default() -> Self {
        Self {
            tip_mm: DVec2::ZERO,
            lengths: [true; JOINTS],
            zeros: [false, true, true],
            counts_per_unit: false,
            directions: [false; JOINTS],
            seat_mm: 0.1,
        }
    }
}

impl Options {
    /// What touches tell of an arm: of joints that turn the lengths of their links and, but for the first, their zeros; of slides, but for the first joint, the directions. The length
    /// and the zero of a slide are one number, and what it adds to the links about it is told by these.
    ///
    /// Touches of one point tell no size, unless there is a slide, whose counts are mm: the longest link's length is kept then.
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

/// A number of a joint that was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Which joint, base first, from 1.
    pub joint: usize,
    /// Which of its numbers, and its unit.
    pub what: Number,
    /// As it was.
    pub before: f64,
    /// As it is found.
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
    /// Counts a turn or a mm.
    CountsPerUnit,
    /// The direction of a slide, degrees.
    Direction,
}

impl Number {
    const ALL: [Self; 4] = [Self::Length, Self::Zero, Self::CountsPerUnit, Self::Direction];

    /// Its name, for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Length => "length",
            Self::Zero => "zero",
            Self::CountsPerUnit => "counts a unit",
            Self::Direction => "direction",
        }
    }

    /// Its unit, for people.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Length => "mm",
            Self::Zero | Self::CountsPerUnit => "counts",
            Self::Direction => "degrees",
        }
    }

    fn of(self, joint: &mut Joint) -> Option<&mut f64> {
        match (self, &mut joint.kind) {
            (Self::Length, _) => Some(&mut joint.length_mm),
            (Self::Zero, _) => Some(&mut joint.zero_counts),
            (Self::CountsPerUnit, _) => Some(&mut joint.counts_per_unit),
            (Self::Direction, Kind::Prismatic { direction_deg }) => Some(direction_deg),
            (Self::Direction, Kind::Revolute) => None,
        }
    }

    fn is_wanted(self, joint: usize, options: &Options) -> bool {
        match self {
            Self::Length => options.lengths[joint],
            Self::Zero => options.zeros[joint],
            Self::CountsPerUnit => options.counts_per_unit,
            Self::Direction => options.directions[joint],
        }
    }

    /// A size that moves the tip by about a millimetre.
    fn typical(self, joint: &Joint, reach_mm: f64) -> f64 {
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

/// An arm that explains touches.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// The arm.
    pub arm: Arm,
    /// Where the tip is in the last link's frame, mm.
    pub tip_mm: DVec2,
    /// What was found, joint by joint.
    pub found: Vec<Found>,
    /// How far each touch lies from its divot, or each pair of touches from its distance, mm.
    pub residuals_mm: Vec<f64>,
    /// Root of their mean square, mm; of those that are no outliers.
    pub rms_mm: f64,
    /// The largest of these, mm.
    pub most_mm: f64,
    /// Standard deviation of the residuals along an axis over [`Options::seat_mm`]: about 1 where the arm is what it is taken for.
    pub spread: f64,
    /// Of the parameters, by sizes that move the tip alike.
    pub condition: f64,
    /// Places among the residuals of those that were left out, as they lie far from all others.
    pub outliers: Vec<usize>,
    /// From where to where each joint's values went, rad or mm.
    pub ranges: [[f64; 2]; JOINTS],
    /// Covariance of what was found, row by row.
    covariance: Vec<Vec<f64>>,
}

impl Fitted {
    /// How far the tip may be from where the arm puts it at these values, by what is not known of the numbers that were found, mm: the root of the sum of the variances along both
    /// axes. In the base's frame, whose x axis is where the first joint's zero says.
    pub fn sd_at(&self, values: &Values) -> f64 {
        let moved: Vec<DVec2> = self
            .found
            .iter()
            .map(|found| model::moved(&self.arm, values, self.tip_mm, found.joint - 1, found.what))
            .collect();
        let mut variance = 0.0;
        for (row, one) in self.covariance.iter().zip(&moved) {
            variance += row.iter().zip(&moved).map(|(between, other)| between * one.dot(*other)).sum::<f64>();
        }
        // Rounding may leave less than nothing.
        variance.max(0.0).sqrt()
    }
}

/// Fits an arm to touches, beginning at one whose numbers are about right: lengths to a tenth, zeros to some degrees.
///
/// The start is found with a loss that is linear far out, the result with one that leaves out what is far from all else: by the touches' own noise, or, where these are too few to
/// say how large it is, by [`Options::seat_mm`].
///
/// # Errors
/// [`NoFit`]: which touch or plate, or what the touches do not tell, and what to touch then.
pub fn fit(start: &Arm, known: &Known<'_>, touches: &[Touch], options: &Options) -> Result<Fitted, NoFit> {
    refusal::check(start, known, touches, options)?;
    let mut model = Model::new(start, known, touches, options);
    if model.parameters.steps() == 0 {
        let residuals_mm = model.residuals_mm(&model.parameters.start());
        return Ok(fitted(*start, &model, residuals_mm, Vec::new(), None));
    }
    let near = model.solve(Loss::Huber, Noise::Compared)?;
    refusal::check_scale(&near, &model, start)?;
    model.parameters.begin_at(&near.state);
    let solution = model.solve(Loss::Tukey, model.noise())?;
    if let Some(direction) = solution.directions().first().filter(|direction| direction.sd > LEAST_KNOWN_MM) {
        return Err(refusal::unseen(&model, std::slice::from_ref(direction)));
    }
    let arm = Arm::new(model.joints(&solution.state))?;
    let mut found = Vec::new();
    for (index, number, place) in &model.numbers {
        let mut before = start.joints()[*index];
        let ([value], [sd]) = (solution.state.vector(*place), solution.sds(*place));
        let before = number.of(&mut before).map_or(value, |before| *before);
        found.push(Found { joint: index + 1, what: *number, before, value, sd });
    }
    Ok(fitted(arm, &model, model.residuals_mm(&solution.state), found, Some(&solution)))
}

/// Of a combination of parameters that is not known to as much of the tip's way nothing is known, mm: noise alone has told it.
const LEAST_KNOWN_MM: f64 = 10.0;

/// What there is to say of an arm; without a solution nothing was sought.
fn fitted(
    arm: Arm,
    model: &Model<'_>,
    residuals_mm: Vec<f64>,
    found: Vec<Found>,
    solution: Option<&Solution>,
) -> Fitted {
    let is_out = |at: usize| solution.is_some_and(|solution| solution.weights[at] == 0.0);
    let outliers: Vec<usize> = (0..residuals_mm.len()).filter(|at| is_out(*at)).collect();
    let kept = || residuals_mm.iter().enumerate().filter(|(at, _)| !is_out(*at)).map(|(_, mm)| *mm);
    let count = (residuals_mm.len() - outliers.len()).max(1) as f64;
    let rms_mm = (kept().map(|mm| mm * mm).sum::<f64>() / count).sqrt();
    let between = |one: &model::Sought, other: &model::Sought| {
        solution.map_or(0.0, |solution| {
            let [[covariance]] = solution.certainty().between(one.2, other.2);
            covariance
        })
    };
    let covariance =
        model.numbers.iter().map(|one| model.numbers.iter().map(|other| between(one, other)).collect()).collect();
    Fitted {
        arm,
        tip_mm: model.options.tip_mm,
        found,
        rms_mm,
        most_mm: kept().fold(0.0, f64::max),
        spread: solution.map_or(rms_mm / model.sd_of_residual_mm(), |solution| solution.spread),
        condition: solution.map_or(1.0, |solution| solution.condition),
        residuals_mm,
        outliers,
        ranges: model::ranges(&arm, model.touches),
        covariance,
    }
}

#[cfg(test)]
mod tests;
