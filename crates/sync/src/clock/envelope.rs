//! The line under a window of samples. Receive times are never too early, so the clock is the
//! line below all of them.
//!
//! Among all lines under the points of the window, the highest at the window's middle is
//! chosen. It has the least mean distance to evenly spread points (Moon, Skelly & Towsley,
//! INFOCOM 1999). It is the edge of the lower convex hull over the middle. If that edge is
//! steeper than the clock can be, it is the line of the steepest allowed slope that touches the
//! hull.
//!
//! The window is a row of blocks of [`BLOCK_NS`]; each keeps the hull of its points. A point
//! above the line does not change it. A point below, or the start of a block, recomputes it
//! from the blocks' hulls. A sample thus takes a few steps; a refit of some hundred steps
//! happens a few times a second.
//!
//! If the points lie much closer above a line that is steeper than allowed, the given rate was
//! wrong, and steeper slopes are allowed from then on.
//!
//! The bound on the line's error follows from the blocks' least distances to it. These are no
//! more evenly spread than delays are, but nearly independent between blocks. Let P(delay < d)
//! ∝ dᵖ near 0. The quotient of the least of n and the m-th least is then below (1 −
//! α^(1/(m−1)))^(1/p) with probability 1 − α. The m-th least, which is observed, thus bounds
//! the least, which is not. Delays that keep their order, as on any line, become rarer towards
//! 0: p is taken as 2.
//!
//! Some links forward data only at certain times (an adapter's packets, a scheduler's ticks).
//! Delays then come in steps, and the least one may be as large as a step. Therefore the step
//! from each block's least delay to the next different one is added.

use std::collections::VecDeque;

use super::hull::{Hull, Inserted, Point};

/// Length of a block, ns of device time.
pub(super) const BLOCK_NS: i64 = 250_000_000;
/// Blocks of the window: 10 s.
pub(super) const BLOCKS: usize = 40;
/// Blocks kept however old, so that the clock does not forget its rate in a pause.
pub(super) const KEPT: usize = 8;
/// Number of newest blocks that must all be later than before until the line is made of them
/// alone: 2 s.
pub(super) const SHIFT_BLOCKS: usize = 8;
/// Assumed least delay before anything is known, ns: the slowest adapters and an unlucky
/// scheduler stay below.
pub(super) const UNKNOWN_NS: i64 = 100_000_000;
/// Steepest slope tried if no allowed slope fits, parts in 10⁹.
pub(super) const FREE_PPB: i64 = 300_000_000;
/// Delays that differ by less than this count as equal, ns.
pub(super) const BAND_NS: i64 = 1_000_000;
/// Delays of a block within this distance of its least count as the least, ns.
const STEP_NS: i64 = 100_000;
/// Probability that the bound on the least delay fails.
const ALPHA: f64 = 1e-3;

/// A line under the points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Line {
    /// Points at which it touches the hull; twice the same if its slope is the steepest
    /// allowed.
    pub(super) touches: [Point; 2],
    /// Its slope is `rise` over `run`; `run` is positive.
    pub(super) rise: i64,
    pub(super) run: i64,
}

impl Line {
    fn through(a: Point, b: Point) -> Self {
        Self { touches: [a, b], rise: b.z.saturating_sub(a.z), run: b.x - a.x }
    }

    pub(super) fn of_slope(at: Point, slope_ppb: i64) -> Self {
        Self { touches: [at; 2], rise: slope_ppb, run: 1_000_000_000 }
    }

    /// Whether it touches in one point only, with its slope at a limit.
    pub(super) fn is_limited(&self) -> bool {
        self.touches[0].x == self.touches[1].x
    }

    /// Height at a position, rounded down to whole ns.
    pub(super) fn at(&self, x: i64) -> i64 {
        let away = i128::from(x) - i128::from(self.touches[0].x);
        let height = i128::from(self.touches[0].z) + (i128::from(self.rise) * away).div_euclid(i128::from(self.run));
        i64::try_from(height).unwrap_or(if height > 0 { i64::MAX } else { i64::MIN })
    }

    /// Height of a point above the line, ns.
    pub(super) fn below(&self, point: Point) -> i64 {
        point.z.saturating_sub(self.at(point.x))
    }

    /// Slope, as a ratio.
    pub(super) fn slope(&self) -> f64 {
        self.rise as f64 / self.run as f64
    }
}

/// Bound on the error of the line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ClockUncertainty {
    /// Bound at the end of the newest block, ns.
    pub(super) bound_ns: i64,
    /// Growth per second after that, parts in 10⁹.
    pub(super) growth_ppb: i64,
    /// Bound on the least delays in the window, ns: a block whose delays all exceed twice this
    /// has no timely sample.
    pub(super) spread_ns: i64,
}

/// A block of device time with the hull of its points.
#[derive(Debug, Clone, Copy)]
struct Block {
    number: i64,
    hull: Hull,
    /// The least delay by the lines at the time, and the least that differs from it.
    least: [Option<i64>; 2],
}

impl Block {
    fn note(&mut self, delay: i64) {
        self.least = match self.least {
            [None, _] => [Some(delay), None],
            [Some(least), _] if delay < least.saturating_sub(STEP_NS) => [Some(delay), Some(least)],
            [Some(least), next] if delay <= least => [Some(delay), next],
            [Some(least), next] if delay > least.saturating_add(STEP_NS) => {
                [Some(least), Some(next.map_or(delay, |next| next.min(delay)))]
            }
            same => same,
        };
    }

    /// Difference between the least delay and the next different one; 0 if there is only one.
    fn step(&self) -> i64 {
        if let [Some(least), Some(next)] = self.least { next.saturating_sub(least) } else { 0 }
    }
}

/// Work done, to be compared with the number of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Work {
    /// Samples that entered the fit.
    pub samples: u64,
    /// Corners visited to insert them.
    pub insert_steps: u64,
    /// Number of refits of the line.
    pub refits: u64,
    /// Corners visited by refits.
    pub refit_steps: u64,
    /// Corners left out because a block held too many.
    pub coarsened: u64,
    /// Times that the allowed rate error was widened.
    pub widened: u64,
}

/// The window and its line.
#[derive(Debug)]
pub(super) struct Envelope {
    blocks: VecDeque<Block>,
    /// The steepest slope either way, parts in 10⁹.
    limit_ppb: i64,
    line: Option<Line>,
    doubt: ClockUncertainty,
    /// Buffers for a refit: the chain of corners, and the blocks' least distances.
    chain: Vec<Point>,
    least: Vec<i64>,
    work: Work,
}

/// Effect of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Change {
    /// The line is unchanged.
    None,
    /// The line has changed.
    Line,
    /// All samples have been later for so long that earlier ones were discarded.
    Shift,
}

impl Envelope {
    pub(super) fn new(limit_ppb: i64) -> Self {
        Self {
            blocks: VecDeque::with_capacity(BLOCKS + 2),
            limit_ppb,
            line: None,
            doubt: ClockUncertainty { bound_ns: UNKNOWN_NS, growth_ppb: 2 * limit_ppb, spread_ns: UNKNOWN_NS },
            chain: Vec::with_capacity(BLOCKS * super::hull::CORNERS),
            least: Vec::with_capacity(BLOCKS + 2),
            work: Work::default(),
        }
    }

    /// Restarts; counters are kept.
    pub(super) fn clear(&mut self, limit_ppb: i64) {
        self.blocks.clear();
        self.line = None;
        self.limit_ppb = limit_ppb;
        self.doubt = ClockUncertainty { bound_ns: UNKNOWN_NS, growth_ppb: 2 * limit_ppb, spread_ns: UNKNOWN_NS };
    }

    pub(super) fn line(&self) -> Option<&Line> {
        self.line.as_ref()
    }

    pub(super) fn limit_ppb(&self) -> i64 {
        self.limit_ppb
    }

    pub(super) fn doubt(&self) -> ClockUncertainty {
        self.doubt
    }

    pub(super) fn work(&self) -> Work {
        self.work
    }

    /// Number of blocks that have all their points.
    pub(super) fn complete(&self) -> usize {
        self.blocks.len().saturating_sub(1)
    }

    /// End of the newest block.
    pub(super) fn end(&self) -> i64 {
        self.blocks.back().map_or(0, |block| (block.number + 1).saturating_mul(BLOCK_NS))
    }

    /// Inserts a point. Points before the window are ignored.
    pub(super) fn insert(&mut self, point: Point) -> Change {
        let number = point.x.div_euclid(BLOCK_NS);
        let newest = self.blocks.back().map(|block| block.number);
        self.work.samples += 1;
        let begins = newest.is_none_or(|newest| number > newest);
        if begins {
            self.blocks.push_back(Block { number, hull: Hull::EMPTY, least: [None; 2] });
            let oldest = number.saturating_sub(BLOCKS as i64);
            while self.blocks.len() > KEPT && self.blocks.front().is_some_and(|block| block.number <= oldest) {
                self.blocks.pop_front();
            }
            // A pause may leave many old blocks, none older than the window of the others.
            if self.blocks.len() > BLOCKS {
                self.blocks.pop_front();
            }
        }
        let place = self.blocks.partition_point(|block| block.number < number);
        match self.blocks.get_mut(place) {
            Some(block) if block.number == number => {
                let Inserted { steps, coarsened } = block.hull.insert(point);
                self.work.insert_steps += steps;
                self.work.coarsened += u64::from(coarsened);
                block.note(self.line.map_or(0, |line| line.below(point)));
            }
            // Between blocks: nothing was received for that time until now, and an old sample
            // adds little.
            _ => return Change::None,
        }
        let is_under = self.line.is_none_or(|line| line.below(point) < 0);
        if !(begins || is_under || self.blocks.len() == 1) {
            return Change::None;
        }
        self.refit();
        if begins && self.has_shifted() {
            self.blocks.drain(..self.blocks.len() - 1 - SHIFT_BLOCKS);
            self.refit();
            return Change::Shift;
        }
        Change::Line
    }

    /// The middle of the window, which only a new block moves.
    fn middle(&self) -> i64 {
        let [first, last] = [self.blocks.front(), self.blocks.back()].map(|block| block.map_or(0, |b| b.number));
        ((i128::from(first) + i128::from(last) + 1) * i128::from(BLOCK_NS) / 2) as i64
    }

    fn refit(&mut self) {
        self.work.refits += 1;
        let chain = &mut self.chain;
        chain.clear();
        for point in self.blocks.iter().flat_map(|block| block.hull.corners()) {
            self.work.refit_steps += 1;
            while let [.., a, b] = chain[..]
                && super::hull::turn(a, b, *point) <= 0
            {
                self.work.refit_steps += 1;
                chain.pop();
            }
            chain.push(*point);
        }
        let (Some(first), Some(last)) = (self.chain.first(), self.chain.last()) else { return };
        let middle = self.middle().clamp(first.x, last.x);
        let mut line = highest(&self.chain, middle, self.limit_ppb);
        if line.is_limited() && self.complete() >= KEPT {
            // Checks whether the rate differs by more than was allowed.
            let free = highest(&self.chain, middle, FREE_PPB);
            if self.spread(&free).saturating_mul(4) + BAND_NS < self.spread(&line) {
                self.limit_ppb = self.limit_ppb.saturating_mul(8).min(FREE_PPB);
                self.work.widened += 1;
                line = highest(&self.chain, middle, self.limit_ppb);
            }
        }
        self.line = Some(line);
        self.judge(&line);
    }

    /// Bound on the least delay for a line, ns.
    fn spread(&mut self, line: &Line) -> i64 {
        let complete = self.complete();
        self.least.clear();
        for block in self.blocks.iter().take(complete) {
            let distances = block.hull.corners().iter().map(|corner| line.below(*corner));
            self.least.push(distances.min().unwrap_or(0));
            self.work.refit_steps += block.hull.corners().len() as u64;
        }
        bounded(&mut self.least)
    }

    /// Computes the line's error bound from the blocks' least distances.
    fn judge(&mut self, line: &Line) {
        let complete = self.complete();
        let spread_ns = self.spread(line);
        self.least.clear();
        self.least.extend(self.blocks.iter().take(complete).map(Block::step));
        self.least.sort_unstable();
        let step_ns = self.least.get(complete / 2).copied().unwrap_or(0);
        let spread_ns = spread_ns.saturating_add(step_ns).min(UNKNOWN_NS);
        let [first, last] = line.touches;
        let end = self.end();
        let limit = self.limit_ppb as f64 * 1e-9;
        let spread = spread_ns as f64;
        // The end of the last block may lie beyond the range of points.
        let [from_first, from_last] = [first, last].map(|touch| end.saturating_sub(touch.x));
        let by_limit = spread + 2.0 * limit * from_last as f64;
        let (bound, growth) = if line.is_limited() {
            (by_limit, 2.0 * limit)
        } else {
            let apart = last.x - first.x;
            let growth = spread / apart as f64;
            let by_touches = spread * from_first.max(apart) as f64 / apart as f64;
            (by_touches.min(by_limit), growth.min(2.0 * limit))
        };
        self.doubt = ClockUncertainty {
            bound_ns: (bound.ceil() as i64).min(UNKNOWN_NS),
            growth_ppb: (growth * 1e9).ceil() as i64,
            spread_ns,
        };
    }

    /// Whether the newest complete blocks all lie above the older ones' line.
    fn has_shifted(&self) -> bool {
        let Some(line) = self.line else { return false };
        if self.complete() < KEPT + SHIFT_BLOCKS {
            return false;
        }
        let late = 2 * self.doubt.spread_ns + BAND_NS;
        self.blocks
            .iter()
            .rev()
            .skip(1)
            .take(SHIFT_BLOCKS)
            .all(|block| block.hull.corners().iter().all(|corner| line.below(*corner) > late))
    }
}

/// Returns the line under a hull that is highest at `middle`, with a slope of at most
/// `limit_ppb` either way. `middle` lies within the hull.
fn highest(chain: &[Point], middle: i64, limit_ppb: i64) -> Line {
    let Some(last) = chain.len().checked_sub(1).filter(|last| *last > 0) else {
        return Line::of_slope(chain.first().copied().unwrap_or_default(), 0);
    };
    let against = |edge: usize, slope_ppb: i64| {
        let [a, b] = [chain[edge], chain[edge + 1]];
        let wide = |to: i64, from: i64| i128::from(to) - i128::from(from);
        (wide(b.z, a.z) * 1_000_000_000).cmp(&(i128::from(slope_ppb) * wide(b.x, a.x)))
    };
    // Slopes grow along the chain; this is the first edge that reaches the middle.
    let edge = chain[1..last].partition_point(|corner| corner.x < middle);
    if against(edge, limit_ppb).is_gt() {
        // The line touches where the slope passes the limit.
        let corner = (0..edge).find(|edge| against(*edge, limit_ppb).is_gt()).unwrap_or(edge);
        Line::of_slope(chain[corner], limit_ppb)
    } else if against(edge, -limit_ppb).is_lt() {
        let corner = (edge + 1..last).find(|edge| against(*edge, -limit_ppb).is_ge()).unwrap_or(last);
        Line::of_slope(chain[corner], -limit_ppb)
    } else {
        Line::through(chain[edge], chain[edge + 1])
    }
}

/// Bound on the least delay from the blocks' least distances to the line, ns. Sorts them.
fn bounded(least: &mut [i64]) -> i64 {
    least.sort_unstable();
    // The two distances at which the line touches carry no information on the spread. A quarter
    // of the blocks counts as timely in any case.
    let place = (least.len().div_ceil(4) + 1).max(4);
    let Some(distance) = least.get(place - 1) else { return UNKNOWN_NS };
    let share = (1.0 - libm::pow(ALPHA, 1.0 / (place - 2) as f64)).sqrt();
    let bound = *distance as f64 * share / (1.0 - share);
    (bound.ceil() as i64).min(UNKNOWN_NS)
}

#[cfg(test)]
mod tests;
