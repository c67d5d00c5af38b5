//! Additional files of a package, made from the program's own definitions: manual pages,
//! completions of its command line, the linked crates' licences, and the list of all crates.
//!
//! None of these files is committed, so none can be out of date: `scripts/deb.sh` runs the binary
//! of this crate for every package.

pub mod completions;
pub mod manual;
pub mod notices;
pub mod sbom;

use clap::CommandFactory;
use sonoweave::cli;

/// A file to write.
#[derive(Debug)]
pub struct Document {
    /// File name, without a folder.
    pub name: String,
    /// Contents of the file.
    pub content: Vec<u8>,
}

/// Returns the command line, with everything that clap adds to it. The subcommand `help` is
/// omitted, because the manual has its contents.
pub fn command_line() -> clap::Command {
    let mut command = cli::Arguments::command().disable_help_subcommand(true);
    command.build();
    command
}
