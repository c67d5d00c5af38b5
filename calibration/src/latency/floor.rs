//! Estimates the lag with a water tank: the probe moves up and down above the floor, and the
//! floor's line in the frames moves the opposite way.

use glam::{DQuat, DVec2, DVec3};
use serde::Serialize;

use super::align::{AlignOptions, Alignment, LEAST_FRAMES, NoLag, Observation, align};
use super::line::{Line, NoLine};
use super::motion::{Motion, PoseSample};
use super::stamps::{Reading, Stamps, wander};
use super::track::NotFinite;
use crate::statistics::median;

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

/// Reasons why there is no lag.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NoFloorLag {
    /// A pose contains NaN or infinity.
    #[error("pose {}: holds NaN or infinity", .0.index)]
    NotFinite(NotFinite),
    /// Too few frames show a floor.
    #[error(
        "of {frames} pictures {lines} show the line of a floor, and {least} are needed: in {nothing} nothing moves, in {scattered} what moves lies on no line; hold the probe above the floor of a water tank, and move it up and down"
    )]
    NoFloor {
        /// Number of frames.
        frames: usize,
        /// Number of frames with a line.
        lines: usize,
        /// Number of lines required.
        least: usize,
        /// Number of frames in which nothing moves.
        nothing: usize,
        /// Number of frames in which the moving pixels form no line.
        scattered: usize,
    },
    /// The stamps cannot be seconds.
    #[error("pictures come every {period_s:e} s by their stamps, which are no seconds then; are they ms, or numbers?")]
    Seconds {
        /// Period of the frames, s.
        period_s: f64,
    },
    /// The line is static.
    #[error(
        "the floor's line moves by {extent_px:.1} px, and by itself it scatters by {scatter_px:.1} px: move the probe up and down, by a third of the picture"
    )]
    PictureStill {
        /// Extent of its motion, px.
        extent_px: f64,
        /// Its scatter, px.
        scatter_px: f64,
    },
    /// There are no poses in the video's time.
    #[error("of {poses} poses none is of the time of the pictures, {:.3} to {:.3} s; are the stamps of one clock, and in seconds?", frames_s[0], frames_s[1])]
    NoPoses {
        /// Number of poses.
        poses: usize,
        /// First and last frame with a line, s.
        frames_s: [f64; 2],
    },
    /// The tracker is static.
    #[error(
        "the tracker moves by {extent_mm:.2} mm, and its noise is {noise_mm:.2} mm: is it this probe's sensor, and was it moved?"
    )]
    TrackerStill {
        /// Extent of its motion, mm.
        extent_mm: f64,
        /// Its noise, mm.
        noise_mm: f64,
    },
    /// The probe does not move up and down.
    #[error("the probe turns round {turns} times, and {least} are needed: move it up and down five times or more")]
    OneWay {
        /// Number of its turns.
        turns: usize,
        /// Number of turns required.
        least: usize,
    },
    /// The units differ.
    #[error(
        "a pixel would be {mm_per_px:.4} mm large by the tracker's motion, where {} is known or possible: are the tracker's positions in mm{hint}?",
        match .pixel_mm { Some(mm) => format!("{mm:.4} mm"), None => "0.01 to 2 mm".to_owned() }
    )]
    Units {
        /// Pixel size by the tracker, mm.
        mm_per_px: f64,
        /// Pixel size by the probe's calibration, mm.
        pixel_mm: Option<f64>,
        /// Suggested unit.
        hint: &'static str,
    },
    /// The signals determine no lag.
    #[error(transparent)]
    Lag(#[from] NoLag),
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
/// [`NoFloorLag`] if the recording determines no lag.
pub fn floor_lag(frames: &[FloorFrame], poses: &[FloorPose], options: &FloorOptions) -> Result<FloorLag, NoFloorLag> {
    let lines: Vec<(usize, Line)> =
        frames.iter().enumerate().filter_map(|(i, frame)| Some((i, frame.line.ok()?))).collect();
    let count = |why: NoLine| frames.iter().filter(|frame| frame.line == Err(why)).count();
    let without = [count(NoLine::Nothing), count(NoLine::Scattered)];
    let least = LEAST_FRAMES.max(frames.len() / 2);
    if lines.len() < least {
        let [nothing, scattered] = without;
        return Err(NoFloorLag::NoFloor { frames: frames.len(), lines: lines.len(), least, nothing, scattered });
    }
    let mut periods: Vec<f64> = frames.windows(2).map(|two| two[1].stamps.given_s - two[0].stamps.given_s).collect();
    let period_s = median(&mut periods);
    if !(PERIODS_S[0]..=PERIODS_S[1]).contains(&period_s) {
        return Err(NoFloorLag::Seconds { period_s });
    }
    let middle = |of: fn(&Line) -> f64| median(&mut lines.iter().map(|(_, line)| of(line)).collect::<Vec<_>>());
    let reference = DVec2::new(middle(|line| line.point_px.x), middle(|line| line.point_px.y));
    let distances: Vec<f64> = lines.iter().map(|(_, line)| line.below(reference)).collect();
    let (extent_px, scatter_px) = (extent(&distances), middle(|line| line.scatter_px));
    if !(extent_px > BEYOND_NOISE * scatter_px) {
        return Err(NoFloorLag::PictureStill { extent_px, scatter_px });
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
    fn solve(&self, without: [usize; 2], extent_px: f64) -> Result<FloorLag, NoFloorLag> {
        let of_frames: Vec<Stamps> = self.frames.iter().map(|frame| frame.stamps).collect();
        let of_poses: Vec<Stamps> = self.poses.iter().map(|pose| pose.stamps).collect();
        let ways = self.ways(&of_poses)?;
        let (mut tried, mut best) = (Vec::new(), None::<(Alignment, Reading, Vec<f64>, &Way)>);
        let mut refused = None;
        for video in Reading::ALL {
            let Some(times) = video.times(&of_frames) else { continue };
            let at = |i: &usize| times[*i];
            let values: Vec<Observation> = self
                .lines
                .iter()
                .zip(self.distances)
                .map(|((i, _), value)| Observation { time_s: at(i), value: *value })
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
            return Err(refused
                .map_or(NoFloorLag::NoPoses { poses: self.poses.len(), frames_s: self.span_s() }, NoFloorLag::Lag));
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
    fn ways(&self, stamps: &[Stamps]) -> Result<Vec<Way>, NoFloorLag> {
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
            let motion = Motion::new(&samples, [first - reach, last + reach]).map_err(NoFloorLag::NotFinite)?;
            let Some(motion) = motion else { continue };
            ways.push(Way { reading, times, motion });
        }
        let Some(Way { motion, .. }) = ways.first() else {
            return Err(NoFloorLag::NoPoses { poses: self.poses.len(), frames_s: [first, last] });
        };
        let Motion { extent_mm, noise_mm, turns, .. } = *motion;
        if !(extent_mm > BEYOND_NOISE * noise_mm) {
            return Err(NoFloorLag::TrackerStill { extent_mm, noise_mm });
        }
        if turns < LEAST_TURNS {
            return Err(NoFloorLag::OneWay { turns, least: LEAST_TURNS });
        }
        Ok(ways)
    }

    fn check_units(&self, mm_per_px: f64) -> Result<(), NoFloorLag> {
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
        Err(NoFloorLag::Units { mm_per_px, pixel_mm, hint: hint.map_or("", |(_, hint)| hint) })
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
