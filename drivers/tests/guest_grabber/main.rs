//! The grabber driver against the kernel's own V4L2 and its virtual device vivid:
//! `make hardware-test`. Elsewhere every test is reported as ignored.
//!
//! - [`pictures`]: output equals input, byte for byte; fields, times, numbers.
//! - [`faults`]: vivid's own faults: lost and damaged frames, refused calls, broken streams, no
//!   signal, another source, unplugging.
//! - [`allocations`]: counts allocation requests.
//! - [`vivid`]: the device's controls, and its output.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(clippy::print_stdout, reason = "a test of rates says what they were")]

mod allocations;
mod faults;
mod pictures;
mod vivid;

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use libtest_mimic::{Arguments, Trial};

use drivers::grabber::{Grabber, GrabberSettings};
use sonoweave_core::clock::{Clock, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Frame, Reading};
use sonoweave_core::{Device, Next};

/// Name and function of a test.
type Test = (&'static str, fn());

fn main() -> ExitCode {
    let in_guest = Path::new("/sonoweave-guest").exists();
    let trials = pictures::TESTS.iter().chain(faults::TESTS).map(|&(name, test)| {
        Trial::test(name, move || {
            vivid::Vivid::reset();
            test();
            Ok(())
        })
        .with_ignored_flag(!in_guest)
    });
    libtest_mimic::run(&Arguments::from_args(), trials.collect()).exit_code()
}

/// A started grabber on vivid's HDMI input, and functions that wait for its frames and states.
struct Rig {
    grabber: Grabber,
}

impl Rig {
    fn start(settings: GrabberSettings) -> Self {
        let mut grabber = Grabber::new(settings, Arc::new(Monotonic)).unwrap();
        grabber.start().unwrap();
        Self { grabber }
    }

    /// Returns the next frame; fails if none comes for `seconds`.
    fn frame_within(&mut self, seconds: i64) -> Frame {
        let deadline = Monotonic.now_ns() + seconds * SECOND;
        match self.grabber.next(deadline).unwrap() {
            Next::Reading(Reading::Frame(frame)) => frame,
            other => panic!("{other:?}; {:?}", self.grabber.health()),
        }
    }

    fn frame(&mut self) -> Frame {
        self.frame_within(5)
    }

    fn frames(&mut self, count: usize) -> Vec<Frame> {
        (0..count).map(|_| self.frame()).collect()
    }

    /// Reads until the device is in this state; fails after ten seconds.
    fn until(&mut self, state: State) {
        let end = Monotonic.now_ns() + 10 * SECOND;
        while self.grabber.health().state != state {
            let now = Monotonic.now_ns();
            assert!(now < end, "not {state:?}: {:?}", self.grabber.health());
            let _ = self.grabber.next(now + SECOND / 20).unwrap();
        }
    }
}

/// Returns the settings of vivid's HDMI input.
fn hdmi() -> GrabberSettings {
    GrabberSettings { input: Some("1".into()), ..GrabberSettings::new(vivid::CAPTURE_NODE) }
}
