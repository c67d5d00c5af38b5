//! The line under a window of samples: receive times are never too early, so that the clock is what lies under all of them.
//!
//! Of all lines under the points of the window the one is taken that is highest in the window's middle, which is the one with the least mean distance to evenly spread
//! points (Moon, Skelly & Towsley, INFOCOM 1999). It is the edge of the lower convex hull over the middle, or, where that is steeper than the clock can be, the line of
//! the steepest slope allowed that touches the hull.
//!
//! The window is a row of blocks of [`BLOCK_NS`]; each keeps the hull of its points. A point above the line changes nothing of it; one below, and the beginning
//! of a block, make it anew from the blocks' hulls. So a sample takes a few steps, and a refit of some hundred steps comes a few times a second.
//!
//! Where the points lie much closer above a line that is steeper than allowed, what was told of the rate is wrong, and steeper ones are allowed from then on.
//!
//! How far the line may be off is told by the blocks' least distances to it. They are no more evenly spread than delays are, but from block to block nearly independent.
//! With P(delay < d) ∝ dᵖ near 0 the quotient of the least of n to the m-th least is below (1 − α^(1/(m−1)))^(1/p) with probability 1 − α: the m-th least, which is seen,
//! bounds the least, which is not. Delays that keep their order, as on any line, become rarer towards 0: p is taken as 2.
//!
//! Where something passes data on at times of its own (an adapter's packets, a scheduler's ticks) delays are not spread at all but come in steps, and the least one may be
//! as large as a step. So the step from each block's least delay to the next one that differs is added.

use std::collections::VecDeque;

use super::hull::{Hull, Inserted, Point};

/// Length of a block, ns of device time.
pub(super) const BLOCK_NS: i64 = 250_000_000;
/// Blocks of the window: 10 s.
pub(super) const BLOCKS: usize = 40;
/// Blocks that are kept however old, so that silence does not make the clock forget its rate.
pub(super) const KEPT: usize = 8;
/// Newest blocks that must agree that all comes later than before, ere the line is made of them alone: 2 s.
pub(super) const SHIFT_BLOCKS: usize = 8;
/// What is thought of the least delay before anything is known, ns: no more than the slowest adapters and a scheduler's bad moment.
pub(super) const UNKNOWN_NS: i64 = 100_000_000;
/// The steepest slope that is looked for where none that is allowed fits, parts in 10⁹.
pub(super) const FREE_PPB: i64 = 300_000_000;
/// Delays nearer to each other than this are one delay, ns.
pub(super) const BAND_NS: i64 = 1_000_000;
/// Delays of a block nearer to its least than this are that one, ns.
const STEP_NS: i64 = 100_000;
/// Share of cases in which the bound on the least delay may fail.
const ALPHA: f64 = 1e-3;

/// A line under the points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Line {
    /// Where it touches them; twice the same where its slope is the steepest allowed.
    pub(super) touches: [Point; 2],
    /// Its slope: `rise` over `run`; `run` is positive.
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

    /// Whether it touches in one point only, its slope being that of a limit.
    pub(super) fn is_limited(&self) -> bool {
        self.touches[0].x == self.touches[1].x
    }

    /// Its height at a place, to the next whole ns below.
    pub(super) fn at(&self, x: i64) -> i64 {
        let away = i128::from(x) - i128::from(self.touches[0].x);
        let height = i128::from(self.touches[0].z) + (i128::from(self.rise) * away).div_euclid(i128::from(self.run));
        i64::try_from(height).unwrap_or(if height > 0 { i64::MAX } else { i64::MIN })
    }

    /// How far a point lies above it, ns.
    pub(super) fn below(&self, point: Point) -> i64 {
        point.z.saturating_sub(self.at(point.x))
    }

    /// Its slope, parts in 10⁹.
    pub(super) fn slope(&self) -> f64 {
        self.rise as f64 / self.run as f64
    }
}

/// How far the truth may lie from the line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Doubt {
    /// At the end of the newest block, ns.
    pub(super) bound_ns: i64,
    /// And more for each second after that, parts in 10⁹.
    pub(super) growth_ppb: i64,
    /// What least delays there are in the window, ns: a block with none below twice this has no timely sample.
    pub(super) spread_ns: i64,
}

/// Blocks of device time with the hulls of their points.
#[derive(Debug, Clone, Copy)]
struct Block {
    number: i64,
    hull: Hull,
    /// The least delay by the lines that there were, and the least that differs from it.
    least: [Option<i64>; 2],
}

impl Block {
    fn note(&mut self, delay: i64) {
        self.least = match self.least {
            [None, _] => [Some(delay), None],
            [Some(least), _] if delay < least - STEP_NS => [Some(delay), Some(least)],
            [Some(least), next] if delay <= least => [Some(delay), next],
            [Some(least), next] if delay > least + STEP_NS => {
                [Some(least), Some(next.map_or(delay, |next| next.min(delay)))]
            }
            same => same,
        };
    }

    /// From the least delay to the next that differs; 0 where there is one delay only.
    fn step(&self) -> i64 {
        if let [Some(least), Some(next)] = self.least { next - least } else { 0 }
    }
}

/// Work done, to be compared with what came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Work {
    /// Samples that entered the fit.
    pub samples: u64,
    /// Corners looked at to insert them.
    pub insert_steps: u64,
    /// Times that the line was made anew.
    pub refits: u64,
    /// Corners looked at for that.
    pub refit_steps: u64,
    /// Corners left out because a block held too many.
    pub coarsened: u64,
    /// Times that the rate was found further off than was allowed.
    pub widened: u64,
}

/// The window and its line.
#[derive(Debug)]
pub(super) struct Envelope {
    blocks: VecDeque<Block>,
    /// The steepest slope either way, parts in 10⁹.
    limit_ppb: i64,
    line: Option<Line>,
    doubt: Doubt,
    /// The chain of corners, and the blocks' least distances: room for a refit.
    chain: Vec<Point>,
    least: Vec<i64>,
    work: Work,
}

/// What a sample did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Change {
    /// The line is the same.
    None,
    /// The line is another.
    Line,
    /// All has come later for so long that what came before was given up.
    Shift,
}

impl Envelope {
    pub(super) fn new(limit_ppb: i64) -> Self {
        Self {
            blocks: VecDeque::with_capacity(BLOCKS + 2),
            limit_ppb,
            line: None,
            doubt: Doubt { bound_ns: UNKNOWN_NS, growth_ppb: 2 * limit_ppb, spread_ns: UNKNOWN_NS },
            chain: Vec::with_capacity(BLOCKS * super::hull::CORNERS),
            least: Vec::with_capacity(BLOCKS + 2),
            work: Work::default(),
        }
    }

    /// Begins anew; what was counted stays.
    pub(super) fn clear(&mut self, limit_ppb: i64) {
        self.blocks.clear();
        self.line = None;
        self.limit_ppb = limit_ppb;
        self.doubt = Doubt { bound_ns: UNKNOWN_NS, growth_ppb: 2 * limit_ppb, spread_ns: UNKNOWN_NS };
    }

    pub(super) fn line(&self) -> Option<&Line> {
        self.line.as_ref()
    }

    pub(super) fn limit_ppb(&self) -> i64 {
        self.limit_ppb
    }

    pub(super) fn doubt(&self) -> Doubt {
        self.doubt
    }

    pub(super) fn work(&self) -> Work {
        self.work
    }

    /// Blocks that have all their points.
    pub(super) fn complete(&self) -> usize {
        self.blocks.len().saturating_sub(1)
    }

    /// Where the newest block ends.
    pub(super) fn end(&self) -> i64 {
        self.blocks.back().map_or(0, |block| (block.number + 1).saturating_mul(BLOCK_NS))
    }

    /// Takes in a point. Points before the window are left out.
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
            // Silence may leave many old blocks none of which is older than the others' window.
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
            // Between blocks: nothing was received in that time until now, and an old sample tells little.
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
            // Is it the rate that is further off than was thought possible?
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

    /// A bound on the least delay, by a line, ns.
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

    /// What the blocks' least distances say of the line.
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
        let by_limit = spread + 2.0 * limit * (end - last.x) as f64;
        let (bound, growth) = if line.is_limited() {
            (by_limit, 2.0 * limit)
        } else {
            let growth = spread / (last.x - first.x) as f64;
            let by_touches = spread * (end - first.x).max(last.x - first.x) as f64 / (last.x - first.x) as f64;
            (by_touches.min(by_limit), growth.min(2.0 * limit))
        };
        self.doubt = Doubt {
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

/// Of the lines under a hull the highest at `middle`, which lies over it, with a slope of at most `limit_ppb` either way.
fn highest(chain: &[Point], middle: i64, limit_ppb: i64) -> Line {
    let Some(last) = chain.len().checked_sub(1).filter(|last| *last > 0) else {
        return Line::of_slope(chain.first().copied().unwrap_or_default(), 0);
    };
    let against = |edge: usize, slope_ppb: i64| {
        let [a, b] = [chain[edge], chain[edge + 1]];
        let wide = |to: i64, from: i64| i128::from(to) - i128::from(from);
        (wide(b.z, a.z) * 1_000_000_000).cmp(&(i128::from(slope_ppb) * wide(b.x, a.x)))
    };
    // Slopes grow along the chain: the first edge that reaches the middle.
    let edge = chain[1..last].partition_point(|corner| corner.x < middle);
    if against(edge, limit_ppb).is_gt() {
        // Where the slope passes the limit the line touches.
        let corner = (0..edge).find(|edge| against(*edge, limit_ppb).is_gt()).unwrap_or(edge);
        Line::of_slope(chain[corner], limit_ppb)
    } else if against(edge, -limit_ppb).is_lt() {
        let corner = (edge + 1..last).find(|edge| against(*edge, -limit_ppb).is_ge()).unwrap_or(last);
        Line::of_slope(chain[corner], -limit_ppb)
    } else {
        Line::through(chain[edge], chain[edge + 1])
    }
}

/// A bound on the least delay among blocks whose least distances to the line are these, ns. They are put in order.
fn bounded(least: &mut [i64]) -> i64 {
    least.sort_unstable();
    // The two that the line touches say nothing of how delays are spread; a quarter may be taken for timely whatever the others are.
    let place = (least.len().div_ceil(4) + 1).max(4);
    let Some(distance) = least.get(place - 1) else { return UNKNOWN_NS };
    let share = (1.0 - libm::pow(ALPHA, 1.0 / (place - 2) as f64)).sqrt();
    let bound = *distance as f64 * share / (1.0 - share);
    (bound.ceil() as i64).min(UNKNOWN_NS)
}

#[cfg(test)]
mod tests;
