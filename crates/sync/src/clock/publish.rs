//! Publication of a clock, and the times computed from it.

use sonoweave_core::Ticks;

use super::envelope::UNKNOWN_NS;
use super::mapping::clamped;
use super::{Basis, ClockMap, LATE_NS, Mapping, State, TimeFlags, Timed, expected, watch};

/// A line is not published again if it moved by less than this at the present time, ns; upwards
/// also if by less than an eighth of its bound.
pub const PUBLISHED_NS: i64 = 20_000;
/// Longest time between publications, ns.
pub const PUBLISHED_EVERY_NS: i64 = 1_000_000_000;

impl ClockMap {
    /// Publishes the clock if it has changed enough, or its state has.
    pub(super) fn publish(&mut self, host_ns: i64, is_new: bool) {
        let complete = self.envelope.complete();
        let known = self.origin.zip(self.envelope.line());
        let Some((origin, line)) = known else {
            let state = if self.mapping.state == State::Lost { State::Lost } else { State::Acquiring };
            let state = if self.watch.is_silent() { State::Lost } else { state };
            if self.mapping.epoch != self.epoch || self.mapping.state != state {
                let (epoch, delay_ns) = (self.epoch, self.settings.delay_ns);
                let nothing =
                    Mapping { tick: 0, time_ns: 0, ns_per_tick_q32: 0, drift_ppb: 0, growth_ppb: 0, ..self.mapping };
                let bounds = Mapping { bound_ns: UNKNOWN_NS, bound_until_ns: i64::MAX, ..nothing };
                self.set(Mapping { epoch, state, delay_ns, ..bounds }, host_ns);
            }
            return;
        };
        let old_time = self.last.map(|last| self.mapping.time(Basis::Ticks(last.0)));
        let doubt = self.envelope.doubt();
        let after = i128::from(self.watch.now_ns()) - i128::from(origin.time_ns) - i128::from(self.envelope.end());
        let grown = after.max(0) * i128::from(doubt.growth_ppb) / 1_000_000_000;
        let now_bound = clamped(i128::from(doubt.bound_ns) + grown);
        let state = self.watch.state(self.mapping.state, complete, now_bound);
        let is_due = host_ns.saturating_sub(self.mapping.published_ns) >= PUBLISHED_EVERY_NS;
        let is_first = self.mapping.ns_per_tick_q32 == 0;
        let has_turned = is_first || state != self.mapping.state || self.epoch != self.mapping.epoch;
        if !(is_new || is_due || has_turned) {
            return;
        }
        let tick = self.last.map_or(origin.tick, |last| last.0);
        let time_ns = expected(Some(origin), Some(line), tick);
        let slack = PUBLISHED_NS.max(doubt.bound_ns / 8);
        let counted = if self.settings.ticks == Ticks::Time { origin.period_q32 >> 32 } else { 0 };
        let candidate = Mapping {
            number: self.mapping.number,
            epoch: self.epoch,
            state,
            published_ns: host_ns,
            tick,
            time_ns,
            ns_per_tick_q32: self.rate_q32(),
            drift_ppb: (line.slope() * 1e9).round() as i64,
            bound_ns: (doubt.bound_ns + slack + counted).min(UNKNOWN_NS),
            bound_until_ns: origin.time_ns.saturating_add(self.envelope.end()),
            growth_ppb: doubt.growth_ppb + watch::WANDER_PPB,
            delay_ns: self.settings.delay_ns,
        };
        // A small upward move may wait. A downward one may not: the received sample was
        // measured before that time.
        let rose = old_time.map_or(i64::MAX, |old| time_ns.saturating_sub(old));
        let has_moved = rose > slack || rose < -PUBLISHED_NS;
        let wider = candidate.bound(time_ns) > self.mapping.bound(time_ns);
        let narrower = candidate.bound_ns < self.mapping.bound_ns / 4 * 3;
        if has_turned || is_due || has_moved || wider || narrower {
            self.set(candidate, host_ns);
        }
    }

    fn set(&mut self, mapping: Mapping, host_ns: i64) {
        // Number 0 is the clock that has received nothing.
        self.mapping = Mapping { number: self.mapping.number + 1, published_ns: host_ns, ..mapping };
        self.published = Some(self.mapping);
    }

    pub(super) fn timed(&self, host_ns: i64, tick: i64, flags: TimeFlags, open_ns: i64, missing: i64) -> Timed {
        let basis = Basis::Ticks(tick);
        let time_ns = self.mapping.time(basis);
        let mut flags = flags | self.state_flags();
        if host_ns.saturating_sub(self.settings.delay_ns).saturating_sub(time_ns) > LATE_NS {
            flags |= TimeFlags::LATE;
        }
        let bound_ns = self.mapping.bound(time_ns).saturating_add(open_ns).saturating_add(self.watch.unvouched_ns());
        Timed { time_ns, bound_ns, basis, mapping: self.mapping.number, flags, missing }
    }

    pub(super) fn received(&mut self, host_ns: i64, bound_ns: i64, flags: TimeFlags) -> Timed {
        self.watch.pass(host_ns.saturating_sub(self.settings.delay_ns));
        self.publish(host_ns, false);
        let basis = Basis::Received(host_ns);
        let flags = flags | TimeFlags::RECEIVED | self.state_flags();
        Timed { time_ns: self.mapping.time(basis), bound_ns, basis, mapping: self.mapping.number, flags, missing: 0 }
    }

    fn state_flags(&self) -> TimeFlags {
        match self.mapping.state {
            State::Acquiring => TimeFlags::ACQUIRING,
            State::Locked => TimeFlags::NONE,
            State::Holdover => TimeFlags::HOLDOVER,
            State::Lost => TimeFlags::LOST,
        }
    }
}
