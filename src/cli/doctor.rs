//! `sonoweave doctor`: checks this machine for live sessions.

use std::path::PathBuf;

use clap::Args;

use super::Failure;
use crate::app::doctor::facts::Facts;
use crate::app::doctor::{Verdict, checks::judge};
use crate::app::json::JsonFlag;

/// Flags of `doctor`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Each line is ok, a warning or a problem, with what to do. The exit code is 1 if there is a problem. The disk test \
writes 17 MB into the folder of the recordings, and leaves nothing. `sonoweave live --check` tries the devices of a \
configuration.

Example: sonoweave doctor --record sessions")]
pub struct Arguments {
    /// Existing folder for recordings, whose disk is tested
    #[arg(long, value_name = "DIR", default_value = ".")]
    record: PathBuf,
    #[command(flatten)]
    json: JsonFlag,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when there is a problem; the findings are printed first.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.json.check([])?;
    let findings = judge(&Facts::gather(&arguments.record));
    for finding in &findings {
        print_line!("{:<9} {:<14} {}", finding.verdict.name(), finding.item, finding.found);
        if let Some(advice) = &finding.advice {
            print_line!("{:<24} → {advice}", "");
        }
    }
    arguments.json.write(&findings)?;
    match findings.iter().filter(|finding| finding.verdict == Verdict::Problem).count() {
        0 => Ok(()),
        1 => Err(Failure::new("one problem was found; see its line for what to do")),
        n => Err(Failure::new(format!("{n} problems were found; see their lines for what to do"))),
    }
}
