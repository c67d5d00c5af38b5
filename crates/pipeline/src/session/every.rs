//! The moments of a replay at which pictures are rendered, and insertion waits for them.

use std::num::{NonZeroU16, NonZeroU64};

use super::shared_volume::PendingChanges;

/// The slices of a replay after which a picture is rendered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Every {
    /// After every so many slices.
    Slices(NonZeroU64),
    /// So many times in 1000 s, the first time at the first slice's: before the next slice with a
    /// later time.
    Millihertz(NonZeroU16),
}

/// Nanoseconds in 1000 s.
const NS_IN_1000_S: u128 = 1_000_000_000_000;

/// The next time of a picture.
#[derive(Default)]
pub(super) struct DueTime {
    /// The time of the slice inserted first, and that of the next picture, ns.
    first_and_next: Option<[i64; 2]>,
    /// Slices inserted until the last picture.
    pictured: u64,
}

impl DueTime {
    /// Returns whether a picture of the slices inserted so far is due before one with a time.
    pub(super) fn passes(&mut self, time_ns: i64, inserted: &PendingChanges, rate: NonZeroU16) -> bool {
        if inserted.inserted == 0 {
            return false;
        }
        let [first, next] = self.first_and_next.get_or_insert([inserted.time_ns; 2]);
        if time_ns <= *next {
            return false;
        }
        let (elapsed, rate) = (u128::from(time_ns.abs_diff(*first)), u128::from(rate.get()));
        let pictures = (elapsed * rate).div_ceil(NS_IN_1000_S);
        *next = first.saturating_add_unsigned((pictures * NS_IN_1000_S / rate) as u64);
        std::mem::replace(&mut self.pictured, inserted.inserted) < inserted.inserted
    }
}
