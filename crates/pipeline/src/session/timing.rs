//! Distributions of durations, in constant memory however long a session lasts.

use hdrhistogram::Histogram;
use serde::{Serialize, Serializer};

/// Longest distinguishable time, ns: ten minutes.
const LONGEST: u64 = 600_000_000_000;

/// Durations, to a part in a hundred. Serialised as their [`Quantiles`], `null` if empty.
#[derive(Debug, Clone)]
pub struct Spread {
    /// Histogram of times in ns; `None` if it could not be made, which its constants exclude.
    times: Option<Histogram<u64>>,
    /// Sum, ns, exact.
    total_ns: u64,
}

/// Quantiles of durations, ms.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quantiles {
    /// Number of durations.
    pub count: u64,
    /// Median.
    pub median_ms: f64,
    /// 99th percentile.
    pub p99_ms: f64,
    /// Maximum.
    pub most_ms: f64,
}

impl Default for Spread {
    fn default() -> Self {
        Self { times: Histogram::new_with_bounds(1_000, LONGEST, 2).ok(), total_ns: 0 }
    }
}

impl Spread {
    /// Adds a duration; negative values count as 0, longer ones as ten minutes.
    pub fn add_ns(&mut self, ns: i64) {
        if let Some(times) = &mut self.times {
            let ns = u64::try_from(ns).unwrap_or(0).min(LONGEST);
            times.saturating_record(ns);
            self.total_ns = self.total_ns.saturating_add(ns);
        }
    }

    /// Copies another's content without allocation.
    pub fn set_to(&mut self, other: &Self) {
        if let (Some(times), Some(others)) = (&mut self.times, &other.times)
            && times.set_to(others).is_ok()
        {
            self.total_ns = other.total_ns;
        }
    }

    /// Returns the number of durations.
    pub fn count(&self) -> u64 {
        self.times.as_ref().map_or(0, Histogram::len)
    }

    /// Returns the number of durations up to `ns`, within the resolution of a part in a hundred.
    pub fn at_most(&self, ns: u64) -> u64 {
        self.times.as_ref().map_or(0, |times| times.count_between(0, ns))
    }

    /// Returns the sum, s.
    pub fn total_s(&self) -> f64 {
        self.total_ns as f64 / 1e9
    }

    /// Returns the quantiles; `None` if empty.
    pub fn quantiles(&self) -> Option<Quantiles> {
        let times = self.times.as_ref().filter(|times| !times.is_empty())?;
        let ms = |ns: u64| ns as f64 / 1e6;
        Some(Quantiles {
            count: times.len(),
            median_ms: ms(times.value_at_quantile(0.5)),
            p99_ms: ms(times.value_at_quantile(0.99)),
            most_ms: ms(times.max()),
        })
    }
}

impl Serialize for Spread {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        self.quantiles().serialize(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_accurate_to_one_percent() {
        let mut spread = Spread::default();
        assert_eq!(spread.quantiles(), None);
        for us in 1..=10_000 {
            spread.add_ns(us * 1000);
        }
        let of = spread.quantiles().unwrap();
        assert_eq!(of.count, 10_000);
        for (found, exact) in [(of.median_ms, 5.0), (of.p99_ms, 9.9), (of.most_ms, 10.0)] {
            assert!((found / exact - 1.0).abs() < 0.011, "{found} for {exact}");
        }
        let half = spread.at_most(5_000_000);
        assert!(half.abs_diff(5_000) <= 50, "{half}");
        assert_eq!((spread.at_most(0), spread.at_most(LONGEST), spread.count()), (0, 10_000, 10_000));
        assert!((spread.total_s() - 50.005).abs() < 1e-9, "{}", spread.total_s());
        let mut other = Spread::default();
        other.add_ns(7);
        other.set_to(&spread);
        assert_eq!((other.quantiles(), other.total_s()), (spread.quantiles(), spread.total_s()));
        assert_eq!(serde_json::to_value(&spread).unwrap(), serde_json::to_value(of).unwrap());
        spread.add_ns(-5);
        spread.add_ns(i64::MAX);
        assert!(spread.quantiles().unwrap().most_ms >= 590_000.0);
    }
}
