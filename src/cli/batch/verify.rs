//! `sonoweave batch verify`: compares the results of a batch with their hashes.

use std::path::PathBuf;

use clap::Args;

use super::flags::{LimitFlags, SelectionFlags};
use super::run::show;
use super::status::print;
use crate::app::batch::folder::RunFolder;
use crate::app::batch::run::{run as run_batch, verdict};
use crate::app::batch::select::Selection;
use crate::app::batch::verify::{remove_damaged, verify};
use crate::app::json::JsonFlag;
use crate::cli::{Failure, FailureKind};

/// Flags of `batch verify`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Every file is read and hashed. The exit code is 10 if one is damaged; sweeps that are not done yet are counted, and \
are no damage. With --repair, damaged sweeps are reconstructed again, with the limits of `batch run`.

Example: sonoweave batch verify run --repair")]
pub(super) struct Arguments {
    /// Folder of the plan
    #[arg(value_name = "RUN")]
    folder: PathBuf,
    #[command(flatten)]
    selection: SelectionFlags,
    /// Reconstruct damaged sweeps again
    #[arg(long)]
    repair: bool,
    #[command(flatten)]
    limits: LimitFlags,
    #[command(flatten)]
    json: JsonFlag,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when a file is damaged and not made again.
pub(super) fn run(arguments: &Arguments, quiet: bool) -> Result<(), Failure> {
    let Arguments { folder, selection, repair, limits, json } = arguments;
    json.check([])?;
    let folder = RunFolder::open(folder)?;
    let verified = verify(&folder, &selection.selection())?;
    let damaged = verified.damaged.len();
    print_line!(
        "{} of {} sweeps are whole, with {} files; {damaged} are damaged, {} are not done",
        verified.whole,
        verified.sweeps,
        verified.files,
        verified.unfinished
    );
    for sweep in &verified.damaged {
        print_line!("{}: {}", sweep.id, sweep.problem);
    }
    json.write(&verified)?;
    if damaged == 0 {
        return Ok(());
    }
    if !repair {
        let sentence = format!("{damaged} sweeps are damaged; make them again by --repair");
        return Err(Failure::new(sentence).of(FailureKind::SomeFailed));
    }
    remove_damaged(&folder, &verified)?;
    let only = verified.damaged.into_iter().map(|sweep| sweep.id).collect();
    let options = limits.options(Selection { only, part: None }, false, false);
    let status = run_batch(&folder, &options, &|progress| show(progress, quiet))?;
    print(&status);
    verdict(&status)
}
