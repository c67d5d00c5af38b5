//! Account of the smoothing of frames' poses.

use std::collections::BTreeMap;

use serde::Serialize;

use sync::pairing::smoothed::SmoothingEffect;
use sync::smoothing::{FastNoise, Smoothing};

/// Frames between two estimates of the sensors' noise.
const NOISE_EVERY: u64 = 128;
/// Correlation of successive third differences of white noise.
const WHITE: f64 = -0.75;
/// Noise with a correlation of this much more is not white. Noise of an autoregressive process with
/// a coefficient of 0.5 has −0.68.
const LEAST_EXCESS: f64 = 0.05;

/// Frames by the smoothing of their poses, and the sensors' noise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SmoothingStatus {
    /// Time before and after a frame over which poses are smoothed, ms.
    pub half_width_ms: f64,
    /// The part of the time after it that is used, ms.
    pub ahead_ms: f64,
    /// Frames whose poses were smoothed.
    pub smoothed: u64,
    /// Frames with a pose that was not smoothed, by the reason.
    pub not_smoothed: BTreeMap<&'static str, u64>,
    /// Distance by which the image's corners moved, mm: the root mean square over the smoothed
    /// frames of the largest of the four.
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
    /// Returns the account before the first frame.
    pub(crate) fn new(settings: Smoothing) -> Self {
        let ms = |ns: i64| ns as f64 * 1e-6;
        Self {
            half_width_ms: ms(settings.half_width_ns),
            ahead_ms: ms(settings.ahead_ns.min(settings.half_width_ns)),
            smoothed: 0,
            not_smoothed: BTreeMap::new(),
            moved_rms_mm: 0.0,
            moved_most_mm: 0.0,
            error_rms_mm: 0.0,
            sensors: Vec::new(),
        }
    }

    /// Counts a frame. Returns whether the sensors' noise is to be estimated again.
    pub(crate) fn count(&mut self, effect: &SmoothingEffect) -> bool {
        match effect.not_smoothed {
            Some(why) => *self.not_smoothed.entry(why.name()).or_default() += 1,
            None => {
                let before = self.smoothed as f64;
                self.smoothed += 1;
                let mean = |rms: f64, mm: f64| ((rms * rms * before + mm * mm) / (before + 1.0)).sqrt();
                self.moved_rms_mm = mean(self.moved_rms_mm, effect.moved_mm);
                self.error_rms_mm = mean(self.error_rms_mm, effect.error_mm);
                self.moved_most_mm = self.moved_most_mm.max(effect.moved_mm);
            }
        }
        let frames = self.smoothed + self.not_smoothed.values().sum::<u64>();
        frames.is_multiple_of(NOISE_EVERY)
    }

    /// Adds the account of another recording in the same volume. The sensors' noise is then that of
    /// all.
    pub(crate) fn add(&mut self, other: Self) {
        let [own, more] = [self.smoothed, other.smoothed].map(|frames| frames as f64);
        let mean = |a: f64, b: f64| ((a * a * own + b * b * more) / (own + more).max(1.0)).sqrt();
        self.moved_rms_mm = mean(self.moved_rms_mm, other.moved_rms_mm);
        self.error_rms_mm = mean(self.error_rms_mm, other.error_rms_mm);
        self.moved_most_mm = self.moved_most_mm.max(other.moved_most_mm);
        self.smoothed += other.smoothed;
        for (why, frames) in other.not_smoothed {
            *self.not_smoothed.entry(why).or_default() += frames;
        }
        self.sensors.extend(other.sensors);
    }

    /// Returns the settings and the frames' numbers in a few words.
    pub fn words(&self) -> String {
        let frames = self.smoothed + self.not_smoothed.values().sum::<u64>();
        let Self { half_width_ms, ahead_ms, smoothed, .. } = self;
        format!("{half_width_ms} ms before and {ahead_ms} ms after a frame; {smoothed} of {frames} frames")
    }
}

impl SensorNoise {
    /// Returns the noise of a sensor from the number of its poses and their noise, mm² and rad²;
    /// `None` if they are too few.
    pub(crate) fn of(sensor: [&str; 2], found: Option<(usize, [FastNoise; 2])>) -> Option<Self> {
        let (poses, [position, rotation]) = found?;
        let lag_1 = [position.lag_1, rotation.lag_1];
        // Three standard errors of the correlation over three axes.
        let excess = (3.0 * (0.5 / poses as f64).sqrt()).max(LEAST_EXCESS);
        Some(Self {
            sensor: sensor.map(str::to_owned),
            position_mm: position.variance.sqrt(),
            rotation_deg: rotation.variance.sqrt().to_degrees(),
            lag_1,
            is_white: lag_1.iter().all(|lag_1| *lag_1 <= WHITE + excess),
        })
    }
}

#[cfg(test)]
mod tests {
    use sonoweave_core::frames::Transform;
    use sync::smoothing::NotSmoothed;

    use super::*;

    #[test]
    fn noise_is_white_within_three_standard_errors() {
        let is_white = |poses: usize, lag_1: f64| {
            let [position, rotation] = [lag_1, WHITE].map(|lag_1| FastNoise { variance: 0.09, lag_1 });
            let found = SensorNoise::of(["Probe", "Tracker"], Some((poses, [position, rotation]))).unwrap();
            assert!((found.position_mm - 0.3).abs() < 1e-12 && found.lag_1 == [lag_1, WHITE], "{found:?}");
            found.is_white
        };
        // Autoregressive noise with a coefficient of 0.9 has −0.66, and with 0.5 −0.68.
        assert!(is_white(2000, -0.72) && !is_white(2000, -0.66) && !is_white(2000, -0.68));
        assert!(is_white(100, -0.66), "100 poses do not tell");
        assert_eq!(SensorNoise::of(["Probe", "Tracker"], None), None);
    }

    #[test]
    fn account_of_two_recordings_is_that_of_all_frames() {
        let effect = |moved_mm: f64, why: Option<NotSmoothed>| SmoothingEffect {
            unsmoothed: Transform::IDENTITY,
            moved_mm,
            error_mm: 0.5 * moved_mm,
            not_smoothed: why,
        };
        let effects =
            [effect(0.3, None), effect(0.4, None), effect(9.0, Some(NotSmoothed::TooFast)), effect(1.2, None)];
        let account = |effects: &[SmoothingEffect]| {
            let mut account = SmoothingStatus::new(Smoothing { half_width_ns: 300_000_000, ahead_ns: 33_000_000 });
            for effect in effects {
                assert!(!account.count(effect), "the noise is estimated now and then");
            }
            account
        };
        let (all, mut parts) = (account(&effects), account(&effects[..1]));
        parts.add(account(&effects[1..]));
        assert!((all.moved_rms_mm - (1.69_f64 / 3.0).sqrt()).abs() < 1e-12 && all.moved_most_mm == 1.2, "{all:?}");
        assert!((parts.moved_rms_mm - all.moved_rms_mm).abs() < 1e-12, "{parts:?}");
        assert!((parts.error_rms_mm - 0.5 * all.moved_rms_mm).abs() < 1e-12, "{parts:?}");
        assert_eq!((parts.smoothed, &parts.not_smoothed), (3, &BTreeMap::from([("motion too fast", 1)])));
        assert_eq!(parts.words(), "300 ms before and 33 ms after a frame; 3 of 4 frames");
    }
}
