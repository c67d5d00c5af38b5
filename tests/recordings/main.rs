//! Real recordings of PLUS: values read from them, our results, and their agreement with PLUS's
//! results.
//!
//! They are PLUS's test data and not part of the project. They are searched in the folder named
//! by `SONOWEAVE_TEST_DATA`, else in `../shared/data`. A test without its files is reported as
//! ignored, by name; with `SONOWEAVE_REQUIRE_RECORDINGS=1` it fails.

#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "figures for who asks with --nocapture; helpers of tests fail as tests do"
)]

mod config;
mod contact;
mod latency;
mod nwire;
mod reconstruct;
mod sameness;
mod stylus;
mod tracking;

use std::path::{Path, PathBuf};

use libtest_mimic::{Arguments, Failed, Trial};

/// A test's function.
type Check = fn(&Path) -> Result<(), Failed>;

/// A test whose files may be absent.
struct Test {
    name: &'static str,
    needs: Needs,
    check: Check,
}

enum Needs {
    /// The check receives this file.
    File(&'static str),
    /// The check receives the folder with these files.
    Files(&'static [&'static str]),
}

impl Test {
    const fn of_file(name: &'static str, file: &'static str, check: Check) -> Self {
        Self { name, needs: Needs::File(file), check }
    }

    const fn of_folder(name: &'static str, files: &'static [&'static str], check: Check) -> Self {
        Self { name, needs: Needs::Files(files), check }
    }

    fn trial(&self, of: &str, folder: &Path, are_required: bool) -> Trial {
        let (at, files) = match &self.needs {
            Needs::File(file) => (folder.join(file), std::slice::from_ref(file)),
            Needs::Files(files) => (folder.to_owned(), *files),
        };
        let absent = files.iter().map(|file| folder.join(file)).find(|file| !file.is_file());
        let (check, is_ignored) = (self.check, absent.is_some() && !are_required);
        let run = move || match &absent {
            Some(file) => {
                Err(format!("{}: is absent; SONOWEAVE_REQUIRE_RECORDINGS requires it", file.display()).into())
            }
            None => check(&at),
        };
        Trial::test(format!("{of}::{}", self.name), run).with_ignored_flag(is_ignored)
    }
}

fn main() {
    let folder = std::env::var_os("SONOWEAVE_TEST_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let are_required = std::env::var_os("SONOWEAVE_REQUIRE_RECORDINGS").is_some_and(|value| value == "1");
    let modules = [
        ("config", config::TESTS),
        ("contact", contact::TESTS),
        ("latency", latency::TESTS),
        ("nwire", nwire::TESTS),
        ("reconstruct", reconstruct::TESTS),
        ("sameness", sameness::TESTS),
        ("stylus", stylus::TESTS),
        ("tracking", tracking::TESTS),
    ];
    let trials = modules.into_iter().flat_map(|(of, tests)| tests.iter().map(move |test| (of, test)));
    let trials = trials.map(|(of, test)| test.trial(of, &folder, are_required)).collect();
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}
