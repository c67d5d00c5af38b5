//! `sonoweave completions`: completions of the command line for shells.

use std::path::PathBuf;

use clap::{Args, Command};
use clap_complete::{Shell, generate};

use formats::whole::write_whole;

use super::Failure;
use super::print::print;
use crate::app::input;

/// Flags of `completions`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
The Debian package installs completions for bash, zsh and fish.

Examples:
  sonoweave completions bash -o ~/.local/share/bash-completion/completions/sonoweave
  sonoweave completions zsh > _sonoweave")]
pub struct Arguments {
    /// Shell that reads them
    #[arg(value_enum)]
    shell: Shell,
    /// Write them to this file [default: stdout]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Runs the command, for the command line `of`.
///
/// # Errors
/// [`Failure`]: the file does not exist then.
pub fn run(arguments: &Arguments, of: Command) -> Result<(), Failure> {
    let text = text(arguments.shell, of);
    let Some(path) = &arguments.output else { return print(&text) };
    input::check_output(path)?;
    write_whole(path, |to| to.write_all(text.as_bytes())).map_err(|error| Failure::io(path, "writing", &error))
}

fn text(shell: Shell, mut of: Command) -> String {
    let mut content = Vec::new();
    generate(shell, &mut of, "sonoweave", &mut content);
    String::from_utf8_lossy(&content).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn completions_contain_every_command_and_flag() {
        let command = crate::cli::command_line();
        let subcommands: Vec<_> = command.get_subcommands().collect();
        assert!(subcommands.iter().any(|sub| sub.get_name() == "live"));
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
            let text = text(shell, command.clone());
            for sub in &subcommands {
                assert!(text.contains(sub.get_name()), "{shell}: {}", sub.get_name());
                for flag in sub.get_arguments().filter_map(clap::Arg::get_long) {
                    let offered = match shell {
                        Shell::Fish => format!("-l {flag}"),
                        _ => format!("--{flag}"),
                    };
                    assert!(text.contains(&offered), "{shell}: {} {offered}", sub.get_name());
                }
            }
        }
    }
}
