//! How fast a recording goes by.

use std::sync::Arc;

use crate::clock::{Clock, Monotonic};

/// The pace of a replay.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Pace {
    /// As fast as it is asked for.
    #[default]
    Unpaced,
    /// So many times as fast as it was recorded; 1 is its own pace.
    Factor(f64),
}

/// Holds a recording's items back until their time has come.
#[derive(Debug)]
pub struct Pacer {
    pace: Pace,
    clock: Arc<dyn Clock>,
    /// Host and recorded time of the first item.
    began: Option<[i64; 2]>,
    /// Recorded time of the last item: one that was recorded before it waits for nothing.
    last_ns: i64,
}

impl Pacer {
    /// Of the host's clock.
    pub fn new(pace: Pace) -> Self {
        Self::by(pace, Arc::new(Monotonic))
    }

    /// Of any clock. A factor that is none (not above 0, not finite) counts as no pace.
    pub fn by(pace: Pace, clock: Arc<dyn Clock>) -> Self {
        let pace = match pace {
            Pace::Factor(factor) if !(factor.is_finite() && factor > 0.0) => Pace::Unpaced,
            pace => pace,
        };
        Self { pace, clock, began: None, last_ns: i64::MIN }
    }

    /// From the first item again.
    pub fn rewind(&mut self) {
        (self.began, self.last_ns) = (None, i64::MIN);
    }

    /// Waits for the time of an item, given in recorded ns, but no longer than the deadline (host ns). Whether the time has come; once it has, this item is not to be
    /// asked for again.
    pub fn is_due(&mut self, recorded_ns: Option<i64>, deadline_ns: i64) -> bool {
        let (Pace::Factor(factor), Some(recorded_ns)) = (self.pace, recorded_ns) else { return true };
        let recorded_ns = recorded_ns.max(self.last_ns);
        let now_ns = self.clock.now_ns();
        let [host, first] = *self.began.get_or_insert([now_ns, recorded_ns]);
        let due_ns = host.saturating_add((recorded_ns.saturating_sub(first) as f64 / factor) as i64);
        if due_ns > deadline_ns {
            self.clock.wait_until(deadline_ns);
            return false;
        }
        if due_ns > now_ns {
            self.clock.wait_until(due_ns);
        }
        self.last_ns = recorded_ns;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{MS, Manual, SECOND};

    #[test]
    fn items_come_at_their_times_divided_by_the_factor_and_no_later_than_deadlines() {
        for factor in [0.5, 1.0, 4.0] {
            let clock = Manual::at(77 * SECOND);
            let mut pacer = Pacer::by(Pace::Factor(factor), Arc::new(clock.clone()));
            for item in 0..50 {
                // One recorded before its predecessor comes with it.
                let recorded = 5 * SECOND + if item == 20 { 0 } else { item * 30 * MS };
                let mut tries = 0;
                while !pacer.is_due(Some(recorded), clock.now_ns() + 10 * MS) {
                    tries += 1;
                    assert!(tries < 13);
                }
                let expected = 77 * SECOND + ((if item == 20 { 19 } else { item }) as f64 * 30e6 / factor) as i64;
                assert_eq!(clock.now_ns(), expected, "{item} at {factor}");
            }
            pacer.rewind();
            assert!(pacer.is_due(Some(5 * SECOND), clock.now_ns()));
        }
    }

    #[test]
    fn without_a_pace_or_a_time_nothing_waits() {
        let clock = Manual::at(0);
        for pace in [Pace::Unpaced, Pace::Factor(0.0), Pace::Factor(f64::NAN)] {
            let mut pacer = Pacer::by(pace, Arc::new(clock.clone()));
            assert!((0..9).all(|n| pacer.is_due(Some(n * SECOND), 0)));
        }
        let mut pacer = Pacer::by(Pace::Factor(1.0), Arc::new(clock.clone()));
        assert!(pacer.is_due(None, 0) && pacer.is_due(None, 0));
        assert_eq!(clock.now_ns(), 0);
    }
}
