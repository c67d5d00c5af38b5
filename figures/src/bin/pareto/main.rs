//! Run time against error: `make pareto`, or `cargo run --release -p sonoweave-figures --bin
//! pareto -- [--quick]`.
//!
//! Kernels, supports, voxel sizes, storage and threads over phantoms and trajectories, all at
//! the effective width of the default configuration. They are compared with the equations in f64
//! and with simple methods in common use. Every timed run's error is checked too, and a wrong
//! answer fails the run; times fail nothing. All rows, tables and pictures are written to
//! `out/pareto`, with an `index.html`. A quick run is a smoke test with too few rounds to
//! measure anything; it writes to `out/pareto/quick`.
//!
//! - [`stage`]: phantoms and scans, and the correct values at positions between the voxels.
//! - [`contestant`]: the contestants, at matched width; a further path is one more variant of
//!   its `Path`.
//! - [`correction`]: corrections of a noisy tracker's poses, before a scan is reconstructed.
//! - [`field`]: results interpolated like by a renderer; [`filling`]: holes.
//! - [`measure`]: errors and times of contestants over a scan; [`limits`]: the largest permitted
//!   errors.
//! - [`front`]: dominance and the Pareto front.
//! - [`rows`], [`pictures`]: reports; [`figures`]: numbers that the documents show.
//! - [`storage`]: sums in 32 and 16 bits, in a separate inserter.
//! - [`rendering`]: pictures, by ray cache, ray termination and step length.
//! - [`left_out`]: recordings, each slice predicted from the others.
//! - [`report`]: checks, the Markdown, the page.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program that speaks to its user")]

#[path = "../../../../benches/reconstruct/baselines.rs"]
#[allow(dead_code, reason = "shared with the bench, which also shows the mean in bytes")]
mod baselines;
#[path = "../../../../benches/reconstruct/check.rs"]
#[allow(dead_code, reason = "shared with the bench, which also compares bricks")]
mod check;
mod contestant;
mod correction;
#[path = "../paper/doll.rs"]
#[allow(dead_code, reason = "shared with the paper's figures, which follow all slices")]
mod doll;
mod field;
mod figures;
mod filling;
mod front;
mod left_out;
mod limits;
#[path = "../../../../benches/reconstruct/loading.rs"]
mod loading;
mod measure;
mod pictures;
mod rendering;
mod report;
mod rows;
mod stage;
mod storage;
#[path = "../../../../benches/reconstruct/timing.rs"]
#[allow(dead_code, reason = "shared with the bench, which times more than this does")]
mod timing;

use std::error::Error;
use std::fs;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use reconstruct::Simd;

use contestant::{Contestant, DEFAULT_VOXEL_MM, full_list, short_list};
use correction::Correction;
use measure::Rounds;
use rendering::Extent;
use report::{Report, digits};

/// Extent of a run.
#[derive(Debug, Clone, Copy)]
struct Effort {
    rounds: Rounds,
    /// Whether everything is swept over the first scans, and brute force runs over every scan.
    whole: bool,
    /// Most slices over the same position.
    stored: u32,
    rendering: Extent,
}

fn main() -> ExitCode {
    let mut effort = Effort {
        rounds: Rounds { cheap: 10, dear: 3 },
        whole: true,
        stored: 1000,
        rendering: Extent { rounds: 2, followed: 16, side: 256, whole: true },
    };
    let figures = Path::new(env!("CARGO_MANIFEST_DIR"));
    let project = figures.parent().unwrap_or(figures);
    let mut folder = project.join("out/pareto");
    for argument in std::env::args().skip(1) {
        if argument != "--quick" {
            eprintln!("unknown argument {argument}; this takes --quick or nothing");
            return ExitCode::from(2);
        }
        effort = Effort {
            rounds: Rounds { cheap: 2, dear: 1 },
            whole: false,
            stored: 100,
            rendering: Extent { rounds: 1, followed: 6, side: 96, whole: false },
        };
        folder = folder.join("quick");
    }
    match run(effort, project, &folder) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("the comparison broke off: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(effort: Effort, project: &Path, folder: &Path) -> Result<bool, Box<dyn Error>> {
    let start = Instant::now();
    fs::create_dir_all(folder)?;
    let mut report = Report::default();
    let machine = machine(effort);
    println!("{machine}");
    let load_before = load();
    let mut rows = Vec::new();
    for (number, plan) in stage::plans().into_iter().enumerate() {
        let stage = stage::Stage::new(plan)?;
        let mut contestants = {
            let planar = plan.is_planar();
            if plan.sweep && effort.whole { full_list(planar) } else { short_list(planar) }
        };
        if plan.is_noisy() {
            let corrected = Correction::ALL.map(contestant::Path::Corrected);
            contestants.extend(corrected.map(|path| Contestant::new(path, DEFAULT_VOXEL_MM)));
        }
        if effort.whole || number == 0 {
            contestants.push(Contestant::new(contestant::Path::BruteForce, DEFAULT_VOXEL_MM));
        }
        let measured = measure::measure(&stage, &contestants, effort.rounds, &mut report)?;
        if let Some(default) = measured.first() {
            let (ms, score) = (default.ms.map(|v| digits(v, 3)), default.score);
            println!(
                "{:32} {:3} contestants, {:5} places; default {} ms ({}–{}), RMSE {} of the truth, {} of the blurred truth; load {}; {:.0} s",
                plan.title,
                measured.len(),
                stage.inside.places.len(),
                ms[1],
                ms[0],
                ms[2],
                digits(score.truth.rmse, 3),
                digits(score.blurred.rmse, 3),
                load(),
                start.elapsed().as_secs_f64()
            );
        }
        rows.extend(measured);
        // An interrupted run has written its rows so far.
        rows::write_csv(&rows, folder)?;
    }
    rows::print_verdicts(&rows, &mut report);
    storage::measure(effort.stored, &mut report, folder)?;
    rendering::measure(effort.rendering, &mut report, folder)?;
    let mut figures = figures::Figures::default();
    figures.add_rows(&rows);
    left_out::measure(project, effort.whole, &mut report, &mut figures, folder)?;
    figures.write(!effort.whole, folder)?;
    pictures::draw(&rows, &mut report, folder)?;
    report.section(format!(
        "### The machine\n\n{machine}; load average {load_before} before, {} after (anything above 0 slows what is measured, two threads most).\n",
        load()
    ));
    let right =
        report.finish("Run time against error", "All rows are in <a href=\"rows.csv\">rows.csv</a>.", folder)?;
    println!(
        "{:.0} s; all rows, tables, pictures and index.html in {}",
        start.elapsed().as_secs_f64(),
        folder.display()
    );
    Ok(right)
}

fn machine(effort: Effort) -> String {
    let model = fs::read_to_string("/proc/cpuinfo")
        .ok()
        .and_then(|text| Some(text.lines().find(|l| l.starts_with("model name"))?.split_once(':')?.1.trim().to_owned()))
        .unwrap_or_else(|| "unknown processor".into());
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let Rounds { cheap, dear } = effort.rounds;
    format!(
        "{model}, {cores} cores, {}; {cheap} rounds of each contestant in turns, {dear} of those that are slow, after one that is not timed",
        Simd::detect().name()
    )
}

/// Returns the load of the last minute.
fn load() -> String {
    let text = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split_whitespace().next().unwrap_or("unknown").to_owned()
}
