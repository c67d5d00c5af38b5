//! Estimates the lag at which one signal follows others best, at uneven times, with its
//! standard error or the reason for a refusal.
//!
//! The model of a frame's value y at t is c + Σ bₖ fₖ(t + lag) with unknown c and b. f₀ is the
//! main signal; the others contribute as far as the values require. A coarse search over the
//! whole range minimises the mean absolute residual. Gauss–Newton steps then use the derivative
//! of a spline through f. Every step eliminates c and b (Golub & Pereyra, SIAM J. Numer. Anal.
//! 10, 1973, in Kaufman's form). Tukey's weights exclude frames with a wrong line.
//!
//! The standard error does not assume that residuals are independent with equal variance: model
//! errors persist from frame to frame. It follows Newey & West (Econometrica 55, 1987) with
//! Parzen's window of Andrews' width (Econometrica 59, 1991), corrected for leverage.

use super::long_run::variance_of_sum;
use super::robust::Biweight;
use crate::error::LatencyError;
use crate::statistics::{deviation_about_zero, median};
use crate::trajectory::spline::Spline;

/// A frame's value and time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedValue {
    /// Time by the video's stamp, s.
    pub time_s: f64,
    /// Position of the line, px.
    pub value: f64,
}

/// Options of the search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AlignOptions {
    /// The search covers lags from −range to +range, s.
    pub range_s: f64,
}

impl Default for AlignOptions {
    fn default() -> Self {
        Self { range_s: 0.5 }
    }
}

/// A lag and its accuracy.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// Lag, s; above 0 if the tracker lags the video.
    pub lag_s: f64,
    /// Its standard error, s.
    pub se_s: f64,
    /// Change of the value with the first of the tracker's numbers.
    pub gain: f64,
    /// Standard deviation of the residuals without outliers.
    pub residual: f64,
    /// Standard deviation of the stamps, s, from the excess of the residuals during fast
    /// motion.
    pub stamp_s: f64,
    /// Number of frames between poses.
    pub frames: usize,
    /// Number of these frames that are outliers.
    pub outliers: usize,
    /// Residual of each frame, in the given order. `None` if there are no poses around its
    /// time.
    pub residuals: Vec<Option<f64>>,
    /// Coarse search: each lag with its mean absolute residual, using the first of the
    /// tracker's numbers only.
    pub curve: Vec<(f64, f64)>,
}

/// Minimum number of frames for a valid standard error.
pub const LEAST_FRAMES: usize = 30;
/// Step of the coarse search, as a share of the motion's time scale: the time in which a sine
/// of its speed passes a radian.
const COARSE: f64 = 0.15;
/// The residual must stay below this share of the values' deviation.
const EXPLAINED: f64 = 0.5;
/// Two lags are indistinct if chance makes their residuals differ this much more often than
/// once in a hundred. In standard deviations of a normal distribution.
const DISTINCT: f64 = 2.33;
/// The standard error must be less than this share of the range.
const KNOWN: f64 = 0.1;
const MOST_STEPS: usize = 200;
/// Number of steps after which the residuals' scale is fixed.
const SETTLED: usize = 15;
/// Step size at which the iteration ends, s.
const CONVERGED_S: f64 = 1e-10;

/// Returns the lag of a track's numbers behind the values.
///
/// # Errors
/// [`LatencyError`] if the signals determine no lag.
pub fn align<const N: usize>(
    values: &[TimedValue],
    track: &Spline<N>,
    options: &AlignOptions,
) -> Result<Alignment, LatencyError> {
    let problem = Problem { values, track };
    let range_s = options.range_s;
    let step_s = problem.coarse_step(range_s)?;
    let steps = (range_s / step_s).ceil().max(2.0) as i32;
    let lags: Vec<f64> = (-steps..=steps).map(|k| range_s * f64::from(k) / f64::from(steps)).collect();
    let step_s = lags[1] - lags[0];
    let curve: Vec<(f64, f64)> = lags.iter().filter_map(|lag| Some((*lag, problem.coarse(*lag)?))).collect();
    if curve.len() < 3 {
        return Err(problem.no_overlap(&lags));
    }
    let mut minima: Vec<(f64, f64)> = curve
        .iter()
        .enumerate()
        .filter(|(i, (_, own))| {
            let beside = |j: Option<usize>| j.and_then(|j| curve.get(j)).is_none_or(|(_, other)| own <= other);
            beside(i.checked_sub(1)) && beside(Some(i + 1))
        })
        .map(|(_, found)| *found)
        .collect();
    minima.sort_by(|a, b| a.1.total_cmp(&b.1));
    minima.truncate(4);
    let mut fits: Vec<Fit> = minima.iter().filter_map(|(lag, _)| problem.refine(*lag, 2.0 * step_s)).collect();
    fits.sort_by(|a, b| a.scale.total_cmp(&b.scale));
    let Some(best) = fits.first() else { return Err(LatencyError::Constant) };
    if !(best.lag_s.abs() < range_s - 0.5 * step_s) {
        return Err(LatencyError::AtEdge { lag_s: best.lag_s, range_s });
    }
    let left = best.scale / problem.deviation();
    if !(left < EXPLAINED) {
        return Err(LatencyError::Unrelated { left });
    }
    let apart = |fit: &&Fit| fit.lag_s.abs() < range_s && (fit.lag_s - best.lag_s).abs() > step_s;
    if let Some(rival) = fits[1..].iter().find(apart) {
        // Chance makes the deviations of n independent residuals differ by 1/√n of themselves.
        let sure = (DISTINCT / best.independent.sqrt()).exp();
        if !(rival.scale > sure * best.scale) {
            let (lags_s, residuals) = ([best.lag_s, rival.lag_s], [best.scale, rival.scale]);
            return Err(LatencyError::Ambiguous { lags_s, residuals });
        }
    }
    if !(best.se_s < KNOWN * range_s) {
        return Err(LatencyError::Unsure { lag_s: best.lag_s, se_s: best.se_s });
    }
    Ok(Alignment {
        lag_s: best.lag_s,
        se_s: best.se_s,
        gain: best.gain,
        residual: best.scale,
        stamp_s: best.stamp_s,
        frames: best.residuals.iter().flatten().count(),
        outliers: best.outliers,
        residuals: best.residuals.clone(),
        curve,
    })
}

struct Problem<'a, const N: usize> {
    values: &'a [TimedValue],
    track: &'a Spline<N>,
}

/// A local minimum.
struct Fit {
    lag_s: f64,
    se_s: f64,
    gain: f64,
    scale: f64,
    stamp_s: f64,
    outliers: usize,
    residuals: Vec<Option<f64>>,
    /// Equivalent number of independent residuals.
    independent: f64,
}

impl<const N: usize> Problem<'_, N> {
    /// Returns the robust spread of the values.
    fn deviation(&self) -> f64 {
        let mut values: Vec<f64> = self.values.iter().map(|frame| frame.value).collect();
        let middle = median(&mut values);
        // The mean distance, because the median would be 0 for a motion that rests at its ends.
        values.iter().map(|x| (x - middle).abs()).sum::<f64>() / values.len().max(1) as f64
    }

    fn no_overlap(&self, lags: &[f64]) -> LatencyError {
        let times = || self.values.iter().map(|frame| frame.time_s);
        let frames_s = [times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max)];
        let between = |lag: &f64| times().filter(|t| self.track.at(t + lag).is_some()).count();
        let most = lags.iter().map(between).max().unwrap_or(0);
        let poses_s = self.track.span_s().unwrap_or([f64::NAN; 2]);
        LatencyError::NoOverlap { all: self.values.len(), most, least: self.least(), frames_s, poses_s }
    }

    /// Returns the number of frames that must lie between poses.
    fn least(&self) -> usize {
        LEAST_FRAMES.max(self.values.len() / 2)
    }

    /// Returns a step so small that the motion between two steps stays within the reach of the
    /// refinement.
    fn coarse_step(&self, range_s: f64) -> Result<f64, LatencyError> {
        let (mut places, mut speeds): (Vec<f64>, Vec<f64>) = self
            .track
            .samples()
            .filter_map(|(time, values)| Some((values[0], self.track.at(time)?.1[0].powi(2))))
            .unzip();
        let middle = median(&mut places);
        let square = places.iter().map(|x| (x - middle).powi(2)).sum::<f64>();
        let speed = speeds.iter_mut().map(|x| *x).sum::<f64>();
        if self.values.len() < LEAST_FRAMES || places.is_empty() {
            return Err(self.no_overlap(&[0.0]));
        }
        if !(self.deviation() > 0.0 && square > 0.0 && speed > 0.0) {
            return Err(LatencyError::Constant);
        }
        Ok((COARSE * (square / speed).sqrt()).clamp(1e-4, 0.25 * range_s))
    }

    /// Returns the mean absolute residual of the best straight line through the values and the
    /// first number. `None` if too few frames lie between poses.
    fn coarse(&self, lag_s: f64) -> Option<f64> {
        let pairs: Vec<(f64, f64)> = self
            .values
            .iter()
            .filter_map(|frame| Some((self.track.at(frame.time_s + lag_s)?.0[0], frame.value)))
            .collect();
        if pairs.len() < self.least() {
            return None;
        }
        let mut weights = vec![1.0; pairs.len()];
        let mut mean = f64::INFINITY;
        // Minimises absolute residuals by weights that are their inverses; a few rounds suffice
        // to compare lags.
        for _ in 0..12 {
            let total: f64 = weights.iter().sum();
            let of = |f: fn(&(f64, f64)) -> f64| pairs.iter().zip(&weights).map(|(p, w)| w * f(p)).sum::<f64>() / total;
            let (x, y) = (of(|p| p.0), of(|p| p.1));
            let (xx, xy) = (of(|p| p.0 * p.0) - x * x, of(|p| p.0 * p.1) - x * y);
            let gain = if xx > 0.0 { xy / xx } else { 0.0 };
            let left: Vec<f64> = pairs.iter().map(|p| (p.1 - y - gain * (p.0 - x)).abs()).collect();
            mean = left.iter().sum::<f64>() / left.len() as f64;
            let floor = 1e-3 * mean + f64::MIN_POSITIVE;
            weights.iter_mut().zip(left).for_each(|(w, r)| *w = 1.0 / r.max(floor));
        }
        Some(mean)
    }

    /// Refines a lag, moving it by at most `most_s`; `None` on failure.
    fn refine(&self, start_s: f64, most_s: f64) -> Option<Fit> {
        let ends = [start_s - most_s, start_s + most_s];
        let is_used = |frame: &TimedValue| ends.iter().all(|lag| self.track.at(frame.time_s + lag).is_some());
        let used: Vec<usize> = (0..self.values.len()).filter(|i| is_used(&self.values[*i])).collect();
        if used.len() < LEAST_FRAMES {
            return None;
        }
        let (mut lag_s, mut scale) = (start_s, Scale { value: self.deviation(), stamp_s: 0.0 });
        let mut weights = vec![1.0; used.len()];
        let mut steps = 0;
        loop {
            let solved = self.solve(&used, lag_s, &weights, scale.value)?;
            if steps < SETTLED {
                scale = Scale::of(&solved);
            }
            let step = solved.step().clamp(-0.5 * most_s, 0.5 * most_s);
            let next = (lag_s + step).clamp(ends[0], ends[1]);
            if steps >= MOST_STEPS || (steps > SETTLED && (next - lag_s).abs() < CONVERGED_S) {
                return Some(solved.fit(lag_s, scale, &weights, &used, self.values.len()));
            }
            lag_s = next;
            steps += 1;
            let weight = |(r, speed): (&f64, &f64)| {
                let own = scale.at(*speed);
                // The first weights are those of least absolute residuals, which do not depend
                // on the start.
                let alone = if steps < 5 { 1.0 / (r.abs() / own).max(0.1) } else { Biweight::of(*r, own).weight };
                alone * (scale.value / own.max(f64::MIN_POSITIVE)).powi(2)
            };
            weights = solved.residuals.iter().zip(&solved.speeds).map(weight).collect();
        }
    }

    /// Returns the best c and b at a lag, with the residuals and their derivative by the lag.
    fn solve(&self, used: &[usize], lag_s: f64, weights: &[f64], scale: f64) -> Option<Solved> {
        let n = used.len();
        let roots: Vec<f64> = weights.iter().map(|w| w.sqrt()).collect();
        let at: Vec<([f64; N], [f64; N])> =
            used.iter().map(|i| self.track.at(self.values[*i].time_s + lag_s)).collect::<Option<_>>()?;
        let values: Vec<f64> = used.iter().map(|i| self.values[*i].value).collect();
        let mut columns: Vec<Vec<f64>> = vec![roots.clone()];
        columns.extend((0..N).map(|k| at.iter().zip(&roots).map(|((f, _), root)| root * f[k]).collect()));
        let mut right: Vec<f64> = values.iter().zip(&roots).map(|(y, root)| root * y).collect();
        // The prior: a mm of each other number has about the effect of a mm of the first. Each
        // such number adds one row, weighted like a frame.
        let spread = |of: &mut dyn Iterator<Item = f64>| of.map(|x| x * x).sum::<f64>().sqrt();
        let middle = median(&mut values.clone());
        let gain = spread(&mut values.iter().zip(weights).map(|(y, w)| w * (y - middle)))
            / spread(&mut at.iter().zip(weights).map(|((f, _), w)| w * f[0]));
        let prior = if gain.is_finite() && gain > 0.0 { scale / gain } else { 0.0 };
        for (k, column) in columns.iter_mut().enumerate() {
            column.extend((2..=N).map(|row| if row == k { prior } else { 0.0 }));
        }
        right.resize(n + N.saturating_sub(1), 0.0);

        let mut triangle = vec![vec![0.0; N + 1]; N + 1];
        let mut along = vec![0.0; N + 1];
        for k in 0..=N {
            let before = dot(&columns[k], &columns[k]).sqrt();
            let (done, rest) = columns.split_at_mut(k);
            let column = &mut rest[0];
            // Orthogonalises twice, to remove rounding errors.
            for _ in 0..2 {
                for (j, other) in done.iter().enumerate() {
                    let share = dot(other, column);
                    triangle[j][k] += share;
                    take_off(column, share, other);
                }
            }
            let length = dot(column, column).sqrt();
            if length <= 1e-12 * before || length == 0.0 {
                // The column depends on the earlier ones and has no effect.
                column.iter_mut().for_each(|x| *x = 0.0);
                triangle[k][k] = 1.0;
                continue;
            }
            column.iter_mut().for_each(|x| *x /= length);
            triangle[k][k] = length;
            along[k] = dot(column, &right);
            take_off(&mut right, along[k], column);
        }
        let mut gains = along.clone();
        for k in (0..=N).rev() {
            for j in k + 1..=N {
                gains[k] -= triangle[k][j] * gains[j];
            }
            gains[k] /= triangle[k][k];
        }
        let mut change: Vec<f64> =
            at.iter().zip(&roots).map(|((_, slope), root)| root * dot(slope, &gains[1..])).collect();
        change.resize(right.len(), 0.0);
        for _ in 0..2 {
            for column in &columns {
                let share = dot(column, &change);
                take_off(&mut change, share, column);
            }
        }
        let speeds = at.iter().map(|(_, slope)| dot(slope, &gains[1..]).abs()).collect();
        let fitted = |(f, _): &([f64; N], [f64; N])| gains[0] + dot(f, &gains[1..]);
        let residuals = values.iter().zip(&at).map(|(y, at)| y - fitted(at)).collect();
        let own = dot(&change, &change);
        let leverage = (0..n)
            .map(|i| {
                columns.iter().map(|c| c[i] * c[i]).sum::<f64>()
                    + if own > 0.0 { change[i] * change[i] / own } else { 0.0 }
            })
            .collect();
        Some(Solved { residuals, speeds, weighted: right, change, leverage, gain: gains[1] })
    }
}

/// Noise model of the residuals: errors of the values and of the stamps.
#[derive(Debug, Clone, Copy)]
struct Scale {
    value: f64,
    stamp_s: f64,
}

impl Scale {
    /// Estimates both by comparing the slower half of the frames with the faster half.
    fn of(solved: &Solved) -> Self {
        let middle = median(&mut solved.speeds.clone());
        let half = |is_fast: bool| {
            let (mut residuals, speeds): (Vec<f64>, Vec<f64>) =
                solved.residuals.iter().zip(&solved.speeds).filter(|(_, speed)| (**speed > middle) == is_fast).unzip();
            let count = speeds.len().max(1) as f64;
            (deviation_about_zero(&mut residuals).powi(2), speeds.iter().map(|x| x * x).sum::<f64>() / count)
        };
        let ((slow, slowly), (fast, fastly)) = (half(false), half(true));
        let all = deviation_about_zero(&mut solved.residuals.clone());
        if !(fast > slow && fastly > slowly) {
            return Self { value: all, stamp_s: 0.0 };
        }
        let stamp = (fast - slow) / (fastly - slowly);
        // Subtracts the stamps' share from the slower frames' residuals.
        Self { value: (slow - stamp * slowly).max(0.2 * slow).sqrt(), stamp_s: stamp.sqrt() }
    }

    /// Returns the standard deviation of a frame at this speed.
    fn at(&self, speed: f64) -> f64 {
        self.value.hypot(self.stamp_s * speed)
    }
}

/// The best fit at a lag. `weighted` and `change` include √weight, and the rows of the prior
/// follow those of the frames.
struct Solved {
    residuals: Vec<f64>,
    /// Absolute rate of change of the value at each frame.
    speeds: Vec<f64>,
    weighted: Vec<f64>,
    change: Vec<f64>,
    leverage: Vec<f64>,
    gain: f64,
}

impl Solved {
    fn step(&self) -> f64 {
        let square = dot(&self.change, &self.change);
        if square > 0.0 { dot(&self.change, &self.weighted) / square } else { 0.0 }
    }

    fn fit(self, lag_s: f64, scale: Scale, weights: &[f64], used: &[usize], all: usize) -> Fit {
        let n = used.len();
        let own = |i: usize| self.weighted[i] * self.change[i] / (1.0 - self.leverage[i]).max(0.1).sqrt();
        let scores: Vec<f64> = (0..n).map(own).collect();
        let variance = variance_of_sum(&scores);
        // Change of the scores' sum with the lag. It is less than the weights suggest, because
        // growing residuals count for less.
        let (weight, slope) = (0..n)
            .map(|i| Biweight::of(self.residuals[i], scale.at(self.speeds[i])))
            .fold((0.0, 0.0), |(weight, slope), of| (weight + of.weight, slope + of.slope));
        let square = dot(&self.change, &self.change) * slope / weight;
        let se_s = if square > 0.0 { variance.sqrt() / square } else { f64::INFINITY };
        let alike: f64 = scores.iter().map(|s| s * s).sum();
        let mut residuals = vec![None; all];
        for (i, r) in used.iter().zip(&self.residuals) {
            residuals[*i] = Some(*r);
        }
        Fit {
            lag_s,
            se_s,
            gain: self.gain,
            scale: deviation_about_zero(&mut self.residuals.clone()),
            stamp_s: scale.stamp_s,
            outliers: weights.iter().filter(|w| **w == 0.0).count(),
            residuals,
            independent: if variance > 0.0 {
                n as f64 * (alike / variance).clamp(1.0 / n as f64, 1.0)
            } else {
                n as f64
            },
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn take_off(from: &mut [f64], share: f64, of: &[f64]) {
    from.iter_mut().zip(of).for_each(|(x, y)| *x -= share * y);
}

#[cfg(test)]
mod tests;
