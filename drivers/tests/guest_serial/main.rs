//! Serial lines against the kernel's own drivers: `make hardware-test`. Elsewhere every test is
//! reported as ignored.
//!
//! - [`gadget`]: `cdc_acm`, connected to a gadget of the kernel; the virtual unit is at the
//!   other end.
//! - [`adapter`]: `ftdi_sio` and `8250`, at the two ends of one cable; the virtual unit is at
//!   either end.
//! - [`terminal`]: a pseudo-terminal.
//! - [`spoken`]: a virtual unit that communicates on a line.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(clippy::print_stdout, reason = "a test of times says what they were, and asks for plugs")]

mod adapter;
#[path = "../guest_grabber/allocations.rs"]
mod allocations;
mod gadget;
#[path = "../guest/mod.rs"]
mod guest;
mod spoken;
mod terminal;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::{Arc, Mutex};

use drivers::simulated::{Faults, Simulated, fastrak};
use drivers::tracker::polhemus::{self, Port, Settings};
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Pose, Reading};

use guest::{Rig, Truth};
use spoken::Spoken;

fn main() -> ExitCode {
    guest::run(&[gadget::TESTS, adapter::TESTS, terminal::TESTS])
}

type Fastrak = Arc<Mutex<Simulated<fastrak::Fastrak>>>;

/// Creates a FASTRAK with one sensor, and the sensor's ground truth.
fn a_fastrak() -> (Fastrak, Truth) {
    let truth = Truth::new();
    (Arc::new(Mutex::new(fastrak::Twin::new(truth.motion(), Faults::default()))), truth)
}

fn open(model: polhemus::Model, path: &str, baud: Option<u32>) -> Rig {
    guest::tracker(model, Port::Serial { path: PathBuf::from(path), baud }, Settings::default())
}

/// Waits until the device runs, and checks each pose against the unit's measurements.
fn assert_exact(rig: &mut Rig, truth: &Truth, count: usize) {
    let took = rig.until(State::Running, 6 * SECOND);
    let late = truth.assert_exact(&rig.poses(count));
    let name = &rig.device.describe().name;
    println!("{name}: running after {} ms, the latest of {count} poses after {} ms", took / MS, late / MS);
}

/// Checks the driver when its line disappears in the middle of a record and returns. `pull`
/// removes it. `back` returns it with a unit on it, and the time since when the unit answers.
fn assert_survives_unplugging(
    rig: &mut Rig,
    truth: &Truth,
    spoken: Spoken,
    mut pull: impl FnMut(&mut Option<Spoken>),
    mut back: impl FnMut() -> (Spoken, i64),
) {
    let mut spoken = Some(spoken);
    for round in 2..4 {
        truth.assert_exact(&rig.poses(60));
        spoken.as_ref().unwrap().fall_silent_mid_record();
        // The half record arrives, and waits for its rest.
        let mut last = rig.readings(30 * MS);
        pull(&mut spoken);
        let begin = Monotonic.now_ns();
        while rig.state() != State::Absent {
            last.extend(rig.readings(5 * MS));
            assert!(Monotonic.now_ns() < begin + 2 * SECOND, "{:?}", rig.device.health());
        }
        let reported = Monotonic.now_ns() - begin;
        let last: Vec<Pose> =
            last.into_iter().map(|r| if let Reading::Pose(pose) = r { pose } else { panic!("{r:?}") }).collect();
        truth.assert_exact(&last);
        assert!(rig.why().contains("was unplugged"), "{}", rig.why());
        // The old line must be closed, so that the new one receives its name.
        drop(spoken.take());
        assert!(rig.readings(700 * MS).is_empty());
        assert!(rig.why().ends_with("is not there: no such file; plug it in"), "{}", rig.why());
        let (again, plugged_ns) = back();
        spoken = Some(again);
        rig.until(State::Running, 6 * SECOND);
        let took = Monotonic.now_ns() - plugged_ns;
        assert!(took < 2 * SECOND, "running {} ms after it first answered", took / MS);
        truth.assert_exact(&rig.poses(60));
        let received = rig.device.health().received;
        assert_eq!((received.opened, received.set_up), (round, round), "{received:?}");
        let name = &rig.device.describe().name;
        println!("{name}: told {} ms after it was pulled, running {} ms after it was back", reported / MS, took / MS);
    }
}
