//! Numerical stress tests: each has a number, an expectation and a measured figure.
//!
//! There are two lengths: a short one in `cargo test`, and the full one (10⁶ slices, a day of
//! stamps) with `SONOWEAVE_STRESS=full`, as `make stress` runs it. All figures are written to
//! `out/stress`, and printed at full length or with `--nocapture`. `README.md` lists the
//! numbers.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]
#![allow(clippy::print_stdout, reason = "the measured figures are the suite's output")]

mod accumulation;
mod adaptive;
mod coverage;
mod decay;
mod departures;
mod faces;
mod figures;
mod folding;
mod following;
mod foreign;
mod geometry;
mod insertion;
mod kernels;
mod memory;
mod order;
mod orientation;
mod pictures;
#[path = "../cli/place.rs"]
#[allow(dead_code, reason = "another suite's helper, used in part")]
mod place;
mod planar;
mod refusals;
mod sampling;
mod selecting;
#[path = "../cli/sequence.rs"]
#[allow(dead_code, reason = "another suite's helper, used in part")]
mod sequence;
mod slabs;
mod support;
mod surfaces;
mod time;

use std::process::{Command, ExitCode};
use std::sync::Arc;

use libtest_mimic::{Arguments, Trial};
use simd::Simd;

use figures::{Length, Report, Test};

/// Environment variable by which this program is `sonoweave` itself.
const AS_PROGRAM: &str = "SONOWEAVE_STRESS_AS_PROGRAM";

/// Returns the `sonoweave` program, for [`place`]. Cargo builds the program's own file for tests of
/// its package only; this one has the same main function.
fn program() -> Command {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.env(AS_PROGRAM, "");
    command
}

fn main() -> ExitCode {
    if std::env::var_os(AS_PROGRAM).is_some() {
        return sonoweave::cli::main();
    }
    if time::is_day_alone() {
        time::day_alone();
        return ExitCode::SUCCESS;
    }
    let arguments = Arguments::from_args();
    let length = Length::from_environment();
    let report = Arc::new(Report::default());
    let themes = [
        accumulation::tests(length),
        order::tests(length),
        support::tests(),
        geometry::tests(),
        coverage::tests(),
        refusals::tests(),
        time::tests(length),
        sampling::tests(),
        orientation::tests(),
        memory::tests(),
        kernels::tests(),
        decay::tests(),
        planar::tests(length),
        departures::tests(),
        selecting::tests(),
        following::tests(),
        folding::tests(),
        adaptive::tests(),
        slabs::tests(),
        surfaces::tests(),
        faces::tests(),
        foreign::tests(),
    ];
    let mut trials: Vec<Trial> = themes.into_iter().flatten().map(|test: Test| test.trial(length, &report)).collect();
    trials.extend(Simd::ALL.map(instruction_set));
    let conclusion = libtest_mimic::run(&arguments, trials);
    report.finish(length, &arguments);
    conclusion.exit_code()
}

/// All tests of the project leave out the instruction sets that the machine lacks. This one is then
/// reported as ignored, so that the set is named.
fn instruction_set(simd: Simd) -> Trial {
    let has_bits = move || match order::has_bits_of_portable(simd) {
        true => Ok(()),
        false => Err("other bits than portable".into()),
    };
    Trial::test(format!("instruction set {}", simd.name()), has_bits).with_ignored_flag(!simd.is_available())
}
