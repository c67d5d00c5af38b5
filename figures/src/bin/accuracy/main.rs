//! Errors with corrections of poses on and off: `make accuracy`, or `cargo run --release -p
//! sonoweave-figures --bin accuracy -- [--quick]`.
//!
//! Sweeps of an unsteady hand are painted at their true poses. A simulated tracker measures the
//! poses with known errors. The poses of the frames follow by the pairing of sessions, and volumes
//! by their reconstruction. All rows, tables and pictures are written to `out/accuracy`, with an
//! `index.html`. A quick run has one sweep of each kind; it writes to `out/accuracy/quick`.
//!
//! - [`sweep`]: painted sweeps, and the truth.
//! - [`tracker`]: errors of the simulated tracker.
//! - [`poses`]: poses of the frames by interpolation and by smoothing.
//! - [`smoothing`]: errors by the tracker's noise, with smoothing on and off.
//! - [`intervals`]: intervals of voxels by their standard errors, and the truth.
//! - [`kernels`]: errors by the kernel, with exact poses.
//! - [`shadows`]: errors behind bone that some views see past.
//! - [`crossing_scan`]: sweeps that cross, as a tracker's sensor measures them.
//! - [`crossings`]: calibrations by crossing sweeps, and alarms of slipped sensors.
//! - [`drift`]: slow drift, corrected by crossing sweeps.
//! - [`breathing`]: gates by breathing, and gates of bodies at rest.
//! - [`recordings`]: errors by the kernel, on recordings.
//! - [`times`]: times of insertion with methods on.
//! - [`report`]: checks, the Markdown, the page.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program that speaks to its user")]

mod breathing;
mod crossing_scan;
mod crossings;
mod drift;
mod intervals;
mod kernels;
#[path = "../../../../benches/reconstruct/loading.rs"]
mod loading;
mod poses;
mod recordings;
#[path = "../pareto/report.rs"]
#[allow(dead_code, reason = "shared with the comparison of run times, which reports wrong answers itself")]
mod report;
mod shadows;
mod smoothing;
mod sweep;
mod times;
#[path = "../../../../benches/reconstruct/timing.rs"]
#[allow(dead_code, reason = "shared with the bench, which times more than this does")]
mod timing;
mod tracker;

use std::error::Error;
use std::fs;
use std::path::Path;
use std::process::ExitCode;

use serde_json::{Map, Value, json};

use report::Report;
use sweep::Sweep;

fn main() -> ExitCode {
    let mut sweeps = 6;
    let figures = Path::new(env!("CARGO_MANIFEST_DIR"));
    let project = figures.parent().unwrap_or(figures);
    let mut folder = project.join("out/accuracy");
    for argument in std::env::args().skip(1) {
        if argument != "--quick" {
            eprintln!("unknown argument {argument}; this takes --quick or nothing");
            return ExitCode::from(2);
        }
        sweeps = 1;
        folder = folder.join("quick");
    }
    match run(sweeps, project, &folder) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("the comparison broke off: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(sweeps: u64, project: &Path, folder: &Path) -> Result<bool, Box<dyn Error>> {
    fs::create_dir_all(folder)?;
    let (mut report, mut figures) = (Report::default(), Map::new());
    let painted = (1..=sweeps).map(Sweep::new).collect::<Result<Vec<_>, _>>()?;
    smoothing::compare(&painted, &mut report, &mut figures, folder)?;
    intervals::compare(&painted, &mut report, &mut figures)?;
    kernels::compare(sweeps, &mut report, &mut figures, folder)?;
    shadows::compare(sweeps, &mut report, &mut figures)?;
    let quick = sweeps == 1;
    crossings::compare(sweeps, &mut report, &mut figures)?;
    drift::compare(sweeps, &mut report, &mut figures)?;
    breathing::compare(sweeps, &mut report, &mut figures)?;
    recordings::compare(project, !quick, &mut report, &mut figures, folder)?;
    times::compare(&painted[0], quick, &mut report, &mut figures)?;
    let run = json!({ "quick": quick, "figures": Value::Object(figures) });
    fs::write(folder.join("figures.json"), serde_json::to_string_pretty(&run)? + "\n")?;
    report.finish("Errors with corrections on and off", "", folder)
}
