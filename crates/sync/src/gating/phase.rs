//! Gating by moments that mark a phase of each period: an operator's key at the end of breathing
//! out, or edges on a line, such as those of a chest belt or of an ECG's R waves.
//!
//! The phase of a frame is the share of its period that has passed since the marker before it. A
//! frame is accepted within half of the gate's share before and after the chosen phase. Periods
//! that differ from those around them, as a missed marker makes them, are left out.

use serde::Serialize;

use super::periodic::sorted;
use super::{NotGated, missing};

/// Least number of periods.
const LEAST_PERIODS: usize = 4;
/// Largest difference of a period from the median of those around it, as a share of that.
const MOST_OFF: f64 = 0.2;
/// Periods before and after one that its median is taken of.
const AROUND: usize = 4;
/// Largest share of the periods that are left out.
const MOST_LEFT_OUT: f64 = 0.34;

/// A gate by markers, and its effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PhaseGate {
    /// Median of the periods, s.
    pub period_s: f64,
    /// Number of periods, and of those that are left out as irregular.
    pub periods: [usize; 2],
    /// Times without an accepted frame, s: the median, and the longest.
    pub missing_s: [f64; 2],
    /// Whether each frame is accepted, in their order.
    #[serde(skip)]
    pub accepted: Vec<bool>,
}

impl PhaseGate {
    /// Gates frames by their times and those of markers, s, both ascending: `share` of each period
    /// is accepted, around this phase, 0 to 1. Frames before the first and after the last marker
    /// are left out.
    ///
    /// # Errors
    /// [`NotGated`] if there are too few periods, or if they are irregular.
    pub fn new(markers_s: &[f64], frames_s: &[f64], share: f64, phase: f64) -> Result<Self, NotGated> {
        let periods: Vec<f64> = markers_s.windows(2).map(|two| two[1] - two[0]).collect();
        if periods.len() < LEAST_PERIODS {
            return Err(NotGated::FewMarkers { markers: markers_s.len(), least: LEAST_PERIODS + 1 });
        }
        let is_regular: Vec<bool> = (0..periods.len())
            .map(|at| {
                let usual = median(&periods[at.saturating_sub(AROUND)..periods.len().min(at + AROUND + 1)]);
                (periods[at] - usual).abs() <= MOST_OFF * usual
            })
            .collect();
        let left_out = is_regular.iter().filter(|is_regular| !**is_regular).count();
        if !(left_out as f64 <= MOST_LEFT_OUT * periods.len() as f64) {
            return Err(NotGated::IrregularMarkers { left_out, periods: periods.len() });
        }
        let accepts = |time_s: &f64| {
            let after = markers_s.partition_point(|marker_s| marker_s <= time_s);
            let Some(period) = after.checked_sub(1).filter(|period| is_regular.get(*period) == Some(&true)) else {
                return false;
            };
            let off = ((time_s - markers_s[period]) / periods[period] - phase).rem_euclid(1.0);
            off.min(1.0 - off) <= 0.5 * share
        };
        let accepted: Vec<bool> = frames_s.iter().map(accepts).collect();
        Ok(Self {
            period_s: median(&periods),
            periods: [periods.len(), left_out],
            missing_s: missing(frames_s, &accepted),
            accepted,
        })
    }
}

/// Returns the median of values.
fn median(values: &[f64]) -> f64 {
    let sorted = sorted(values);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of 40 s, 30 a second.
    fn frames() -> Vec<f64> {
        (0..1200).map(|n| f64::from(n) / 30.0).collect()
    }

    fn count(gate: &PhaseGate) -> usize {
        gate.accepted.iter().filter(|accepted| **accepted).count()
    }

    #[test]
    fn share_around_the_phase_is_accepted_in_each_period() {
        let markers: Vec<f64> = (0..11).map(|n| 1.0 + 3.5 * f64::from(n)).collect();
        for (share, phase) in [(0.35, 0.0), (0.2, 0.7), (0.5, 0.25)] {
            let gate = PhaseGate::new(&markers, &frames(), share, phase).unwrap();
            assert!((gate.period_s - 3.5).abs() < 1e-9 && gate.periods == [10, 0], "{gate:?}");
            assert!((count(&gate) as f64 / (35.0 * 30.0) - share).abs() < 0.01, "{share}: {}", count(&gate));
            for (time_s, accepted) in frames().iter().zip(&gate.accepted) {
                let of = ((time_s - 1.0) / 3.5 - phase).rem_euclid(1.0);
                let is_near = of.min(1.0 - of) <= 0.5 * share;
                if (of.min(1.0 - of) - 0.5 * share).abs() < 1e-9 {
                    continue;
                }
                assert_eq!(*accepted, is_near && (1.0..36.0).contains(time_s), "{time_s}");
            }
            assert!((gate.missing_s[1] - (1.0 - share) * 3.5).abs() < 0.07, "{gate:?}");
        }
    }

    #[test]
    fn periods_unlike_those_around_them_are_left_out() {
        // The period follows a slow change; one marker is missed, and one comes twice.
        let mut markers = vec![0.0];
        for n in 0..12 {
            markers.push(markers[markers.len() - 1] + 2.5 + 0.05 * f64::from(n));
        }
        let even = PhaseGate::new(&markers, &frames(), 0.3, 0.0).unwrap();
        assert_eq!(even.periods, [12, 0]);
        let missed = markers.remove(4);
        let gate = PhaseGate::new(&markers, &frames(), 0.3, 0.0).unwrap();
        assert_eq!(gate.periods, [11, 1]);
        let between = |time_s: f64| time_s > markers[3] && time_s < markers[4];
        let accepted = frames().into_iter().zip(&gate.accepted).filter(|(_, accepted)| **accepted);
        assert!(accepted.clone().all(|(time_s, _)| !between(time_s)) && accepted.count() > 200);
        markers.insert(4, missed);
        markers.insert(5, missed + 0.2);
        assert_eq!(PhaseGate::new(&markers, &frames(), 0.3, 0.0).unwrap().periods, [13, 1]);
    }

    #[test]
    fn few_or_irregular_markers_are_refused() {
        let refused = |markers: &[f64]| PhaseGate::new(markers, &frames(), 0.3, 0.0).unwrap_err().to_string();
        assert!(refused(&[1.0, 4.0, 7.0, 10.0]).contains("4 markers"), "{}", refused(&[1.0, 4.0, 7.0, 10.0]));
        assert!(refused(&[]).contains("0 markers"));
        let irregular = refused(&[0.0, 1.0, 4.0, 5.0, 12.0, 13.0, 17.0, 17.5]);
        assert!(irregular.contains("irregular") && irregular.contains("of 7 periods"), "{irregular}");
        assert!(refused(&[1.0, f64::NAN, 4.0, 7.0, 10.0, 13.0]).contains("irregular"));
    }
}
