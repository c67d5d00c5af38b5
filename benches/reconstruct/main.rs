//! Run time and error of the reconstruction: `make bench`, or `cargo bench --bench reconstruct --
//! [--quick] [--only SECTION]`.
//!
//! Every timed result is also checked, against the equations in f64 or against the phantom's
//! truth, and a wrong one fails the run. A missed goal is printed but fails nothing, because
//! machines differ. Tables are printed when finished and written to `out/bench`. A quick run
//! writes to `out/bench/quick`; it is a smoke test with too few repeats to measure anything.
//!
//! - [`recording`]: a real freehand recording, beside our own nearest and trilinear baselines, and
//!   beside IGSIO if `make peers` has compiled it.
//! - [`blobs`]: the comparison scan with known truth: speed and accuracy, with the same
//!   contestants.
//! - [`cube`]: large slices in all orientations, full and fan, instruction sets, threads.
//! - [`planar`]: a 3-DOF arm's scan with the general and the planar insertion path.
//! - [`filling`]: filling the recording's holes.
//! - [`memory`]: bytes per voxel.
//! - [`igsio`]: IGSIO in a [`process`] of its own.
//! - [`baselines`], [`check`], [`loading`], [`timing`], [`report`]: shared parts; `make pareto`
//!   uses all but the last too.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a bench speaks to its user")]

mod baselines;
mod blobs;
mod check;
mod cube;
mod filling;
mod igsio;
mod loading;
mod memory;
mod planar;
mod process;
mod recording;
mod report;
mod timing;

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use serde_json::{Value, json};

use reconstruct::Simd;

/// Amount of work of a run.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Effort {
    /// Runs of each method.
    pub(crate) rounds: usize,
    /// Frames of the scan with known truth.
    pub(crate) blob_frames: u32,
    /// Slices of a sweep through the cube.
    pub(crate) cube_slices: u32,
    /// Slices of the sweep whose memory is measured.
    pub(crate) memory_slices: u32,
}

const WHOLE: Effort = Effort { rounds: 10, blob_frames: 120, cube_slices: 40, memory_slices: 200 };
const QUICK: Effort = Effort { rounds: 2, blob_frames: 24, cube_slices: 12, memory_slices: 24 };

/// Sections that `--only` accepts, in order.
const SECTIONS: [&str; 6] = ["recording", "blobs", "cube", "planar", "filling", "memory"];

fn main() -> ExitCode {
    let (mut effort, mut quick) = (WHOLE, false);
    let mut folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("out/bench");
    let mut only = None;
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--only" => only = Some(arguments.next().unwrap_or_default()),
            // Cargo passes this to every bench.
            "--bench" => {}
            "--quick" => {
                (effort, quick) = (QUICK, true);
                folder = folder.join("quick");
            }
            other => {
                eprintln!("unknown argument {other}; this bench takes --quick and --only SECTION");
                return ExitCode::from(2);
            }
        }
    }
    if let Some(only) = &only {
        if !SECTIONS.contains(&only.as_str()) {
            eprintln!("--only {only}: the sections are {}", SECTIONS.join(", "));
            return ExitCode::from(2);
        }
        folder = folder.join(only);
    }
    match run(effort, quick, only.as_deref(), &folder) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("the bench broke off: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(effort: Effort, quick: bool, only: Option<&str>, folder: &Path) -> Result<bool, Box<dyn Error>> {
    let start = Instant::now();
    let load_before = first_line("/proc/loadavg");
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let model = std::fs::read_to_string("/proc/cpuinfo")
        .ok()
        .and_then(|text| Some(text.lines().find(|l| l.starts_with("model name"))?.split_once(':')?.1.trim().to_owned()))
        .unwrap_or_else(|| "unknown".into());
    let simd = Simd::detect().name();
    println!("CPU             {model}, {cores} cores available, widest instruction set {simd}");
    println!("load average    {load_before} (anything above 0 slows what is measured, two threads most)");
    println!(
        "runs            {} of each contestant, taking turns; ms are per frame, over all frames of all runs",
        effort.rounds
    );

    let mut report = report::Report::new();
    // Memory is measured first, while the process is small.
    let requested = |section: &str| only.is_none_or(|only| only == section);
    let memory = if requested("memory") { Some(memory::measure(effort)?) } else { None };
    let sections = [recording::bench, blobs::bench, cube::bench, planar::bench, filling::bench];
    for (name, bench) in SECTIONS.into_iter().zip(sections) {
        if requested(name) {
            bench(effort, &mut report)?;
        }
    }
    if let Some(memory) = memory {
        memory::report(&memory, &mut report);
    }

    let machine: Value = json!({
        "cpu": model, "cores": cores, "simd": simd,
        "load_average_before": load_before, "load_average_after": first_line("/proc/loadavg"),
        "rounds": effort.rounds, "version": env!("CARGO_PKG_VERSION"),
    });
    let right = report.finish(machine, folder, quick, effort.rounds)?;
    println!("load average    {load_before} before, {} after", first_line("/proc/loadavg"));
    println!("whole run       {:.0} s; tables in {}", start.elapsed().as_secs_f64(), folder.display());
    Ok(right)
}

/// Returns the numbers in a one-line file of the kernel, or "unknown" if there is none.
fn first_line(path: &str) -> String {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let figures: Vec<&str> = text.split_whitespace().take(3).collect();
    if figures.is_empty() { "unknown".into() } else { figures.join(" ") }
}
