//! A device on a twin, and what comes of it.

use std::sync::{Arc, Mutex};

use drivers::clock::{Clock, MS, Manual};
use drivers::connection::{Connection, Protocol};
use drivers::health::State;
use drivers::reading::{Pose, Reading};
use drivers::simulated::{Motion, Placed};
use drivers::transport::{MemoryOpener, Peer};
use drivers::{Device, Next};

/// Time at which everything begins, ns: not 0, lest something relies on it.
pub(crate) const BEGIN: i64 = 123_456_789_000;

/// A driver and the twin that it drives.
pub(crate) struct Rig<T, P> {
    pub(crate) twin: Arc<Mutex<T>>,
    pub(crate) clock: Manual,
    pub(crate) device: Connection<P>,
}

impl<T: Peer + 'static, P: Protocol> Rig<T, P> {
    pub(crate) fn new(twin: T, protocol: P, keeps_raw: bool) -> Self {
        let twin = Arc::new(Mutex::new(twin));
        let clock = Manual::at(BEGIN);
        let opener = MemoryOpener::new(Arc::clone(&twin), clock.clone(), 9600);
        let device = Connection::new(Box::new(opener), Arc::new(clock.clone()), protocol, keeps_raw);
        Self { twin, clock, device }
    }

    /// Everything that is delivered in so long a time. The device never overstays a deadline.
    pub(crate) fn readings(&mut self, ns: i64) -> Vec<Reading> {
        let end = self.clock.now_ns() + ns;
        let mut readings = Vec::new();
        loop {
            let now = self.clock.now_ns();
            if now >= end {
                return readings;
            }
            let deadline = (now + 10 * MS).min(end);
            match self.device.next(deadline).unwrap() {
                Next::Reading(reading) => readings.push(reading),
                Next::Pending => {}
                Next::End => panic!("hardware does not end"),
            }
            assert!(self.clock.now_ns() <= deadline, "{} beyond the deadline", self.clock.now_ns() - deadline);
        }
    }

    pub(crate) fn poses(&mut self, ns: i64) -> Vec<Pose> {
        let poses = self.readings(ns).into_iter().filter_map(|reading| match reading {
            Reading::Pose(pose) => Some(pose),
            _ => None,
        });
        poses.collect()
    }

    /// How long it takes until the device is in a state, ns.
    pub(crate) fn until(&mut self, state: State, at_most_ns: i64) -> i64 {
        let begin = self.clock.now_ns();
        while self.device.health().state != state {
            let passed = self.clock.now_ns() - begin;
            assert!(passed < at_most_ns, "not {state:?} after {} ms: {:?}", passed / MS, self.device.health());
            self.readings(MS);
        }
        self.clock.now_ns() - begin
    }
}

/// A path whose place tells the time exactly, in binary fractions that singles hold: ms since [`BEGIN`] along x, eight a ms, each 1/4096 cm, and the station along y.
pub(crate) fn ticking() -> Motion {
    Arc::new(|station, ns| Placed {
        position_cm: [((ns - BEGIN) / (MS / 8)) as f64 / 4096.0 + 1.0, f64::from(station), -30.25],
        quaternion_wxyz: [0.5, -0.5, 0.5, -0.5],
    })
}

/// The time that a place of [`ticking`] tells, ns, an eighth of a ms at most too early.
pub(crate) fn time_told(pose: &Pose) -> i64 {
    ((pose.position_cm[0] - 1.0) * 4096.0).round() as i64 * (MS / 8) + BEGIN
}
