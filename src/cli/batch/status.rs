//! `sonoweave batch status`: reports what is done, what has failed and why.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

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
    /// Write numbers and times as metrics for the text file collector of Prometheus; their label
    /// `batch` is the file's name
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
    let metrics_file = prometheus.as_ref().map(|path| Ok::<_, Failure>((path, batch_name(path)?))).transpose()?;
    let folder = RunFolder::open(folder)?;
    let status = status(&folder, &selection.selection())?;
    print(&status);
    if let Some((path, batch)) = metrics_file {
        write_whole(path, |to| to.write_all(metrics(&status, batch).as_bytes()))
            .map_err(|e| Failure::io(path, "writing", &e))?;
    }
    json.write(&status)
}

/// Returns the name of a batch among others: that of its file of metrics, without the ending that
/// the collector reads.
///
/// # Errors
/// [`Failure`] for a name that the collector or a label does not take, or a missing folder.
fn batch_name(path: &Path) -> Result<&str, Failure> {
    let name = path.file_name().and_then(OsStr::to_str).and_then(|name| name.strip_suffix(".prom"));
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-');
    let Some(name) = name.filter(|name| !name.is_empty() && name.chars().all(is_plain)) else {
        fail_usage!(
            "--prometheus {}: names the batch; give a file name of letters, digits, points, hyphens and underscores \
             that ends in .prom",
            path.display()
        );
    };
    input::check_output(path)?;
    Ok(name)
}

/// Prints the state of a batch: its numbers, and a line for each sweep that failed or runs.
pub(super) fn print(status: &Status) {
    let Status { sweeps, done, failed, running, waiting, unfinished, .. } = status;
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
