//! How long things take, in a fixed number of bytes however long a session lasts.

use hdrhistogram::Histogram;
use serde::{Serialize, Serializer};

/// The longest time that is told from others, ns: ten minutes.
const LONGEST: u64 = 600_000_000_000;

/// Times, to a part in a hundred. Serialised as their [`Quantiles`], `null` where there are none.
#[derive(Debug, Clone)]
pub struct Spread {
    /// Of times in ns; `None` where the histogram could not be made, which its constants exclude.
    times: Option<Histogram<u64>>,
    /// All together, ns, exact.
    total_ns: u64,
}

/// Quantiles of times, ms.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quantiles {
    /// How many times there are.
    pub count: u64,
    /// Half of them are at most this.
    pub median_ms: f64,
    /// 99 in 100 are at most this.
    pub p99_ms: f64,
    /// The longest.
    pub most_ms: f64,
}

impl Default for Spread {
    fn default() -> Self {
        Self { times: Histogram::new_with_bounds(1_000, LONGEST, 2).ok(), total_ns: 0 }
    }
}

impl Spread {
    /// One more; what is negative counts as none, what is longer than ten minutes as those.
    pub fn add_ns(&mut self, ns: i64) {
        if let Some(times) = &mut self.times {
            let ns = u64::try_from(ns).unwrap_or(0).min(LONGEST);
            times.saturating_record(ns);
            self.total_ns = self.total_ns.saturating_add(ns);
        }
    }

    /// Becomes another's equal; no memory is asked for.
    pub fn set_to(&mut self, other: &Self) {
        if let (Some(times), Some(others)) = (&mut self.times, &other.times)
            && times.set_to(others).is_ok()
        {
            self.total_ns = other.total_ns;
        }
    }

    /// How many times there are.
    pub fn count(&self) -> u64 {
        self.times.as_ref().map_or(0, Histogram::len)
    }

    /// How many are at most so long, ns, to the hundredth part that times are told apart by.
    pub fn at_most(&self, ns: u64) -> u64 {
        self.times.as_ref().map_or(0, |times| times.count_between(0, ns))
    }

    /// All together, s.
    pub fn total_s(&self) -> f64 {
        self.total_ns as f64 / 1e9
    }

    /// `None` where there are no times.
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
    fn quantiles_are_right_to_a_part_in_a_hundred() {
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
