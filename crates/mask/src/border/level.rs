//! The border's level and noise, from the frame's own outer rim.

use super::plane::{Map, Plane, median};
use super::statistics::Moments;
use crate::found::UnsureReason;

/// Width of the rim, as a part of the frame's shorter side, and its least width, pixels.
const RIM: usize = 60;
const LEAST_RIM: usize = 4;
/// Bins of a level, and bins on either side that count with the most frequent one.
const BINS: usize = 2;
const PEAK: usize = 2;
/// Levels on either side of the most frequent one that may still be border.
const NEAR: f32 = 4.0;
/// Least share of the rim that the border must have: a picture may reach three sides.
const LEAST_SHARE: f64 = 0.2;
/// Largest spread of the border's 3×3 means, levels. A border is even; a picture is not.
const MOST_SPREAD: f32 = 3.0;
/// Brightest border and most noise of it, 8-bit grey levels: twice the black level of analogue
/// grabbers, and a quarter more than their noise. A rim beyond them is picture.
const MOST_LEVEL: f32 = 48.0;
const MOST_NOISE: f32 = 5.0;
/// A median absolute deviation of 1 is this standard deviation, for normal noise.
const MAD: f32 = 1.4826;

/// The border's level and noise.
#[derive(Debug, Clone, Copy)]
pub(super) struct BorderLevel {
    /// The level.
    pub(super) level: f32,
    /// Standard deviation of a pixel of a single frame.
    pub(super) noise: f32,
    /// Standard deviation of a pixel's mean over the frames, and of the mean of 3×3 of those.
    pub(super) pixel_spread: f32,
    window_spread: f32,
    /// Median and standard deviation of the 3×3 means of the variance over the frames.
    change: Option<[f32; 2]>,
}

/// Median, and standard deviation from the median absolute deviation.
fn spread(values: &[f32]) -> [f32; 2] {
    let middle = median(&mut values.to_vec());
    let mut away: Vec<f32> = values.iter().map(|value| (value - middle).abs()).collect();
    [middle, MAD * median(&mut away)]
}

impl BorderLevel {
    /// Estimates the border. `smooth` and `smooth_change` are the 3×3 means of the moments.
    ///
    /// # Errors
    /// [`UnsureReason::NoBorder`] if the rim has no even level, or is too bright or noisy.
    pub(super) fn estimate(
        moments: &Moments,
        smooth: &Plane,
        smooth_change: Option<&Plane>,
    ) -> Result<Self, UnsureReason> {
        let rim = rim(smooth.width, smooth.height);
        let levels: Vec<f32> = rim.iter().map(|&at| smooth.values[at]).collect();
        let centre = most_frequent(&levels);
        let near: Vec<f32> = levels.iter().copied().filter(|level| (level - centre).abs() <= NEAR).collect();
        let [middle, width] = spread(&near);
        let reach = (4.0 * width).max(1.0);
        let border: Vec<usize> =
            rim.iter().copied().filter(|&at| (smooth.values[at] - middle).abs() <= reach).collect();
        let share = border.len() as f64 / rim.len().max(1) as f64;
        let of = |plane: &Plane| -> Vec<f32> { border.iter().map(|&at| plane.values[at]).collect() };
        let [level, window_spread] = spread(&of(smooth));
        if share < LEAST_SHARE || window_spread > MOST_SPREAD {
            return Err(UnsureReason::NoBorder { share });
        }
        let [_, pixel_spread] = spread(&of(&moments.mean));
        let change = smooth_change.map(|change| spread(&of(change)));
        // A frozen scanner's noise does not change, but it still differs between pixels.
        let noise = change.map_or(0.0, |[change, _]| change.sqrt()).max(pixel_spread);
        if level > MOST_LEVEL || noise > MOST_NOISE {
            return Err(UnsureReason::NoBorder { share });
        }
        Ok(Self { level, noise, pixel_spread, window_spread, change })
    }

    /// Returns the pixels that differ from the border, by their mean or their change.
    pub(super) fn active(&self, smooth: &Plane, smooth_change: Option<&Plane>) -> Map {
        let away = (4.5 * self.window_spread).max(1.0);
        let mut set: Vec<bool> = smooth.values.iter().map(|value| (value - self.level).abs() > away).collect();
        if let (Some([middle, width]), Some(change)) = (self.change, smooth_change) {
            let limit = middle + 8.0 * width + 1.0;
            for (set, change) in set.iter_mut().zip(&change.values) {
                *set |= *change > limit;
            }
        }
        Map { width: smooth.width, height: smooth.height, set }
    }
}

/// Returns the indices of the rim's pixels.
fn rim(width: usize, height: usize) -> Vec<usize> {
    let band = (width.min(height) / RIM).max(LEAST_RIM);
    let is_outer = |at: usize, count: usize| at < band || at + band >= count;
    let pixels = (0..height).flat_map(|v| (0..width).map(move |u| (u, v)));
    pixels.filter(|&(u, v)| is_outer(u, width) || is_outer(v, height)).map(|(u, v)| v * width + u).collect()
}

/// Returns the level with the most values near it.
fn most_frequent(values: &[f32]) -> f32 {
    let mut bins = [0_u32; 256 * BINS];
    for value in values {
        bins[((value * BINS as f32) as usize).min(bins.len() - 1)] += 1;
    }
    let around = |at: usize| -> u32 { bins[at.saturating_sub(PEAK)..(at + PEAK + 1).min(bins.len())].iter().sum() };
    // Among equal sums, the one with the most in its own bin.
    let best = (0..bins.len()).rev().max_by_key(|&at| (around(at), bins[at])).unwrap_or(0);
    (best as f32 + 0.5) / BINS as f32
}
