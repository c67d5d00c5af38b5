//! How fast the picture moves, and which part of that is across it, by the slices' own times.
//!
//! A straight line is fitted to the way of the picture's middle and of its corners over the last half second (least squares), so that a tracker's noise and a hand's tremor do not
//! count as speed. What counts for gaps is the motion across the plane, and of a probe that is tilted the fastest corner's: slices are farthest apart there.

use std::collections::VecDeque;

use drivers::clock::{MS, SECOND};
use glam::DVec3;
use serde::Serialize;

use super::pane::Pane;
use super::spacing::Spacing;

/// What the line is fitted to, ns.
const WINDOW_NS: i64 = 500 * MS;
/// Slices that it is fitted to at most: as many as the fastest scanners make.
const MOST: usize = 128;
/// So many at least, over so long.
const LEAST: usize = 4;
const LEAST_NS: i64 = 90 * MS;
/// Slices that are older tell no speed.
const STALE_NS: i64 = SECOND;
/// A longer time between two begins anew.
const BREAK_NS: i64 = 300 * MS;
/// Slower is still, mm/s.
const STILL: f64 = 1.0;
/// What is below this part of a limit is well again, once it was not.
const AGAIN: f64 = 0.9;

/// What there is to say of the speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The probe rests.
    Still,
    /// It moves within the picture's plane, which shows nothing new across it.
    Sideways,
    /// Slices lie close.
    Good,
    /// They leave no gaps, but little is known between them.
    Fast,
    /// They leave gaps.
    TooFast,
}

/// The speed, as it is told.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SpeedTold {
    /// What there is to say of it.
    pub verdict: Verdict,
    /// The same in words, with numbers.
    pub says: String,
    /// Of the picture's middle, mm/s.
    pub mm_per_s: f64,
    /// Its part across the picture's plane, mm/s.
    pub across_mm_per_s: f64,
    /// Across the plane, of the fastest corner, mm/s: what gaps come of.
    pub edge_mm_per_s: f64,
    /// Slices a second.
    pub slices_per_s: f64,
    /// Of the fastest corner, at most so many mm/s leave no gaps,
    pub gapless_mm_per_s: f64,
    /// and so many an even volume.
    pub even_mm_per_s: f64,
    /// Slices a centimetre across the plane, where they lie farthest apart; `None` of a probe that hardly moves across it.
    pub images_per_cm: Option<f64>,
}

#[derive(Debug, Clone, Copy)]
struct At {
    time_ns: i64,
    /// The corners and, last, the middle.
    points: [DVec3; 5],
    normal: DVec3,
}

/// The way of the last half second.
#[derive(Debug, Default)]
pub struct Speed {
    way: VecDeque<At>,
    /// The direction across which the sweep went last.
    travel: Option<DVec3>,
    verdict: Option<Verdict>,
}

impl Speed {
    /// A slice was taken there at a time, ns.
    pub fn add(&mut self, pane: &Pane, time_ns: i64) {
        if let Some(last) = self.way.back() {
            let passed = time_ns - last.time_ns;
            if passed == 0 {
                return;
            }
            if !(0..=BREAK_NS).contains(&passed) {
                self.way.clear();
            }
        }
        let [a, b, c, d] = *pane.corners();
        self.way.push_back(At { time_ns, points: [a, b, c, d, pane.middle()], normal: pane.normal() });
        while self.way.len() > MOST || self.way.front().is_some_and(|first| time_ns - first.time_ns > WINDOW_NS) {
            self.way.pop_front();
        }
        if let Some(Motion { middle, normal, .. }) = self.motion()
            && middle.dot(normal).abs() > STILL
        {
            self.travel = Some(normal * middle.dot(normal).signum());
        }
    }

    /// In which direction the sweep goes, or went last: of length 1, across the plane.
    pub fn travel(&self) -> Option<DVec3> {
        self.travel
    }

    /// What there is to tell, where slices may lie so far apart.
    pub fn told(&mut self, spacing: Spacing, now_ns: i64) -> Option<SpeedTold> {
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
        let says = match verdict {
            Verdict::Still => "still".into(),
            Verdict::Sideways => format!("sideways: {:.0} mm/s within the picture's plane", middle.length()),
            Verdict::Good => format!("good: {edge:.0} mm/s"),
            Verdict::Fast => format!("fast: {edge:.0} mm/s where {even:.0} mm/s makes an even volume"),
            Verdict::TooFast => format!("too fast: {edge:.0} mm/s where {gapless:.0} mm/s leaves no gaps"),
        };
        Some(SpeedTold {
            verdict,
            says,
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
            // From the first one's place, so that nothing cancels.
            self.way.iter().map(|at| (at.points[point] - first.points[point]) * (seconds(at) - mean_s)).sum::<DVec3>()
                / spread
        };
        let normal = last.normal;
        let edge = (0..4).map(|corner| velocity(corner).dot(normal).abs()).fold(0.0, f64::max);
        Some(Motion { middle: velocity(4), normal, edge, rate: (count - 1.0) / (span_ns as f64 / 1e9) })
    }
}

struct Motion {
    /// Of the middle, mm/s.
    middle: DVec3,
    normal: DVec3,
    edge: f64,
    rate: f64,
}
