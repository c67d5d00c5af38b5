//! What goes into a package beside the program itself, made from the program's own definitions: manual pages and completions of its command line, and the licences of
//! the crates that are linked into it.
//!
//! Nothing of this is committed, so that nothing of it can be out of date: `scripts/deb.sh` runs the binary of this crate for every package.

pub mod completions;
pub mod manual;
pub mod notices;

use clap::CommandFactory;
use sonoweave::cli;

/// A file to be.
#[derive(Debug)]
pub struct Document {
    /// Its name, without a folder.
    pub name: String,
    /// What stands in it.
    pub content: Vec<u8>,
}

/// The command line, with all that clap adds to it. The subcommand `help` is left out: what it says stands in the manual.
pub fn command_line() -> clap::Command {
    let mut command = cli::Arguments::command().disable_help_subcommand(true);
    command.build();
    command
}
