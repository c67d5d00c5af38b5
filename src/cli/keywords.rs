//! The flags of commands as keywords of a program: the same names, values and defaults.

use clap::error::ErrorKind;
use clap::{Args, Parser};

use crate::failure::Failure;

/// A flag by its name, with `_` for `-`, and its value in the command line's notation; `None` for
/// a flag that takes no value.
pub type Keyword = (String, Option<String>);

#[derive(Debug, Parser)]
#[command(no_binary_name = true, disable_help_flag = true)]
struct Words<A: Args> {
    #[command(flatten)]
    arguments: A,
}

/// Parses keywords, such as `max_weight` and `3`, as the flags of their names.
///
/// # Errors
/// [`Failure`] names the keyword, its value and the values that it takes.
pub(crate) fn parse<A: Args>(keywords: &[Keyword]) -> Result<A, Failure> {
    let is_name = |name: &str| !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    if let Some((name, _)) = keywords.iter().find(|(name, _)| !is_name(name)) {
        return Err(Failure::usage(format!("{name:?}: is no keyword; give letters, digits and _")));
    }
    let words = keywords.iter().map(|(name, value)| {
        let flag = name.replace('_', "-");
        value.as_ref().map_or_else(|| format!("--{flag}"), |value| format!("--{flag}={value}"))
    });
    Words::try_parse_from(words).map(|Words { arguments }| arguments).map_err(|error| {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Args)]
    struct Flags {
        #[arg(long)]
        most_mm: Option<f64>,
        #[arg(long)]
        check: bool,
    }

    fn parsed(keywords: &[(&str, Option<&str>)]) -> Result<(Option<f64>, bool), String> {
        let keywords: Vec<Keyword> =
            keywords.iter().map(|(name, value)| ((*name).into(), value.map(str::to_owned))).collect();
        let parsed = parse::<Flags>(&keywords).map_err(|Failure(reason)| reason.sentence);
        parsed.map(|Flags { most_mm, check }| (most_mm, check))
    }

    #[test]
    fn keywords_are_flags_of_their_names() {
        assert_eq!(parsed(&[]), Ok((None, false)));
        assert_eq!(parsed(&[("most_mm", Some("-2.5")), ("check", None)]), Ok((Some(-2.5), true)));
        for (keyword, says) in [
            (("most_mm", None), "a value is required for '--most-mm"),
            (("check", Some("true")), "unexpected value 'true' for '--check'"),
            (("other", None), "unexpected argument '--other' found; check the keyword's name"),
            (("x=1 --check", None), "is no keyword"),
        ] {
            let sentence = parsed(&[keyword]).unwrap_err();
            assert!(sentence.contains(says) && !sentence.contains('\n'), "{sentence}");
        }
    }
}
