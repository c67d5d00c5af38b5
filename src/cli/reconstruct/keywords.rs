//! The flags of `reconstruct` as keywords of a program: the same names, values and defaults.

use clap::Parser;
use clap::error::ErrorKind;

use super::flags::Flags;
use crate::failure::Failure;

#[derive(Debug, Parser)]
#[command(no_binary_name = true, disable_help_flag = true)]
struct Keywords {
    #[command(flatten)]
    flags: Flags,
}

/// Parses keywords, such as `max_weight` and `3`, as the flags of their names.
///
/// # Errors
/// [`Failure`] names the keyword, its value and the values that it takes.
pub(crate) fn parse(keywords: &[(String, String)]) -> Result<Flags, Failure> {
    parse_as::<Keywords>(keywords).map(|parsed| parsed.flags)
}

/// Parses keywords as flags of a command.
pub(in crate::cli) fn parse_as<P: Parser>(keywords: &[(String, String)]) -> Result<P, Failure> {
    let is_name = |name: &str| !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    if let Some((name, _)) = keywords.iter().find(|(name, _)| !is_name(name)) {
        return Err(Failure::usage(format!("{name:?}: is no keyword; give letters, digits and _")));
    }
    let words = keywords.iter().map(|(name, value)| format!("--{}={value}", name.replace('_', "-")));
    P::try_parse_from(words).map_err(|error| {
        let text = error.render().to_string();
        // The usage and the tips that follow are those of a command line.
        let sentence = text.split("\n\nUsage").next().unwrap_or(&text);
        let sentence = sentence.split("\n\n").next().unwrap_or(sentence).trim();
        let sentence = sentence.strip_prefix("error: ").unwrap_or(sentence);
        match error.kind() {
            ErrorKind::UnknownArgument => Failure::usage(format!("{sentence}; check the keyword's name")),
            _ => Failure::usage(sentence.split_whitespace().collect::<Vec<_>>().join(" ")),
        }
    })
}
