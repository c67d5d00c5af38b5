//! Devices that are unplugged and plugged in again during a session.

use std::os::unix::fs::symlink;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use tempfile::TempDir;

use drivers::OpenSettings;
use drivers::simulated::grabber::Grabber;
use drivers::simulated::{Faults, Machine, Motion, Placed, Pty, fastrak};
use drivers::tracker::polhemus::{self, Model, Port, TrackerSettings};
use sonoweave_core::Device;
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::refusal::Reason;

use crate::script::{begin, poses};
use crate::set::{SIZE, Set, frames};

/// A simulated device on a line that keeps its name when plugged in again, like links in
/// /dev/serial/by-id.
pub(crate) struct Line<P> {
    pub(crate) twin: Arc<Mutex<P>>,
    pty: Option<Pty>,
    folder: TempDir,
}

impl<P: Machine + 'static> Line<P> {
    pub(crate) fn new(twin: P) -> Self {
        let mut line = Self { twin: Arc::new(Mutex::new(twin)), pty: None, folder: tempfile::tempdir().unwrap() };
        line.connect();
        line
    }

    pub(crate) fn path(&self) -> PathBuf {
        self.folder.path().join("device")
    }

    fn connect(&mut self) {
        let pty = Pty::run(Arc::clone(&self.twin)).unwrap();
        let new = self.folder.path().join("new");
        symlink(pty.path(), &new).unwrap();
        std::fs::rename(new, self.path()).unwrap();
        self.pty = Some(pty);
    }

    pub(crate) fn pull(&mut self) {
        self.twin.lock().unwrap().unplug();
        self.pty = None;
        std::fs::remove_file(self.path()).unwrap();
    }

    pub(crate) fn plug_in(&mut self) {
        self.twin.lock().unwrap().plug_in(Monotonic.now_ns());
        self.connect();
    }
}

/// A virtual grabber whose frames differ.
pub(crate) fn grabber(rate_hz: f64) -> Grabber {
    let picture = Box::new(|at_ns: i64, pixels: &mut [u8]| {
        let shown = at_ns.to_le_bytes();
        pixels.iter_mut().zip(shown.iter().cycle()).for_each(|(pixel, byte)| *pixel = 60 + byte % 128);
    });
    Grabber::new(picture, SIZE, rate_hz, Faults::default(), Arc::new(Monotonic)).unwrap()
}

/// A probe that moves along z.
pub(crate) fn hand() -> Motion {
    let begin_ns = Monotonic.now_ns();
    Arc::new(move |_, at_ns| Placed {
        position_cm: [10.0, 0.0, (at_ns - begin_ns) as f64 * 1e-9],
        quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
    })
}

/// The phase of the test.
#[derive(PartialEq)]
enum Phase {
    Before,
    Away,
    /// Plugged in again; number of frames used before.
    Back(u64),
}

#[test]
fn replugged_tracker_loses_only_frames_meanwhile() {
    let mut line = Line::new(fastrak::Twin::new(hand(), Faults::default()));
    let port = Port::Serial { path: line.path(), baud: None };
    let settings =
        TrackerSettings { model: Model::Fastrak, port, settings: polhemus::Settings::default(), keeps_raw: false };
    let tracker = drivers::open(&OpenSettings::Tracker(settings)).unwrap();
    let mut set = Set::of(poses(0, 0), grabber(50.0)).waits(300 * MS);
    set.tracking = tracker;
    let mut phase = Phase::Before;
    let mut missing = [0; 2];
    let (finished, seen) = set.until(|status, _| {
        let used = status.ledger.frames.used;
        let refused = status.ledger.frames.refused.get(&Reason::PoseMissing).copied().unwrap_or(0);
        match phase {
            Phase::Before if used >= 20 => {
                line.pull();
                (phase, missing[0]) = (Phase::Away, refused);
            }
            Phase::Away if refused >= missing[0] + 20 && status.devices[0].state == "absent" => {
                line.plug_in();
                (phase, missing[1]) = (Phase::Back(used), refused);
            }
            Phase::Back(before) => return used >= before + 20,
            _ => {}
        }
        false
    });
    let (total, used, refused) = frames(&finished);
    let [(Reason::PoseMissing, missed)] = refused[..] else { panic!("{refused:?}") };
    assert!(used >= 40 && missed >= missing[1] && total == used + missed, "{}", finished.status.ledger);
    let states = seen.states(0);
    let of = |state| states.iter().position(|one| *one == state);
    let (runs, away) = (of("running").unwrap(), states.iter().rposition(|one| *one == "absent").unwrap());
    assert!(runs < away && states[away..].contains(&"running"), "{states:?}");
    assert!(seen.said(0, "absent", "plug it in") || seen.said(0, "absent", "unplugged"), "{:?}", seen.devices[0]);
    assert_eq!(finished.status.devices[0].set_up, 2);
    let readings = &finished.status.ledger.readings[0];
    assert_eq!((readings.used, readings.dropped), (readings.total, 0), "what came was good");
}

#[test]
fn replugged_grabber_restarts_and_loses_nothing_else() {
    let begin_ns = begin();
    let grabber = grabber(50.0);
    let controls = grabber.controls();
    // A tracker that continues as long as necessary.
    let mut phase = Phase::Before;
    let mut turns = 0;
    let (finished, seen) = Set::of(poses(begin_ns, 2000), grabber).waits(SECOND).until(|status, _| {
        let used = status.ledger.frames.used;
        match phase {
            Phase::Before if used >= 20 => {
                controls.lock().unwrap().plugged = false;
                phase = Phase::Away;
            }
            Phase::Away if status.devices[1].state == "absent" => {
                turns += 1;
                if turns == 20 {
                    assert_eq!(status.ledger.frames.waiting, 0, "none comes, and none is left");
                    controls.lock().unwrap().plugged = true;
                    phase = Phase::Back(used);
                }
            }
            Phase::Back(before) => return used >= before + 20,
            _ => {}
        }
        false
    });
    let (total, used, refused) = frames(&finished);
    // Before the first pose, and after the last, there is none.
    let missing: u64 = refused.iter().map(|(_, count)| count).sum();
    assert!(refused.iter().all(|(reason, _)| *reason == Reason::PoseMissing), "{refused:?}");
    assert!(used >= 40 && total == used + missing, "{}", finished.status.ledger);
    let states = seen.states(1);
    assert!(states.windows(3).any(|three| three == ["running", "absent", "running"]), "{states:?}");
    assert!(seen.said(1, "absent", "is unplugged; plug it in"));
    assert_eq!(finished.status.devices[1].set_up, 2);
}

#[test]
fn hung_grabber_is_reported_silent_alone() {
    let grabber = grabber(50.0);
    let controls = grabber.controls();
    let mut phase = Phase::Before;
    let (finished, seen) = Set::of(poses(begin(), 2000), grabber).waits(SECOND).until(|status, _| {
        let used = status.ledger.frames.used;
        match phase {
            Phase::Before if used >= 20 => {
                controls.lock().unwrap().hung = true;
                phase = Phase::Away;
            }
            Phase::Away if status.devices[1].state == "silent" => {
                controls.lock().unwrap().hung = false;
                phase = Phase::Back(used);
            }
            Phase::Back(before) => return used >= before + 20,
            _ => {}
        }
        false
    });
    assert!(finished.status.ledger.frames.used >= 40);
    assert!(seen.said(1, "silent", "is there and delivers nothing"));
    assert!(!seen.states(0).contains(&"silent"), "{:?}", seen.states(0));
}

#[test]
fn failed_device_is_reported_at_once_and_other_continues() {
    /// A device that always fails.
    struct Broken(sonoweave_core::Description, sonoweave_core::Health);
    impl Device for Broken {
        fn start(&mut self) -> Result<(), sonoweave_core::Error> {
            Err(sonoweave_core::Error::other("the arm has four joints"))
        }
        fn next(&mut self, _: i64) -> Result<sonoweave_core::Next, sonoweave_core::Error> {
            unreachable!("it never started")
        }
        fn stop(&mut self) -> Result<(), sonoweave_core::Error> {
            Ok(())
        }
        fn describe(&self) -> &sonoweave_core::Description {
            &self.0
        }
        fn health(&self) -> &sonoweave_core::Health {
            &self.1
        }
    }
    let mut set = Set::of(Broken(Default::default(), Default::default()), grabber(50.0)).waits(100 * MS);
    set.of = vec!["Probe"];
    let mut reported_while_running = false;
    let (finished, _) = set.until(|status, _| {
        reported_while_running |= status.devices[0].state == "ended" && status.devices[0].why.contains("four joints");
        status.ledger.frames.refused.get(&Reason::PoseMissing).is_some_and(|missing| *missing >= 10)
    });
    assert!(reported_while_running);
    let (total, used, refused) = frames(&finished);
    assert_eq!((used, refused), (0, vec![(Reason::PoseMissing, total)]));
}
