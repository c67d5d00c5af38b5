//! Cost of a slice until its picture is finished: `make bench`, or `cargo bench --bench render --
//! [--quick] [--parts]`.
//!
//! One scan is like that of Ohbuchi, Chen & Fuchs (1992): 90 slices of 128×128 pixels into
//! 128×128×256 voxels, with a picture of 256×256. The other has 256³ voxels and a picture of
//! 512×512. Every timed picture is compared with the one of the whole volume, bit for bit, and
//! with the equations in f64. A wrong picture fails the run; a missed goal is printed but fails
//! nothing.
//!
//! - [`case`]: the scans.
//! - [`follow`]: a slice arrives. [`still`]: a new view. [`slab`]: a few planes change, with and
//!   without caches. [`parts`]: the same in parts of the world, also alone by `--parts`.
//! - [`snapshot`]: volumes of bytes for other renderers; [`peer`]: VTK on the same volumes, if
//!   `make peers` has created its environment.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a bench speaks to its user")]

mod case;
mod follow;
mod parts;
mod peer;
#[path = "../reconstruct/process.rs"]
mod process;
#[path = "../reconstruct/report.rs"]
#[allow(dead_code, reason = "shared with the bench of the reconstruction, which also compares threads")]
mod report;
mod slab;
mod snapshot;
mod still;
#[path = "../reconstruct/timing.rs"]
#[allow(dead_code, reason = "shared with the bench of the reconstruction, which times inserts alone")]
mod timing;

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

use serde_json::json;

use simd::Simd;

use case::{CASES, Ready};
use report::Report;

/// Amount of work of a run: cases, rounds, and view directions beside VTK.
#[derive(Clone, Copy)]
struct Effort {
    cases: usize,
    rounds: usize,
    sides: usize,
    /// Whether it is a smoke test.
    quick: bool,
    /// Whether only pictures in parts are measured.
    only_parts: bool,
}

fn main() -> ExitCode {
    let (mut quick, mut only_parts) = (false, false);
    for argument in std::env::args().skip(1) {
        match argument.as_str() {
            // Cargo passes this to every bench.
            "--bench" => {}
            "--quick" => quick = true,
            "--parts" => only_parts = true,
            other => {
                eprintln!("unknown argument {other}; this bench takes --quick, --parts or nothing");
                return ExitCode::from(2);
            }
        }
    }
    let effort = match quick {
        true => Effort { cases: 1, rounds: 1, sides: 1, quick, only_parts },
        false => Effort { cases: CASES.len(), rounds: 5, sides: 6, quick, only_parts },
    };
    let folder = match (quick, only_parts) {
        (false, false) => "out/bench/render",
        (true, false) => "out/bench/quick-render",
        (false, true) => "out/bench/render-parts",
        (true, true) => "out/bench/quick-render-parts",
    };
    match run(effort, &Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("the bench broke off: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(Effort { cases, rounds, sides, quick, only_parts }: Effort, folder: &Path) -> Result<bool, Box<dyn Error>> {
    let mut report = Report::new();
    let python = peer::environment();
    let mut peers = peer::table();
    for case in &CASES[..cases] {
        let ready = Ready::new(case)?;
        parts::measure(case, &ready, rounds, &mut report)?;
        if only_parts {
            continue;
        }
        follow::measure(case, &ready, rounds, &mut report)?;
        still::measure(case, &ready, rounds, &mut report)?;
        slab::measure(case, &ready, rounds, &mut report)?;
        if let Some(python) = &python {
            peer::measure(case, &ready, python, [rounds, sides], folder, &mut peers, &mut report)?;
        }
    }
    match python {
        Some(_) => report.add(peers),
        None => println!("\nNot compared with VTK: its environment is not there; make peers makes it."),
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let machine = json!({ "cores": cores, "simd": Simd::detect().name(), "load_average_after": load.trim() });
    report.finish(machine, folder, quick, rounds)
}
