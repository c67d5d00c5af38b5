//! The host's clock, and one that tests turn by hand.
//!
//! Every receive time, every patience and every pause of a driver goes through a [`Clock`]: with [`Manual`] a test passes ten seconds of waiting in no time.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

/// Nanoseconds of a millisecond.
pub const MS: i64 = 1_000_000;
/// Nanoseconds of a second.
pub const SECOND: i64 = 1_000 * MS;

/// Host nanoseconds.
pub trait Clock: Send + Sync + std::fmt::Debug {
    /// Now, ns.
    fn now_ns(&self) -> i64;

    /// Returns at that time, or at once where it has passed.
    fn wait_until(&self, at_ns: i64);
}

/// CLOCK_MONOTONIC: what V4L2 stamps frames with, too.
#[derive(Debug, Clone, Copy, Default)]
pub struct Monotonic;

impl Clock for Monotonic {
    fn now_ns(&self) -> i64 {
        let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        now.tv_sec * SECOND + now.tv_nsec
    }

    fn wait_until(&self, at_ns: i64) {
        let left = at_ns - self.now_ns();
        // Negative: it has passed.
        if let Ok(left) = u64::try_from(left) {
            std::thread::sleep(Duration::from_nanos(left));
        }
    }
}

/// CLOCK_REALTIME, the wall clock: ns since 1970.
pub fn wall_now_ns() -> i64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Realtime);
    now.tv_sec * SECOND + now.tv_nsec
}

/// The wall clock's time of a host time, ns since 1970, as both clocks stand now.
pub fn wall_ns(host_ns: i64) -> i64 {
    wall_now_ns().saturating_sub(Monotonic.now_ns().saturating_sub(host_ns))
}

/// Stands still until it is told to go on; waiting is what moves it. Clones are the same clock.
#[derive(Debug, Clone, Default)]
pub struct Manual(Arc<AtomicI64>);

impl Manual {
    /// At this time, ns.
    pub fn at(now_ns: i64) -> Self {
        Self(Arc::new(AtomicI64::new(now_ns)))
    }

    /// So much later, ns.
    pub fn pass(&self, ns: i64) {
        self.0.fetch_add(ns, Ordering::Relaxed);
    }
}

impl Clock for Manual {
    fn now_ns(&self) -> i64 {
        self.0.load(Ordering::Relaxed)
    }

    fn wait_until(&self, at_ns: i64) {
        self.0.fetch_max(at_ns, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_host_s_clock_goes_on_and_waits() {
        let before = Monotonic.now_ns();
        Monotonic.wait_until(before + 2 * MS);
        let after = Monotonic.now_ns();
        assert!(after >= before + 2 * MS, "{before} {after}");
        Monotonic.wait_until(before);
        assert!(Monotonic.now_ns() < after + SECOND, "what has passed is not waited for");
    }

    #[test]
    fn a_host_time_is_as_long_ago_by_the_wall_clock() {
        let (host_ns, wall) = (Monotonic.now_ns(), wall_now_ns());
        assert!((wall_ns(host_ns) - wall).abs() < SECOND && wall > 1_500_000_000 * SECOND);
        assert!((wall_ns(host_ns - 90 * SECOND) - wall + 90 * SECOND).abs() < SECOND);
    }

    #[test]
    fn a_clock_turned_by_hand_moves_when_it_is_waited_for() {
        let clock = Manual::at(5);
        let same = clock.clone();
        clock.wait_until(100);
        clock.wait_until(50);
        same.pass(11);
        assert_eq!([clock.now_ns(), same.now_ns()], [111; 2]);
    }
}
