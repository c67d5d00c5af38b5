//! Gating by breathing: frames of one state of the body are used, others are left out.
//!
//! A signal tells the body's displacement over time: the position of a sensor on the body, or the
//! tissue's shift in depth from frame to frame. If it is periodic as breathing is, the gate is the
//! share of the frames with the least displacement from the end of breathing out, where a body
//! rests longest. The gate is by displacement and not by phase, as breaths differ in depth.
//!
//! Instead of a signal, markers may tell the phase: see [`PhaseGate`].
//!
//! A body at rest is not gated: a periodic signal must exceed what the wander of a resting body
//! reaches by chance, by its correlation and by its size.

#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "a comparison with NaN must refuse, not pass")]

mod depth;
mod periodic;
mod phase;
mod signal;
#[cfg(test)]
mod tests;

use std::fmt;

use serde::Serialize;

pub use depth::DepthShift;
pub use phase::PhaseGate;
pub use signal::Signal;

/// Least number of periods in a recording.
const LEAST_PERIODS: f64 = 4.0;
/// Least size of the displacement between its deciles, mm. Less is not told from a body's wander.
const LEAST_MM: f64 = 1.0;
/// Share of the frames that a gate must accept at least.
pub const LEAST_SHARE: f64 = 0.15;
/// Largest difference of the periods of both halves of a recording, as a share of the period.
const MOST_CHANGE: f64 = 0.3;

/// Breathing, as a signal shows it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Breathing {
    /// Period, s.
    pub period_s: f64,
    /// Correlation of the signal with itself a period later.
    pub correlation: f64,
    /// Displacement between the first and the last decile, mm.
    pub size_mm: f64,
}

/// A gate, and its effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Gate {
    /// The breathing.
    pub breathing: Breathing,
    /// Largest accepted displacement from the end of breathing out, mm.
    pub most_mm: f64,
    /// Standard deviations of the displacement over all frames, and over the accepted ones, mm.
    pub motion_mm: [f64; 2],
    /// Times without an accepted frame, s: the median, and the longest.
    pub missing_s: [f64; 2],
    /// Whether each frame is accepted, in their order.
    #[serde(skip)]
    pub accepted: Vec<bool>,
}

/// Reason why frames are not gated.
#[derive(Debug, Clone, PartialEq)]
pub enum NotGated {
    /// The signal has gaps, or is too short.
    Short {
        /// Its length without gaps of more than a second, s.
        seconds: f64,
    },
    /// The signal is not periodic.
    NotPeriodic {
        /// Its largest correlation with itself later.
        correlation: f64,
        /// The correlation that wander alone reaches in one of 100 recordings of this length.
        least: f64,
    },
    /// The displacement is too small.
    Small {
        /// The displacement, mm.
        size_mm: f64,
    },
    /// There are too few markers.
    FewMarkers {
        /// Their number.
        markers: usize,
        /// The number that is needed.
        least: usize,
    },
    /// The markers are irregular.
    IrregularMarkers {
        /// The number of periods that differ from those around them.
        left_out: usize,
        /// The number of all.
        periods: usize,
    },
    /// The period changes.
    Irregular {
        /// The periods of both halves of the recording, s.
        halves_s: [f64; 2],
    },
}

impl fmt::Display for NotGated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Short { seconds } => write!(
                f,
                "the signal has {seconds:.0} s without a gap, which are fewer than {LEAST_PERIODS} breaths; record 30 s \
                 or more"
            ),
            Self::NotPeriodic { correlation, least } => write!(
                f,
                "the body does not breathe, or its motion is not seen: the signal correlates with itself a breath \
                 later by {correlation:.2}, and that of a body at rest may by {least:.2}; record longer, or fix the \
                 Reference sensor where the body moves"
            ),
            Self::Small { size_mm } => write!(
                f,
                "the body moves by {size_mm:.1} mm, and {LEAST_MM} mm are needed to tell breathing from wander; gate \
                 nothing"
            ),
            Self::FewMarkers { markers, least } => write!(
                f,
                "the session has {markers} markers, and {least} are needed; mark the end of breathing out each time \
                 while you record"
            ),
            Self::IrregularMarkers { left_out, periods } => write!(
                f,
                "the markers are irregular: {left_out} of {periods} periods differ by more than a fifth from those \
                 around them; mark every breath once, or check the line that gives the markers"
            ),
            Self::Irregular { halves_s: [early, late] } => write!(
                f,
                "a breath takes {early:.1} s in the first half and {late:.1} s in the second, so that one state of the \
                 body is not seen again; let the patient breathe evenly"
            ),
        }
    }
}

impl Gate {
    /// Gates frames by their times, s, which ascend; `share` of them is accepted.
    ///
    /// # Errors
    /// [`NotGated`] if the signal shows no regular breathing.
    pub fn new(signal: &Signal, frames_s: &[f64], share: f64) -> Result<Self, NotGated> {
        let grid = signal.grid();
        let seconds = grid.seconds();
        if seconds < LEAST_PERIODS * periodic::PERIODS_S[0] {
            return Err(NotGated::Short { seconds });
        }
        let band = grid.band();
        let (period_s, correlation) = periodic::period(&band, grid.step_s());
        let least = periodic::by_chance(seconds);
        if !(correlation > least) {
            return Err(NotGated::NotPeriodic { correlation, least });
        }
        if seconds < LEAST_PERIODS * period_s {
            return Err(NotGated::Short { seconds });
        }
        let size_mm = periodic::size(&band);
        if !(size_mm >= LEAST_MM) {
            return Err(NotGated::Small { size_mm });
        }
        let (early, late) = band.split_at(band.len() / 2);
        let halves_s = [early, late].map(|half| periodic::period(half, grid.step_s()).0);
        let change = (halves_s[0] - halves_s[1]).abs() / period_s;
        if change > MOST_CHANGE {
            return Err(NotGated::Irregular { halves_s });
        }
        let breathing = Breathing { period_s, correlation, size_mm };
        // The sum of small shifts wanders; a sensor's position does not.
        let level = if signal.is_summed() { band.clone() } else { grid.smooth() };
        let side = periodic::rest_side(&band);
        let displaced: Vec<f64> = frames_s.iter().map(|time_s| side * grid.at(&level, *time_s)).collect();
        // NaN beyond the signal's ends: such frames are left out.
        let known = displaced.iter().filter(|value| !value.is_nan());
        let mut sorted: Vec<f64> = known.clone().copied().collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let place = ((share * sorted.len() as f64).round() as usize).clamp(1, sorted.len().max(1)) - 1;
        let Some(limit) = sorted.get(place).copied() else { return Err(NotGated::Short { seconds: 0.0 }) };
        let accepted: Vec<bool> = displaced.iter().map(|value| *value <= limit).collect();
        Ok(Self {
            breathing,
            most_mm: limit - sorted[0],
            motion_mm: [deviation(known), deviation(displaced.iter().filter(|value| **value <= limit))],
            missing_s: missing(frames_s, &accepted),
            accepted,
        })
    }

    /// Returns the highest speed of a sweep that leaves no holes, mm/s, if the kernel bridges a
    /// gap of so many mm.
    pub fn speed_mm_s(&self, bridged_mm: f64) -> f64 {
        bridged_mm / self.missing_s[1]
    }
}

/// Returns the times without an accepted frame: the median of those longer than a frame, and the
/// longest.
fn missing(frames_s: &[f64], accepted: &[bool]) -> [f64; 2] {
    let times: Vec<f64> = frames_s.iter().zip(accepted).filter(|(_, accepted)| **accepted).map(|(t, _)| *t).collect();
    let mut gaps: Vec<f64> = times.windows(2).map(|two| two[1] - two[0]).collect();
    gaps.sort_unstable_by(f64::total_cmp);
    let longest = gaps.last().copied().unwrap_or(0.0);
    let long: Vec<f64> = gaps.into_iter().filter(|gap| *gap > 0.25 * longest).collect();
    [long.get(long.len() / 2).copied().unwrap_or(0.0), longest]
}

/// Returns a standard deviation.
fn deviation<'a>(values: impl Iterator<Item = &'a f64> + Clone) -> f64 {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / count;
    (values.map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt()
}
