//! Infers the measurement number of a record if the device does not send it.
//!
//! Trackers without a counter measure at a steady period. A record is then the next one after
//! the last, unless so much time has passed that some must be missing. Elapsed time may also
//! mean that records wait in a buffer and arrive together. Therefore, after a gap, records
//! first count as provisionally lost. If the next ones arrive sooner than the device can have
//! measured them, none was lost, and the count is corrected. A line on which that happened
//! forwards records in packets: gaps of that length no longer count as losses. The remaining
//! ambiguity is reported with each record, in periods.

/// Number of records after a gap, arriving on time, until the gap is accepted. Also the number
/// of late records in a row until their lateness counts as a loss.
const BELIEVED: u32 = 8;
/// A gap of more records than this was hardly noise on the line: it is accepted only after
/// [`BELIEVED_NS`].
const NOISE: i64 = 2;
/// Time until a long gap is accepted, ns: records that were held back for a moment may stay
/// late a moment longer.
const BELIEVED_NS: i64 = 1_000_000_000;
/// Gaps that follow each other for this long are not losses, ns: the device measures at another
/// period.
const HOPELESS_NS: i64 = 5_000_000_000;

/// A gap, with the state needed to correct the count.
#[derive(Debug, Clone, Copy)]
struct Gap {
    /// Number of the record after the gap if none had been lost.
    without_loss: i64,
    /// Number of records since, including that one.
    since: u32,
    begun_ns: i64,
    lost: i64,
}

/// Counts records by their times.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Inference {
    last: Option<(i64, i64)>,
    gap: Option<Gap>,
    /// Time since which a gap is not yet accepted, ns; `None` if there is none.
    doubted_ns: Option<i64>,
    /// Gaps of up to this many periods are packets, not losses.
    packets: i64,
    late: u32,
    late_ns: i64,
    least_late: i64,
}

/// Result for a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Inferred {
    /// Inferred number of the measurement.
    pub(super) tick: i64,
    /// Ambiguity of the number, in periods.
    pub(super) open: i64,
    /// Number of records missing before it; negative if records counted as missing have
    /// arrived.
    pub(super) missing: i64,
    /// It arrives too soon for a new measurement.
    pub(super) repeated: bool,
    /// Whether losses before it are uncertain: the record must not be used to fit the clock.
    pub(super) in_doubt: bool,
    /// It arrives too soon for any number: the clock is wrong.
    pub(super) impossible: bool,
    /// The count was ambiguous for so long that the period must be another.
    pub(super) hopeless: bool,
}

impl Inference {
    /// The last number and the arrival time of its record.
    pub(super) fn last(&self) -> Option<(i64, i64)> {
        self.last
    }

    /// Infers the number of the record at a time (ns, minus the known delays). `expected`
    /// returns the arrival time of a number without delay, accurate to `within_ns`; `period_ns`
    /// is the period.
    pub(super) fn record(
        &mut self,
        time_ns: i64,
        period_ns: i64,
        within_ns: i64,
        expected: impl Fn(i64) -> i64,
    ) -> Inferred {
        let Some((last, last_ns)) = self.last else {
            self.last = Some((0, time_ns));
            return Inferred::default();
        };
        let period = period_ns.max(1);
        let half = period / 2;
        let next = last + 1;
        // Lateness in whole periods; negative for early. A record late by a whole period,
        // within the clock's error, may be another one. If it is less than half a period early,
        // it is the next and the clock is late, unless earlier losses are uncertain.
        let within = within_ns.clamp(0, period / 4);
        let sooner = if self.gap.is_some() { within } else { half };
        let periods = |tick: i64| {
            let late = time_ns.saturating_sub(expected(tick));
            late.saturating_add(if late > 0 { within } else { sooner }).div_euclid(period)
        };
        let later = periods(next);
        let passed_ns = time_ns.saturating_sub(last_ns);
        let plain = Inferred { tick: next, ..Inferred::default() };
        let inferred = if later < 0 {
            let unlost = self.gap.take().map(|gap| (gap.without_loss + i64::from(gap.since), gap.lost));
            match unlost.map(|(tick, lost)| (tick, lost, periods(tick))) {
                Some((tick, lost, open)) if open >= 0 => {
                    self.packets = self.packets.max(lost);
                    Inferred { tick, open, missing: -lost, ..plain }
                }
                _ if later >= -2 => Inferred { tick: next + later, open: -later, repeated: true, ..plain },
                _ => return Inferred { open: later.saturating_neg(), impossible: true, ..plain },
            }
        } else if later == 0 {
            self.late = 0;
            plain
        } else if later > self.packets && passed_ns.saturating_mul(2) > period.saturating_mul(3) {
            let passed = passed_ns.saturating_add(half) / period - 1;
            let lost = later.min(passed.max(1));
            // A gap that follows another uncertain one is part of it.
            let gap = self.gap.unwrap_or(Gap { without_loss: next, since: 0, begun_ns: time_ns, lost: 0 });
            self.gap = Some(Gap { lost: gap.lost + lost, begun_ns: time_ns, ..gap });
            self.late = 0;
            Inferred { tick: next + lost, open: later, missing: lost, ..plain }
        } else if passed_ns < half {
            // A buffer is being emptied.
            self.late = 0;
            Inferred { open: later, ..plain }
        } else {
            if self.late == 0 {
                (self.least_late, self.late_ns) = (later, time_ns);
            }
            self.least_late = self.least_late.min(later);
            self.late += 1;
            if believed(self.late, self.least_late, time_ns.saturating_sub(self.late_ns)) {
                let lost = self.least_late;
                (self.late, self.packets) = (0, 0);
                self.gap = Some(Gap { without_loss: next, since: 0, begun_ns: time_ns, lost });
                Inferred { tick: next + lost, open: later, missing: lost, ..plain }
            } else {
                Inferred { open: later, ..plain }
            }
        };
        let mut open = inferred.open;
        if let Some(gap) = &mut self.gap {
            open = open.max(gap.lost);
            gap.since += 1;
            if believed(gap.since, gap.lost, time_ns.saturating_sub(gap.begun_ns)) {
                self.gap = None;
            }
        }
        self.last = Some((inferred.tick, time_ns.max(last_ns)));
        let in_doubt = self.gap.is_some();
        self.doubted_ns = in_doubt.then(|| self.doubted_ns.unwrap_or(time_ns));
        let hopeless = self.doubted_ns.is_some_and(|since| time_ns.saturating_sub(since) > HOPELESS_NS);
        Inferred { open, in_doubt, hopeless, ..inferred }
    }
}

/// Whether this many records, over this much time, confirm the loss of `lost` records.
fn believed(records: u32, lost: i64, passed_ns: i64) -> bool {
    records > BELIEVED && (lost <= NOISE || passed_ns > BELIEVED_NS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const T: i64 = 10_000_000;

    /// Returns number, ambiguity and missing count of records at these times (in periods), on a
    /// correct clock.
    fn count(times: &[f64]) -> Vec<(i64, i64, i64)> {
        let mut inference = Inference::default();
        let mut take = |time: &f64| {
            let inferred = inference.record((time * T as f64) as i64, T, T / 10, |tick| tick * T);
            (inferred.tick, inferred.open, inferred.missing)
        };
        times.iter().map(&mut take).collect()
    }

    #[test]
    fn gaps_count_as_lost_records() {
        assert_eq!(count(&[0.0, 1.1, 2.3, 5.2, 6.0]), [(0, 0, 0), (1, 0, 0), (2, 0, 0), (5, 2, 2), (6, 2, 0)]);
        let mut times: Vec<f64> = (0..30).map(f64::from).collect();
        times.drain(5..9);
        let counted = count(&times);
        assert_eq!(counted.last(), Some(&(29, 4, 0)), "more than noise takes a while to believe");
        assert_eq!(counted.iter().map(|(_, _, missing)| missing).sum::<i64>(), 4);
    }

    #[test]
    fn buffered_records_are_not_lost() {
        // Records 3 to 8 all arrived at 8.2.
        let counted = count(&[0.0, 1.0, 2.0, 8.2, 8.2, 8.2, 8.2, 8.2, 8.2, 9.0, 10.0]);
        let ticks: Vec<i64> = counted.iter().map(|(tick, _, _)| *tick).collect();
        // The first of them is taken for the one just measured.
        assert_eq!(ticks, [0, 1, 2, 8, 4, 5, 6, 7, 8, 9, 10]);
        assert_eq!(counted[3].1, 5, "which the open periods tell");
        assert_eq!(counted.iter().map(|(_, _, missing)| missing).sum::<i64>(), 0);
        assert_eq!(counted[10].1, 0);
    }

    #[test]
    fn packets_of_adapter_are_not_gaps() {
        // Forwarded at multiples of 1.92 periods: 16 ms at 120 Hz.
        let times: Vec<f64> = (0..400).map(|n| (f64::from(n) / 1.92).ceil() * 1.92).collect();
        let counted = count(&times);
        let wrong: Vec<usize> = (0..400).filter(|n| counted[*n].0 != *n as i64).collect();
        assert_eq!(wrong, [1, 2], "the first gaps are taken for losses");
        assert!(wrong.iter().all(|n| counted[*n].0 - counted[*n].1 <= *n as i64), "in doubt");
        assert!(counted.iter().skip(20).all(|(_, open, missing)| *open <= 1 && *missing == 0));
    }

    #[test]
    fn duplicate_record_counted_once() {
        let mut inference = Inference::default();
        let mut take = |time: i64| inference.record(time, T, T / 2, |tick| tick * T);
        for n in 0..5 {
            take(n * T);
        }
        let again = take(4 * T);
        assert!(again.repeated && again.tick == 4 && again.open == 1, "{again:?}");
        assert_eq!(take(5 * T).tick, 5);
        assert!(take(-9 * T).impossible);
        assert_eq!(take(6 * T).tick, 6, "as if it had not come");
    }

    #[test]
    fn loss_hidden_in_burst_found() {
        // Held back from 2 on; only four of 3 to 8 arrived.
        let mut times = vec![0.0, 1.0, 2.0, 8.5, 8.5, 8.5, 8.5];
        times.extend((9..45).map(f64::from));
        let counted = count(&times);
        assert_eq!(counted.last(), Some(&(44, 0, 0)));
        assert_eq!(counted.iter().map(|(_, _, missing)| missing).sum::<i64>(), 2);
        // Until then the ambiguity is reported.
        for ((tick, open, _), time) in counted.iter().zip(&times).skip(7) {
            assert!(tick + open >= *time as i64 && *tick <= *time as i64, "{tick} {open} {time}");
        }
    }

    proptest! {
        #[test]
        fn losses_counted_exactly_with_jitter_below_half_period(
            records in prop::collection::vec((prop_oneof![12 => Just(0_i64), 1 => 1_i64..6], 0_i64..4_900_000), 2..200),
        ) {
            let mut inference = Inference::default();
            let mut number = -1;
            for (at, (lost, jitter)) in records.into_iter().enumerate() {
                number += 1 + if at == 0 { 0 } else { lost };
                let jitter = if at == 0 { 0 } else { jitter };
                let inferred = inference.record(number * T + jitter, T, T / 2, |tick| tick * T);
                prop_assert_eq!(inferred.tick, number);
                prop_assert!(!inferred.repeated && !inferred.impossible);
            }
        }
    }
}
