//! How long a tick takes, where nobody says or what is said may be wrong: by the first records.

use drivers::Ticks;

use super::settings::UNKNOWN_PPM;
use super::{ClockMap, Origin, Sample, limit_ppb};

/// Samples by which a rate is told that nobody said.
pub(super) const BOOTSTRAP: usize = 16;
/// Times between ticks that a device may have, ns.
const PERIODS_NS: std::ops::RangeInclusive<f64> = 1.0..=2e9;
/// A rate that is told must be so near to what the first records say to be believed.
const NEAR: f64 = 0.25;
/// A rate that nobody told must be seen for so long, ns: what has lain in a buffer comes at a rate that is none of the device's.
const SEEN_NS: i64 = 500_000_000;

impl ClockMap {
    /// Whether there is an origin now: where the rate is known, or enough has come to tell it.
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
            // All at once, or a count that stands or goes back: they say nothing.
            self.waiting.clear();
            return false;
        }
        let measured = passed as f64 / ticks as f64;
        if !PERIODS_NS.contains(&measured) {
            self.waiting.clear();
            return false;
        }
        let near = |a: f64, b: f64| (a / b - 1.0).abs() < NEAR;
        // Where some were held back or lost, most of them still come one period after another.
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
                // Whatever was said of how exact the rate is was said of another one.
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

    /// The median time from tick to tick among those that wait, ns.
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
