//! Estimates the lag with a water tank: the probe moves up and down above the floor, and the
//! floor's line in the frames moves the opposite way.

use glam::{DQuat, DVec2, DVec3};
use serde::Serialize;

use super::align::{AlignOptions, Alignment, LEAST_FRAMES, TimedValue, align};
use super::line::{Line, NoLine};
use super::motion::Motion;
use super::stamps::{Reading, Stamps, wander};
use crate::error::{CalibrationError, LatencyError};
use crate::statistics::median;
use crate::trajectory::PoseSample;

/// A frame's line, and its times.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloorFrame {
    /// Times.
    pub stamps: Stamps,
    /// The floor's line, if found.
    pub line: Result<Line, NoLine>,
}

/// The probe's pose in the tracker's frame, and its times.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloorPose {
    /// Times.
    pub stamps: Stamps,
    /// Unit quaternion.
    pub rotation: DQuat,
    /// mm.
    pub position_mm: DVec3,
}

/// Options of the search, and known values.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FloorOptions {
    /// The range of lags.
    pub align: AlignOptions,
    /// Size of a pixel by the probe's calibration, mm along v.
    pub pixel_mm: Option<f64>,
}

/// A pair of ways to read stamps, and its result.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tried {
    /// Stamps of the frames.
    pub video: Reading,
    /// Stamps of the poses.
    pub tracker: Reading,
    /// Lag, s; standard error, s; and residual of the line's motion, px.
    pub found: Option<[f64; 3]>,
}

/// A lag found with the floor.
#[derive(Debug, Clone)]
pub struct FloorLag {
    /// The lag.
    pub alignment: Alignment,
    /// The stamps used: of the frames and of the poses.
    pub readings: [Reading; 2],
    /// All pairs that were tried.
    pub tried: Vec<Tried>,
    /// Deviation of the given stamps of frames and of poses from those used, s.
    pub wander_s: [f64; 2],
    /// Number of frames with a line.
    pub lines: usize,
    /// Number of frames in which nothing moves, and in which the moving pixels form no line.
    pub without: [usize; 2],
    /// Extent of the line's motion without the extreme tenth of the frames, px.
    pub extent_px: f64,
    /// The tracker's motion in that time.
    pub motion: Motion,
    /// Pixel size at which both motions agree, mm.
    pub mm_per_px: f64,
    /// Distance of each line from their median position, with the times that were used.
    pub values: Vec<(f64, f64)>,
}

/// A motion must exceed its scatter by this factor.
const BEYOND_NOISE: f64 = 10.0;
const LEAST_TURNS: usize = 4;
/// Range of the video's period, s.
const PERIODS_S: [f64; 2] = [1e-3, 2.0];
/// Range of ultrasound pixel sizes, mm: from high-frequency probes to whole abdomens.
const PIXELS_MM: [f64; 2] = [0.01, 2.0];
/// Largest ratio of the calibrated pixel size and that from the motion. A tilted image's pixels
/// are longer by up to 1/cos 45°.
const ALIKE: f64 = 1.5;

/// Returns the lag of poses behind the floor's lines.
///
/// # Errors
/// [`CalibrationError::Latency`] if the recording determines no lag.
pub fn floor_lag(
    frames: &[FloorFrame],
    poses: &[FloorPose],
    options: &FloorOptions,
) -> Result<FloorLag, CalibrationError> {
    let lines: Vec<(usize, Line)> =
        frames.iter().enumerate().filter_map(|(i, frame)| Some((i, frame.line.ok()?))).collect();
    let count = |why: NoLine| frames.iter().filter(|frame| frame.line == Err(why)).count();
    let without = [count(NoLine::Nothing), count(NoLine::Scattered)];
    let least = LEAST_FRAMES.max(frames.len() / 2);
    if lines.len() < least {
        let [nothing, scattered] = without;
        return Err(
            LatencyError::NoFloor { frames: frames.len(), lines: lines.len(), least, nothing, scattered }.into()
        );
    }
    let mut periods: Vec<f64> = frames.windows(2).map(|two| two[1].stamps.given_s - two[0].stamps.given_s).collect();
    let period_s = median(&mut periods);
    if !(PERIODS_S[0]..=PERIODS_S[1]).contains(&period_s) {
        return Err(LatencyError::Seconds { period_s }.into());
    }
    let middle = |of: fn(&Line) -> f64| median(&mut lines.iter().map(|(_, line)| of(line)).collect::<Vec<_>>());
    let reference = DVec2::new(middle(|line| line.point_px.x), middle(|line| line.point_px.y));
    let distances: Vec<f64> = lines.iter().map(|(_, line)| line.below(reference)).collect();
    let (extent_px, scatter_px) = (extent(&distances), middle(|line| line.scatter_px));
    if !(extent_px > BEYOND_NOISE * scatter_px) {
        return Err(LatencyError::PictureStill { extent_px, scatter_px }.into());
    }
    let problem = Problem { frames, poses, lines: &lines, distances: &distances, options };
    problem.solve(without, extent_px)
}

struct Problem<'a> {
    frames: &'a [FloorFrame],
    poses: &'a [FloorPose],
    lines: &'a [(usize, Line)],
    distances: &'a [f64],
    options: &'a FloorOptions,
}

/// The motion by one reading of the poses' stamps.
struct Way {
    reading: Reading,
    times: Vec<f64>,
    motion: Motion,
}

impl Problem<'_> {
    fn solve(&self, without: [usize; 2], extent_px: f64) -> Result<FloorLag, CalibrationError> {
        let of_frames: Vec<Stamps> = self.frames.iter().map(|frame| frame.stamps).collect();
        let of_poses: Vec<Stamps> = self.poses.iter().map(|pose| pose.stamps).collect();
        let ways = self.ways(&of_poses)?;
        let (mut tried, mut best) = (Vec::new(), None::<(Alignment, Reading, Vec<f64>, &Way)>);
        let mut refused = None;
        for video in Reading::ALL {
            let Some(times) = video.times(&of_frames) else { continue };
            let at = |i: &usize| times[*i];
            let values: Vec<TimedValue> = self
                .lines
                .iter()
                .zip(self.distances)
                .map(|((i, _), value)| TimedValue { time_s: at(i), value: *value })
                .collect();
            for way in &ways {
                let result = align(&values, &way.motion.track, &self.options.align);
                let found = result.as_ref().ok().map(|a| [a.lag_s, a.se_s, a.residual]);
                tried.push(Tried { video, tracker: way.reading, found });
                match result {
                    Ok(alignment) if best.as_ref().is_none_or(|(best, ..)| alignment.residual < best.residual) => {
                        best = Some((alignment, video, times.clone(), way));
                    }
                    Ok(_) => {}
                    // Report the error of the first reading, the simplest one.
                    Err(why) => refused = refused.or(Some(why)),
                }
            }
        }
        let Some((alignment, video, times, way)) = best else {
            let none = LatencyError::NoPoses { poses: self.poses.len(), frames_s: self.span_s() };
            return Err(refused.unwrap_or(none).into());
        };
        let mm_per_px = 1.0 / alignment.gain.abs();
        self.check_units(mm_per_px)?;
        Ok(FloorLag {
            readings: [video, way.reading],
            wander_s: [wander(&of_frames, &times), wander(&of_poses, &way.times)],
            lines: self.lines.len(),
            without,
            extent_px,
            motion: way.motion.clone(),
            mm_per_px,
            values: self.lines.iter().zip(self.distances).map(|((i, _), value)| (times[*i], *value)).collect(),
            alignment,
            tried,
        })
    }

    /// Returns the times of the first and last frame with a line, by the given stamps.
    fn span_s(&self) -> [f64; 2] {
        let times = || self.lines.iter().map(|(i, _)| self.frames[*i].stamps.given_s);
        [times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max)]
    }

    /// Returns the tracker's motion in the video's time, for each way to read its stamps.
    fn ways(&self, stamps: &[Stamps]) -> Result<Vec<Way>, CalibrationError> {
        let [first, last] = self.span_s();
        let reach = 2.0 * self.options.align.range_s;
        let mut ways = Vec::new();
        for reading in Reading::ALL {
            let Some(times) = reading.times(stamps) else { continue };
            let samples: Vec<PoseSample> = self
                .poses
                .iter()
                .zip(&times)
                .map(|(pose, time_s)| PoseSample {
                    time_s: *time_s,
                    rotation: pose.rotation,
                    position_mm: pose.position_mm,
                })
                .collect();
            let motion = Motion::new(&samples, [first - reach, last + reach])?;
            let Some(motion) = motion else { continue };
            ways.push(Way { reading, times, motion });
        }
        let Some(Way { motion, .. }) = ways.first() else {
            return Err(LatencyError::NoPoses { poses: self.poses.len(), frames_s: [first, last] }.into());
        };
        let Motion { extent_mm, noise_mm, turns, .. } = *motion;
        if !(extent_mm > BEYOND_NOISE * noise_mm) {
            return Err(LatencyError::TrackerStill { extent_mm, noise_mm }.into());
        }
        if turns < LEAST_TURNS {
            return Err(LatencyError::OneWay { turns, least: LEAST_TURNS }.into());
        }
        Ok(ways)
    }

    fn check_units(&self, mm_per_px: f64) -> Result<(), LatencyError> {
        let pixel_mm = self.options.pixel_mm;
        let is_fit = match pixel_mm {
            Some(mm) => (mm / ALIKE..=mm * ALIKE).contains(&mm_per_px),
            None => (PIXELS_MM[0]..=PIXELS_MM[1]).contains(&mm_per_px),
        };
        if is_fit {
            return Ok(());
        }
        let known = pixel_mm.unwrap_or((PIXELS_MM[0] * PIXELS_MM[1]).sqrt());
        let nearest =
            [(0.1, ", not in cm"), (1.0 / 25.4, ", not in inches"), (1e-3, ", not in m"), (1e3, ", not in µm")]
                .into_iter()
                .min_by(|a, b| (mm_per_px / known / a.0).ln().abs().total_cmp(&(mm_per_px / known / b.0).ln().abs()));
        let hint = nearest.filter(|(by, _)| pixel_mm.is_none() || (mm_per_px / known / by).ln().abs() < ALIKE.ln());
        Err(LatencyError::Units { mm_per_px, pixel_mm, hint: hint.map_or("", |(_, hint)| hint) })
    }
}

/// Returns the distance between the 5th and the 95th percentile.
fn extent(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share).round() as usize];
    at(0.95) - at(0.05)
}

#[cfg(test)]
mod tests;
