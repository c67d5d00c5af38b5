//! Account of the smoothing of frames' poses.

use std::collections::BTreeMap;

use serde::Serialize;

use sync::history::PoseHistory;
use sync::pairing::timed::SmoothingEffect;
use sync::smoothing::noise_of;

/// Frames between two estimates of the sensors' noise.
const NOISE_EVERY: u64 = 128;
/// Least number of poses for a word about the noise: the standard error of the correlation is then
/// below 0.02.
const LEAST_POSES: usize = 1000;
/// Noise with a correlation above this is not white. Noise of an autoregressive process with a
/// coefficient of 0.5 has −0.68.
const LEAST_WHITE: f64 = -0.7;

/// Frames by the smoothing of their poses, and the sensors' noise.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SmoothingStatus {
    /// Frames whose poses were smoothed.
    pub smoothed: u64,
    /// Frames with a pose that was interpolated, by the reason.
    pub interpolated: BTreeMap<&'static str, u64>,
    /// Distance of the image's corners from their interpolated places, mm: the root mean square
    /// over the smoothed frames of the largest of the four.
    pub moved_rms_mm: f64,
    /// The largest such distance, mm.
    pub moved_most_mm: f64,
    /// Root mean square error of the corners, mm, if the noise is white: the same mean.
    pub error_rms_mm: f64,
    /// Noise of the sensors while they moved, by the last estimate.
    pub sensors: Vec<SensorNoise>,
}

/// Noise of a moving sensor.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SensorNoise {
    /// The moving frame and the one in which it is tracked.
    pub sensor: [String; 2],
    /// Standard deviation of the position along an axis, mm.
    pub position_mm: f64,
    /// Standard deviation of the rotation about an axis, degrees.
    pub rotation_deg: f64,
    /// Correlations of successive third differences of position and rotation; −0.75 for white
    /// noise.
    pub lag_1: [f64; 2],
    /// Whether the noise is white, as far as its correlations tell.
    pub is_white: bool,
}

impl SmoothingStatus {
    /// Counts a frame. Returns whether the sensors' noise is to be estimated again.
    pub(super) fn count(&mut self, effect: &SmoothingEffect) -> bool {
        match effect.not_smoothed {
            Some(why) => *self.interpolated.entry(why.name()).or_default() += 1,
            None => {
                let before = self.smoothed as f64;
                self.smoothed += 1;
                let mean = |rms: f64, mm: f64| ((rms * rms * before + mm * mm) / (before + 1.0)).sqrt();
                self.moved_rms_mm = mean(self.moved_rms_mm, effect.moved_mm);
                self.error_rms_mm = mean(self.error_rms_mm, effect.error_mm);
                self.moved_most_mm = self.moved_most_mm.max(effect.moved_mm);
            }
        }
        let frames = self.smoothed + self.interpolated.values().sum::<u64>();
        frames.is_multiple_of(NOISE_EVERY)
    }
}

impl SensorNoise {
    /// Estimates the noise of a source's poses; `None` if they are too few.
    pub(super) fn of(sensor: &[String; 2], history: &PoseHistory) -> Option<Self> {
        let (poses, [position, rotation]) = noise_of(history)?;
        if poses < LEAST_POSES {
            return None;
        }
        let lag_1 = [position.lag_1, rotation.lag_1];
        Some(Self {
            sensor: sensor.clone(),
            position_mm: position.variance.sqrt(),
            rotation_deg: rotation.variance.sqrt().to_degrees(),
            lag_1,
            is_white: lag_1.iter().all(|lag_1| *lag_1 < LEAST_WHITE),
        })
    }
}
