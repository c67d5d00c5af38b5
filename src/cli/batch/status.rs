//! `sonoweave batch status`: reports what is done, what has failed and why.

use std::path::PathBuf;

use clap::Args;

use formats::whole::write_whole;

use super::flags::SelectionFlags;
use crate::app::batch::folder::RunFolder;
use crate::app::batch::status::{Status, SweepState, metrics, status};
use crate::app::input;
use crate::app::json::JsonFlag;
use crate::cli::Failure;

/// Flags of `batch status`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Folder of the plan
    #[arg(value_name = "RUN")]
    folder: PathBuf,
    #[command(flatten)]
    selection: SelectionFlags,
    /// Write the numbers of sweeps as metrics, for the text file collector of Prometheus
    #[arg(long, value_name = "FILE.prom")]
    prometheus: Option<PathBuf>,
    #[command(flatten)]
    json: JsonFlag,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the plan cannot be read.
pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { folder, selection, prometheus, json } = arguments;
    json.check([])?;
    if let Some(path) = prometheus {
        input::check_output(path)?;
    }
    let folder = RunFolder::open(folder)?;
    let status = status(&folder, &selection.selection())?;
    print(&status);
    if let Some(path) = prometheus {
        write_whole(path, |to| to.write_all(metrics(&status).as_bytes()))
            .map_err(|e| Failure::io(path, "writing", &e))?;
    }
    json.write(&status)
}

/// Prints the state of a batch: its numbers, and a line for each sweep that failed or runs.
pub(super) fn print(status: &Status) {
    let Status { sweeps, done, failed, running, waiting, unfinished } = status;
    print_line!("{done} of {sweeps} sweeps are done, {failed} have failed, {running} run, {waiting} wait");
    if unfinished.is_empty() {
        return;
    }
    let width = unfinished.iter().map(|sweep| sweep.id.len()).max().unwrap_or(0).max(2);
    print_line!("\n{:width$}  state    tries  exit  reason", "id");
    for sweep in unfinished {
        let state = match sweep.state {
            SweepState::Failed => "failed",
            SweepState::Running => "running",
            SweepState::Waiting => "waiting",
        };
        let exit = sweep.exit.map_or("–".into(), |exit| exit.to_string());
        let kind = sweep.kind.map(|kind| format!("{}: ", kind.words())).unwrap_or_default();
        let why = sweep.sentence.as_deref().unwrap_or("–");
        print_line!("{:width$}  {state:7}  {:>5}  {exit:>4}  {kind}{why}", sweep.id, sweep.attempts);
    }
}
