//! How far a clock is to be believed, by when timely samples came.

use super::envelope::{BAND_NS, Doubt, KEPT, UNKNOWN_NS};
use super::mapping::State;

/// A bound up to this makes a locked clock, ns,
pub(super) const LOCK_NS: i64 = 20_000_000;
/// and one above this an unlocked one, ns.
pub(super) const UNLOCK_NS: i64 = 40_000_000;
/// Without a timely sample for so long a clock goes on by itself, ns,
pub(super) const HOLD_NS: i64 = 1_000_000_000;
/// and when they have come again for so long, it does no more, ns.
pub(super) const RELOCK_NS: i64 = 500_000_000;
/// Without any sample for so long it is lost, ns; and with a bound above twice what is thought of a clock of which nothing is known.
pub(super) const LOST_NS: i64 = 60_000_000_000;
/// What crystals wander on their own, parts in 10⁹ of the time that passes unseen.
pub(super) const WANDER_PPB: i64 = 1_000;
/// Late samples for so long, and no timely one: their least delay may as well be a step, ns.
const DOUBTED_NS: i64 = 300_000_000;

/// What is remembered of the samples. Times are of receipt, less the known delays.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Watch {
    now_ns: Option<i64>,
    heard_ns: Option<i64>,
    /// The last timely sample,
    timely_ns: Option<i64>,
    /// and since when they come without a pause.
    since_ns: i64,
    /// The least lateness of those that came long after the last timely one.
    least_late_ns: Option<i64>,
    /// The greatest in this epoch.
    latest_ns: i64,
}

impl Watch {
    /// An epoch begins.
    pub(super) fn begin(&mut self) {
        *self = Self { now_ns: self.now_ns, heard_ns: self.heard_ns, ..Self::default() };
    }

    /// Time passes.
    pub(super) fn pass(&mut self, now_ns: i64) {
        self.now_ns = Some(self.now_ns.map_or(now_ns, |before| before.max(now_ns)));
    }

    /// A sample came, so late by the line that was there before it.
    pub(super) fn sample(&mut self, at_ns: i64, late_ns: i64, doubt: &Doubt) {
        self.pass(at_ns);
        let now_ns = self.now_ns();
        self.heard_ns = Some(now_ns);
        self.latest_ns = self.latest_ns.max(late_ns);
        let is_timely = doubt.spread_ns >= UNKNOWN_NS || late_ns <= 2 * doubt.spread_ns + BAND_NS;
        if !is_timely {
            // What comes late soon after a timely one is but late.
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

    /// Whether nothing at all was heard for long.
    pub(super) fn is_silent(&self) -> bool {
        self.heard_ns.is_some_and(|heard| self.now_ns().saturating_sub(heard) > LOST_NS)
    }

    /// What is to be added to a bound because nothing vouches for the clock, ns.
    pub(super) fn unvouched_ns(&self) -> i64 {
        self.least_late_ns.unwrap_or(0)
    }

    /// The state after one, with so many complete blocks and that bound now.
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
    fn states_follow_each_other_with_pauses_between() {
        let doubt = Doubt { bound_ns: MS, growth_ppb: 1000, spread_ns: MS / 2 };
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
    fn late_samples_vouch_for_nothing_and_their_lateness_is_added() {
        let doubt = Doubt { bound_ns: MS, growth_ppb: 1000, spread_ns: MS / 2 };
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
