//! Which of a device's stamps tell its times best.
//!
//! A frame or a pose comes with the time that its source gives it, perhaps filtered; often with the raw time of receipt, and with a number by which the device counts. What is
//! filtered follows a jump only slowly, what is raw has every delay in it, and a number keeps pace where the device's own clock is even and it counts what it loses. Which of them
//! is true the signals themselves tell: by which they agree. Whichever it is, a lag is the mean one of the given stamps, as these are what pictures and poses are paired by.

use serde::Serialize;

/// What is known of when something was measured.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Stamps {
    /// By the source, s.
    pub given_s: f64,
    /// When it was received, s.
    pub raw_s: Option<f64>,
    /// The device's own count.
    pub number: Option<u64>,
}

/// A way to read stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reading {
    /// As the source gives them.
    Given,
    /// When they were received.
    Raw,
    /// By the device's count, evenly.
    Counted,
}

impl Reading {
    /// All, the plainest first.
    pub const ALL: [Self; 3] = [Self::Given, Self::Raw, Self::Counted];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Given => "stamps as given",
            Self::Raw => "unfiltered stamps",
            Self::Counted => "the device's own count",
        }
    }

    /// The times of all, s, their mean that of the given ones; `None` where the stamps do not hold them all, or they are the given ones again.
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

/// How far given stamps wander about times: standard deviation, s.
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
    fn counts_give_even_times_with_the_given_mean() {
        let stamps = stamps(true, true);
        let times = Reading::Counted.times(&stamps).unwrap();
        let mean = times.iter().zip(&stamps).map(|(t, s)| t - s.given_s).sum::<f64>() / 30.0;
        assert!(mean.abs() < 1e-12, "{mean}");
        // A frame was lost, and counted.
        assert!((times[11] - times[10] - 2.0 * (times[1] - times[0])).abs() < 1e-12);
        assert!((times[1] - times[0] - 0.1).abs() < 2e-4 && wander(&stamps, &times) < 2e-3);
    }

    #[test]
    fn what_is_not_there_or_nothing_new_is_no_reading() {
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
