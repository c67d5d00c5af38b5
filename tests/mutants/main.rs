//! Mutants: small errors inserted into the source on purpose, each of which a named test must
//! detect.
//!
//! `list.toml` names them. They are all inserted at once, in a copy of the tree, each behind its
//! own switch. Then each is enabled alone and its test is run, which must fail. Without any
//! enabled, that test must pass; this is checked once, before its first mutant. The suite fails
//! if a mutant survives, times out, no longer applies to the source or does not compile.
//!
//! They need a separate build, so they are run by `make mutants` (`--include-ignored`) and not
//! by every `cargo test`, which only looks whether all apply. `share.rs` describes which are tried.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "the choice is told before the trials")]

mod build;
mod list;
mod share;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::ExitCode;
use std::sync::{Arc, OnceLock};

use libtest_mimic::{Arguments, Failed, Trial};

use build::{Build, Outcome, PATIENCE, PROCESSOR_SECONDS};
use list::Mutant;
use share::Choice;

/// Data that all trials share.
struct Work {
    mutants: Vec<Mutant>,
    /// Places of those that are left out when the time is up.
    if_time: BTreeSet<usize>,
    /// The build, made by the first trial.
    build: OnceLock<Result<Build, String>>,
    /// Runs of a suite and a filter without any mutant, each made by the first trial that needs
    /// it.
    baselines: BTreeMap<(String, String), OnceLock<Result<(), String>>>,
}

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let mutants = list::read();
    let Choice { all: chosen, if_time, line } = match share::chosen(&mutants) {
        Ok(choice) => choice,
        Err(problem) => {
            eprintln!("{problem}");
            return ExitCode::FAILURE;
        }
    };
    if (arguments.include_ignored || arguments.ignored) && !arguments.list {
        println!("{line}");
    }
    let test = |number: &usize| (mutants[*number].suite.clone(), mutants[*number].test.clone());
    let baselines = chosen.iter().map(|number| (test(number), OnceLock::new())).collect();
    let work = Arc::new(Work { mutants, if_time, build: OnceLock::new(), baselines });
    let trial = |number: usize| {
        let Mutant { name, suite, test, .. } = &work.mutants[number];
        let name = format!("{name} is noticed by {suite} {test} (make mutants)");
        let work = Arc::clone(&work);
        Trial::test(name, move || work.noticed(number)).with_ignored_flag(true)
    };
    let applied = {
        let work = Arc::clone(&work);
        Trial::test("every mutant applies to its source and can be parsed", move || applied(&work.mutants))
    };
    let trials = chosen.into_iter().map(trial).chain([applied]).collect();
    libtest_mimic::run(&arguments, trials).exit_code()
}

/// Puts all mutants into their sources, and parses these with each of them, without a build.
fn applied(mutants: &[Mutant]) -> Result<(), Failed> {
    let files: BTreeSet<&str> = mutants.iter().map(|mutant| mutant.file.as_str()).collect();
    for file in files {
        let source = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file));
        let source = source.map_err(|error| format!("{file}: {error}"))?;
        list::switched(file, &source, mutants)?;
        for mutant in mutants.iter().filter(|mutant| mutant.file == file) {
            if mutant.original.starts_with("let ") {
                return Err(
                    format!("mutant {:?} hides a name from what follows: take its value alone", mutant.name).into()
                );
            }
            syn::parse_file(&list::switched(file, &source, std::slice::from_ref(mutant))?).map_err(|error| {
                format!(
                    "mutant {:?} of {file} is no expression and no statement: {error}. Change it in \
                     tests/mutants/list.toml.",
                    mutant.name
                )
            })?;
        }
    }
    Ok(())
}

impl Work {
    fn noticed(&self, number: usize) -> Result<(), Failed> {
        let mutant = &self.mutants[number];
        if self.if_time.contains(&number) && share::is_time_up() {
            println!("mutants: not tried, as the time is up: {:?}", mutant.name);
            return Ok(());
        }
        let build = once(&self.build, || {
            let suites: BTreeSet<&str> = self.baselines.keys().map(|(suite, _)| suite.as_str()).collect();
            Build::new(&self.mutants, &suites)
        })?;
        once(&self.baselines[&(mutant.suite.clone(), mutant.test.clone())], || unchanged(build, mutant))?;
        match build.run(&mutant.suite, &mutant.test, Some(number)) {
            Outcome::Failed(_) => Ok(()),
            Outcome::TimedOut => Err(format!(
                "mutant {:?} timed out: with it in {}, the tests {:?} of {} ran longer than {}, and noticed nothing; \
                 give what they wait for a limit",
                mutant.name,
                mutant.file,
                mutant.test,
                mutant.suite,
                limits()
            )
            .into()),
            Outcome::Passed(tests) => Err(format!(
                "mutant {:?} survives: with it in {}, {tests} of {tests} tests {:?} of {} pass; a test is missing",
                mutant.name, mutant.file, mutant.test, mutant.suite
            )
            .into()),
        }
    }
}

/// Checks that a mutant's test passes without any mutant.
fn unchanged(build: &Build, mutant: &Mutant) -> Result<(), String> {
    let Mutant { suite, test, .. } = mutant;
    match build.run(suite, test, None) {
        Outcome::Passed(0) => Err(format!("{suite} has no test {test:?}: name another in tests/mutants/list.toml")),
        Outcome::Passed(_) => Ok(()),
        Outcome::Failed(output) => Err(format!("{suite} {test:?} fails without any mutant:\n{output}")),
        Outcome::TimedOut => {
            Err(format!("{suite} {test:?} without any mutant timed out: it ran longer than {}", limits()))
        }
    }
}

/// Returns the limits of a run, in words.
fn limits() -> String {
    format!("{PROCESSOR_SECONDS} s of processor time or {} s", PATIENCE.as_secs())
}

/// Returns what the first call made. A failure's details are in that call's error alone.
fn once<T>(cell: &OnceLock<Result<T, String>>, make: impl FnOnce() -> Result<T, String>) -> Result<&T, Failed> {
    let mut is_first = false;
    let made = cell.get_or_init(|| {
        is_first = true;
        make()
    });
    made.as_ref().map_err(|problem| match problem.lines().next() {
        Some(line) if !is_first => format!("{line} (the first mutant that failed so has the details)").into(),
        _ => problem.into(),
    })
}
