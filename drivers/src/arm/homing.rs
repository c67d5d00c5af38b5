//! Converts raw counters to positions: undoes wraps, detects jumps, and tracks whether each
//! joint's zero is known.
//!
//! An incremental encoder measures movements, not positions. Its zero is known after homing until
//! its counter restarts or loses steps. Both show as an impossible movement, and so does a
//! reading that was corrupted on the line but looks valid. The next reading decides. If it
//! continues from the earlier position, the odd reading was corrupted and is refused. If it
//! continues from the odd reading, the counter has jumped; the joint then counts as not homed
//! until it is homed again.
//!
//! Only an odd reading is held back, until the next one arrives.

use std::borrow::Cow;
use std::fmt::Write;

use sonoweave_core::clock::SECOND;
use sonoweave_core::reading::{AXES, Status};

/// Jitter of an encoder at rest, counts.
const SLACK: i64 = 2;
/// After this many consecutive odd readings that do not continue each other, the last one is
/// accepted. The arm may be faster than the settings say.
const MOST_ODD: u8 = 4;

/// Relation of two readings, according to their own data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Between {
    /// The second was taken later.
    Later {
        /// Upper limit of the time between them, ns.
        ns: i64,
        /// Bit by axis: the counter was set in between, so it may have any value.
        set: u8,
        /// Whether the second is an expected successor of the first.
        expected: bool,
    },
    /// The device's clock or numbers went back: it has restarted.
    Anew,
}

/// Counts of a reading, and its other data.
type Taken<P> = (P, [i64; AXES]);

/// Result of one more reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Passed<P> {
    /// Number of readings found corrupted.
    pub refused: u64,
    /// The reading that was held back, if it proved valid: the arm's counters have jumped.
    pub held: Option<Taken<P>>,
    /// This reading, unless it is held back.
    pub this: Option<Taken<P>>,
}

/// Comparison of a reading with an earlier one.
struct After {
    counts: [i64; AXES],
    /// Bit by axis: the movement is impossible.
    beyond: u8,
    anew: bool,
    /// Bit by axis: the joint may have moved by more than half of its counter's range.
    unsure: u8,
    expected: bool,
    ns: i64,
}

impl After {
    fn is_plausible(&self) -> bool {
        self.beyond == 0 && self.expected && !self.anew
    }
}

/// Follows the counters of a device. `P` is the other data of a reading.
#[derive(Debug, Clone)]
pub struct Homing<P> {
    first: u8,
    axes: u8,
    of: u8,
    bits: u32,
    fastest: i64,
    grace_ns: i64,
    known: Option<Taken<P>>,
    odd: Option<Taken<P>>,
    odd_in_a_row: u8,
    homed: u8,
    to_home: u8,
    zeros: [i64; AXES],
    why: String,
}

impl<P: Copy> Homing<P> {
    /// Creates a follower of `axes` counters of `bits` bits; the first is axis `first` (from 0)
    /// of an arm with `of` axes. No axis is homed.
    ///
    /// `fastest`: counts per second that no joint reaches; `grace_ns`: maximum error of the time
    /// between two readings.
    pub fn new(first: u8, axes: u8, of: u8, bits: u32, fastest: u32, grace_ns: i64) -> Self {
        Self {
            first,
            axes: axes.min(AXES as u8),
            of,
            bits: bits.clamp(2, 62),
            fastest: i64::from(fastest),
            grace_ns,
            known: None,
            odd: None,
            odd_in_a_row: 0,
            homed: 0,
            to_home: 0,
            zeros: [0; AXES],
            why: String::new(),
        }
    }

    /// Returns all axes, bit by axis of the device.
    pub fn all(&self) -> u8 {
        ((1_u16 << self.axes) - 1) as u8
    }

    /// Returns the axes with a known zero, bit by axis.
    pub fn homed(&self) -> u8 {
        self.homed
    }

    /// Returns the last accepted counts, before the zeros are subtracted.
    pub fn last(&self) -> Option<&[i64; AXES]> {
        self.known.as_ref().map(|(_, counts)| counts)
    }

    /// Marks these axes as homed.
    pub fn trust(&mut self, axes: u8) {
        self.homed |= axes & self.all();
    }

    /// Clears the reported problem.
    pub fn settle(&mut self) {
        self.why.clear();
    }

    /// Marks these axes as not homed, and stores the reason.
    pub fn distrust(&mut self, axes: u8, why: &str) {
        self.homed &= !axes;
        self.why.clear();
        self.why.push_str(why);
    }

    /// Homes these axes in the next reading: their counts are 0 there.
    pub fn home(&mut self, axes: u8) {
        self.to_home |= axes & self.all();
    }

    /// Restarts, with these axes homed.
    pub fn restart(&mut self, homed: u8) {
        (self.known, self.odd, self.odd_in_a_row) = (None, None, 0);
        (self.homed, self.zeros) = (homed & self.all(), [0; AXES]);
    }

    /// Returns why axes are not homed, as a sentence. Empty if all are homed, or if none ever
    /// was.
    pub fn why(&self) -> &str {
        &self.why
    }

    /// Takes one more reading: the raw counters, and its relation to an earlier reading.
    pub fn push(&mut self, payload: P, shown: [i64; AXES], between: impl Fn(&P, &P) -> Between) -> Passed<P> {
        let mut passed = Passed { refused: 0, held: None, this: None };
        let Some(known) = &self.known else {
            passed.this = Some(self.accept((payload, shown)));
            return passed;
        };
        let after = self.after(known, &payload, &shown, &between);
        if after.is_plausible() {
            passed.refused = u64::from(self.odd.take().is_some());
            self.odd_in_a_row = 0;
            if after.unsure != 0 {
                self.note_unsure(&after);
            }
            passed.this = Some(self.accept((payload, after.counts)));
            return passed;
        }
        let Some(odd) = self.odd.take() else {
            self.odd = Some((payload, shown));
            self.odd_in_a_row = 1;
            return passed;
        };
        let before = self.after(known, &odd.0, &odd.1, &between);
        let since = self.after(&(odd.0, before.counts), &payload, &shown, &between);
        if since.is_plausible() {
            self.note_jump(&before);
            passed.held = Some(self.accept((odd.0, before.counts)));
            passed.this = Some(self.accept((payload, since.counts)));
            self.odd_in_a_row = 0;
            return passed;
        }
        passed.refused = 1;
        self.odd_in_a_row += 1;
        if self.odd_in_a_row < MOST_ODD {
            self.odd = Some((payload, shown));
        } else {
            self.odd_in_a_row = 0;
            self.note_jump(&after);
            passed.this = Some(self.accept((payload, after.counts)));
        }
        passed
    }

    /// Compares a reading with an earlier one.
    fn after(
        &self,
        (earlier, from): &Taken<P>,
        later: &P,
        shown: &[i64; AXES],
        between: impl Fn(&P, &P) -> Between,
    ) -> After {
        let mut after = After { counts: *shown, beyond: 0, anew: false, unsure: 0, expected: false, ns: 0 };
        let Between::Later { ns, set, expected } = between(earlier, later) else {
            (after.anew, after.beyond) = (true, self.all());
            return after;
        };
        (after.ns, after.expected) = (ns, expected);
        let most = i128::from(self.fastest) * i128::from(ns.saturating_add(self.grace_ns)) / i128::from(SECOND);
        let most = i64::try_from(most).unwrap_or(i64::MAX).saturating_add(SLACK);
        for axis in 0..usize::from(self.axes) {
            let bit = 1 << axis;
            if set & bit != 0 {
                continue;
            }
            let moved = wrapped(shown[axis].wrapping_sub(from[axis]), self.bits);
            if most >= 1 << (self.bits - 1) {
                after.unsure |= bit;
            } else if moved.abs() > most {
                after.beyond |= bit;
                continue;
            }
            after.counts[axis] = from[axis] + moved;
        }
        after
    }

    /// Accepts the reading as reference for the next ones; returns its counts minus the zeros.
    fn accept(&mut self, taken: Taken<P>) -> Taken<P> {
        self.known = Some(taken);
        let (payload, mut counts) = taken;
        if self.to_home != 0 {
            for axis in (0..AXES).filter(|axis| self.to_home & 1 << axis != 0) {
                self.zeros[axis] = counts[axis];
            }
            let homed = std::mem::take(&mut self.to_home);
            self.trust(homed);
            if self.homed == self.all() {
                self.settle();
            }
        }
        counts.iter_mut().zip(self.zeros).for_each(|(count, zero)| *count -= zero);
        (payload, counts)
    }

    fn note_jump(&mut self, after: &After) {
        if after.beyond == 0 {
            return;
        }
        self.why.clear();
        for axis in (0..usize::from(self.axes)).filter(|axis| after.beyond & 1 << axis != 0) {
            self.zeros[axis] = 0;
            let by = self.known.as_ref().map_or(0, |(_, counts)| wrapped(after.counts[axis] - counts[axis], self.bits));
            if !after.anew {
                let and = if self.why.is_empty() { "" } else { ", " };
                // Writing to a string cannot fail.
                let _ = write!(
                    self.why,
                    "{and}axis {} of {} jumped by {by} counts",
                    usize::from(self.first) + axis + 1,
                    self.of
                );
            }
        }
        self.homed &= !after.beyond;
        if after.anew {
            self.why.push_str("the arm has begun anew and does not know where it is");
        }
        self.why.push_str(HOME_IT);
    }

    fn note_unsure(&mut self, after: &After) {
        if self.homed & after.unsure == 0 {
            return;
        }
        self.homed &= !after.unsure;
        self.why.clear();
        let ms = after.ns / sonoweave_core::clock::MS;
        let _ = write!(
            self.why,
            "nothing was heard for {ms} ms, in which a joint may have turned by more than its counter holds{HOME_IT}"
        );
    }

    /// Returns the status of a reading: like [`Self::status`], but with the jump before it, if the
    /// counters have `jumped` and an axis lost its zero by that.
    pub fn status_after(&self, jumped: bool, homed: u8, fault: u8) -> Status {
        match self.status(homed, fault) {
            Status::Other(_) if jumped && !self.why.is_empty() => Status::Other(self.why.clone().into()),
            status => status,
        }
    }

    /// Returns the problem of the device after a reading of this status; empty for none.
    pub fn trouble<'a>(&'a self, status: &'a Status) -> &'a str {
        match status {
            Status::Ok => "",
            Status::Other(why) if self.why.is_empty() => why,
            Status::Other(_) => &self.why,
        }
    }

    /// Returns the status of readings, for the homed and the faulty axes (bit by axis of the
    /// device).
    pub fn status(&self, homed: u8, fault: u8) -> Status {
        let texts = |axes: u8| match axes.count_ones() {
            1 => 1 + usize::from(self.first) + axes.trailing_zeros() as usize,
            _ => 0,
        };
        if fault != 0 {
            return Status::Other(Cow::Borrowed(FAULTY[texts(fault).min(AXES)]));
        }
        match !homed & self.all() {
            0 => Status::Ok,
            unknown => Status::Other(Cow::Borrowed(NOT_HOMED[texts(unknown).min(AXES)])),
        }
    }
}

/// Advice for an unknown position.
pub const HOME_IT: &str = ": move the arm to its home position and home it";

macro_rules! of_each_axis {
    ($several:literal, $text:literal) => {
        [
            concat!($several, $text),
            concat!("axis 1 ", $text),
            concat!("axis 2 ", $text),
            concat!("axis 3 ", $text),
            concat!("axis 4 ", $text),
            concat!("axis 5 ", $text),
            concat!("axis 6 ", $text),
        ]
    };
}

/// Texts for several axes, then for each axis.
static NOT_HOMED: [&str; AXES + 1] =
    of_each_axis!("more than one axis ", "is not homed: move the arm to its home position and home it");
static FAULTY: [&str; AXES + 1] = of_each_axis!(
    "more than one axis ",
    "has lost steps: check its encoder, then move the arm to its home position and home it"
);

/// Returns the difference of two values of a counter of `bits` bits along the shortest way.
pub fn wrapped(difference: i64, bits: u32) -> i64 {
    let spare = 64 - bits;
    difference << spare >> spare
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use sonoweave_core::clock::MS;

    fn later(ns: i64) -> impl Fn(&i64, &i64) -> Between {
        move |_, _| Between::Later { ns, set: 0, expected: true }
    }

    /// Relates readings by their own times, ns.
    fn by_clock(earlier: &i64, later: &i64) -> Between {
        match later - earlier {
            ns if ns > 0 => Between::Later { ns, set: 0, expected: true },
            _ => Between::Anew,
        }
    }

    fn one(count: i64) -> [i64; AXES] {
        [count, 0, 0, 0, 0, 0]
    }

    /// Returns the unsigned value of a counter of `bits` bits.
    fn shown(count: i64, bits: u32) -> i64 {
        count.rem_euclid(1 << bits)
    }

    proptest! {
        #[test]
        fn steps_below_half_range_are_followed_exactly(
            bits in 8_u32..=40,
            first in 0.0..1.0_f64,
            steps in proptest::collection::vec(-1.0..1.0_f64, 1..200),
        ) {
            // The speed limit reaches half the range in 1 s; the steps take a little less.
            let half = 1_i64 << (bits - 1);
            let mut homing = Homing::new(0, 1, 1, bits, 1_000_000, 0);
            let ns = (half - 1 - SLACK) * 1000;
            let mut truth = (first * half as f64) as i64;
            let begun = homing.push(0, one(truth), later(0)).this.unwrap();
            prop_assert_eq!(begun.1[0], truth);
            for step in steps {
                truth += (step * (half - 1 - SLACK) as f64) as i64;
                let passed = homing.push(0, one(shown(truth, bits)), later(ns));
                prop_assert_eq!((passed.this.map(|this| this.1[0]), passed.refused), (Some(truth), 0));
            }
        }

        #[test]
        fn single_corrupted_reading_is_refused(
            at in 1_usize..50, by in prop_oneof![-30_000_i64..-2000, 2000_i64..30_000],
        ) {
            let mut homing = Homing::new(0, 1, 1, 16, 100_000, 0);
            homing.trust(1);
            let (mut refused, mut found) = (0, Vec::new());
            for n in 0..60_usize {
                let damage = if n == at { by } else { 0 };
                let passed = homing.push(n as i64 * 10 * MS, one(shown(700 * n as i64 + damage, 16)), by_clock);
                refused += passed.refused;
                found.extend(passed.held.into_iter().chain(passed.this).map(|(_, counts)| counts[0]));
            }
            let expected: Vec<i64> = (0..60).filter(|n| *n != at).map(|n| 700 * n as i64).collect();
            prop_assert_eq!((refused, found, homing.homed(), homing.why()), (1, expected, 1, ""));
        }
    }

    #[test]
    fn jump_is_accepted_at_next_reading_and_reported() {
        let mut homing = Homing::new(1, 2, 3, 32, 1000, 0);
        homing.trust(3);
        let take = |homing: &mut Homing<i64>, a, b| homing.push(0, [a, b, 0, 0, 0, 0], later(10 * MS));
        assert!(take(&mut homing, 5, 7).this.is_some());
        assert_eq!(take(&mut homing, 6, 900), Passed { refused: 0, held: None, this: None });
        assert_eq!(homing.homed(), 3, "nothing is known yet");
        let passed = take(&mut homing, 7, 901);
        assert_eq!([passed.held, passed.this].map(|taken| taken.unwrap().1[1]), [900, 901]);
        assert_eq!(homing.homed(), 1);
        assert_eq!(homing.why(), "axis 3 of 3 jumped by 893 counts: move the arm to its home position and home it");
        assert!(matches!(homing.status(1, 0), Status::Other(why) if why.starts_with("axis 3 is not homed")));
        homing.home(2);
        let this = take(&mut homing, 8, 902).this.unwrap();
        assert_eq!((this.1[..2].to_vec(), homing.homed(), homing.why()), (vec![8, 0], 3, ""));
        assert_eq!(take(&mut homing, 8, 905).this.unwrap().1[1], 3, "from home on");
    }

    #[test]
    fn too_fast_arm_is_accepted_but_not_homed() {
        let mut homing = Homing::new(0, 1, 1, 32, 1000, 0);
        homing.trust(1);
        let found: usize = (0..100)
            .map(|n| homing.push(0, one(n * n * 100), later(10 * MS)))
            .map(|passed| usize::from(passed.this.is_some()) + usize::from(passed.held.is_some()))
            .sum();
        assert!(found >= 20 && homing.homed() == 0, "{found}");
    }

    #[test]
    fn possible_wrap_in_silence_is_not_homed() {
        let mut homing = Homing::new(0, 1, 1, 14, 10_000, 0);
        homing.trust(1);
        homing.push(0, one(100), later(0));
        assert!(homing.push(0, one(200), later(800 * MS)).this.is_some());
        assert_eq!((homing.homed(), homing.why()), (1, ""));
        assert!(homing.push(0, one(300), later(900 * MS)).this.is_some());
        assert_eq!(homing.homed(), 0);
        assert!(homing.why().contains("nothing was heard for 900 ms"), "{}", homing.why());
    }

    #[test]
    fn restart_differs_from_jump() {
        let mut homing = Homing::new(0, 1, 1, 32, 1000, 0);
        homing.trust(1);
        homing.push(100 * MS, one(5), by_clock);
        assert!(homing.push(MS, one(5), by_clock).this.is_none());
        assert!(homing.push(2 * MS, one(5), by_clock).held.is_some());
        assert_eq!(homing.homed(), 0);
        assert!(homing.why().starts_with("the arm has begun anew"), "{}", homing.why());
    }
}
