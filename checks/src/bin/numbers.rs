//! Renews the measured figures of the documents.
//!
//! - `numbers` writes each block's text from its template and records, and the chart: `make
//!   numbers`.
//! - `numbers record NAME RUN.json --command COMMAND --sources FOLDER,FOLDER…` enters a run's
//!   figures into the record NAME, as measured now. `out/numbers` has every run's record.
//!
//! A run replaces the documents' own record, and renews their blocks, under three conditions. It
//! was no quick one, it has all figures that the documents show, and the measured sources are those
//! of the commit.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program that speaks to its user")]

use std::error::Error;
use std::fs;
use std::path::Path;
use std::process::ExitCode;

use sonoweave_checks::FOLDER;
use sonoweave_checks::chart;
use sonoweave_checks::documents::Documents;
use sonoweave_checks::record::{Machine, Record, Run};
use sonoweave_checks::sources::Checkout;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap_or(Path::new("."));
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let result = match arguments[..] {
        [] => renew(root),
        ["record", name, run, "--command", command, "--sources", sources] => {
            enter(root, name, Path::new(run), command, sources.split(',').collect())
        }
        _ => Err("usage: numbers [record NAME RUN.json --command COMMAND --sources FOLDER,FOLDER…]".into()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("numbers: {error}");
            ExitCode::FAILURE
        }
    }
}

fn renew(root: &Path) -> Result<(), Box<dyn Error>> {
    let checkout = Checkout::open(root).map_err(|e| format!("the sources of today are unknown: {e}"))?;
    let documents = Documents::read(root, Some(&checkout))?;
    let drawn = chart::drawn(&documents.records)?;
    let is_current = fs::read_to_string(root.join(chart::PATH)).is_ok_and(|before| before == drawn);
    let chart = (!is_current).then(|| (chart::PATH.to_owned(), drawn));
    for (path, text) in documents.renewed()?.into_iter().chain(chart) {
        fs::write(root.join(&path), text)?;
        println!("{path} was renewed");
    }
    Ok(())
}

fn enter(root: &Path, name: &str, run: &Path, command: &str, paths: Vec<&str>) -> Result<(), Box<dyn Error>> {
    let text = fs::read_to_string(run).map_err(|e| format!("{}: {e}", run.display()))?;
    let run: Run = serde_json::from_str(&text).map_err(|e| format!("{}: {e}", run.display()))?;
    let checkout = match Checkout::open(root) {
        Ok(checkout) => checkout,
        Err(error) => {
            println!("The figures of {name} are not recorded, because their commit is unknown: {error}");
            return Ok(());
        }
    };
    let commit = checkout.commit()?;
    let sources = checkout.today(paths.iter().copied())?;
    if let Some(absent) = paths.iter().find(|path| !sources.contains_key(**path)) {
        return Err(format!("there is no {absent} to be measured").into());
    }
    let changed = checkout.hashes(&commit, paths.iter().copied()) != sources;
    let date = chrono::Utc::now().format("%Y-%m-%d").to_string();
    let mut record = Record {
        commit,
        date,
        command: command.to_owned(),
        machine: Machine::this(),
        sources,
        peers: run.peers.clone(),
        figures: run.figures.clone(),
    };
    let file = format!("{name}.json");
    record.write(&root.join("out/numbers").join(&file))?;
    let shown = Documents::read(root, None)?.shown(name, &run);
    let shown = if changed { Err("the measured sources are not committed".into()) } else { shown };
    match shown {
        Ok(figures) => {
            record.figures = figures;
            record.write(&root.join(FOLDER).join(&file))?;
            println!("{FOLDER}/{file} has the figures of this run");
            renew(root)
        }
        Err(reason) => {
            println!("The figures are in out/numbers/{file}, and not in the documents: {reason}");
            Ok(())
        }
    }
}
