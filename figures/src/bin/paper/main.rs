//! The paper's figures and claims with ours beside them: `make paper`, or `cargo run --release
//! -p sonoweave-figures --bin paper -- [--quick]`.
//!
//! Ohbuchi, Chen & Fuchs (1992). Every number shown is computed in the run, and the statements
//! about it are asserted: a figure that contradicts its caption fails the run. Pictures, their
//! numbers and the table of claims are written to `out/paper` (a quick run's to
//! `out/paper/quick`), with an `index.html`.
//!
//! - [`support`]: figure 5, half width and σ, the kernel's end, its effective width.
//! - [`signal`], [`reconstructed`]: figures 6 and 7, and the cost of truncation.
//! - [`corrections`]: the same signal with corrections of uneven gaps.
//! - [`ripple`]: slices at equal distances.
//! - [`decay`], [`decay_reconstructed`], [`fading`]: decay of old data, and the resulting shifts,
//!   by the equations and by the reconstructor.
//! - [`pulsating`]: the same for a moving sphere, in three dimensions.
//! - [`weights`], [`columns_reconstructed`], [`columns`]: one weight per column against one per
//!   voxel, by the equations and by the reconstructor's two paths.
//! - [`speed`]: the paper's test sizes against the clock.
//! - [`reconstructed_volumes`]: claims about volumes, on the reconstructor itself.
//! - [`doll`]: the paper's test of the renderer; [`caches`]: figures 9 to 11; [`adaptive`],
//!   [`incremental`], [`parts`]: claims about incremental rendering.
//! - [`tank`], [`thigh`]: figures 12 and 13, with simulated echoes; [`bedside`] is shared by
//!   both.
//! - [`report`]: checks, claims, the page.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program that speaks to its user")]

mod adaptive;
mod bedside;
mod caches;
mod columns;
mod columns_reconstructed;
mod corrections;
mod decay;
mod decay_reconstructed;
mod doll;
mod fading;
mod incremental;
mod parts;
mod pulsating;
mod reconstructed;
mod reconstructed_volumes;
mod report;
mod ripple;
mod signal;
mod speed;
mod support;
mod tank;
mod thigh;
#[path = "../../../../benches/reconstruct/timing.rs"]
#[allow(dead_code, reason = "shared with the bench, which times more than this does")]
mod timing;
mod weights;

use std::error::Error;
use std::fs;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use report::Report;

/// Extent of a run.
struct Effort {
    /// Draws of the samples' positions.
    draws: u64,
    /// Runs of each timed scan.
    rounds: u32,
    /// Slices of the incremental rendering, of the paper's 90.
    slices: u32,
    /// Decay rates over a moving object, 1/s.
    rates: &'static [f64],
}

fn main() -> ExitCode {
    let mut effort = Effort {
        draws: 200,
        rounds: 5,
        slices: doll::SLICES,
        rates: &[0.3, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 30.0, 50.0, 100.0],
    };
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut folder = here.parent().unwrap_or(here).join("out/paper");
    for argument in std::env::args().skip(1) {
        if argument != "--quick" {
            eprintln!("unknown argument {argument}; this takes --quick or nothing");
            return ExitCode::from(2);
        }
        effort = Effort { draws: 10, rounds: 1, slices: 20, rates: &[3.0, 10.0] };
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
    let agreement = speed::doll(&mut report, effort.rounds)?;
    speed::thigh(&mut report, effort.rounds)?;
    support::draw(&mut report, folder)?;
    reconstructed::draw(&mut report, folder, effort.draws)?;
    corrections::draw(&mut report, folder, effort.draws)?;
    let ripples = reconstructed_volumes::undersampling(&mut report)?;
    ripple::draw(&mut report, folder, &ripples)?;
    fading::draw(&mut report, folder)?;
    let ages = pulsating::draw(&mut report, folder, decay::kernel()?, effort.rates)?;
    columns::draw(&mut report, folder, &agreement, ages)?;
    reconstructed_volumes::sums(&mut report)?;
    reconstructed_volumes::widths(&mut report)?;
    reconstructed_volumes::slab(&mut report)?;
    let doll = doll::Doll::new(effort.slices)?;
    incremental::exact(&mut report, &doll)?;
    incremental::clipped(&mut report, &doll)?;
    parts::composited(&mut report, &doll)?;
    incremental::timed(&mut report, &doll, effort.rounds)?;
    caches::draw(&mut report, folder, &doll, effort.rounds)?;
    adaptive::draw(&mut report, folder, &doll)?;
    tank::draw(&mut report, folder)?;
    thigh::draw(&mut report, folder)?;
    let load = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = load.split_whitespace().next().unwrap_or("unknown").to_owned();
    let simd = reconstruct::Simd::detect().name();
    let text = format!(
        "Every number of “this run” was computed in it; times with {simd}, medians of {} runs, load average {load} (anything above 0 slows them).",
        effort.rounds
    );
    let right = report.finish(folder, &text)?;
    println!("{:.0} s; figures and index.html in {}", start.elapsed().as_secs_f64(), folder.display());
    Ok(right)
}
