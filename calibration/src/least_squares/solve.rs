//! Damped Gauss–Newton.

use super::blocks::Blocks;
use super::certainty::Certainty;
use super::linear::Linear;
use super::loss::{Loss, spread};
use super::parameters::{Parameters, State};
use super::solution::{Direction, Solution, Stopped};

/// The iteration ends at a step whose components are all below this share of their typical
/// sizes.
const STEP: f64 = 1e-11;
/// Steps below this are taken even if the cost does not fall …
const FLAT_STEP: f64 = 1e-6;
/// … but grows by less than this share of itself,
const FLAT_COST: f64 = 1e-10;
/// and as long as each is shorter than this share of the one before.
const SHRINKS: f64 = 0.9;
/// Initial damping, as a share of the largest singular value's square, and the level below
/// which it becomes 0.
const DAMPING: [f64; 2] = [1e-6, 1e-16];
/// Least spread for robust losses. Residuals of exact data are rounding errors, which have
/// outliers of their own.
const LEAST_SPREAD: f64 = 1e-6;
/// A robust solution alternates between scale and state until the scale changes by less …
const SAME_SCALE: f64 = 1e-4;
/// … or this many times.
const MOST_SCALES: u32 = 40;

/// Knowledge of the noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Noise {
    /// The whitening gives the relative noise of residuals; the residuals themselves give its
    /// size.
    #[default]
    Compared,
    /// The whitening gives the absolute noise. The covariance follows from it, and a robust
    /// loss judges residuals by it.
    Known,
}

/// Settings of the solver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// The loss function.
    pub loss: Loss,
    /// Knowledge of the noise.
    pub noise: Noise,
    /// Maximum number of steps, tried or taken.
    pub most_iterations: u32,
    /// A direction is undetermined if its singular value is less than this share of the
    /// largest, by typical sizes.
    pub least_determined: f64,
}

impl Default for Settings {
    /// Returns the settings for plain least squares, with the noise from the residuals.
    fn default() -> Self {
        Self { loss: Loss::Quadratic, noise: Noise::Compared, most_iterations: 500, least_determined: 1e-9 }
    }
}

impl Settings {
    /// Returns the settings for a robust loss, with its scale and the noise from the residuals.
    pub fn robust(loss: Loss) -> Self {
        Self { loss, ..Self::default() }
    }
}

/// Reasons why there is no solution.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Unsolved {
    /// There are fewer measured numbers than parameters.
    #[error("{residuals} measured numbers do not determine {parameters} parameters; measure more")]
    TooFew {
        /// Components of residuals.
        residuals: usize,
        /// Components of a step.
        parameters: usize,
    },
    /// A residual or derivative is NaN or infinite, or a covariance is invalid.
    #[error(
        "measurement {block} gives a residual, a derivative or a noise that is not a finite number; correct the input"
    )]
    NotFinite {
        /// Index of the block of residuals, from 0.
        block: usize,
    },
    /// The data do not determine these directions, the least determined first.
    #[error("the measurements do not determine {}; measure from other directions", listed(.directions))]
    Undetermined {
        /// Combinations of parameters.
        directions: Vec<Direction>,
    },
}

fn listed(directions: &[Direction]) -> String {
    directions.iter().map(ToString::to_string).collect::<Vec<_>>().join("; nor ")
}

/// Finds the parameters that minimise the residuals' cost, starting at [`Parameters::start`].
///
/// `evaluate` adds all residuals at a state, always as many and in the same order. A weight
/// that depends on the state must be computed from an earlier state, because the derivatives do
/// not cover its change.
///
/// # Errors
/// [`Unsolved`]: too few residuals, invalid numbers, or directions that the data do not
/// determine.
pub fn solve<F>(parameters: &Parameters, settings: &Settings, evaluate: F) -> Result<Solution, Unsolved>
where
    F: Fn(&State, &mut Blocks<'_>),
{
    let problem = Problem { parameters, settings, columns: &parameters.columns(), typical: &parameters.typical() };
    let mut search = Search { state: parameters.start(), iterations: 0, stopped: Stopped::Step };
    let first = problem.at(&search.state, &evaluate, true);
    let residuals = first.residuals().len();
    if residuals < parameters.steps() || residuals == 0 {
        return Err(Unsolved::TooFew { residuals, parameters: parameters.steps() });
    }
    check_finite(&first)?;
    let mut scale = problem.scale(&first);
    for _ in 0..MOST_SCALES {
        problem.descend(&mut search, scale, &evaluate)?;
        let next = problem.scale(&problem.at(&search.state, &evaluate, false));
        let same = (next - scale).abs() <= SAME_SCALE * scale;
        scale = next;
        if same || search.stopped == Stopped::Iterations {
            break;
        }
    }
    problem.solution(&search, scale, &evaluate)
}

/// State of the iteration.
struct Search {
    state: State,
    iterations: u32,
    stopped: Stopped,
}

struct Problem<'a> {
    parameters: &'a Parameters,
    settings: &'a Settings,
    columns: &'a [Option<usize>],
    typical: &'a [f64],
}

impl<'a> Problem<'a> {
    fn at(&self, state: &State, evaluate: &impl Fn(&State, &mut Blocks<'_>), derivatives: bool) -> Blocks<'a> {
        Blocks::of(self.parameters, self.columns, derivatives, |blocks| evaluate(state, blocks))
    }

    /// Returns the number of residuals over the degrees of freedom.
    fn share_of_freedom(&self, residuals: usize) -> f64 {
        let freedom = residuals.saturating_sub(self.parameters.steps()).max(1);
        residuals as f64 / freedom as f64
    }

    /// Returns the scale of a robust loss: the spread of the whitened residuals.
    fn scale(&self, blocks: &Blocks<'_>) -> f64 {
        if self.settings.loss == Loss::Quadratic || self.settings.noise == Noise::Known {
            return 1.0;
        }
        let spread = spread(&blocks.lengths()) * self.share_of_freedom(blocks.residuals().len()).sqrt();
        spread.max(LEAST_SPREAD)
    }

    /// Returns twice the sum of losses, in the given standard deviations.
    fn cost(&self, blocks: &Blocks<'_>, scale: f64) -> f64 {
        let cost = |(components, length): (usize, f64)| self.settings.loss.of(components).cost(length / scale);
        2.0 * scale * scale * blocks.lengths().into_iter().map(cost).sum::<f64>()
    }

    fn weights(&self, blocks: &Blocks<'_>, scale: f64) -> Vec<f64> {
        let weight = |(components, length): (usize, f64)| self.settings.loss.of(components).weight(length / scale);
        blocks.lengths().into_iter().map(weight).collect()
    }

    /// Returns the Jacobian by typical sizes and the residuals, each block times the root of
    /// its weight.
    fn linear(&self, blocks: &Blocks<'_>, weights: &[f64]) -> Linear {
        let width = self.typical.len();
        let (mut jacobian, mut residuals) = (blocks.jacobian().to_vec(), blocks.residuals().to_vec());
        for (range, weight) in blocks.ranges().zip(weights) {
            let root = weight.sqrt();
            residuals[range.clone()].iter_mut().for_each(|r| *r *= root);
            for row in jacobian[range.start * width..range.end * width].chunks_exact_mut(width) {
                row.iter_mut().zip(self.typical).for_each(|(entry, typical)| *entry *= root * typical);
            }
        }
        Linear::of(width, &jacobian, &residuals)
    }

    /// Descends to the nearest minimum at one scale.
    fn descend(
        &self,
        search: &mut Search,
        scale: f64,
        evaluate: &impl Fn(&State, &mut Blocks<'_>),
    ) -> Result<(), Unsolved> {
        let ([mut damping, least], mut before) = (DAMPING, f64::INFINITY);
        let mut blocks = self.at(&search.state, evaluate, true);
        loop {
            check_finite(&blocks)?;
            let cost = self.cost(&blocks, scale);
            let linear = self.linear(&blocks, &self.weights(&blocks, scale));
            loop {
                if search.iterations >= self.settings.most_iterations {
                    search.stopped = Stopped::Iterations;
                    return Ok(());
                }
                search.iterations += 1;
                let relative = linear.step(damping);
                let largest = relative.iter().fold(0.0, |most: f64, y| most.max(y.abs()));
                let step: Vec<f64> = relative.iter().zip(self.typical).map(|(y, typical)| y * typical).collect();
                let there = self.parameters.moved(&search.state, &step);
                let trial = self.at(&there, evaluate, false);
                // A cost of NaN does not count as less.
                let cost_there = self.cost(&trial, scale);
                // The cost is flat at its minimum: only half of its digits distinguish two
                // states. Small steps are taken as long as they shrink.
                let flat = largest <= FLAT_STEP && cost_there <= cost * (1.0 + FLAT_COST);
                if cost_there <= cost || flat {
                    search.state = there;
                    damping = if damping * 0.1 < least { 0.0 } else { damping * 0.1 };
                    let settled = flat && largest >= SHRINKS * before;
                    before = largest;
                    if largest <= STEP || settled {
                        search.stopped = if largest <= STEP { Stopped::Step } else { Stopped::Cost };
                        return Ok(());
                    }
                    break;
                }
                if largest <= STEP {
                    search.stopped = Stopped::Cost;
                    return Ok(());
                }
                damping = (damping * 10.0).max(DAMPING[0]);
            }
            blocks = self.at(&search.state, evaluate, true);
        }
    }

    fn solution(
        &self,
        search: &Search,
        scale: f64,
        evaluate: &impl Fn(&State, &mut Blocks<'_>),
    ) -> Result<Solution, Unsolved> {
        let blocks = self.at(&search.state, evaluate, true);
        check_finite(&blocks)?;
        let weights = self.weights(&blocks, scale);
        let weighted = self.linear(&blocks, &weights);
        let direction = |shares, sd| Direction::new(self.parameters, self.columns, shares, sd);
        let most = weighted.weakest_first().last().map_or(0.0, |(value, _)| value);
        let undetermined: Vec<Direction> = weighted
            .weakest_first()
            .filter(|(value, _)| *value <= self.settings.least_determined * most)
            .map(|(_, shares)| direction(shares, f64::INFINITY))
            .collect();
        if !undetermined.is_empty() {
            return Err(Unsolved::Undetermined { directions: undetermined });
        }

        // Blocks with weight 0 do not contribute to the covariance.
        let kept: Vec<f64> = weights.iter().map(|weight| if *weight > 0.0 { 1.0 } else { 0.0 }).collect();
        let variance = self.variance(&blocks, &weights, scale);
        let n = self.typical.len();
        let mut covariance = self.linear(&blocks, &kept).inverse_normal();
        for (at, entry) in covariance.iter_mut().enumerate() {
            *entry *= variance * self.typical[at / n] * self.typical[at % n];
        }
        let directions =
            weighted.weakest_first().map(|(value, shares)| direction(shares, variance.sqrt() / value)).collect();
        let residuals = blocks.residuals();
        let spread = match self.settings.loss {
            Loss::Quadratic => (sum_of_squares(residuals) / self.freedom(residuals.len()) as f64).sqrt(),
            _ => spread(&blocks.lengths()) * self.share_of_freedom(residuals.len()).sqrt(),
        };
        Ok(Solution {
            state: search.state.clone(),
            cost: self.cost(&blocks, scale),
            iterations: search.iterations,
            stopped: search.stopped,
            spread,
            freedom: residuals.len() - n,
            condition: weighted.condition(),
            lengths: blocks.lengths().into_iter().map(|(_, length)| length).collect(),
            weights,
            directions,
            certainty: Certainty::new(self.parameters, self.columns, &covariance),
        })
    }

    /// Returns the degrees of freedom left for the noise, at least one.
    fn freedom(&self, residuals: usize) -> usize {
        residuals.saturating_sub(self.parameters.steps()).max(1)
    }

    /// Returns the factor of (JᵀJ)⁻¹. For a robust loss it is Huber's (*Robust Statistics*,
    /// 1981, section 7.6): the mean square of ψ over the square of the mean of ψ′, corrected
    /// for few residuals. A block of d components counts d times, with ψ′ averaged over
    /// directions: (ρ″ + (d − 1)·ρ′/r)/d.
    fn variance(&self, blocks: &Blocks<'_>, weights: &[f64], scale: f64) -> f64 {
        let known = self.settings.noise == Noise::Known;
        if self.settings.loss == Loss::Quadratic {
            let residuals = blocks.residuals();
            return if known { 1.0 } else { sum_of_squares(residuals) / self.freedom(residuals.len()) as f64 };
        }
        let (mut count, mut squares, mut slopes, mut slopes_squared) = (0, 0.0, 0.0, 0.0);
        for ((components, length), weight) in blocks.lengths().into_iter().zip(weights) {
            if *weight <= 0.0 {
                continue;
            }
            let (d, r) = (components as f64, length / scale);
            let slope = (self.settings.loss.of(components).curvature(r) + (d - 1.0) * weight) / d;
            count += components;
            squares += (weight * r).powi(2);
            slopes += d * slope;
            slopes_squared += d * slope * slope;
        }
        let n = count as f64;
        let mean = slopes / n;
        let uneven = (slopes_squared / n / (mean * mean) - 1.0).max(0.0);
        let few = 1.0 + self.parameters.steps() as f64 / n * uneven;
        scale * scale * few * few * squares / self.freedom(count) as f64 / (mean * mean)
    }
}

fn sum_of_squares(numbers: &[f64]) -> f64 {
    numbers.iter().map(|x| x * x).sum()
}

fn check_finite(blocks: &Blocks<'_>) -> Result<(), Unsolved> {
    let width = if blocks.residuals().is_empty() { 0 } else { blocks.jacobian().len() / blocks.residuals().len() };
    let is_finite = |range: &std::ops::Range<usize>| {
        let derivatives = &blocks.jacobian()[range.start * width..range.end * width];
        blocks.residuals()[range.clone()].iter().chain(derivatives).all(|x| x.is_finite())
    };
    match blocks.ranges().position(|range| !is_finite(&range)) {
        Some(block) => Err(Unsolved::NotFinite { block }),
        None => Ok(()),
    }
}
