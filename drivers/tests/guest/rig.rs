//! A started device, and functions that wait for its readings and states.

use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Counts, Pose, Reading};
use sonoweave_core::{Device, Next};

/// Tolerance of a call beyond its deadline on a busy machine, ns.
const LATE: i64 = 400 * MS;

pub(crate) struct Rig {
    pub(crate) device: Box<dyn Device>,
}

impl Rig {
    pub(crate) fn start(mut device: Box<dyn Device>) -> Self {
        device.start().unwrap();
        Self { device }
    }

    pub(crate) fn state(&self) -> State {
        self.device.health().state
    }

    pub(crate) fn why(&self) -> &str {
        &self.device.health().why
    }

    /// Returns the next reading within `ns`, if any. No event on the line is an error, and no
    /// deadline is exceeded.
    fn next(&mut self, ns: i64) -> Option<Reading> {
        let deadline = Monotonic.now_ns() + ns;
        let next = self.device.next(deadline).unwrap();
        let late = Monotonic.now_ns() - deadline;
        assert!(late < LATE, "{} ms beyond the deadline: {:?}", late / MS, self.device.health());
        match next {
            Next::Reading(reading) => Some(reading),
            Next::Pending => None,
            Next::End => panic!("hardware does not end"),
        }
    }

    /// Returns all readings delivered within `ns`.
    pub(crate) fn readings(&mut self, ns: i64) -> Vec<Reading> {
        let end = Monotonic.now_ns() + ns;
        let mut readings = Vec::new();
        loop {
            let left = end - Monotonic.now_ns();
            if left <= 0 {
                return readings;
            }
            readings.extend(self.next(left.min(50 * MS)));
        }
    }

    /// Returns `count` readings; fails if one of them takes 5 s.
    fn take(&mut self, count: usize) -> Vec<Reading> {
        let mut readings = Vec::with_capacity(count);
        let mut end = Monotonic.now_ns() + 5 * SECOND;
        while readings.len() < count {
            match self.next(50 * MS) {
                Some(reading) => {
                    readings.push(reading);
                    end = Monotonic.now_ns() + 5 * SECOND;
                }
                None => {
                    assert!(
                        Monotonic.now_ns() < end,
                        "after {} of {count}: {:?}",
                        readings.len(),
                        self.device.health()
                    );
                }
            }
        }
        readings
    }

    /// Returns `count` poses.
    pub(crate) fn poses(&mut self, count: usize) -> Vec<Pose> {
        let pose = |reading| match reading {
            Reading::Pose(pose) => pose,
            other => panic!("{other:?}"),
        };
        self.take(count).into_iter().map(pose).collect()
    }

    /// Returns `count` samples of an arm.
    #[allow(dead_code, reason = "trackers on USB have none")]
    pub(crate) fn counts(&mut self, count: usize) -> Vec<Counts> {
        let counts = |reading| match reading {
            Reading::Counts(counts) => counts,
            other => panic!("{other:?}"),
        };
        self.take(count).into_iter().map(counts).collect()
    }

    /// Waits for a state; returns the time it takes, ns. Drops the readings meanwhile, except
    /// the one that may cause the state.
    pub(crate) fn until(&mut self, state: State, at_most_ns: i64) -> i64 {
        let begin = Monotonic.now_ns();
        while self.state() != state {
            let passed = Monotonic.now_ns() - begin;
            assert!(passed < at_most_ns, "not {state:?} after {} ms: {:?}", passed / MS, self.device.health());
            let _ = self.next(10 * MS);
        }
        Monotonic.now_ns() - begin
    }
}
