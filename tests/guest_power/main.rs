//! Recordings, volumes and calibration files on a disk of the emulated machine, whose power is cut,
//! or which is full, read-only or slow: `make hardware-test`. Elsewhere every test is reported as
//! ignored.
//!
//! This program runs on both sides:
//!
//! - [`host`]: the tests. They boot the guest with a disk, cut its power, and boot it again.
//! - [`loss`]: what is left of a disk whose own cache has lost its content.
//! - [`guest`]: the guest's tasks: to record until the power is cut, to check a disk, and to record
//!   on a disk with faults.
//! - [`recording`]: a session with virtual devices, by the real recorder; its content.
//! - [`files`]: files that are replaced again and again; their content.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(clippy::print_stdout, reason = "both sides talk by lines, and cuts are printed")]

mod files;
mod guest;
mod host;
mod loss;
mod recording;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use libtest_mimic::{Arguments, Trial};

fn main() -> ExitCode {
    if Path::new("/sonoweave-guest").exists() {
        let words: Vec<String> = std::env::args().skip(1).collect();
        // A failed task ends the guest at once. Unwinding would wait for the session's threads.
        let report = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            report(info);
            std::process::exit(101);
        }));
        guest::run(&words);
        return ExitCode::SUCCESS;
    }
    // The folder of the guest's scripts; `scripts/hardware-test.sh` sets it.
    let scripts = std::env::var_os("SONOWEAVE_GUEST").map(PathBuf::from);
    let trials = host::TESTS.iter().map(|&(name, test)| {
        let scripts = scripts.clone();
        let is_ignored = scripts.is_none();
        Trial::test(name, move || {
            test(&scripts.ok_or("SONOWEAVE_GUEST is not set; run `make hardware-test`")?);
            Ok(())
        })
        .with_ignored_flag(is_ignored)
    });
    libtest_mimic::run(&Arguments::from_args(), trials.collect()).exit_code()
}
