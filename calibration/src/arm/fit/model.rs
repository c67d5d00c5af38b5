//! The residuals of touches: the tip's position by the joints' numbers, less its known
//! position.

use glam::{DVec2, DVec3};

use sonoweave_core::rotation::direction;

use super::number::Number;
use super::options::Options;
use super::touches::{Known, Touch};
use crate::arm::{Arm, JOINTS, Joint, Values};
use crate::least_squares::{
    Blocks, Loss, Noise, Parameters, Settings, Solution, State, Unsolved, Vector, Whitening, solve,
};

/// The residuals estimate their noise only with this many measured numbers per parameter. With
/// fewer, the fit could meet some exactly and take the rest for outliers.
const LEAST_PER_NUMBER: usize = 3;

/// A fitted number: joint index, kind, and place among the parameters.
pub(super) type FittedNumber = (usize, Number, Vector<1>);

/// The parameters of a fit, and their relation to the joints' numbers.
pub(super) struct Model<'a> {
    start: &'a Arm,
    known: Known<'a>,
    pub(super) touches: &'a [Touch],
    pub(super) options: &'a Options,
    pub(super) parameters: Parameters,
    pub(super) numbers: Vec<FittedNumber>,
    /// Position of the plate: its angle (absent for one divot) and its shift. Distances have no
    /// position.
    placing: Option<(Option<Vector<1>>, Vector<2>)>,
}

impl<'a> Model<'a> {
    pub(super) fn new(start: &'a Arm, known: &Known<'a>, touches: &'a [Touch], options: &'a Options) -> Self {
        let reach_mm = start.joints().iter().map(|joint| joint.length_mm.abs()).sum::<f64>().max(1.0);
        let mut parameters = Parameters::new();
        let mut numbers = Vec::new();
        for (index, joint) in start.joints().iter().enumerate() {
            for number in Number::ALL.into_iter().filter(|number| number.is_fitted(index, options)) {
                let mut copy = *joint;
                let Some(value) = number.of(&mut copy) else { continue };
                let name = format!("{} of joint {}", number.name(), index + 1);
                let typical = number.typical(joint, reach_mm);
                numbers.push((index, number, parameters.vector(&name, [""], number.unit(), typical, [*value])));
            }
        }
        let placing = match known {
            Known::Divots(plate_mm) => {
                let (angle, shift) = placed(start, plate_mm, touches, options.tip_mm);
                let angle = (!is_one(plate_mm, touches))
                    .then(|| parameters.vector("the plate's angle", [""], "rad", 1.0 / reach_mm, [angle]));
                Some((angle, parameters.vector("the plate", ["x", "y"], "mm", 1.0, shift.to_array())))
            }
            Known::Distances(_) => None,
        };
        Self { start, known: *known, touches, options, parameters, numbers, placing }
    }

    pub(super) fn joints(&self, state: &State) -> [Joint; JOINTS] {
        let mut joints = *self.start.joints();
        for (index, number, place) in &self.numbers {
            if let Some(value) = number.of(&mut joints[*index]) {
                [*value] = state.vector(*place);
            }
        }
        joints
    }

    /// Returns the standard deviation of a residual along an axis, mm. A distance has the
    /// errors of both its ends.
    pub(super) fn sd_of_residual_mm(&self) -> f64 {
        match self.known {
            Known::Divots(_) => self.options.tip_sd_mm,
            Known::Distances(_) => self.options.tip_sd_mm * 2.0_f64.sqrt(),
        }
    }

    /// Returns the touched divot, turned by the plate's angle but not yet shifted.
    fn turned(&self, state: &State, plate_mm: &[DVec2], touch: &Touch) -> DVec2 {
        let angle = self.placing.and_then(|(angle, _)| angle).map_or(0.0, |angle| state.vector(angle)[0]);
        direction(angle).rotate(plate_mm[touch.of])
    }

    fn shift(&self, state: &State) -> DVec2 {
        self.placing.map_or(DVec2::ZERO, |(_, shift)| DVec2::from_array(state.vector(shift)))
    }

    /// Returns the touches of both ends of a distance, after
    /// [`check`](super::refusal::check) has verified that there are two.
    fn ends(&self, distance: usize) -> [&'a Touch; 2] {
        let mut own = self.touches.iter().filter(|touch| touch.of == distance);
        let mut next = || own.next().unwrap_or(&self.touches[0]);
        [next(), next()]
    }

    /// Adds the residuals and derivatives: the tip less its divot, or the tips' distance less
    /// the known one, mm.
    pub(super) fn put(&self, state: &State, blocks: &mut Blocks<'_>) {
        let arm = Arm { joints: self.joints(state) };
        match self.known {
            Known::Divots(plate_mm) => self.put_divots(state, &arm, plate_mm, blocks),
            Known::Distances(distances_mm) => self.put_distances(&arm, distances_mm, blocks),
        }
    }

    fn put_divots(&self, state: &State, arm: &Arm, plate_mm: &[DVec2], blocks: &mut Blocks<'_>) {
        let noise = Whitening::sd(self.options.tip_sd_mm);
        let shift = self.shift(state);
        for touch in self.touches {
            let values = values(arm, touch);
            let divot = self.turned(state, plate_mm, touch);
            let residual = arm.pose(&values).point(self.options.tip_mm) - divot - shift;
            let mut row = blocks.add(residual.to_array(), &noise);
            for (index, number, place) in &self.numbers {
                let moved = moved(arm, &values, self.options.tip_mm, *index, *number);
                row = row.by(*place, [[moved.x], [moved.y]]);
            }
            if let Some((angle, shift)) = self.placing {
                row = row.by(shift, [[-1.0, 0.0], [0.0, -1.0]]);
                if let Some(angle) = angle {
                    let turned = -divot.perp();
                    row.by(angle, [[turned.x], [turned.y]]);
                }
            }
        }
    }

    fn put_distances(&self, arm: &Arm, distances_mm: &[f64], blocks: &mut Blocks<'_>) {
        let noise = Whitening::sd(self.sd_of_residual_mm());
        for (distance, mm) in distances_mm.iter().enumerate() {
            let ends = self.ends(distance).map(|touch| values(arm, touch));
            let [one, other] = ends.map(|values| arm.pose(&values).point(self.options.tip_mm));
            let along = (one - other).normalize_or_zero();
            let mut row = blocks.add([(one - other).length() - mm], &noise);
            for (index, number, place) in &self.numbers {
                let [one, other] = ends.map(|values| moved(arm, &values, self.options.tip_mm, *index, *number));
                row = row.by(*place, [[along.dot(one - other)]]);
            }
        }
    }

    /// Returns the residuals of [`Self::put`], each as a length, mm.
    pub(super) fn residuals_mm(&self, state: &State) -> Vec<f64> {
        let arm = Arm { joints: self.joints(state) };
        let tip = |touch: &Touch| arm.pose(&values(&arm, touch)).point(self.options.tip_mm);
        match self.known {
            Known::Divots(plate_mm) => {
                let off = |touch: &Touch| tip(touch) - self.turned(state, plate_mm, touch) - self.shift(state);
                self.touches.iter().map(|touch| off(touch).length()).collect()
            }
            Known::Distances(distances_mm) => {
                let off = |(distance, mm): (usize, &f64)| {
                    let [one, other] = self.ends(distance).map(tip);
                    (one.distance(other) - mm).abs()
                };
                distances_mm.iter().enumerate().map(off).collect()
            }
        }
    }

    /// Returns the count of measured numbers.
    pub(super) fn measured(&self) -> usize {
        match self.known {
            Known::Divots(_) => 2 * self.touches.len(),
            Known::Distances(distances_mm) => distances_mm.len(),
        }
    }

    /// Returns how the solver learns the noise: from the residuals if there are many, else from
    /// the given value.
    pub(super) fn noise(&self) -> Noise {
        match self.measured() < LEAST_PER_NUMBER * self.parameters.steps() {
            true => Noise::Known,
            false => Noise::Compared,
        }
    }

    pub(super) fn solve(&self, loss: Loss, noise: Noise) -> Result<Solution, Unsolved> {
        let settings = Settings { loss, noise, ..Settings::default() };
        solve(&self.parameters, &settings, |state, blocks| self.put(state, blocks))
    }
}

/// Returns the joint values at a touch.
pub(super) fn values(arm: &Arm, touch: &Touch) -> Values {
    std::array::from_fn(|joint| arm.joints()[joint].value(touch.counts[joint]))
}

/// Returns the range of each joint's values, rad or mm.
pub(super) fn ranges(arm: &Arm, touches: &[Touch]) -> [[f64; 2]; JOINTS] {
    let mut ranges = [[f64::INFINITY, f64::NEG_INFINITY]; JOINTS];
    for touch in touches {
        for ([least, most], value) in ranges.iter_mut().zip(values(arm, touch)) {
            (*least, *most) = (least.min(value), most.max(value));
        }
    }
    ranges
}

/// Returns the tip's motion with a number of a joint, mm per unit of that number.
pub(super) fn moved(arm: &Arm, values: &Values, tip_mm: DVec2, joint: usize, number: Number) -> DVec2 {
    let by = &arm.derivatives(values)[joint];
    let by: DVec3 = match number {
        Number::Length => by.length,
        Number::Zero => by.zero_counts,
        Number::CountsPerUnit => by.counts_per_unit,
        Number::Direction => by.direction,
    };
    let lever = direction(arm.pose(values).heading_rad).rotate(tip_mm).perp();
    by.truncate() + lever * by.z
}

/// Returns whether all touches are of one place, according to the plate.
pub(super) fn is_one(plate_mm: &[DVec2], touches: &[Touch]) -> bool {
    touches.windows(2).all(|two| plate_mm[two[0].of] == plate_mm[two[1].of])
}

/// Estimates the plate's position with the start arm: the rigid map of the divots to the
/// touches, in the plane.
fn placed(arm: &Arm, plate_mm: &[DVec2], touches: &[Touch], tip_mm: DVec2) -> (f64, DVec2) {
    let tip = |touch: &Touch| (plate_mm[touch.of], arm.pose(&values(arm, touch)).point(tip_mm));
    let tips: Vec<(DVec2, DVec2)> = touches.iter().map(tip).collect();
    let count = tips.len() as f64;
    let [divots, points] =
        [tips.iter().map(|(a, _)| *a).sum::<DVec2>() / count, tips.iter().map(|(_, b)| *b).sum::<DVec2>() / count];
    if is_one(plate_mm, touches) {
        return (0.0, points - divots);
    }
    let (mut sine, mut cosine) = (0.0, 0.0);
    for (divot, point) in &tips {
        let (a, b) = (*divot - divots, *point - points);
        sine += a.perp_dot(b);
        cosine += a.dot(b);
    }
    let angle = sine.atan2(cosine);
    (angle, points - direction(angle).rotate(divots))
}
