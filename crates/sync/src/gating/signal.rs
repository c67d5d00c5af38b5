//! A displacement over time, at even times, and its parts by their frequency.

use glam::DVec3;

/// Distance of even times, s.
const STEP_S: f64 = 0.05;
/// Longest gap between samples that is interpolated, s.
const MOST_GAP_S: f64 = 1.0;
/// Standard deviation of the mean that leaves the noise of samples out, s.
const SMOOTH_S: f64 = 0.15;
/// Standard deviation of the weights of the line that is slower than breathing, s.
const SLOW_S: f64 = 3.0;
/// Distance at which weights end, in standard deviations.
const REACH: f64 = 4.0;
/// Rounds by which the axis of the largest variance is found.
const ROUNDS: usize = 64;

/// A body's displacement over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Signal {
    /// Times, s, ascending.
    times_s: Vec<f64>,
    /// Displacements, mm.
    values_mm: Vec<f64>,
    /// Whether it is a sum of shifts, which wanders.
    is_summed: bool,
}

/// A signal at even times.
pub(super) struct Grid {
    begin_s: f64,
    values: Vec<f64>,
}

impl Signal {
    /// Uses the position of a sensor, mm, along the axis in which it moves most as fast as a body
    /// breathes. Times, s, ascend.
    pub fn of_positions(samples: &[(f64, DVec3)]) -> Self {
        let times_s: Vec<f64> = samples.iter().map(|(time_s, _)| *time_s).collect();
        let along = |axis: DVec3| Self {
            times_s: times_s.clone(),
            values_mm: samples.iter().map(|(_, position_mm)| position_mm.dot(axis)).collect(),
            is_summed: false,
        };
        let bands = DVec3::AXES.map(|axis| along(axis).grid().band());
        let at = |index: usize| DVec3::from_array(bands.each_ref().map(|band| band[index]));
        let mut axis = DVec3::ONE;
        for _ in 0..ROUNDS {
            let turned = (0..bands[0].len()).map(|index| at(index) * at(index).dot(axis)).sum::<DVec3>();
            axis = turned.try_normalize().unwrap_or(DVec3::X);
        }
        along(axis)
    }

    /// Uses shifts, mm, each from the time before it to its own, which are summed. Times, s,
    /// ascend.
    pub fn of_shifts(shifts: &[(f64, f64)]) -> Self {
        let mut sum = 0.0;
        let (times_s, values_mm) = shifts
            .iter()
            .map(|(time_s, mm)| {
                sum += mm;
                (*time_s, sum)
            })
            .unzip();
        Self { times_s, values_mm, is_summed: true }
    }

    pub(super) fn is_summed(&self) -> bool {
        self.is_summed
    }

    /// Returns it at even times: means of the samples around each, interpolated between them.
    /// Without gaps of more than a second: the longest part of the signal that has none.
    pub(super) fn grid(&self) -> Grid {
        let mut part = 0..0;
        let mut begin = 0;
        for at in 0..self.times_s.len() {
            if at > 0 && self.times_s[at] - self.times_s[at - 1] > MOST_GAP_S {
                begin = at;
            }
            if at - begin >= part.len() {
                part = begin..at + 1;
            }
        }
        let (times_s, values) = (&self.times_s[part.clone()], &self.values_mm[part]);
        let (Some(first), Some(last)) = (times_s.first(), times_s.last()) else {
            return Grid { begin_s: 0.0, values: Vec::new() };
        };
        let count = ((last - first) / STEP_S) as usize + 1;
        let mut sums = vec![(0.0, 0.0); count];
        for (time_s, value) in times_s.iter().zip(values) {
            let place = (((time_s - first) / STEP_S).round() as usize).min(count - 1);
            sums[place].0 += value;
            sums[place].1 += 1.0;
        }
        let known: Vec<(usize, f64)> =
            sums.iter().enumerate().filter(|(_, (_, n))| *n > 0.0).map(|(at, (sum, n))| (at, sum / n)).collect();
        let mut next = 0;
        let values = (0..count).map(|at| {
            while known[next].0 < at {
                next += 1;
            }
            let (right, after) = known[next];
            let (left, before) = known[next.saturating_sub(usize::from(right != at))];
            if right == left { after } else { before + (after - before) * (at - left) as f64 / (right - left) as f64 }
        });
        Grid { begin_s: *first, values: values.collect() }
    }
}

impl Grid {
    pub(super) fn step_s(&self) -> f64 {
        STEP_S
    }

    /// Returns its length, s.
    pub(super) fn seconds(&self) -> f64 {
        self.values.len() as f64 * STEP_S
    }

    /// Returns it without the noise of samples.
    pub(super) fn smooth(&self) -> Vec<f64> {
        lines(&self.values, SMOOTH_S)
    }

    /// Returns its part as fast as breathing: without noise, and without what is slower.
    pub(super) fn band(&self) -> Vec<f64> {
        let smooth = self.smooth();
        lines(&smooth, SLOW_S).iter().zip(&smooth).map(|(slow, smooth)| smooth - slow).collect()
    }

    /// Interpolates values at this grid's times to another time, s. Beyond the ends it returns
    /// NaN: nothing is known there.
    pub(super) fn at(&self, values: &[f64], time_s: f64) -> f64 {
        let place = (time_s - self.begin_s) / STEP_S;
        let before = place.floor();
        if !(before >= 0.0) {
            return f64::NAN;
        }
        let index = before as usize;
        match (values.get(index), values.get(index + 1)) {
            (Some(left), Some(right)) => left + (right - left) * (place - before),
            (Some(left), None) if place == before => *left,
            _ => f64::NAN,
        }
    }
}

/// Returns at each place the value of the line through the values around it, with Gaussian weights.
/// At an end, a mean would lag behind a slope.
fn lines(values: &[f64], sigma_s: f64) -> Vec<f64> {
    let sigma = sigma_s / STEP_S;
    let reach = (REACH * sigma) as usize;
    let weights: Vec<f64> = (0..=reach).map(|distance| libm::exp(-0.5 * (distance as f64 / sigma).powi(2))).collect();
    let line = |at: usize| {
        let begin = at.saturating_sub(reach);
        let [mut s0, mut s1, mut s2, mut b0, mut b1] = [0.0; 5];
        for (place, value) in (begin..).zip(&values[begin..values.len().min(at + reach + 1)]) {
            let distance = place as f64 - at as f64;
            let weight = weights[place.abs_diff(at)];
            s0 += weight;
            s1 += weight * distance;
            s2 += weight * distance * distance;
            b0 += weight * value;
            b1 += weight * distance * value;
        }
        let determinant = s0 * s2 - s1 * s1;
        if determinant > 0.0 { (s2 * b0 - s1 * b1) / determinant } else { b0 / s0 }
    };
    (0..values.len()).map(line).collect()
}
