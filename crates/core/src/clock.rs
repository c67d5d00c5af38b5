//! The host's clock, and a clock that tests advance manually.
//!
//! Drivers take every receive time, timeout and pause from a [`Clock`]. A test with a
//! [`Manual`] clock therefore waits ten seconds in no time.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

/// Nanoseconds in a millisecond.
pub const MS: i64 = 1_000_000;
/// Nanoseconds in a second.
pub const SECOND: i64 = 1_000 * MS;

/// A source of host time, ns.
pub trait Clock: Send + Sync + std::fmt::Debug {
    /// Returns the time now, ns.
    fn now_ns(&self) -> i64;

    /// Returns at `at_ns`, or at once if that time has passed.
    fn wait_until(&self, at_ns: i64);
}

/// CLOCK_MONOTONIC, which V4L2 also uses for frame stamps.
#[derive(Debug, Clone, Copy, Default)]
pub struct Monotonic;

impl Clock for Monotonic {
    fn now_ns(&self) -> i64 {
        let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        now.tv_sec * SECOND + now.tv_nsec
    }

    fn wait_until(&self, at_ns: i64) {
        let left = at_ns - self.now_ns();
        // The conversion fails for a negative value: the time has passed.
        if let Ok(left) = u64::try_from(left) {
            std::thread::sleep(Duration::from_nanos(left));
        }
    }
}

/// Returns CLOCK_REALTIME, the wall clock: ns since 1970.
pub fn wall_now_ns() -> i64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Realtime);
    now.tv_sec * SECOND + now.tv_nsec
}

/// Converts a host time to wall-clock time, ns since 1970, by the present offset of the two
/// clocks.
pub fn wall_ns(host_ns: i64) -> i64 {
    wall_now_ns().saturating_sub(Monotonic.now_ns().saturating_sub(host_ns))
}

/// A clock that advances only by [`Self::pass`] and by waiting. Clones share one time.
#[derive(Debug, Clone, Default)]
pub struct Manual(Arc<AtomicI64>);

impl Manual {
    /// Creates a clock at this time, ns.
    pub fn at(now_ns: i64) -> Self {
        Self(Arc::new(AtomicI64::new(now_ns)))
    }

    /// Advances the clock by `ns`.
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
    fn monotonic_wait_until_returns_after_time() {
        let before = Monotonic.now_ns();
        Monotonic.wait_until(before + 2 * MS);
        let after = Monotonic.now_ns();
        assert!(after >= before + 2 * MS, "{before} {after}");
        Monotonic.wait_until(before);
        assert!(Monotonic.now_ns() < after + SECOND, "what has passed is not waited for");
    }

    #[test]
    fn wall_ns_keeps_distance_to_now() {
        let (host_ns, wall) = (Monotonic.now_ns(), wall_now_ns());
        assert!((wall_ns(host_ns) - wall).abs() < SECOND && wall > 1_500_000_000 * SECOND);
        assert!((wall_ns(host_ns - 90 * SECOND) - wall + 90 * SECOND).abs() < SECOND);
    }

    #[test]
    fn manual_clock_wait_advances_all_clones() {
        let clock = Manual::at(5);
        let same = clock.clone();
        clock.wait_until(100);
        clock.wait_until(50);
        same.pass(11);
        assert_eq!([clock.now_ns(), same.now_ns()], [111; 2]);
    }
}
