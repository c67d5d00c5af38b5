//! Determines the duration of a tick from the first records, if the device gives none or
//! possibly a wrong one.

use sonoweave_core::Ticks;

use super::settings::{LONGEST_NS, UNKNOWN_PPM};
use super::{BOOTSTRAP, ClockMap, Origin, Sample, limit_ppb};

/// Accepted times between ticks, ns.
const PERIODS_NS: std::ops::RangeInclusive<f64> = 1.0..=LONGEST_NS;
/// A given rate is accepted if it differs from that of the first records by less than this
/// fraction.
const NEAR: f64 = 0.25;
/// Time for which an unknown rate must be observed, ns: buffered records arrive at a rate
/// unrelated to the device's.
const SEEN_NS: i64 = 500_000_000;

impl ClockMap {
    /// Determines the origin if the rate is known or enough samples have arrived; returns
    /// whether there is one now.
    pub(super) fn know_rate(&mut self, sample: Sample) -> bool {
        let nominal = self.settings.tick_hz.map(|hz| 1e9 / hz);
        if self.settings.ticks != Ticks::None
            && let Some(period) = nominal
        {
            self.set_origin(sample, period);
            return true;
        }
        self.waiting.push(sample);
        self.last = Some(sample);
        if self.waiting.len() < BOOTSTRAP {
            return false;
        }
        let (first, last) = (self.waiting[0], sample);
        let (ticks, passed) = (last.0.saturating_sub(first.0), last.1.saturating_sub(first.1));
        if ticks <= 0 || passed <= 0 {
            // All at once, or a count that is static or decreases: the samples carry no
            // information.
            self.waiting.clear();
            return false;
        }
        let measured = passed as f64 / ticks as f64;
        if !PERIODS_NS.contains(&measured) {
            self.waiting.clear();
            return false;
        }
        let near = |a: f64, b: f64| (a / b - 1.0).abs() < NEAR;
        // If some were held back or lost, most still arrive one period apart.
        let usual = self.usual_period();
        let period = match nominal.filter(|nominal| near(measured, *nominal) || near(usual, *nominal)) {
            Some(nominal) => nominal,
            None => {
                let since_ns = self.seen.filter(|(seen, _)| near(measured, *seen)).map_or(first.1, |(_, since)| since);
                self.seen = Some((measured, since_ns));
                if last.1.saturating_sub(since_ns) < SEEN_NS {
                    self.waiting.clear();
                    return false;
                }
                // The given accuracy applied to the wrong rate.
                self.envelope.clear(limit_ppb(UNKNOWN_PPM));
                measured
            }
        };
        self.seen = None;
        self.set_origin(first, period);
        self.last = None;
        if self.settings.ticks != Ticks::None {
            let waiting = std::mem::take(&mut self.waiting);
            for sample in &waiting[..waiting.len() - 1] {
                self.fit(*sample);
            }
            self.waiting = waiting;
        }
        true
    }

    /// Median time from tick to tick among the waiting samples, ns.
    fn usual_period(&self) -> f64 {
        let mut periods = [f64::INFINITY; BOOTSTRAP - 1];
        for (period, pair) in periods.iter_mut().zip(self.waiting.windows(2)) {
            *period = pair[1].1.saturating_sub(pair[0].1) as f64 / pair[1].0.saturating_sub(pair[0].0).max(1) as f64;
        }
        periods.sort_unstable_by(f64::total_cmp);
        periods[(BOOTSTRAP - 1) / 2]
    }

    fn set_origin(&mut self, sample: Sample, period_ns: f64) {
        let period_q32 = (period_ns * 4_294_967_296.0).round() as i64;
        self.origin = Some(Origin { tick: sample.0, time_ns: sample.1, period_q32: period_q32.max(1) });
    }
}
