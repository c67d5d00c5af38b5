//! Estimates the lag at which the slices of a scan agree best along their intersections.
//!
//! Two slices whose planes cross within the data show the same line of the body. Poses of a
//! wrong moment displace the line in both slices, by the probe's motion meanwhile. The
//! displacements differ, because the slices were acquired at different motions. At the true lag
//! the grey values along both lines are therefore most alike. No phantom is needed.
//!
//! The measure of agreement is n·ln(1 − r²), with r the correlation of the grey values along
//! the line. It is the likelihood of one line being the other with unknown brightness, contrast
//! and noise. The sum over all crossings has its minimum at the lag. The standard error is a
//! jackknife over stretches of time, because the slices of one stretch are not independent.

use glam::DAffine3;

use crate::error::{CalibrationError, LatencyError};
use crate::slices::Slices;
use crate::statistics::median;

/// A lag and its accuracy.
#[derive(Debug, Clone, PartialEq)]
pub struct Agreement {
    /// Lag, s; above 0 if the tracker lags the video.
    pub lag_s: f64,
    /// Its standard error, s.
    pub se_s: f64,
    /// Number of compared pairs of slices.
    pub crossings: usize,
    /// Number of slices in these pairs.
    pub slices: usize,
    /// Median of the correlations at the lag.
    pub correlation: f64,
    /// The same at zero lag.
    pub correlation_at_zero: f64,
    /// Coarse search: each lag with its cost.
    pub curve: Vec<(f64, f64)>,
}

/// Minimum length of an intersection within both images, as a share of the image's smaller
/// side.
const LEAST_LENGTH: f64 = 0.2;
/// Minimum number of crossings for an estimate.
const LEAST_CROSSINGS: usize = 40;
const MOST_CROSSINGS: usize = 3000;
/// Maximum number of crossings of one slice, because these are not independent.
const MOST_OF_ONE: usize = 30;
/// Number of points along a line.
const POINTS: usize = 64;
/// Minimum number of points of a line within the data of both images.
const LEAST_POINTS: usize = 16;
/// Number of stretches of time for the jackknife.
const STRETCHES: usize = 12;
const COARSE_S: f64 = 0.01;
/// Lags on either side of the best one used to find the minimum; half as many in the check.
const FINE: i32 = 4;
const DISTINCT: f64 = 3.3;

impl Slices {
    /// Selects useful crossings: long ones of slices acquired at different motions.
    fn crossings(&self, range_s: f64) -> Result<Vec<[usize; 2]>, LatencyError> {
        let n = self.pixels.len();
        let placed: Vec<Option<DAffine3>> = (0..n)
            .map(|i| {
                // The slice must lie between poses at every lag.
                self.placed(i, -range_s)?;
                self.placed(i, range_s)?;
                self.placed(i, 0.0)
            })
            .collect();
        let m = self.probe_from_pixel.matrix3;
        let sides = [0, 1].map(|axis| (self.bounds[axis][1] - self.bounds[axis][0]) * m.col(axis).length());
        let least_mm = LEAST_LENGTH * sides[0].min(sides[1]);
        let mut found = Vec::new();
        for i in 0..n {
            for j in i + 1..n {
                let (Some(a), Some(b)) = (&placed[i], &placed[j]) else { continue };
                let Some([from, to]) = self.line([a, b]) else { continue };
                let length = (to - from).length();
                if length < least_mm {
                    continue;
                }
                let middle = 0.5 * (from + to);
                let velocity = |slice: usize| {
                    let time = self.pixels[slice].0;
                    let place = self.poses.at(time)?.inverse().transform_point3(middle);
                    self.poses.velocity(time, place)
                };
                let (Some(v), Some(w)) = (velocity(i), velocity(j)) else { continue };
                found.push(((v - w).length(), length, [i, j]));
            }
        }
        if found.len() < LEAST_CROSSINGS {
            return Err(LatencyError::FewCrossings { slices: n, crossings: found.len(), least: LEAST_CROSSINGS });
        }
        // The most informative first; a stable sort makes the choice the same on every machine.
        found.sort_by(|a, b| (b.0 * b.1).total_cmp(&(a.0 * a.1)));
        let mut of_one = vec![0; n];
        let mut chosen = Vec::new();
        let mut speeds = Vec::new();
        for (speed, _, pair) in found {
            if chosen.len() < MOST_CROSSINGS && pair.iter().all(|slice| of_one[*slice] < MOST_OF_ONE) {
                pair.iter().for_each(|slice| of_one[*slice] += 1);
                chosen.push(pair);
                speeds.push(speed);
            }
        }
        let (mm, least_mm) = (median(&mut speeds) * range_s, self.pixel_mm());
        if chosen.len() < LEAST_CROSSINGS {
            return Err(LatencyError::FewCrossings { slices: n, crossings: chosen.len(), least: LEAST_CROSSINGS });
        }
        if !(mm > least_mm) {
            return Err(LatencyError::TooSlow { mm, least_mm, range_s });
        }
        Ok(chosen)
    }

    /// Returns the correlation of two slices along their intersection and the number of points;
    /// `None` if they no longer cross.
    fn alike(&self, [i, j]: [usize; 2], placed: [&DAffine3; 2]) -> Option<(f64, usize)> {
        let [from, to] = self.line(placed)?;
        let back = placed.map(DAffine3::inverse);
        let ends = back.map(|back| [from, to].map(|end| back.transform_point3(end).truncate()));
        let mut sums = [0.0; 5];
        let mut count = 0;
        for k in 0..POINTS {
            let share = (k as f64 + 0.5) / POINTS as f64;
            let [x, y] = ends.map(|[a, b]| a.lerp(b, share));
            let (Some(x), Some(y)) = (self.grey(&self.pixels[i].1, x), self.grey(&self.pixels[j].1, y)) else {
                continue;
            };
            count += 1;
            for (sum, term) in sums.iter_mut().zip([x, y, x * x, y * y, x * y]) {
                *sum += term;
            }
        }
        if count < LEAST_POINTS {
            return None;
        }
        let [x, y, xx, yy, xy] = sums.map(|sum| sum / count as f64);
        let (xx, yy, xy) = (xx - x * x, yy - y * y, xy - x * y);
        // Grey values that vary by less than their rounding count as constant.
        let correlation = if xx > 0.1 && yy > 0.1 { xy / (xx * yy).sqrt() } else { 0.0 };
        Some((correlation, count))
    }

    /// Returns the cost and the correlation of each crossing at a lag.
    fn costs(&self, crossings: &[[usize; 2]], lag_s: f64) -> Vec<(f64, f64)> {
        let placed: Vec<Option<DAffine3>> = (0..self.pixels.len()).map(|i| self.placed(i, lag_s)).collect();
        let cost = |pair: &[usize; 2]| {
            let (Some(a), Some(b)) = (&placed[pair[0]], &placed[pair[1]]) else { return (0.0, 0.0) };
            let Some((r, count)) = self.alike(*pair, [a, b]) else { return (0.0, 0.0) };
            // A negative correlation is no agreement.
            let alike = r.max(0.0);
            (count as f64 * (1.0 - alike * alike).max(1e-6).ln(), r)
        };
        crossings.iter().map(cost).collect()
    }

    /// Returns the lag within ±range at which slices agree best along their intersections.
    ///
    /// # Errors
    /// [`CalibrationError::Latency`] if the slices determine no lag.
    pub fn lag(&self, range_s: f64) -> Result<Agreement, CalibrationError> {
        let crossings = self.crossings(range_s)?;
        let steps = (range_s / COARSE_S).ceil().max(3.0) as i32;
        let lags: Vec<f64> = (-steps..=steps).map(|k| range_s * f64::from(k) / f64::from(steps)).collect();
        let stretches = self.stretches();
        let coarse: Vec<Vec<f64>> =
            lags.iter().map(|lag| self.costs(&crossings, *lag).into_iter().map(|cost| cost.0).collect()).collect();
        let totals: Vec<f64> = coarse.iter().map(|costs| costs.iter().sum()).collect();
        let curve: Vec<(f64, f64)> = lags.iter().copied().zip(totals.iter().copied()).collect();
        let Some(best) = (0..lags.len()).min_by(|a, b| totals[*a].total_cmp(&totals[*b])) else {
            return Err(LatencyError::SlicesUnrelated.into());
        };
        if best == 0 || best + 1 == lags.len() {
            return Err(LatencyError::AtEdge { lag_s: lags[best], range_s }.into());
        }
        // The best lag must beat distant ones by more than the stretches of the scan vary.
        let sure = |other: &[f64]| {
            let mut by_stretch = [0.0; STRETCHES];
            for ((pair, own), other) in crossings.iter().zip(&coarse[best]).zip(other) {
                pair.iter().for_each(|slice| by_stretch[stretches[*slice]] += 0.5 * (other - own));
            }
            let sum: f64 = by_stretch.iter().sum();
            let mean = sum / STRETCHES as f64;
            let spread = by_stretch.iter().map(|x| (x - mean).powi(2)).sum::<f64>() * STRETCHES as f64
                / (STRETCHES as f64 - 1.0);
            sum > DISTINCT * spread.sqrt()
        };
        let middle: Vec<f64> = (0..crossings.len())
            .map(|k| coarse.iter().map(|costs| costs[k]).sum::<f64>() / coarse.len() as f64)
            .collect();
        if !sure(&middle) {
            return Err(LatencyError::SlicesUnrelated.into());
        }
        let is_minimum = |k: usize| totals[k] < totals[k - 1] && totals[k] <= totals[k + 1];
        let rivals = (1..lags.len() - 1).filter(|k| k.abs_diff(best) > 2 && is_minimum(*k));
        if let Some(rival) = rivals.min_by(|a, b| totals[*a].total_cmp(&totals[*b]))
            && !sure(&coarse[rival])
        {
            return Err(LatencyError::SlicesAmbiguous { lags_s: [lags[best], lags[rival]] }.into());
        }
        let (lag_s, se_s) = self.refine(&crossings, &stretches, lags[best]);
        let correlation =
            |lag: f64| median(&mut self.costs(&crossings, lag).into_iter().map(|cost| cost.1).collect::<Vec<_>>());
        let mut taking_part: Vec<usize> = crossings.iter().flatten().copied().collect();
        taking_part.sort_unstable();
        taking_part.dedup();
        Ok(Agreement {
            lag_s,
            se_s,
            crossings: crossings.len(),
            slices: taking_part.len(),
            correlation: correlation(lag_s),
            correlation_at_zero: correlation(0.0),
            curve,
        })
    }

    /// Fits a parabola to the costs at lags about a start, and recentres it at the minimum.
    /// Returns the minimum and its jackknife standard error.
    fn refine(&self, crossings: &[[usize; 2]], stretches: &[usize], start_s: f64) -> (f64, f64) {
        let step_s = 0.5 * COARSE_S;
        let mut middle_s = start_s;
        for last in [false, false, true] {
            let offsets: Vec<f64> = (-FINE..=FINE).map(|k| step_s * f64::from(k)).collect();
            let costs: Vec<Vec<f64>> = offsets
                .iter()
                .map(|off| self.costs(crossings, middle_s + off).into_iter().map(|cost| cost.0).collect())
                .collect();
            let without = |left_out: Option<usize>| {
                let counts = |pair: &[usize; 2]| pair.iter().all(|slice| Some(stretches[*slice]) != left_out);
                let sum = |costs: &Vec<f64>| {
                    crossings.iter().zip(costs).filter(|(pair, _)| counts(pair)).map(|(_, cost)| cost).sum()
                };
                vertex(&offsets, &costs.iter().map(sum).collect::<Vec<f64>>())
            };
            let at = without(None).clamp(offsets[0], -offsets[0]);
            if last {
                let others: Vec<f64> = (0..STRETCHES).map(|stretch| without(Some(stretch))).collect();
                let count = others.len() as f64;
                let mean = others.iter().sum::<f64>() / count;
                let spread = others.iter().map(|x| (x - mean).powi(2)).sum::<f64>() * (count - 1.0) / count;
                // The difference from a narrower parabola's minimum adds to the uncertainty.
                let half = (FINE / 2) as usize;
                let inner = half..offsets.len() - half;
                let sums: Vec<f64> = costs[inner.clone()].iter().map(|costs| costs.iter().sum()).collect();
                return (middle_s + at, spread.sqrt().hypot(vertex(&offsets[inner], &sums) - at));
            }
            middle_s += at;
        }
        unreachable!("the last round returns")
    }

    /// Returns the stretch of time of each slice; all stretches have equally many slices.
    fn stretches(&self) -> Vec<usize> {
        let n = self.pixels.len();
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|a, b| self.pixels[*a].0.total_cmp(&self.pixels[*b].0));
        let mut stretches = vec![0; n];
        for (rank, slice) in order.into_iter().enumerate() {
            stretches[slice] = rank * STRETCHES / n;
        }
        stretches
    }
}

/// Returns the minimum of the parabola fitted to values at evenly spaced places about 0.
/// Without a minimum, returns the lower end.
fn vertex(places: &[f64], values: &[f64]) -> f64 {
    let n = places.len() as f64;
    let square: f64 = places.iter().map(|x| x * x).sum::<f64>();
    let fourth: f64 = places.iter().map(|x| x.powi(4)).sum::<f64>();
    let sum = |power: i32| places.iter().zip(values).map(|(x, y)| x.powi(power) * y).sum::<f64>();
    let slope = sum(1) / square;
    let bend = (n * sum(2) - square * sum(0)) / (n * fourth - square * square);
    let end = places.last().copied().unwrap_or(0.0);
    if bend > 0.0 { (-0.5 * slope / bend).clamp(-end, end) } else { -end * slope.signum() }
}

#[cfg(test)]
mod tests;
