//! Flags of earlier versions: their errors name the present ones.

use std::ffi::OsString;

use clap::error::{ContextKind, ContextValue, ErrorKind};

/// Commands, their flags of earlier versions, and what to do instead. A command's name is also
/// that of all its subcommands. An empty flag is an output without a flag.
const RENAMED: &[(&str, &str, &str)] = &[
    ("calibrate", "--report", "was renamed; use --json=FILE"),
    ("convert", "", "the output follows -o; use `sonoweave convert INPUT -o OUTPUT`"),
    ("demo", "--out", "was renamed; use -o or --output"),
    ("dicom", "", "the output follows -o; use `sonoweave dicom INPUT -o OUTPUT`"),
    ("inspect", "--repair", "is a command now; use `sonoweave repair SESSION -o OUTPUT`"),
    ("live", "--stats", "was renamed; use --json=FILE"),
    ("live", "--volume", "was renamed; use -o or --output"),
    ("reconstruct", "--stats", "was renamed; use --json=FILE"),
    ("render", "--stats", "was renamed; use --json=FILE"),
    ("replay", "--stats", "was renamed; use --json=FILE"),
];

/// Returns the error for arguments, with the present flag if they have one of an earlier version.
pub(super) fn explain(error: clap::Error, command: &mut clap::Command, words: &[OsString]) -> clap::Error {
    let Some(ContextValue::String(flag)) = error.get(ContextKind::InvalidArg) else { return error };
    if error.kind() != ErrorKind::UnknownArgument {
        return error;
    }
    let flag = flag.split('=').next().unwrap_or_default().to_owned();
    let is_moved = replays(words) && draws(command, &flag);
    let (mut at, mut path) = (command, Vec::new());
    for word in words.iter().skip(1).filter_map(|word| word.to_str()) {
        if at.find_subcommand(word).is_none() {
            continue;
        }
        path.push(word);
        let Some(sub) = at.find_subcommand_mut(word) else { return error };
        at = sub;
    }
    let old = if flag.starts_with('-') { flag.as_str() } else { "" };
    let advice = RENAMED.iter().find(|(name, renamed, _)| path.first() == Some(name) && *renamed == old);
    let advice = match advice {
        Some((.., advice)) => advice,
        None if is_moved => {
            "a session is replayed with its recorded configuration; give another by --config. A sweep is drawn by \
             `sonoweave animate`"
        }
        None => return error,
    };
    at.error(ErrorKind::UnknownArgument, format!("{flag}: {advice}"))
}

/// Whether the arguments are those of `replay`.
fn replays(words: &[OsString]) -> bool {
    words.iter().any(|word| word == "replay")
}

/// Whether `animate` takes a flag.
fn draws(command: &clap::Command, flag: &str) -> bool {
    let flag = flag.trim_start_matches("--");
    command.find_subcommand("animate").is_some_and(|sub| sub.get_arguments().any(|arg| arg.get_long() == Some(flag)))
}

#[cfg(test)]
mod tests {
    use super::super::Arguments;
    use super::*;

    fn refused(words: &str) -> String {
        Arguments::of(std::iter::once("sonoweave").chain(words.split(' '))).unwrap_err().to_string()
    }

    #[test]
    fn every_renamed_flag_names_present_one() {
        for (command, flag, advice) in RENAMED {
            let words = match *command {
                "calibrate" => format!("calibrate pivot {flag} x"),
                "convert" | "dicom" => format!("{command} a b"),
                _ => format!("{command} {flag} x"),
            };
            let said = refused(&words);
            assert!(said.contains(advice), "{words}: {said}");
            assert!(said.contains(&format!("Usage: sonoweave {command}")), "{said}");
        }
        assert!(refused("live --volume=v.mha").contains("--volume: was renamed; use -o"));
    }

    #[test]
    fn other_unknown_flags_keep_their_error() {
        for words in ["live --volumes x", "render v.mha --repair x", "convert a --no-such", "inspect a b"] {
            assert!(refused(words).contains("unexpected argument"), "{}", refused(words));
        }
        assert!(refused("replay s.mcap --mode mip").contains("`sonoweave animate`"));
    }
}
