//! Calendar days.

use std::fmt;
use std::time::{SystemTime, UNIX_EPOCH};

/// A day of the Gregorian calendar.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Date {
    days: i64,
}

impl Date {
    /// Returns the day this many days after 1 January 1970.
    pub fn since_1970(days: i64) -> Self {
        Self { days }
    }

    /// Returns the current day by this machine's clock, in universal time.
    pub fn today() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { days: i64::try_from(since.as_secs() / 86_400).unwrap_or(i64::MAX) }
    }

    /// Returns the days from an earlier day to this one.
    pub fn days_since(self, earlier: Self) -> i64 {
        self.days - earlier.days
    }

    /// Parses `YYYY-MM-DD`; `None` for text that is no day, such as 30 February.
    pub fn parse(text: &str) -> Option<Self> {
        let mut parts = text.split('-');
        let [year, month, day] = [4, 2, 2].map(|digits| {
            let part = parts.next().filter(|part| part.len() == digits && part.bytes().all(|b| b.is_ascii_digit()))?;
            part.parse::<i64>().ok()
        });
        let (None, year, month, day) = (parts.next(), year?, month?, day?) else { return None };
        let date = Self { days: days(year, month, day) };
        ((1..=12).contains(&month) && date.parts() == [year, month, day]).then_some(date)
    }

    fn parts(self) -> [i64; 3] {
        // Starts from a year that is not too late: the division takes years after 1970 as too
        // long and those before it as too short. The loops are cheap enough, because dates are
        // read seldom.
        let mut year = 1970 + self.days.div_euclid(if self.days < 0 { 365 } else { 366 });
        while days(year + 1, 1, 1) <= self.days {
            year += 1;
        }
        let month = (1..=12).rev().find(|month| days(year, *month, 1) <= self.days).unwrap_or(1);
        [year, month, self.days - days(year, month, 1) + 1]
    }
}

impl fmt::Display for Date {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [year, month, day] = self.parts();
        write!(f, "{year:04}-{month:02}-{day:02}")
    }
}

/// Returns the days from 1 January 1970 to a day.
fn days(year: i64, month: i64, day: i64) -> i64 {
    // Years begin in March, so that the leap day is the last day.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let leaps = year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    365 * year + leaps + (153 * month + 2) / 5 + day - 1 - 719_468
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn invalid_days_are_refused() {
        for text in [
            "2026-02-29",
            "2026-13-01",
            "2026-00-10",
            "2026-1-1",
            "26-01-01",
            "2026-01-01-1",
            "",
            "2026-11-31",
            "1900-02-29",
        ] {
            assert_eq!(Date::parse(text), None, "{text}");
        }
        assert_eq!(Date::parse("1970-01-01"), Some(Date::since_1970(0)));
        assert_eq!(Date::parse("2000-03-01"), Some(Date::since_1970(11_017)));
        assert_eq!(Date::since_1970(20_779).to_string(), "2026-11-22");
    }

    proptest! {
        #[test]
        fn written_day_is_read_back(days in -700_000_i64..2_900_000) {
            let date = Date::since_1970(days);
            prop_assert_eq!(Date::parse(&date.to_string()), Some(date));
        }
    }
}
