//! Shell completions of the command line.

use clap_complete::{Shell, generate};

use crate::Document;

/// The shells, and the file name that each expects.
pub const SHELLS: [(Shell, &str); 3] =
    [(Shell::Bash, "sonoweave"), (Shell::Zsh, "_sonoweave"), (Shell::Fish, "sonoweave.fish")];

/// Returns one file per shell.
pub fn all(command: &clap::Command) -> Vec<Document> {
    let of_shell = |(shell, name): (Shell, &str)| {
        let mut content = Vec::new();
        generate(shell, &mut command.clone(), "sonoweave", &mut content);
        Document { name: name.to_owned(), content }
    };
    SHELLS.into_iter().map(of_shell).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn completions_contain_every_command_and_flag() {
        let command = crate::command_line();
        let subcommands: Vec<_> = command.get_subcommands().collect();
        assert!(subcommands.iter().any(|sub| sub.get_name() == "live"));
        for (Document { name, content }, (shell, _)) in all(&command).into_iter().zip(SHELLS) {
            let text = String::from_utf8(content).unwrap();
            for sub in &subcommands {
                assert!(text.contains(sub.get_name()), "{name}: {}", sub.get_name());
                for flag in sub.get_arguments().filter_map(clap::Arg::get_long) {
                    let offered = match shell {
                        Shell::Fish => format!("-l {flag}"),
                        _ => format!("--{flag}"),
                    };
                    assert!(text.contains(&offered), "{name}: {} {offered}", sub.get_name());
                }
            }
        }
    }
}
