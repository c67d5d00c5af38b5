//! An arm's parameters from touches: its tip is set down on divots of a plate whose distances are known, each from as many sides as can be.
//!
//! What is found: lengths of the links, zeros of the encoders and, if asked for, counts a turn or a mm and directions of slides; and where the plate lies. What the touches do not
//! say is refused by name. The zero of the first joint says only which way the base's x axis points, and the plate's own place takes it: it is kept as it was.

use glam::{DVec2, DVec3};

use super::{Arm, BadArm, JOINTS, Joint, Kind};
use crate::least_squares::{
    Blocks, Direction, Loss, Noise, Parameters, Settings, Solution, State, Unsolved, Vector, Whitening, solve,
};

/// The tip on a divot, still.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// Mean counts of the joints, base first.
    pub counts: [f64; JOINTS],
    /// Which divot, by its place on the plate.
    pub divot: usize,
}

/// What is found, and what is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Where the tip is in the last link's frame (its origin at the link's end, x along it), mm. A tip of which neither this nor the link's length is known is found as length.
    pub tip_mm: DVec2,
    /// Find the lengths of links.
    pub lengths: bool,
    /// Of which joints to find the zeros. The first one's turns all there is, as the plate's place does: touches never tell it.
    pub zeros: [bool; JOINTS],
    /// Find counts a turn or a mm. Those of an encoder's disc are known better than they can be measured.
    pub counts_per_unit: bool,
    /// Find the directions of slides.
    pub directions: bool,
    /// How exactly the tip sits in a divot, mm, one standard deviation along each axis.
    pub seat_mm: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            tip_mm: DVec2::ZERO,
            lengths: true,
            zeros: [false, true, true],
            counts_per_unit: false,
            directions: true,
            seat_mm: 0.1,
        }
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
            Self::Length => options.lengths,
            Self::Zero => options.zeros[joint],
            Self::CountsPerUnit => options.counts_per_unit,
            Self::Direction => options.directions && joint > 0,
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
    /// What was found, joint by joint.
    pub found: Vec<Found>,
    /// Where each touch lies from its divot, mm, in the plate's plane.
    pub residuals_mm: Vec<DVec2>,
    /// Root mean square of their lengths, mm.
    pub rms_mm: f64,
    /// The longest, mm.
    pub most_mm: f64,
    /// Standard deviation of the residuals along an axis over [`Options::seat_mm`]: about 1 where the arm is what it is taken for.
    pub spread: f64,
    /// Of the parameters, by sizes that move the tip alike.
    pub condition: f64,
    /// Touches that were left out, as they lie far from all others.
    pub outliers: Vec<usize>,
}

/// Why touches make no arm.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NoFit {
    /// A divot that the plate does not have.
    #[error("touch {touch} is of divot {divot}, and the plate has {divots}")]
    NoDivot {
        /// From 1.
        touch: usize,
        /// From 1.
        divot: usize,
        /// Divots of the plate.
        divots: usize,
    },
    /// No known distance: an arm twice as large would explain the touches as well.
    #[error(
        "all touches are of one divot: touch at least two whose distance is known, or the arm's size stays unknown"
    )]
    OneDivot,
    /// Something that the touches do not say.
    #[error("the touches do not tell {what}: {why}")]
    Undetermined {
        /// Combination of parameters.
        what: String,
        /// What to do.
        why: &'static str,
    },
    /// Too few.
    #[error("{touches} touches are too few for {numbers} numbers: touch each divot from at least three sides")]
    Few {
        /// As many as there are.
        touches: usize,
        /// As many as are sought.
        numbers: usize,
    },
    /// The numbers make no sense.
    #[error(
        "the touches do not belong to this arm and plate ({0}): check the arm's start values, the plate's units and which divot is which"
    )]
    Senseless(String),
    /// The plate is in other units.
    #[error(
        "the plate fits an arm {factor} times as large as the one given: its numbers are in {unit}, and must be in mm"
    )]
    Units {
        /// 10, 25.4 or one over them.
        factor: f64,
        /// What the plate seems to be in.
        unit: &'static str,
    },
}

impl From<BadArm> for NoFit {
    fn from(bad: BadArm) -> Self {
        Self::Senseless(bad.to_string())
    }
}

/// The parameters of a fit, and where they stand among the joints' numbers.
struct Model<'a> {
    start: &'a Arm,
    plate_mm: &'a [DVec2],
    options: &'a Options,
    parameters: Parameters,
    numbers: Vec<(usize, Number, Vector<1>)>,
    angle: Vector<1>,
    shift: Vector<2>,
}

impl<'a> Model<'a> {
    fn new(start: &'a Arm, plate_mm: &'a [DVec2], touches: &[Touch], options: &'a Options) -> Self {
        let reach_mm = start.joints().iter().map(|joint| joint.length_mm.abs()).sum::<f64>().max(1.0);
        let mut parameters = Parameters::new();
        let mut numbers = Vec::new();
        for (index, joint) in start.joints().iter().enumerate() {
            for number in Number::ALL.into_iter().filter(|number| number.is_wanted(index, options)) {
                let mut copy = *joint;
                let Some(value) = number.of(&mut copy) else { continue };
                let name = format!("{} of joint {}", number.name(), index + 1);
                let typical = number.typical(joint, reach_mm);
                numbers.push((index, number, parameters.vector(&name, [""], number.unit(), typical, [*value])));
            }
        }
        let (angle, shift) = placed(start, plate_mm, touches, options.tip_mm);
        let angle = parameters.vector("the plate's angle", [""], "rad", 1.0 / reach_mm, [angle]);
        let shift = parameters.vector("the plate", ["x", "y"], "mm", 1.0, shift.to_array());
        Self { start, plate_mm, options, parameters, numbers, angle, shift }
    }

    fn joints(&self, state: &State) -> [Joint; JOINTS] {
        let mut joints = *self.start.joints();
        for (index, number, place) in &self.numbers {
            if let Some(value) = number.of(&mut joints[*index]) {
                [*value] = state.vector(*place);
            }
        }
        joints
    }

    /// The tip less its divot, mm, and its derivatives.
    fn put(&self, state: &State, touches: &[Touch], blocks: &mut Blocks<'_>) {
        let arm = Arm { joints: self.joints(state) };
        let seat = Whitening::sd(self.options.seat_mm);
        let [angle] = state.vector(self.angle);
        let (turn, shift) = (DVec2::from_angle(angle), DVec2::from_array(state.vector(self.shift)));
        for touch in touches {
            let values = std::array::from_fn(|i| arm.joints[i].value(touch.counts[i]));
            let pose = arm.pose(&values);
            let divot = turn.rotate(self.plate_mm[touch.divot]);
            let residual = pose.point(self.options.tip_mm) - divot - shift;
            let mut row = blocks.add(residual.to_array(), &seat);
            let derivatives = arm.derivatives(&values);
            let lever = DVec2::from_angle(pose.heading_rad).rotate(self.options.tip_mm).perp();
            for (index, number, place) in &self.numbers {
                let by = &derivatives[*index];
                let by: DVec3 = match number {
                    Number::Length => by.length,
                    Number::Zero => by.zero_counts,
                    Number::CountsPerUnit => by.counts_per_unit,
                    Number::Direction => by.direction,
                };
                let moved = by.truncate() + lever * by.z;
                row = row.by(*place, [[moved.x], [moved.y]]);
            }
            let turned = -divot.perp();
            row.by(self.angle, [[turned.x], [turned.y]]).by(self.shift, [[-1.0, 0.0], [0.0, -1.0]]);
        }
    }

    fn solve(&self, touches: &[Touch], loss: Loss) -> Result<Solution, NoFit> {
        let settings = Settings { loss, noise: Noise::Compared, ..Settings::default() };
        solve(&self.parameters, &settings, |state, blocks| self.put(state, touches, blocks)).map_err(|unsolved| {
            match unsolved {
                Unsolved::TooFew { parameters, .. } => NoFit::Few { touches: touches.len(), numbers: parameters },
                Unsolved::NotFinite { .. } => NoFit::Senseless("a number is not finite".into()),
                Unsolved::Undetermined { directions } => unseen(self, &directions),
            }
        })
    }
}

/// Where the plate lies by the arm as it is taken for: the rigid map of the divots to the touches, in the plane.
fn placed(arm: &Arm, plate_mm: &[DVec2], touches: &[Touch], tip_mm: DVec2) -> (f64, DVec2) {
    let tips: Vec<(DVec2, DVec2)> = touches
        .iter()
        .map(|touch| {
            let values = std::array::from_fn(|i| arm.joints()[i].value(touch.counts[i]));
            (plate_mm[touch.divot], arm.pose(&values).point(tip_mm))
        })
        .collect();
    let count = tips.len() as f64;
    let [divots, points] =
        [tips.iter().map(|(a, _)| *a).sum::<DVec2>() / count, tips.iter().map(|(_, b)| *b).sum::<DVec2>() / count];
    let (mut sine, mut cosine) = (0.0, 0.0);
    for (divot, point) in &tips {
        let (a, b) = (*divot - divots, *point - points);
        sine += a.perp_dot(b);
        cosine += a.dot(b);
    }
    let angle = sine.atan2(cosine);
    (angle, points - DVec2::from_angle(angle).rotate(divots))
}

/// Fits an arm to touches of a plate's divots (mm, in the plane that the arm moves in), beginning at an arm whose numbers are about right: lengths to a tenth, zeros to some degrees.
///
/// The start is found with a loss that is linear far out, the result with one that leaves out what is far from all else.
///
/// # Errors
/// [`NoFit`]: which touch or plate, or what the touches do not tell, and what to touch then.
pub fn fit(start: &Arm, plate_mm: &[DVec2], touches: &[Touch], options: &Options) -> Result<Fitted, NoFit> {
    if let Some((index, touch)) = touches.iter().enumerate().find(|(_, touch)| touch.divot >= plate_mm.len()) {
        return Err(NoFit::NoDivot { touch: index + 1, divot: touch.divot + 1, divots: plate_mm.len() });
    }
    let is_one = touches.iter().all(|touch| plate_mm[touch.divot] == plate_mm[touches[0].divot]);
    if options.lengths && (touches.is_empty() || is_one) {
        return Err(NoFit::OneDivot);
    }
    let mut model = Model::new(start, plate_mm, touches, options);
    let near = model.solve(touches, Loss::Huber)?;
    scaled(&near, &model, start)?;
    let state = near.state;
    model.parameters.begin_at(&state);
    let solution = model.solve(touches, Loss::Tukey)?;
    if let Some(direction) = solution.directions().first().filter(|direction| direction.sd > LEAST_KNOWN_MM) {
        return Err(unseen(&model, std::slice::from_ref(direction)));
    }
    let arm = Arm::new(model.joints(&solution.state))?;
    let mut found = Vec::new();
    for (index, number, place) in &model.numbers {
        let mut before = start.joints()[*index];
        let ([value], [sd]) = (solution.state.vector(*place), solution.sds(*place));
        let before = number.of(&mut before).map_or(value, |before| *before);
        found.push(Found { joint: index + 1, what: *number, before, value, sd });
    }
    let (angle, shift) = (solution.state.vector(model.angle)[0], DVec2::from_array(solution.state.vector(model.shift)));
    let residuals_mm: Vec<DVec2> = touches
        .iter()
        .map(|touch| {
            let values = std::array::from_fn(|i| arm.joints()[i].value(touch.counts[i]));
            arm.pose(&values).point(options.tip_mm) - DVec2::from_angle(angle).rotate(plate_mm[touch.divot]) - shift
        })
        .collect();
    let outliers: Vec<usize> = (0..touches.len()).filter(|touch| solution.weights[*touch] == 0.0).collect();
    let kept =
        || residuals_mm.iter().enumerate().filter(|(touch, _)| !outliers.contains(touch)).map(|(_, mm)| mm.length());
    let count = (touches.len() - outliers.len()).max(1) as f64;
    Ok(Fitted {
        arm,
        found,
        rms_mm: (kept().map(|mm| mm * mm).sum::<f64>() / count).sqrt(),
        most_mm: kept().fold(0.0, f64::max),
        spread: solution.spread,
        condition: solution.condition,
        residuals_mm,
        outliers,
    })
}

/// Of a combination of parameters that is not known to as much of the tip's way nothing is known, mm: noise alone has told it.
const LEAST_KNOWN_MM: f64 = 10.0;

/// What touches do not tell, and what to do.
fn unseen(model: &Model<'_>, directions: &[Direction]) -> NoFit {
    let what = directions.first().map(ToString::to_string).unwrap_or_default();
    let share = |wanted: Number| -> f64 {
        let own = directions.first().into_iter().flat_map(|direction| {
            model
                .numbers
                .iter()
                .filter(|(_, number, _)| *number == wanted)
                .map(|(_, _, place)| direction.share(*place)[0])
        });
        own.map(|share| share * share).sum()
    };
    let why = if share(Number::CountsPerUnit) > 0.3 {
        "touch divots far apart and from all sides, or keep the encoders' counts a turn as the maker states them"
    } else if share(Number::Direction) > 0.3 {
        "touch from more places along the slide"
    } else {
        "touch each divot with the elbow bent to the left and to the right, and divots near to the base and far from it"
    };
    NoFit::Undetermined { what, why }
}

/// An arm all of whose links come out so many times as long is an arm whose plate is in other units.
fn scaled(near: &Solution, model: &Model<'_>, start: &Arm) -> Result<(), NoFit> {
    let [before, after] = [*start.joints(), model.joints(&near.state)]
        .map(|joints| joints.iter().map(|joint| joint.length_mm.abs()).sum::<f64>());
    let ratio = after / before;
    for (factor, unit) in
        [(0.1, "cm"), (10.0, "tenths of mm"), (1.0 / 25.4, "inches"), (25.4, "1/25.4 mm"), (0.001, "m")]
    {
        if (ratio / factor - 1.0).abs() < 0.15 {
            return Err(NoFit::Units { factor: ratio, unit });
        }
    }
    if !(0.5..=2.0).contains(&ratio) {
        return Err(NoFit::Senseless(format!("links of {after:.0} mm in all instead of {before:.0} mm")));
    }
    Ok(())
}

#[cfg(test)]
mod tests;
