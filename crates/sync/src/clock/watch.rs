//! Reliability of a clock, from the times of timely samples.

use super::envelope::{BAND_NS, ClockUncertainty, KEPT, UNKNOWN_NS};
use super::mapping::State;

/// Largest bound at which a clock locks, ns.
pub(super) const LOCK_NS: i64 = 20_000_000;
/// Bound above which a locked clock unlocks, ns.
pub(super) const UNLOCK_NS: i64 = 40_000_000;
/// Time without a timely sample after which a clock is in holdover, ns.
pub(super) const HOLD_NS: i64 = 1_000_000_000;
/// Time of timely samples after which holdover ends, ns.
pub(super) const RELOCK_NS: i64 = 500_000_000;
/// Time without any sample after which a clock is lost, ns. It is also lost if its bound
/// exceeds twice that of an unknown clock.
pub(super) const LOST_NS: i64 = 60_000_000_000;
/// Drift of crystals beyond the fitted rate, parts in 10⁹ of the unobserved time.
pub(super) const WANDER_PPB: i64 = 1_000;
/// Time of late samples without a timely one after which their least delay may be a clock step,
/// ns.
const DOUBTED_NS: i64 = 300_000_000;

/// State derived from the samples. Times are of receipt, minus the known delays.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Watch {
    now_ns: Option<i64>,
    received_ns: Option<i64>,
    /// Time of the last timely sample.
    timely_ns: Option<i64>,
    /// Time since which they arrive without a pause.
    since_ns: i64,
    /// Least lateness of samples that arrived long after the last timely one.
    least_late_ns: Option<i64>,
    /// Greatest lateness in this epoch.
    latest_ns: i64,
}

impl Watch {
    /// Begins an epoch.
    pub(super) fn begin(&mut self) {
        *self = Self { now_ns: self.now_ns, received_ns: self.received_ns, ..Self::default() };
    }

    /// Advances the time.
    pub(super) fn pass(&mut self, now_ns: i64) {
        self.now_ns = Some(self.now_ns.map_or(now_ns, |before| before.max(now_ns)));
    }

    /// Adds a sample with its lateness relative to the previous line.
    pub(super) fn sample(&mut self, at_ns: i64, late_ns: i64, doubt: &ClockUncertainty) {
        self.pass(at_ns);
        let now_ns = self.now_ns();
        self.received_ns = Some(now_ns);
        self.latest_ns = self.latest_ns.max(late_ns);
        let is_timely = doubt.spread_ns >= UNKNOWN_NS || late_ns <= 2 * doubt.spread_ns + BAND_NS;
        if !is_timely {
            // A late sample soon after a timely one is merely late.
            if self.timely_ns.is_some_and(|timely| now_ns.saturating_sub(timely) > DOUBTED_NS) {
                self.least_late_ns = Some(self.least_late_ns.map_or(late_ns, |least| least.min(late_ns)));
            }
            return;
        }
        if self.timely_ns.is_none_or(|before| now_ns.saturating_sub(before) > HOLD_NS) {
            self.since_ns = now_ns;
        }
        (self.timely_ns, self.least_late_ns) = (Some(now_ns), None);
    }

    /// The newest time.
    pub(super) fn now_ns(&self) -> i64 {
        self.now_ns.unwrap_or(0)
    }

    /// The greatest lateness in this epoch, ns.
    pub(super) fn latest_ns(&self) -> i64 {
        self.latest_ns.min(UNKNOWN_NS)
    }

    /// Whether nothing was received for long.
    pub(super) fn is_silent(&self) -> bool {
        self.received_ns.is_some_and(|received| self.now_ns().saturating_sub(received) > LOST_NS)
    }

    /// Amount to add to a bound because no timely sample confirms the clock, ns.
    pub(super) fn unvouched_ns(&self) -> i64 {
        self.least_late_ns.unwrap_or(0)
    }

    /// The next state, for the state before, the number of complete blocks and the present
    /// bound.
    pub(super) fn state(&self, before: State, complete: usize, bound_ns: i64) -> State {
        if self.is_silent() || bound_ns > 2 * UNKNOWN_NS {
            return State::Lost;
        }
        let most = if matches!(before, State::Locked | State::Holdover) { UNLOCK_NS } else { LOCK_NS };
        if complete < KEPT || (bound_ns > most && before != State::Holdover) {
            return State::Acquiring;
        }
        let Some(timely_ns) = self.timely_ns else { return State::Acquiring };
        if self.now_ns().saturating_sub(timely_ns) > HOLD_NS {
            return State::Holdover;
        }
        let waits = matches!(before, State::Holdover | State::Lost);
        if waits && self.now_ns().saturating_sub(self.since_ns) < RELOCK_NS { State::Holdover } else { State::Locked }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    #[test]
    fn state_changes_need_their_delays() {
        let doubt = ClockUncertainty { bound_ns: MS, growth_ppb: 1000, spread_ns: MS / 2 };
        let mut watch = Watch::default();
        assert_eq!(watch.state(State::Acquiring, 0, MS), State::Acquiring);
        watch.sample(0, 0, &doubt);
        assert_eq!(watch.state(State::Acquiring, KEPT - 1, MS), State::Acquiring);
        assert_eq!(watch.state(State::Acquiring, KEPT, LOCK_NS + 1), State::Acquiring);
        assert_eq!(watch.state(State::Acquiring, KEPT, LOCK_NS), State::Locked);
        assert_eq!(
            watch.state(State::Locked, KEPT, UNLOCK_NS),
            State::Locked,
            "once locked it stays so a little longer"
        );
        assert_eq!(watch.state(State::Locked, KEPT, UNLOCK_NS + 1), State::Acquiring);
        watch.pass(HOLD_NS + 1);
        assert_eq!(watch.state(State::Locked, KEPT, MS), State::Holdover);
        watch.sample(HOLD_NS + 2 * MS, 0, &doubt);
        assert_eq!(watch.state(State::Holdover, KEPT, MS), State::Holdover, "one timely sample does not make it");
        watch.sample(HOLD_NS + 2 * MS + RELOCK_NS, 0, &doubt);
        assert_eq!(watch.state(State::Holdover, KEPT, MS), State::Locked);
        watch.pass(2 * LOST_NS);
        assert_eq!(watch.state(State::Holdover, KEPT, MS), State::Lost);
    }

    #[test]
    fn late_samples_widen_bound_by_lateness() {
        let doubt = ClockUncertainty { bound_ns: MS, growth_ppb: 1000, spread_ns: MS / 2 };
        let mut watch = Watch::default();
        watch.sample(0, 0, &doubt);
        for n in 1..200 {
            watch.sample(n * 10 * MS, 50 * MS + n, &doubt);
            let expected = if n * 10 * MS > DOUBTED_NS { 50 * MS + DOUBTED_NS / (10 * MS) + 1 } else { 0 };
            assert_eq!(watch.unvouched_ns(), expected);
        }
        assert_eq!(watch.state(State::Locked, KEPT, MS), State::Holdover);
        watch.sample(2000 * MS, 2 * MS, &doubt);
        assert_eq!(watch.unvouched_ns(), 0, "{}", 2 * doubt.spread_ns + BAND_NS);
    }
}
