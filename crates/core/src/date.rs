//! Calendar days, and seconds of them.

use std::fmt;

use chrono::{DateTime, Datelike as _, NaiveDate, NaiveDateTime, TimeDelta, Timelike as _, Utc};

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

/// A second of the Gregorian calendar, in an unknown time zone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Second(NaiveDateTime);

/// Fourteen digits: year, month, day, hour, minute, second.
const DIGITS: &str = "%Y%m%d%H%M%S";

impl Second {
    /// Parses fourteen digits, `YYYYMMDDhhmmss`; `None` for text that is no date and time.
    pub fn parse(text: &str) -> Option<Self> {
        let parsed = NaiveDateTime::parse_from_str(text, DIGITS).ok().map(Self)?;
        // chrono reads a leap second as more than a second's nanoseconds.
        let is_leap = parsed.0.nanosecond() != 0;
        (parsed.to_string() == text && parsed.0.year() >= 1 && !is_leap).then_some(parsed)
    }

    /// Returns the second of a time in nanoseconds since 1970, in universal time.
    pub fn of_unix_ns(ns: i64) -> Self {
        Self(DateTime::from_timestamp(ns.div_euclid(1_000_000_000), 0).unwrap_or_default().naive_utc())
    }

    /// Returns the whole seconds since 1970.
    pub fn unix_s(self) -> i64 {
        self.0.and_utc().timestamp()
    }

    /// Returns the time that is so many seconds earlier; `None` before the year 1.
    pub fn earlier_by(self, seconds: i64) -> Option<Self> {
        let earlier = self.0.checked_sub_signed(TimeDelta::try_seconds(seconds)?)?;
        (earlier.year() >= 1).then_some(Self(earlier))
    }
}

impl fmt::Display for Second {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.format(DIGITS).fmt(f)
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
    fn seconds_are_read_back_and_moved() {
        let second = Second::parse("20240301000005").unwrap();
        assert_eq!(second.earlier_by(10).unwrap().to_string(), "20240229235955");
        assert_eq!(Second::of_unix_ns(second.unix_s() * 1_000_000_000 + 7), second);
        assert!(Second::parse("00010101000000").unwrap().earlier_by(1).is_none());
        for text in ["20240230000000", "2024030100000", "20240301000060", "20240301 00000", "00000101000000", ""] {
            assert_eq!(Second::parse(text), None, "{text}");
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
