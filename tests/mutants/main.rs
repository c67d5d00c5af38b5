//! Mutants: small errors put into the source on purpose, each of which a named test must notice.
//!
//! `list.toml` names them. They are all built at once, in a copy of the tree, each behind a switch of its own; then each is switched on alone
//! and its test is run, which must fail. Without any switched on, all those tests must pass. A mutant that survives, that no longer finds its
//! place in the source or that does not compile fails the suite.
//!
//! They take a build of their own, so they are run by `make stress` (`--include-ignored`) and not by every `cargo test`.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod build;
mod list;

use std::process::ExitCode;
use std::sync::{Arc, OnceLock};

use libtest_mimic::{Arguments, Failed, Trial};

use build::{Build, Outcome};
use list::Mutant;

/// The build, made by the first trial that asks.
type Shared = Arc<OnceLock<Result<Build, String>>>;

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let mutants = Arc::new(list::read());
    let shared: Shared = Arc::default();
    let mut trials: Vec<Trial> = Vec::new();
    let mut add = |name: String, check: Box<dyn FnOnce() -> Result<(), Failed> + Send>| {
        trials.push(Trial::test(format!("{name} (make stress)"), check).with_ignored_flag(true));
    };
    {
        let (mutants, shared) = (Arc::clone(&mutants), Arc::clone(&shared));
        let made = move || match shared.get_or_init(|| Build::new(&mutants)) {
            Ok(_) => Ok(()),
            Err(problem) => Err(Failed::from(problem.clone())),
        };
        add("every mutant has its place in the source and compiles".into(), Box::new(made));
    }
    for (suite, filter) in list::tests(&mutants) {
        let (mutants, shared) = (Arc::clone(&mutants), Arc::clone(&shared));
        let name = format!("the source as it is passes {suite} {filter}");
        add(name, Box::new(move || unchanged(build(&shared, &mutants)?, &suite, &filter)));
    }
    for number in 0..mutants.len() {
        let (mutants, shared) = (Arc::clone(&mutants), Arc::clone(&shared));
        let name = format!("{} is noticed by {} {}", mutants[number].name, mutants[number].suite, mutants[number].test);
        add(name, Box::new(move || noticed(build(&shared, &mutants)?, &mutants[number], number)));
    }
    libtest_mimic::run(&arguments, trials).exit_code()
}

fn build<'a>(shared: &'a Shared, mutants: &[Mutant]) -> Result<&'a Build, Failed> {
    let built = shared.get_or_init(|| Build::new(mutants));
    built.as_ref().map_err(|_| Failed::from("the mutants could not be built: see the first test"))
}

fn unchanged(build: &Build, suite: &str, filter: &str) -> Result<(), Failed> {
    match build.run(suite, filter, None) {
        Outcome::Passed(0) => {
            Err(format!("{suite} has no test {filter:?}: name another in tests/mutants/list.toml").into())
        }
        Outcome::Passed(_) => Ok(()),
        Outcome::Failed(output) => Err(format!("fails without any mutant:\n{output}").into()),
    }
}

fn noticed(build: &Build, mutant: &Mutant, number: usize) -> Result<(), Failed> {
    match build.run(&mutant.suite, &mutant.test, Some(number)) {
        Outcome::Failed(_) => Ok(()),
        Outcome::Passed(tests) => Err(format!(
            "mutant {:?} survives: with it in {}, {tests} of {tests} tests {:?} of {} pass; a test is missing",
            mutant.name, mutant.file, mutant.test, mutant.suite
        )
        .into()),
    }
}
