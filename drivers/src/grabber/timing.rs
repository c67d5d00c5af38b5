//! Checks whether a driver's stamps and numbers are reliable.

/// Counts frames by the driver's sequence number, which has 32 bits and restarts with every
/// start.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sequence {
    /// The driver's last number since its start.
    last: Option<u32>,
    /// Number of the next frame if none is lost.
    next: u64,
}

/// Largest step that counts as lost frames; a larger one means that the driver counts
/// differently.
const FARTHEST: u32 = 1 << 16;

impl Sequence {
    /// Returns the frame's number, from 0 without wrap, and the frames lost before it. Single
    /// fields of a frame share its number.
    pub(crate) fn count(&mut self, sequence: u32, one_field: bool) -> (u64, u64) {
        let step = self.last.replace(sequence).map(|last| sequence.wrapping_sub(last));
        let lost = match step {
            Some(0) if one_field => return (self.next.saturating_sub(1), 0),
            // A repeated or constant number shows no loss; the frame is a new one.
            Some(step) if step <= FARTHEST => u64::from(step.saturating_sub(1)),
            _ => 0,
        };
        let number = self.next + lost;
        self.next = number + 1;
        (number, lost)
    }

    /// Resets the driver's count; the frames' numbers continue.
    pub(crate) const fn restart(&mut self) {
        self.last = None;
    }
}

/// Source of a frame's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum FrameClock {
    /// The kernel's stamp, taken when the frame arrived.
    #[default]
    Kernel,
    /// The time at which the frame was handed over: the driver's stamps are of another clock, or
    /// wrong.
    Handover,
}

/// Stamps further from the present than this are of another clock, whatever the driver reports:
/// some drivers use the wall clock.
const FARTHEST_NS: i64 = 1_000_000_000;

/// Returns the frame's time in nanoseconds of the host's monotonic clock, and its source.
pub(crate) fn frame_time(stamp_ns: i64, monotonic: bool, now_ns: i64) -> (i64, FrameClock) {
    if monotonic && stamp_ns.abs_diff(now_ns) < FARTHEST_NS.unsigned_abs() {
        (stamp_ns, FrameClock::Kernel)
    } else {
        (now_ns, FrameClock::Handover)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_count_as_lost_across_wrap_but_not_restart() {
        let mut sequence = Sequence::default();
        let mut count = |number, one_field| sequence.count(number, one_field);
        assert_eq!(count(u32::MAX - 1, false), (0, 0));
        assert_eq!(count(u32::MAX, false), (1, 0));
        assert_eq!(count(0, false), (2, 0));
        assert_eq!(count(3, false), (5, 2));
        assert_eq!(count(3, true), (5, 0), "the other field");
        assert_eq!(count(3, false), (6, 0), "a number given twice");
        assert_eq!(count(4, false), (7, 0));
        assert_eq!(count(1, false), (8, 0), "backwards is no four thousand million");
        assert_eq!(count(2, false), (9, 0));
        sequence.restart();
        assert_eq!(sequence.count(77, false), (10, 0));
        assert_eq!(sequence.count(79, false), (12, 1));
    }

    #[test]
    fn stamps_of_other_clock_are_replaced() {
        let now = 5_000_000_000_000;
        assert_eq!(frame_time(now - 30_000_000, true, now), (now - 30_000_000, FrameClock::Kernel));
        assert_eq!(frame_time(now - 30_000_000, false, now), (now, FrameClock::Handover));
        for wrong in [now - 1_000_000_000, now + 1_000_000_000, 0, i64::MIN, i64::MAX, 1_763_700_000_000_000_000] {
            assert_eq!(frame_time(wrong, true, now), (now, FrameClock::Handover), "{wrong}");
        }
    }
}
