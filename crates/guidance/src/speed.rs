//! Speed of the image plane, and its part across the plane, from the slices' own times.
//!
//! A straight line is fitted by least squares to the path of the image's middle and of its
//! corners over the last half second. Tracker noise and hand tremor therefore do not count as
//! speed. Only the motion across the plane matters for gaps. If the probe tilts, the fastest
//! corner counts, because slices are farthest apart there.

use std::collections::VecDeque;

use glam::DVec3;
use serde::Serialize;

use sonoweave_core::clock::{MS, SECOND};

use super::slice_plane::SlicePlane;
use super::spacing::Spacing;

/// Time window of the fit, ns.
const WINDOW_NS: i64 = 500 * MS;
/// Largest number of slices in the fit, at the rate of the fastest scanners.
const MOST: usize = 128;
/// Smallest number of slices, and shortest time span, of a fit.
const LEAST: usize = 4;
const LEAST_NS: i64 = 90 * MS;
/// Age at which slices no longer give a speed, ns.
const STALE_NS: i64 = SECOND;
/// A longer interval between two slices restarts the fit, ns.
const BREAK_NS: i64 = 300 * MS;
/// Speed below which the probe is static, mm/s.
const STILL: f64 = 1.0;
/// Share of a limit below which the speed counts as acceptable again after exceeding it.
const AGAIN: f64 = 0.9;

/// Assessment of the speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The probe is static.
    Still,
    /// It moves within the image plane, which scans nothing new.
    Sideways,
    /// Slices are close together.
    Good,
    /// Slices leave no gaps, but data between them are thin.
    Fast,
    /// Slices leave gaps.
    TooFast,
}

/// Report of the speed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SpeedStatus {
    /// Assessment.
    pub verdict: Verdict,
    /// The assessment in words, with numbers.
    #[serde(rename = "says")]
    pub text: String,
    /// Speed of the image's middle, mm/s.
    pub mm_per_s: f64,
    /// Its part across the image plane, mm/s.
    pub across_mm_per_s: f64,
    /// Speed of the fastest corner across the plane, mm/s, which determines gaps.
    pub edge_mm_per_s: f64,
    /// Slices a second.
    pub slices_per_s: f64,
    /// Largest speed of the fastest corner that leaves no gaps, mm/s.
    pub gapless_mm_per_s: f64,
    /// Largest speed of the fastest corner for an even volume, mm/s.
    pub even_mm_per_s: f64,
    /// Slices per cm across the plane, where they are farthest apart; `None` if the probe hardly
    /// moves across it.
    pub images_per_cm: Option<f64>,
}

#[derive(Debug, Clone, Copy)]
struct At {
    time_ns: i64,
    /// The corners and, last, the middle.
    points: [DVec3; 5],
    normal: DVec3,
}

/// The path of the last half second.
#[derive(Debug, Default)]
pub struct Speed {
    way: VecDeque<At>,
    /// The last direction of the sweep across the plane.
    travel: Option<DVec3>,
    verdict: Option<Verdict>,
}

impl Speed {
    /// Adds a slice taken at a time, ns.
    pub fn add(&mut self, plane: &SlicePlane, time_ns: i64) {
        if let Some(last) = self.way.back() {
            let passed = time_ns - last.time_ns;
            if passed == 0 {
                return;
            }
            if !(0..=BREAK_NS).contains(&passed) {
                self.way.clear();
            }
        }
        let [a, b, c, d] = *plane.corners();
        self.way.push_back(At { time_ns, points: [a, b, c, d, plane.middle()], normal: plane.normal() });
        while self.way.len() > MOST || self.way.front().is_some_and(|first| time_ns - first.time_ns > WINDOW_NS) {
            self.way.pop_front();
        }
        if let Some(Motion { middle, normal, .. }) = self.motion()
            && middle.dot(normal).abs() > STILL
        {
            self.travel = Some(normal * middle.dot(normal).signum());
        }
    }

    /// Returns the current or last direction of the sweep: unit vector, across the plane.
    pub fn travel(&self) -> Option<DVec3> {
        self.travel
    }

    /// Returns the report for this allowed spacing of slices.
    pub fn status(&mut self, spacing: Spacing, now_ns: i64) -> Option<SpeedStatus> {
        let newest = self.way.back()?;
        if now_ns - newest.time_ns > STALE_NS {
            self.verdict = None;
            return None;
        }
        let Motion { middle, normal, edge, rate } = self.motion()?;
        let (gapless, even) = (spacing.gapless_mm * rate, spacing.even_mm * rate);
        let was = self.verdict;
        let over =
            |limit: f64, is: &[Verdict]| edge > limit * if was.is_some_and(|v| is.contains(&v)) { AGAIN } else { 1.0 };
        let verdict = if over(gapless, &[Verdict::TooFast]) {
            Verdict::TooFast
        } else if over(even, &[Verdict::Fast, Verdict::TooFast]) {
            Verdict::Fast
        } else if edge > STILL {
            Verdict::Good
        } else if middle.length() > 2.0 * STILL {
            Verdict::Sideways
        } else {
            Verdict::Still
        };
        self.verdict = Some(verdict);
        let text = match verdict {
            Verdict::Still => "still".into(),
            Verdict::Sideways => format!("sideways: {:.0} mm/s within the picture's plane", middle.length()),
            Verdict::Good => format!("good: {edge:.0} mm/s"),
            Verdict::Fast => format!("fast: {edge:.0} mm/s where {even:.0} mm/s makes an even volume"),
            Verdict::TooFast => format!("too fast: {edge:.0} mm/s where {gapless:.0} mm/s leaves no gaps"),
        };
        Some(SpeedStatus {
            verdict,
            text,
            mm_per_s: middle.length(),
            across_mm_per_s: middle.dot(normal).abs(),
            edge_mm_per_s: edge,
            slices_per_s: rate,
            gapless_mm_per_s: gapless,
            even_mm_per_s: even,
            images_per_cm: (edge > STILL).then(|| 10.0 * rate / edge),
        })
    }

    fn motion(&self) -> Option<Motion> {
        let (first, last) = (self.way.front()?, self.way.back()?);
        let span_ns = last.time_ns - first.time_ns;
        if self.way.len() < LEAST || span_ns < LEAST_NS {
            return None;
        }
        let count = self.way.len() as f64;
        let seconds = |at: &At| (at.time_ns - first.time_ns) as f64 / 1e9;
        let mean_s = self.way.iter().map(seconds).sum::<f64>() / count;
        let spread: f64 = self.way.iter().map(|at| (seconds(at) - mean_s).powi(2)).sum();
        let velocity = |point: usize| {
            // Relative to the first position, to avoid cancellation.
            self.way.iter().map(|at| (at.points[point] - first.points[point]) * (seconds(at) - mean_s)).sum::<DVec3>()
                / spread
        };
        let normal = last.normal;
        let edge = (0..4).map(|corner| velocity(corner).dot(normal).abs()).fold(0.0, f64::max);
        Some(Motion { middle: velocity(4), normal, edge, rate: (count - 1.0) / (span_ns as f64 / 1e9) })
    }
}

struct Motion {
    /// Velocity of the middle, mm/s.
    middle: DVec3,
    normal: DVec3,
    edge: f64,
    rate: f64,
}
