//! What the tests that run in the guest have in common: a device that was opened, what it delivers, and the truth to compare that with.

mod rig;
mod truth;

pub(crate) use rig::Rig;
pub(crate) use truth::Truth;

use std::path::Path;
use std::process::ExitCode;

use drivers::polhemus::{Model, Port, Settings, TrackerSettings};
use drivers::{Driver, OpenSettings};
use libtest_mimic::{Arguments, Trial};

/// A test by its name.
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

/// A tracker by the way that the daemon opens one.
pub(crate) fn tracker(model: Model, port: Port, settings: Settings) -> Rig {
    let settings = TrackerSettings { model, port, settings, keeps_raw: false };
    Rig::start(drivers::polhemus::TrackerDriver.open(&OpenSettings::Tracker(settings)).unwrap())
}
