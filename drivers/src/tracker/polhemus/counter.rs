//! A unit's own frame count: finds lost frames and implausible counts.

use sonoweave_core::clock::SECOND;

/// A count below this that does not follow the previous one starts a new sequence.
const NEW: u32 = 10;

/// Result of checking a count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Counted {
    /// The count follows the previous one, with this many missing between.
    Next(u32),
    /// A new sequence starts.
    First,
    /// The count is implausible for its time: it is corrupted, or the unit started a new
    /// sequence. The next count decides.
    Doubtful,
}

/// Checks the frame count of one station.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counter {
    last: Option<(u32, i64)>,
    doubt: Option<u32>,
    first: u32,
}

impl Counter {
    /// Checks the count of a frame received at `at_ns`, at `hz` frames per second.
    pub(super) fn count(&mut self, count: u32, at_ns: i64, hz: f64) -> Counted {
        let Some((last, last_ns)) = self.last else {
            *self = Self { last: Some((count, at_ns)), doubt: None, first: count };
            return Counted::First;
        };
        // Allows half a second for buffering, and a clock error of 1 %.
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
            // The doubtful frame was not delivered either.
            return Counted::Next(ahead);
        }
        self.doubt = Some(count);
        Counted::Doubtful
    }

    /// Returns the number of frames since the sequence started.
    pub(super) fn since_first(&self) -> u32 {
        self.last.map_or(0, |(last, _)| last.wrapping_sub(self.first))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sonoweave_core::clock::MS;

    /// Returns the results for a sequence of counts, 4 ms apart, at 250 frames per second.
    fn counted(counts: &[u32]) -> Vec<Counted> {
        let mut counter = Counter::default();
        counts.iter().zip(0..).map(|(count, n)| counter.count(*count, n * 4 * MS, 250.0)).collect()
    }

    #[test]
    fn gaps_across_wrap_are_counted() {
        use Counted::{First, Next};
        assert_eq!(
            counted(&[u32::MAX - 1, u32::MAX, 0, 1, 5, 6]),
            [First, Next(0), Next(0), Next(0), Next(3), Next(0)]
        );
    }

    #[test]
    fn corrupted_count_is_doubtful_then_missing() {
        use Counted::{Doubtful, First, Next};
        assert_eq!(counted(&[100, 101, 0x0100_0066, 103, 104]), [First, Next(0), Doubtful, Next(1), Next(0)]);
        assert_eq!(counted(&[100, 101, 101, 102]), [First, Next(0), Doubtful, Next(0)], "the same again is none");
    }

    #[test]
    fn new_sequence_is_accepted_at_second_count() {
        use Counted::{Doubtful, First, Next};
        assert_eq!(counted(&[5000, 5001, 700, 701, 702]), [First, Next(0), Doubtful, Next(1), Next(0)]);
        assert_eq!(counted(&[5000, 5001, 0, 1]), [First, Next(0), First, Next(0)], "from 0 at once");
    }

    #[test]
    fn long_gap_is_accepted_only_after_enough_time() {
        let mut counter = Counter::default();
        counter.count(100, 0, 250.0);
        assert_eq!(counter.count(1100, 10 * MS, 250.0), Counted::Doubtful);
        assert_eq!(counter.count(1102, 4 * SECOND, 250.0), Counted::Next(1001));
    }
}
