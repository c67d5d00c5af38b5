//! A unit's own count of its frames: what was lost, and which counts cannot be.

use crate::clock::SECOND;

/// A count below this that does not follow the one before begins a count.
const NEW: u32 = 10;

/// What a count says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Counted {
    /// It follows the last one; so many are missing between.
    Next(u32),
    /// A count begins.
    First,
    /// It is not where the count can be by now: the number was harmed, or the unit has begun to count elsewhere, which the next will tell.
    Doubtful,
}

/// Follows one station's count.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counter {
    last: Option<(u32, i64)>,
    doubt: Option<u32>,
    first: u32,
}

impl Counter {
    /// The count of a frame received at a time, of a unit with so many frames a second.
    pub(super) fn count(&mut self, count: u32, at_ns: i64, hz: f64) -> Counted {
        let Some((last, last_ns)) = self.last else {
            *self = Self { last: Some((count, at_ns)), doubt: None, first: count };
            return Counted::First;
        };
        // Half a second for what waited in buffers, and a clock that is off by 1 in 100.
        let waited = hz / 2.0 + 1.0;
        let possible = (1.01 * hz * ((at_ns - last_ns).max(0) as f64 / SECOND as f64) + waited) as u32;
        let follows =
            |before: u32, most: u32| Some(count.wrapping_sub(before)).filter(|ahead| (1..=most).contains(ahead));
        if let Some(ahead) = follows(last, possible) {
            (self.last, self.doubt) = (Some((count, at_ns)), None);
            return Counted::Next(ahead - 1);
        }
        if count < NEW {
            *self = Self { last: Some((count, at_ns)), doubt: None, first: count };
            return Counted::First;
        }
        if let Some(ahead) = self.doubt.and_then(|doubt| follows(doubt, waited as u32)) {
            (self.last, self.doubt) = (Some((count, at_ns)), None);
            // The one that was in doubt was not delivered either.
            return Counted::Next(ahead);
        }
        self.doubt = Some(count);
        Counted::Doubtful
    }

    /// Frames since the count began.
    pub(super) fn since_first(&self) -> u32 {
        self.last.map_or(0, |(last, _)| last.wrapping_sub(self.first))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::MS;

    /// What a sequence of counts, 4 ms apart, says at 250 frames a second.
    fn said(counts: &[u32]) -> Vec<Counted> {
        let mut counter = Counter::default();
        counts.iter().zip(0..).map(|(count, n)| counter.count(*count, n * 4 * MS, 250.0)).collect()
    }

    #[test]
    fn gaps_are_counted_across_the_wrap() {
        use Counted::{First, Next};
        assert_eq!(said(&[u32::MAX - 1, u32::MAX, 0, 1, 5, 6]), [First, Next(0), Next(0), Next(0), Next(3), Next(0)]);
    }

    #[test]
    fn a_harmed_count_is_in_doubt_and_missing_afterwards() {
        use Counted::{Doubtful, First, Next};
        assert_eq!(said(&[100, 101, 0x0100_0066, 103, 104]), [First, Next(0), Doubtful, Next(1), Next(0)]);
        assert_eq!(said(&[100, 101, 101, 102]), [First, Next(0), Doubtful, Next(0)], "the same again is none");
    }

    #[test]
    fn a_count_that_begins_elsewhere_is_believed_the_second_time() {
        use Counted::{Doubtful, First, Next};
        assert_eq!(said(&[5000, 5001, 700, 701, 702]), [First, Next(0), Doubtful, Next(1), Next(0)]);
        assert_eq!(said(&[5000, 5001, 0, 1]), [First, Next(0), First, Next(0)], "from 0 at once");
    }

    #[test]
    fn a_long_gap_is_one_only_if_there_was_time_for_it() {
        let mut counter = Counter::default();
        counter.count(100, 0, 250.0);
        assert_eq!(counter.count(1100, 10 * MS, 250.0), Counted::Doubtful);
        assert_eq!(counter.count(1102, 4 * SECOND, 250.0), Counted::Next(1001));
    }
}
