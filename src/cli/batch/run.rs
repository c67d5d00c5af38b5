//! `sonoweave batch run` and `retry`: reconstruct the sweeps that are not done.

use std::path::PathBuf;

use clap::Args;

use super::flags::{LimitFlags, SelectionFlags};
use super::status::print;
use crate::app::batch::folder::RunFolder;
use crate::app::batch::run::{Progress, run as run_batch, verdict};
use crate::app::json::JsonFlag;
use crate::cli::Failure;
use crate::cli::progress::say;

/// Flags of `batch run` and `batch retry`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
A sweep is done if its done.json, which is written last, has the key of its inputs and settings; `run` leaves it alone. \
A killed run is run again, and goes on. `run` does not try sweeps again whose tries are used up, or whose failure would \
be the same: `retry` does. The exit code is 10 if some sweeps are not done.

Example: sonoweave batch run run --jobs 4 --memory 4GiB
         sonoweave batch run run --part 3/10
         sonoweave batch retry run --only sweep-17 --timeout 3h")]
pub(super) struct Arguments {
    /// Folder of the plan
    #[arg(value_name = "RUN")]
    folder: PathBuf,
    #[command(flatten)]
    selection: SelectionFlags,
    #[command(flatten)]
    limits: LimitFlags,
    /// Begin no sweep after one has failed
    #[arg(long)]
    fail_fast: bool,
    #[command(flatten)]
    json: JsonFlag,
}

/// Runs the command; `counts_earlier` is whether tries of earlier runs count.
///
/// # Errors
/// [`Failure`] when some sweeps are not done, or the run cannot go on.
pub(super) fn run(arguments: &Arguments, quiet: bool, counts_earlier: bool) -> Result<(), Failure> {
    let Arguments { folder, selection, limits, fail_fast, json } = arguments;
    json.check([])?;
    let folder = RunFolder::open(folder)?;
    let options = limits.options(selection.selection(), *fail_fast, counts_earlier);
    let status = run_batch(&folder, &options, &|progress| show(progress, quiet))?;
    print(&status);
    json.write(&status)?;
    verdict(&status)
}

/// Says the result of a try.
pub(super) fn show(progress: &Progress<'_>, quiet: bool) {
    let Progress { attempt, is_repeated, ended, of } = progress;
    let (id, wall_s) = (&attempt.id, attempt.wall_s);
    if attempt.has_failed() {
        let exit = attempt.exit.unwrap_or_default();
        let why = attempt.sentence.as_deref().unwrap_or("it gave no reason");
        let then = if *is_repeated { "; it is tried again" } else { "" };
        say(&format!("[{ended}/{of}] {id}: failed with exit code {exit}: {why}{then}"));
    } else if !quiet {
        say(&format!("[{ended}/{of}] {id}: done in {wall_s:.1} s"));
    }
}
