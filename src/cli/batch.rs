//! `sonoweave batch`: many sweeps by a manifest, each reconstructed by a process of its own.

mod card;
mod flags;
mod plan;
mod run;
mod settings;
mod status;
mod values;
mod verify;

use clap::{Args, Subcommand};

use super::Failure;

/// Commands of `batch`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
A manifest has a row for each sweep, as CSV or JSON Lines. `plan` checks it, `run` reconstructs what is not done yet, \
and may be killed and run again at any time. Results are in RUN/sweeps/ID, accounts of all tries in RUN/attempts/ID.

Example: sonoweave batch plan manifest.csv -o run
         sonoweave batch run run --jobs 4
         sonoweave batch status run")]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Check a manifest, and write the plan of its sweeps
    Plan(plan::Arguments),
    /// Reconstruct the sweeps that are not done
    Run(run::Arguments),
    /// Report what is done, what has failed and why
    Status(status::Arguments),
    /// Compare the results with their hashes
    Verify(verify::Arguments),
    /// Reconstruct failed sweeps again
    Retry(run::Arguments),
    /// Write the card of the data set: numbers, participants, description
    Card(card::Arguments),
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when a plan cannot be made or used, or some sweeps are not done.
pub fn run(arguments: &Arguments, quiet: bool) -> Result<(), Failure> {
    match &arguments.command {
        Command::Plan(arguments) => plan::run(arguments),
        Command::Run(arguments) => run::run(arguments, quiet, true),
        Command::Status(arguments) => status::run(arguments),
        Command::Verify(arguments) => verify::run(arguments, quiet),
        Command::Retry(arguments) => run::run(arguments, quiet, false),
        Command::Card(arguments) => card::run(arguments),
    }
}
