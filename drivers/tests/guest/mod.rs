//! Shared parts of the tests that run in the guest: an opened device, its readings, and the
//! ground truth.

mod rig;
mod truth;

pub(crate) use rig::Rig;
pub(crate) use truth::Truth;

use std::path::Path;
use std::process::ExitCode;

use libtest_mimic::{Arguments, Trial};

use drivers::OpenSettings;
use drivers::tracker::polhemus::{Model, Port, Settings, TrackerSettings};

/// Name and function of a test.
pub(crate) type Test = (&'static str, fn());

/// Runs the tests in the guest; elsewhere reports each as ignored.
pub(crate) fn run(tests: &[&[Test]]) -> ExitCode {
    let in_guest = Path::new("/sonoweave-guest").exists();
    let trials = tests.iter().flat_map(|tests| tests.iter()).map(|&(name, test)| {
        Trial::test(name, move || {
            test();
            Ok(())
        })
        .with_ignored_flag(!in_guest)
    });
    libtest_mimic::run(&Arguments::from_args(), trials.collect()).exit_code()
}

/// Opens a tracker in the same way as the daemon.
pub(crate) fn tracker(model: Model, port: Port, settings: Settings) -> Rig {
    let settings = TrackerSettings { model, port, settings, keeps_raw: false };
    Rig::start(drivers::open(&OpenSettings::Tracker(settings)).unwrap())
}
