//! Calendar days.

use std::fmt;

use chrono::{NaiveDate, Utc};

/// A day of the Gregorian calendar.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Date(NaiveDate);

impl Date {
    /// Returns the current day by this machine's clock, in universal time.
    pub fn today() -> Self {
        Self(Utc::now().date_naive())
    }

    /// Returns the days from an earlier day to this one.
    pub fn days_since(self, earlier: Self) -> i64 {
        (self.0 - earlier.0).num_days()
    }

    /// Parses `YYYY-MM-DD`; `None` for text that is no day, such as 30 February.
    pub fn parse(text: &str) -> Option<Self> {
        // chrono also reads 2026-1-1 and spaces.
        text.parse().ok().map(Self).filter(|date| date.to_string() == text)
    }
}

impl fmt::Display for Date {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_days_are_refused() {
        for text in [
            "2026-02-29",
            "2026-13-01",
            "2026-00-10",
            "2026-1-1",
            " 2026-01-01",
            "+2026-01-01",
            "12026-01-01",
            "26-01-01",
            "2026-01-01-1",
            "",
            "2026-11-31",
            "1900-02-29",
        ] {
            assert_eq!(Date::parse(text), None, "{text}");
        }
    }

    #[test]
    fn days_are_counted_and_read_back() {
        let day = |text| Date::parse(text).unwrap();
        assert_eq!(day("2000-03-01").days_since(day("1970-01-01")), 11_017);
        assert_eq!(day("1969-12-31").days_since(day("1970-01-01")), -1);
        assert_eq!(day("0001-01-01").to_string(), "0001-01-01");
    }
}
