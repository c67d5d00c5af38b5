//! Smoothed poses: a quadratic through the samples around a time, instead of a line between two.
//!
//! Positions, and rotations as rotation vectors from the nearest sample, are each fitted over a
//! window by local regression (Cleveland, J. Am. Stat. Assoc. 74, 1979), robust against single
//! outliers. A fit depends on nothing but the samples in reach, so that a replay repeats it.
//!
//! The window is the longest whose residuals the noise explains: a motion that the quadratic cannot
//! follow leaves larger ones. The noise is that of the samples of the last [`NOISE_NS`], by their
//! third differences ([`noise`]). Only noise that is white is averaged out. Where it is not, or
//! where the samples are too few, there is no smoothed pose, and the reason is given.

use std::fmt;

use glam::DVec3;
use serde::Serialize;

use sonoweave_core::rotation::{of_rotation_vector, rotation_vector};

use crate::history::{PoseHistory, PoseSample, Rigid};
use regression::{Fit, Value};

pub mod noise;
pub mod recorded;
mod regression;

pub use noise::FastNoise;

/// The noise is estimated over this time before the window's end, ns.
pub const NOISE_NS: i64 = 4_000_000_000;
/// Lengths of windows that are tried, in the longest.
const LENGTHS: [f64; 7] = [1.0, 0.707, 0.5, 0.354, 0.25, 0.177, 0.125];
/// Least number of samples in a window.
const LEAST: usize = 7;
/// Least number of third differences for an estimate of the noise: its standard error is 25 %.
const LEAST_DIFFERENCES: usize = 16;
/// Residuals may exceed the noise by this many standard errors.
const EXCESS: f64 = 5.0;
/// Successive third differences with a correlation above this are not of white noise (−0.75), nor
/// of noise that smoothing lowers.
const LEAST_WHITE: f64 = -0.5;
/// Variances below these are rounding: (0.1 µm)² and (0.1 µrad)².
const LEAST_VARIANCES: [f64; 2] = [1e-8, 1e-14];

/// Settings of smoothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Smoothing {
    /// Half of the longest window, ns.
    pub half_width_ns: i64,
    /// Samples up to this long after the time are used, ns. A frame waits for them.
    pub ahead_ns: i64,
}

impl Smoothing {
    /// Returns smoothing by all samples of the window, as for recordings.
    pub fn offline(half_width_ns: i64) -> Self {
        Self { half_width_ns, ahead_ns: half_width_ns }
    }

    /// Time up to which samples are used, ns.
    pub(crate) fn until_ns(&self, time_ns: i64) -> i64 {
        time_ns.saturating_add(self.ahead_ns.min(self.half_width_ns))
    }
}

/// A smoothed pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Smoothed {
    /// The pose.
    pub pose: Rigid,
    /// Standard error of the position along an axis, mm, if the noise is white.
    pub position_se_mm: f64,
    /// Standard error of the rotation about an axis, rad, if the noise is white.
    pub rotation_se_rad: f64,
    /// Half of the windows of position and rotation, ns.
    pub half_widths_ns: [i64; 2],
}

impl Smoothed {
    /// Variance of a point at a distance from the sensor, mm², the sum along all axes. A rotation
    /// about the line to the point does not move it.
    pub(crate) fn variance_mm2(&self, lever_mm: f64) -> f64 {
        3.0 * self.position_se_mm.powi(2) + 2.0 * (lever_mm * self.rotation_se_rad).powi(2)
    }
}

/// Reason why a pose is not smoothed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "why")]
pub enum NotSmoothed {
    /// Too few samples around the time, repeats not counted.
    FewSamples {
        /// Their number in the longest window.
        samples: usize,
    },
    /// The noise is not white.
    NotWhite {
        /// Correlation of successive third differences.
        lag_1: f64,
    },
    /// The motion is too fast for the shortest window.
    TooFast,
}

impl NotSmoothed {
    /// Name of the reason, for counts.
    pub fn name(&self) -> &'static str {
        match self {
            Self::FewSamples { .. } => "few samples",
            Self::NotWhite { .. } => "noise not white",
            Self::TooFast => "motion too fast",
        }
    }
}

impl fmt::Display for NotSmoothed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FewSamples { samples } => {
                write!(f, "only {samples} different poses lie in the window")
            }
            Self::NotWhite { lag_1 } => write!(
                f,
                "the noise is not white: its third differences correlate by {lag_1:.2}, and those of white noise by \
                −0.75"
            ),
            Self::TooFast => write!(f, "the sensor moves too fast for the shortest window"),
        }
    }
}

/// Returns the smoothed pose at a time for which the history has samples on both sides. It depends
/// on those up to [`Smoothing::ahead_ns`] after the time only.
///
/// # Errors
/// [`NotSmoothed`]: the reason why there is none.
pub fn smoothed(history: &PoseHistory, time_ns: i64, settings: &Smoothing) -> Result<Smoothed, NotSmoothed> {
    let half_ns = settings.half_width_ns;
    let from_ns = time_ns.saturating_sub(half_ns.max(NOISE_NS));
    let samples = history.distinct(from_ns, settings.until_ns(time_ns));
    let first = samples.partition_point(|sample| sample.time_ns <= time_ns.saturating_sub(half_ns));
    let window = &samples[first..];
    let few = NotSmoothed::FewSamples { samples: window.len() };
    let nearest = window.iter().min_by_key(|sample| sample.time_ns.abs_diff(time_ns)).ok_or(few)?;
    let back = nearest.pose.rotation.conjugate();
    let components = |sample: &PoseSample| {
        [sample.pose.position_mm - nearest.pose.position_mm, rotation_vector(back * sample.pose.rotation)]
    };
    let at = |sample: &PoseSample| (sample.time_ns - time_ns) as f64 / half_ns as f64;
    let noise = fast_noise(&samples).ok_or(few)?;
    let fitted = |kind: usize| {
        let FastNoise { variance, lag_1 } = noise[kind];
        let least = LEAST_VARIANCES[kind];
        if variance > least && lag_1 > LEAST_WHITE {
            return Err(NotSmoothed::NotWhite { lag_1 });
        }
        let values: Vec<Value> =
            window.iter().map(|sample| Value { at: at(sample), vector: components(sample)[kind] }).collect();
        longest(&values, variance.max(least), least).map_err(|none| none.unwrap_or(few))
    };
    let ((position, position_length), (rotation, rotation_length)) = (fitted(0)?, fitted(1)?);
    let pose = Rigid {
        rotation: (nearest.pose.rotation * of_rotation_vector(rotation.vector)).normalize(),
        position_mm: nearest.pose.position_mm + position.vector,
    };
    let error = |fit: &Fit, kind: usize| (fit.share * fit.variance.max(noise[kind].variance)).sqrt();
    Ok(Smoothed {
        pose,
        position_se_mm: error(&position, 0),
        rotation_se_rad: error(&rotation, 1),
        half_widths_ns: [position_length, rotation_length].map(|length| (length * half_ns as f64) as i64),
    })
}

/// Fits over the longest window whose residuals the noise explains. Returns the fit, and the
/// window's length in the longest. `Err(None)` if there are too few values in the longest.
fn longest(values: &[Value], variance: f64, least: f64) -> Result<(Fit, f64), Option<NotSmoothed>> {
    let mut within = Vec::with_capacity(values.len());
    for (n, length) in LENGTHS.into_iter().enumerate() {
        within.clear();
        within.extend(
            values
                .iter()
                .filter(|value| value.at.abs() < length)
                .map(|value| Value { at: value.at / length, ..*value }),
        );
        let fit = if within.len() < LEAST { None } else { regression::fit(&within, least) };
        let Some(fit) = fit else { return Err((n > 0).then_some(NotSmoothed::TooFast)) };
        // Each value has three components.
        let standard_error = (2.0 / (3.0 * within.len() as f64)).sqrt();
        if fit.variance <= variance * (1.0 + EXCESS * standard_error) {
            return Ok((fit, length));
        }
    }
    Err(Some(NotSmoothed::TooFast))
}

/// Returns the number of usable poses of a history, repeats left out, and the noise of their
/// positions (mm²) and rotations (rad²) by their third differences; `None` if they are too few.
pub fn noise_of(history: &PoseHistory) -> Option<(usize, [FastNoise; 2])> {
    let kept = history.distinct(i64::MIN, i64::MAX);
    Some((kept.len(), fast_noise(&kept)?))
}

/// Estimates the noise from distinct poses in the order of time; `None` if they are too few.
fn fast_noise(samples: &[&PoseSample]) -> Option<[FastNoise; 2]> {
    if samples.len() < LEAST_DIFFERENCES + 3 {
        return None;
    }
    let steps = samples.windows(2).map(|pair| {
        let [before, after] = [&pair[0].pose, &pair[1].pose];
        [after.position_mm - before.position_mm, rotation_vector(before.rotation.conjugate() * after.rotation)]
    });
    let steps: Vec<[DVec3; 2]> = steps.collect();
    let thirds = |kind: usize| -> Vec<DVec3> {
        steps.windows(3).map(|three| three[2][kind] - 2.0 * three[1][kind] + three[0][kind]).collect()
    };
    Some([noise::of_third_differences(&thirds(0))?, noise::of_third_differences(&thirds(1))?])
}

#[cfg(test)]
mod tests;
