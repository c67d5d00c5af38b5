//! `sonoweave repair`: writes the intact part of a damaged or interrupted session to a new file.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use formats::Limits;
use formats::session::repair;

use super::Failure;
use super::inspect::session::SessionReport;
use super::inspect::text::{Text, count};
use super::print::print;
use crate::app::input;
use crate::app::json::JsonFlag;

/// Flags of `repair`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
The new file contains every readable message, in order, with times and numbers, and lists the missing parts. The old \
file stays as it is. A session that ended in order and has no damage is copied.

Example: sonoweave repair SESSION-20261121-213000.mcap -o whole.mcap")]
pub struct Arguments {
    /// Recorded session (.mcap)
    session: PathBuf,
    /// Write the repaired session to this file, which must not exist
    #[arg(short, long, value_name = "OUT.mcap")]
    output: PathBuf,
    #[command(flatten)]
    json: JsonFlag,
}

/// A repaired session.
#[derive(Debug, Serialize)]
struct Report<'a> {
    /// The session before, with its losses and damage.
    #[serde(flatten)]
    session: SessionReport,
    repaired: Repaired<'a>,
}

/// The new file.
#[derive(Debug, Serialize)]
struct Repaired<'a> {
    path: &'a PathBuf,
    messages: u64,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: there is no new file then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { session, output, json } = arguments;
    json.check([session.as_path(), output])?;
    input::check_folder(output)?;
    if !input::is_session(session)? {
        fail!(
            "{}: is not a session, and only sessions are repaired; give one that `live --record` wrote",
            session.display()
        );
    }
    let report = SessionReport::read(session)?;
    let messages = repair(session, output, &Limits::default())?.messages;
    let mut text = Text::default();
    report.write(&mut text);
    text.heading("repaired");
    text.row("written", format!("{}: {}", output.display(), count(messages, "message")));
    print(&text.finish())?;
    json.write(&Report { session: report, repaired: Repaired { path: output, messages } })
}
