//! Replay pace of a recording.

use std::sync::Arc;

use sonoweave_core::clock::{Clock, Monotonic};

/// The pace of a replay.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Pace {
    /// Without delay: the consumer sets the pace.
    #[default]
    Unpaced,
    /// Speed factor relative to the recording; 1 is real time.
    Factor(f64),
}

/// Delays a recording's items until their time has come.
#[derive(Debug)]
pub struct Pacer {
    pace: Pace,
    clock: Arc<dyn Clock>,
    /// Host and recorded time of the first item, ns.
    began: Option<[i64; 2]>,
    /// Recorded time of the last item, ns. An item recorded before it is not delayed.
    last_ns: i64,
}

impl Pacer {
    /// Creates a pacer on the host's clock.
    pub fn new(pace: Pace) -> Self {
        Self::by(pace, Arc::new(Monotonic))
    }

    /// Creates a pacer on any clock. An invalid factor (not above 0, not finite) means unpaced.
    pub fn by(pace: Pace, clock: Arc<dyn Clock>) -> Self {
        let pace = match pace {
            Pace::Factor(factor) if !(factor.is_finite() && factor > 0.0) => Pace::Unpaced,
            pace => pace,
        };
        Self { pace, clock, began: None, last_ns: i64::MIN }
    }

    /// Restarts at the first item.
    pub fn rewind(&mut self) {
        (self.began, self.last_ns) = (None, i64::MIN);
    }

    /// Waits for the time of an item, in recorded ns, but no longer than the deadline (host
    /// ns). Returns whether the time has come. After true, do not ask for the same item again.
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
    use sonoweave_core::clock::{MS, Manual, SECOND};

    #[test]
    fn items_are_due_at_scaled_times() {
        for factor in [0.5, 1.0, 4.0] {
            let clock = Manual::at(77 * SECOND);
            let mut pacer = Pacer::by(Pace::Factor(factor), Arc::new(clock.clone()));
            for item in 0..50 {
                // An item with an earlier recorded time is due together with its predecessor.
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
    fn unpaced_or_untimed_item_is_due_at_once() {
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
