//! What a shell offers when Tab is pressed.

use clap_complete::{Shell, generate};

use crate::Document;

/// The shells, and what each expects its file to be called.
pub const SHELLS: [(Shell, &str); 3] =
    [(Shell::Bash, "sonoweave"), (Shell::Zsh, "_sonoweave"), (Shell::Fish, "sonoweave.fish")];

/// A file for each shell.
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
    fn every_command_and_flag_is_offered_in_every_shell() {
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
