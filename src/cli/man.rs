//! `sonoweave man`: manual pages of the program, its commands and its configuration.

mod pages;

use std::path::PathBuf;

use clap::{Args, Command};

use formats::whole::write_whole;

use super::Failure;
use super::print::print;
use crate::app::input;
use pages::Page;

/// Flags of `man`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
The Debian package installs all pages.

Examples:
  sonoweave man live | man -l -
  sonoweave man --all -o ~/.local/share/man/man1")]
pub struct Arguments {
    /// Command of the page, such as live or calibrate-probe, or bedside for session
    /// configurations [default: the program]
    #[arg(value_name = "COMMAND", conflicts_with = "all")]
    page: Option<String>,
    /// Write the page to this file, or all pages to this folder, which is created if missing
    /// [default: stdout]
    #[arg(short, long, value_name = "FILE|DIR")]
    output: Option<PathBuf>,
    /// Write every page
    #[arg(long, requires = "output")]
    all: bool,
}

/// Runs the command, for the command line `of`.
///
/// # Errors
/// [`Failure`]: the file that failed does not exist then.
pub fn run(arguments: &Arguments, of: &Command) -> Result<(), Failure> {
    let pages = pages::all(of)?;
    if let (true, Some(folder)) = (arguments.all, &arguments.output) {
        std::fs::create_dir_all(folder).map_err(|error| Failure::io(folder, "making the folder", &error))?;
        return pages.iter().try_for_each(|page| write(&folder.join(&page.name), &page.text));
    }
    let asked = arguments.page.as_deref().map_or("sonoweave".to_owned(), |page| format!("sonoweave-{page}"));
    let Some(Page { text, .. }) = pages.iter().find(|page| page.title() == asked) else {
        let titles: Vec<&str> = pages.iter().filter_map(|page| page.title().strip_prefix("sonoweave-")).collect();
        fail!("{}: has no page; give one of {}", arguments.page.as_deref().unwrap_or_default(), titles.join(", "));
    };
    match &arguments.output {
        None => print(text),
        Some(path) => {
            input::check_output(path)?;
            write(path, text)
        }
    }
}

fn write(path: &std::path::Path, text: &str) -> Result<(), Failure> {
    write_whole(path, |to| to.write_all(text.as_bytes())).map_err(|error| Failure::io(path, "writing", &error))
}
