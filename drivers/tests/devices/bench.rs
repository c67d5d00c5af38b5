//! A driver connected to a twin, and functions that read it.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use drivers::connection::{Connection, Protocol};
use drivers::simulated::{Machine, Model, Motion, Placed, Pty, Simulated};
use drivers::transport::{MemoryOpener, Peer, PortPath, SerialOpener};
use sonoweave_core::clock::{Clock, MS, Manual, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Pose, Reading};
use sonoweave_core::{Device, Next};

/// Time at which every test begins, ns: not 0, so that nothing can rely on 0.
pub(crate) const BEGIN: i64 = 123_456_789_000;

/// Returns the setting that a unit refuses.
pub(crate) fn refused_setting(refused: Option<drivers::Error>) -> &'static str {
    match refused {
        Some(drivers::Error::Setting { setting, .. }) => setting,
        other => panic!("{other:?}"),
    }
}

/// A driver with its twin.
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

    /// Returns all readings delivered within `ns`. Checks that no deadline is exceeded.
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

    /// Waits for a state; returns the time it takes, ns.
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

impl<M: Model + 'static, P: Protocol> Rig<Simulated<M>, P> {
    /// Unplugs the unit three times. Checks that it is absent at once, runs soon after plugging
    /// in, and loses nothing.
    pub(crate) fn assert_survives_unplugging(&mut self) {
        self.until(State::Running, 2 * SECOND);
        for _ in 0..3 {
            self.readings(300 * MS);
            self.twin.lock().unwrap().unplug();
            assert!(self.until(State::Absent, SECOND) < 20 * MS, "told at once");
            assert!(self.device.health().why.contains("unplugged"), "{}", self.device.health().why);
            assert!(self.readings(5 * SECOND).is_empty());
            assert!(self.device.health().why.contains("plug it in"), "{}", self.device.health().why);
            self.twin.lock().unwrap().wire.plugged = true;
            let back = self.until(State::Running, 2 * SECOND);
            assert!(back < SECOND, "{} ms", back / MS);
        }
        let received = self.device.health().received;
        assert_eq!((received.opened, received.set_up, received.lost), (4, 4, 0));
    }

    /// Hangs the unit. Checks that it is silent and not absent, and runs soon after it answers
    /// again.
    pub(crate) fn assert_survives_hanging(&mut self) {
        self.until(State::Running, 2 * SECOND);
        self.twin.lock().unwrap().wire.hung = true;
        let noticed = self.until(State::Silent, 2 * SECOND);
        assert!(noticed < 600 * MS, "{} ms", noticed / MS);
        assert!(self.readings(2 * SECOND).is_empty());
        let why = self.device.health().why.clone();
        assert!(why.contains("does not answer") && why.contains("switched on"), "{why}");
        self.twin.lock().unwrap().wire.hung = false;
        let back = self.until(State::Running, 4 * SECOND);
        assert!(back < 2 * SECOND, "{} ms", back / MS);
        assert_eq!(self.device.health().received.opened, 1, "the line was open all along");
    }

    /// Returns how often the unit received these bytes.
    pub(crate) fn times_sent(&self, bytes: &[u8]) -> usize {
        self.twin.lock().unwrap().wire.obeyed.iter().filter(|command| command.as_slice() == bytes).count()
    }

    /// Returns the commands that the unit received, as text.
    pub(crate) fn reported(&self) -> Vec<String> {
        self.twin.lock().unwrap().wire.obeyed.iter().map(|bytes| String::from_utf8(bytes.clone()).unwrap()).collect()
    }
}

/// Runs a twin in real time on a pseudo-terminal until it has delivered `expected` poses. Then
/// the twin hangs up, and the driver must notice.
pub(crate) fn on_a_terminal(twin: impl Peer + 'static, unit: impl Protocol, expected: usize) -> Vec<Pose> {
    let pty = Pty::run(Arc::new(Mutex::new(twin))).unwrap();
    let opener = SerialOpener::new(PortPath { path: pty.path().into(), baud: 9600 }, Arc::new(Monotonic));
    let mut device = Connection::new(Box::new(opener), Arc::new(Monotonic), unit, false);
    device.start().unwrap();
    let end = Monotonic.now_ns() + 20 * SECOND;
    let mut poses = Vec::new();
    while poses.len() < expected {
        assert!(Monotonic.now_ns() < end, "{:?}", device.health());
        match device.next(Monotonic.now_ns() + 50 * MS).unwrap() {
            Next::Reading(Reading::Pose(pose)) => poses.push(pose),
            Next::Reading(other) => panic!("{other:?}"),
            Next::Pending => {}
            Next::End => panic!("the end"),
        }
    }
    drop(pty);
    while device.health().state != State::Absent {
        assert!(Monotonic.now_ns() < end + 5 * SECOND, "{:?}", device.health());
        device.next(Monotonic.now_ns() + 50 * MS).unwrap();
    }
    poses
}

/// Returns a path whose position gives the time exactly, in binary fractions that fit single
/// precision. x is the time since [`BEGIN`] in eighths of a ms, 1/4096 cm each; y is the
/// station.
pub(crate) fn ticking() -> Motion {
    Arc::new(|station, ns| Placed {
        position_cm: [((ns - BEGIN) / (MS / 8)) as f64 / 4096.0 + 1.0, f64::from(station), -30.25],
        quaternion_wxyz: [0.5, -0.5, 0.5, -0.5],
    })
}

/// Returns the time encoded in a position of [`ticking`], ns, at most an eighth of a ms too
/// early.
pub(crate) fn time_of(pose: &Pose) -> i64 {
    ((pose.position_cm[0] - 1.0) * 4096.0).round() as i64 * (MS / 8) + BEGIN
}

/// Decodes the raw pieces among `readings` twice, by a new protocol. Checks that all other
/// readings come again; returns their number.
pub(crate) fn replays<P: Protocol>(readings: &[Reading], protocol: impl Fn() -> P) -> usize {
    let live: Vec<String> = readings
        .iter()
        .filter(|reading| !matches!(reading, Reading::Raw(_)))
        .map(|reading| format!("{reading:?}"))
        .collect();
    let mut protocol = protocol();
    for _ in 0..2 {
        let mut again = VecDeque::new();
        protocol.reset();
        protocol.resume();
        for reading in readings {
            if let Reading::Raw(raw) = reading {
                protocol.decode(&raw.bytes, raw.stamp.host_ns.unwrap(), &mut again);
            }
        }
        assert_eq!(again.len(), live.len());
        for (item, (mut again, live)) in (0..).zip(again.into_iter().zip(&live)) {
            again.stamp_mut().item = item;
            assert_eq!(format!("{again:?}"), *live);
        }
    }
    live.len()
}
