//! The paper's figures and claims with ours beside them: `make paper`, or `cargo run --release -p sonoweave-figures --bin paper -- [--quick]`.
//!
//! Ohbuchi, Chen & Fuchs (1992). Every number shown is computed in the run, and what is said of it is asserted: a figure that no longer shows what its
//! caption says fails the run. Pictures, their numbers and the table of claims are in `out/paper` (a quick run's in `out/paper/quick`), with `index.html`
//! to look at.
//!
//! - [`support`]: figure 5, half width and σ, the kernel's end, its effective width.
//! - [`signal`], [`woven`]: figures 6 and 7, and what truncation costs.
//! - [`ripple`]: slices at equal distances.
//! - [`decay`], [`fading`]: what becomes of old data, and where it shows.
//! - [`weights`], [`columns`]: a weight a column against a weight a voxel.
//! - [`woven_volumes`]: claims about volumes, on the reconstructor itself.
//! - [`report`]: checks, claims, the page.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program that speaks to its user")]

mod columns;
mod decay;
mod fading;
mod report;
mod ripple;
mod signal;
mod support;
mod weights;
mod woven;
mod woven_volumes;

use std::error::Error;
use std::fs;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use report::Report;

/// How much of it.
struct Effort {
    /// Draws of the samples' positions.
    draws: u64,
    /// Runs of each timed scan.
    rounds: u32,
}

fn main() -> ExitCode {
    let mut effort = Effort { draws: 200, rounds: 5 };
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut folder = here.parent().unwrap_or(here).join("out/paper");
    for argument in std::env::args().skip(1) {
        if argument != "--quick" {
            eprintln!("unknown argument {argument}; this takes --quick or nothing");
            return ExitCode::from(2);
        }
        effort = Effort { draws: 20, rounds: 1 };
        folder = folder.join("quick");
    }
    match run(&effort, &folder) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("the figures broke off: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(effort: &Effort, folder: &Path) -> Result<bool, Box<dyn Error>> {
    let start = Instant::now();
    fs::create_dir_all(folder)?;
    let mut report = Report::default();
    woven_volumes::speed(&mut report, effort.rounds)?;
    support::draw(&mut report, folder)?;
    woven::draw(&mut report, folder, effort.draws)?;
    let ripples = woven_volumes::undersampling(&mut report)?;
    ripple::draw(&mut report, folder, &ripples)?;
    fading::draw(&mut report, folder)?;
    columns::draw(&mut report, folder)?;
    woven_volumes::sums(&mut report)?;
    woven_volumes::widths(&mut report)?;
    woven_volumes::slab(&mut report)?;
    let load = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = load.split_whitespace().next().unwrap_or("unknown").to_owned();
    let simd = sonoweave::reconstruct::Simd::detect().name();
    let told = format!(
        "Every number of “this run” was computed in it; times with {simd}, medians of {} runs, load average {load} (anything above 0 slows them).",
        effort.rounds
    );
    let right = report.finish(folder, &told)?;
    println!("{:.0} s; figures and index.html in {}", start.elapsed().as_secs_f64(), folder.display());
    Ok(right)
}
