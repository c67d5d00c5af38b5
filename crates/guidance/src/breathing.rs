//! Breathing of the body under the probe, by a sensor on it.

use std::collections::VecDeque;

use glam::DVec3;
use serde::Serialize;

use sonoweave_core::clock::{MS, SECOND};
use sync::gating::{Gate, Signal};

/// Time over which the sensor is watched, ns, and the distance of the samples that are used.
const WATCHED_NS: i64 = 60 * SECOND;
const STEP_NS: i64 = 50 * MS;
/// Time after which breathing is looked for again, ns.
const AFRESH_NS: i64 = 5 * SECOND;
/// Share of the frames that a gate uses.
const SHARE: f64 = 0.35;
/// Distance that a kernel bridges, mm.
const BRIDGED_MM: f64 = 1.0;

/// Breathing of the body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BreathingStatus {
    /// Period, s.
    pub period_s: f64,
    /// Displacement of the sensor between the first and the last decile, mm.
    pub size_mm: f64,
    /// Highest speed of one sweep that leaves no holes when breathing is gated, mm/s.
    pub speed_mm_s: f64,
}

/// The sensor's positions of the last minute.
#[derive(Debug, Default)]
pub(super) struct Breathing {
    samples: VecDeque<(i64, DVec3)>,
    evaluated_ns: Option<i64>,
    found: Option<BreathingStatus>,
}

impl Breathing {
    /// Adds a position, mm.
    pub(super) fn add(&mut self, time_ns: i64, position_mm: DVec3) {
        let last_ns = self.samples.back().map_or(i64::MIN, |(time_ns, _)| *time_ns);
        if time_ns >= last_ns.saturating_add(STEP_NS) {
            self.samples.push_back((time_ns, position_mm));
        }
        while self.samples.front().is_some_and(|(first_ns, _)| time_ns - first_ns > WATCHED_NS) {
            self.samples.pop_front();
        }
    }

    /// Returns the breathing at this time, if there is any.
    pub(super) fn status(&mut self, now_ns: i64) -> Option<BreathingStatus> {
        if self.evaluated_ns.is_none_or(|evaluated_ns| now_ns - evaluated_ns >= AFRESH_NS) {
            self.evaluated_ns = Some(now_ns);
            self.found = self.evaluated();
        }
        self.found
    }

    fn evaluated(&self) -> Option<BreathingStatus> {
        let (begin_ns, _) = self.samples.front()?;
        let seconds = |time_ns: i64| (time_ns - begin_ns) as f64 * 1e-9;
        let samples: Vec<(f64, DVec3)> = self.samples.iter().map(|(time_ns, at)| (seconds(*time_ns), *at)).collect();
        let times_s: Vec<f64> = samples.iter().map(|(time_s, _)| *time_s).collect();
        let gate = Gate::new(&Signal::of_positions(&samples), &times_s, SHARE).ok()?;
        let (period_s, size_mm) = (gate.breathing.period_s, gate.breathing.size_mm);
        Some(BreathingStatus { period_s, size_mm, speed_mm_s: gate.speed_mm_s(BRIDGED_MM) })
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use mask::MaskSettings;
    use pipeline::Observer as _;
    use pipeline::session::SessionStatus;
    use sync::clock::TimeFlags;
    use sync::history::{PoseSample, Rigid};

    use super::*;
    use crate::spacing::Spacing;
    use crate::{GuidanceSettings, ScanGuidance};

    #[test]
    fn breathing_is_advised_with_the_speed_that_leaves_no_holes() {
        // Returns the status after some seconds of a body that moves by so many mm each 4 s, and
        // rests longest breathed out, with a tracker's noise.
        let after = |seconds: i64, mm: f64, name: &str| {
            let guidance = ScanGuidance::new(GuidanceSettings {
                spacing: Spacing { gapless_mm: 5.0, even_mm: 2.0 },
                mask: MaskSettings::default(),
                calibration: None,
            });
            let mut status = None;
            for n in 0..seconds * 50 {
                let time_ns = n * 20 * MS;
                let phase = std::f64::consts::PI * n as f64 / 200.0;
                let noise =
                    DVec3::new((n * 7919 % 101) as f64, (n * 104_729 % 97) as f64, 50.0) / 500.0 - DVec3::splat(0.1);
                let position_mm =
                    DVec3::new(200.0, -50.0, 80.0) + DVec3::new(0.6, 0.8, 0.0) * mm * phase.sin().powi(4) + noise;
                let pose = Rigid { rotation: DQuat::IDENTITY, position_mm };
                let sample = PoseSample { time_ns, bound_ns: 0, flags: TimeFlags::NONE, pose, invalid: None };
                guidance.pose([name, "Tracker"], &sample);
                if n % 10 == 0 {
                    status = Some(guidance.status(&SessionStatus::default(), time_ns));
                }
            }
            status.unwrap()
        };
        let status = after(50, 8.0, "Reference");
        let breathing = status.breathing.unwrap();
        assert!((breathing.period_s - 4.0).abs() < 0.1 && (4.0..8.5).contains(&breathing.size_mm), "{breathing:?}");
        // No frame is used for two to three seconds at a time, and a kernel bridges 1 mm.
        assert!((0.3..0.5).contains(&breathing.speed_mm_s), "{breathing:?}");
        let advice = status.advice.iter().find(|advice| advice.key == "breathing").unwrap();
        assert!(advice.sentence.contains(&format!("slower than {:.1} mm/s", breathing.speed_mm_s)), "{advice:?}");
        for (seconds, mm, name) in [(50, 0.0, "Reference"), (50, 8.0, "Probe"), (6, 8.0, "Reference")] {
            let status = after(seconds, mm, name);
            assert!(status.breathing.is_none() && status.advice.is_empty(), "{seconds} {mm} {name}: {status:?}");
        }
    }
}
