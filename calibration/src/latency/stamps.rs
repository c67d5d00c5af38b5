//! Chooses the most accurate of a device's stamps.
//!
//! A frame or a pose has the time given by its source, possibly filtered. Often it also has the
//! raw time of receipt and the device's own count. Filtered stamps follow a jump only slowly,
//! and raw stamps contain every delay. Counts are accurate if the device's clock is even and it
//! counts lost items. The signals themselves decide: the stamps at which they agree best are
//! used. In any case the lag is the mean lag of the given stamps, because frames and poses are
//! paired by these.

use serde::Serialize;

/// The stamps of a measurement.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Stamps {
    /// Time given by the source, s.
    pub given_s: f64,
    /// Time of receipt, s.
    pub raw_s: Option<f64>,
    /// The device's own count.
    pub number: Option<u64>,
}

/// A way to read stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reading {
    /// The source's stamps.
    Given,
    /// The times of receipt.
    Raw,
    /// Even times from the device's count.
    Counted,
}

impl Reading {
    /// All readings, the simplest first.
    pub const ALL: [Self; 3] = [Self::Given, Self::Raw, Self::Counted];

    /// Returns a description for people.
    pub fn words(self) -> &'static str {
        match self {
            Self::Given => "stamps as given",
            Self::Raw => "unfiltered stamps",
            Self::Counted => "the device's own count",
        }
    }

    /// Returns all times, s, with the mean of the given stamps. `None` if stamps are missing,
    /// or if the result equals the given ones.
    pub fn times(self, stamps: &[Stamps]) -> Option<Vec<f64>> {
        let given = || stamps.iter().map(|stamp| stamp.given_s);
        let first = given().next()?;
        let times: Vec<f64> = match self {
            Self::Given => return Some(given().collect()),
            Self::Raw => stamps.iter().map(|stamp| stamp.raw_s).collect::<Option<_>>()?,
            Self::Counted => {
                let numbers: Vec<u64> = stamps.iter().map(|stamp| stamp.number).collect::<Option<_>>()?;
                if !numbers.windows(2).all(|two| two[0] < two[1]) {
                    return None;
                }
                let counts: Vec<f64> = numbers.iter().map(|number| (number - numbers[0]) as f64).collect();
                let raw = stamps.iter().map(|stamp| stamp.raw_s.unwrap_or(stamp.given_s) - first).collect::<Vec<_>>();
                let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
                let (middle, time) = (mean(&counts), mean(&raw));
                let square: f64 = counts.iter().map(|c| (c - middle).powi(2)).sum();
                let period = counts.iter().zip(&raw).map(|(c, t)| (c - middle) * (t - time)).sum::<f64>() / square;
                if !(period.is_finite() && period > 0.0) {
                    return None;
                }
                counts.iter().map(|count| first + time + period * (count - middle)).collect()
            }
        };
        let off = times.iter().zip(given()).map(|(time, given)| given - time).sum::<f64>() / times.len() as f64;
        let same = times.iter().zip(given()).all(|(time, given)| (time + off - given).abs() < 1e-9);
        (off.is_finite() && !same).then(|| times.into_iter().map(|time| time + off).collect())
    }
}

/// Returns the standard deviation of the given stamps about these times, s.
pub(super) fn wander(stamps: &[Stamps], times: &[f64]) -> f64 {
    let squares = stamps.iter().zip(times).map(|(stamp, time)| (stamp.given_s - time).powi(2)).sum::<f64>();
    (squares / times.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamps(raw: bool, counted: bool) -> Vec<Stamps> {
        let of = |i: u32| {
            let (time, lost) = (0.1 * f64::from(i), u64::from(i > 10));
            let raw_s = raw.then_some(5.0 + time + 0.1 * lost as f64 + if i % 7 == 3 { 0.03 } else { 0.0 });
            Stamps {
                given_s: 5.0 + time + 0.1 * lost as f64,
                raw_s,
                number: counted.then_some(u64::from(i) + 40 + lost),
            }
        };
        (0..30).map(of).collect()
    }

    #[test]
    fn counts_give_even_times_with_given_mean() {
        let stamps = stamps(true, true);
        let times = Reading::Counted.times(&stamps).unwrap();
        let mean = times.iter().zip(&stamps).map(|(t, s)| t - s.given_s).sum::<f64>() / 30.0;
        assert!(mean.abs() < 1e-12, "{mean}");
        // A lost frame was counted.
        assert!((times[11] - times[10] - 2.0 * (times[1] - times[0])).abs() < 1e-12);
        assert!((times[1] - times[0] - 0.1).abs() < 2e-4 && wander(&stamps, &times) < 2e-3);
    }

    #[test]
    fn missing_or_identical_stamps_give_no_reading() {
        assert!(Reading::Raw.times(&stamps(false, true)).is_none());
        assert!(Reading::Counted.times(&stamps(true, false)).is_none());
        let mut back = stamps(true, true);
        back[4].number = Some(1);
        assert!(Reading::Counted.times(&back).is_none());
        let even: Vec<Stamps> =
            (0..9).map(|i| Stamps { given_s: f64::from(i), raw_s: Some(f64::from(i) + 7.0), number: None }).collect();
        assert!(Reading::Raw.times(&even).is_none(), "the same but for a constant");
        assert_eq!(Reading::Given.times(&even).unwrap()[3], 3.0);
    }
}
