//! Checks that the program understands every `sonoweave …` command in the documentation.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use clap::error::ErrorKind;

/// A command that begins with `sonoweave ` in a text.
#[derive(Debug, PartialEq, Eq)]
struct QuotedCommand {
    command: String,
    /// Whether it is a complete command: a line of a block, behind `$ ` or alone. Text between
    /// backticks may only mention a command.
    whole: bool,
}

/// Returns the commands in a text, also behind `sudo` and its flags, up to a comment, a pipe or a
/// redirection.
fn commands(text: &str) -> Vec<QuotedCommand> {
    let mut all = Vec::new();
    let mut in_block = false;
    for line in text.lines() {
        // A block within a list is indented.
        if line.trim_start().starts_with("```") {
            in_block = !in_block;
        } else if in_block {
            all.push((line.trim_start().trim_start_matches("$ "), true));
        } else {
            all.extend(line.split('`').skip(1).step_by(2).map(|named| (named, false)));
            all.extend(line.strip_prefix("#   ").map(|typed| (typed, true)));
        }
    }
    let told = |(line, whole)| Some(QuotedCommand { command: command(line)?, whole });
    all.into_iter().filter_map(told).collect()
}

fn command(line: &str) -> Option<String> {
    let line = line.strip_prefix("sudo ").map_or(line, |line| line.strip_prefix("-u sonoweave ").unwrap_or(line));
    // "sonoweave: …" is output, not a command.
    line.strip_prefix("sonoweave ")?;
    let end = [" #", " | ", " > ", "   "].iter().filter_map(|end| line.find(end)).min();
    Some(line[..end.unwrap_or(line.len())].trim_end().to_owned())
}

/// Splits a command like a shell, with double quotation marks only.
fn words(command: &str) -> Vec<String> {
    let parts = command.split('"').enumerate();
    parts
        .flat_map(|(n, part)| match n % 2 {
            0 => part.split_whitespace().map(str::to_owned).collect::<Vec<_>>(),
            _ => vec![part.to_owned()],
        })
        .collect()
}

/// Returns why the program would refuse the command.
fn refused(told: &QuotedCommand) -> Option<String> {
    let error = sonoweave::cli::command_line().try_get_matches_from(words(&told.command)).err()?;
    let unknown = matches!(error.kind(), ErrorKind::UnknownArgument | ErrorKind::InvalidSubcommand);
    let asked = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
    (unknown || told.whole && !asked).then(|| error.to_string())
}

/// Returns the documents to check: `*.md` in the repository's root, and `*.md` and `*.toml` under
/// `docs`.
fn documents(root: &Path) -> Vec<PathBuf> {
    let mut all: Vec<_> =
        entries(root).into_iter().filter(|path| path.extension().is_some_and(|end| end == "md")).collect();
    let mut found = entries(&root.join("docs"));
    while let Some(path) = found.pop() {
        if path.is_dir() {
            found.extend(entries(&path));
        } else if path.extension().is_some_and(|end| end == "md" || end == "toml") {
            all.push(path);
        }
    }
    all
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let read = || std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<_>>();
    read().unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
}

#[test]
fn documented_commands_are_understood() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let documents = documents(&root);
    for name in ["README.md", "docs/bedside.md", "docs/examples/virtual.toml", "docs/phantom/nwire.toml"] {
        assert!(documents.contains(&root.join(name)), "{name} is not among the documents");
    }
    let mut found = Vec::new();
    for path in &documents {
        let text = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        found.extend(commands(&text).into_iter().map(|command| (path.display(), command)));
    }
    for word in ["devices", "live", "inspect", "replay", "reconstruct", "render", "phantom"] {
        let begin = format!("sonoweave {word}");
        assert!(found.iter().any(|(_, told)| told.whole && told.command.starts_with(&begin)), "none tells {begin}");
    }
    let wrong: Vec<String> =
        found.iter().filter_map(|(name, told)| Some(format!("{name}: {}\n{}", told.command, refused(told)?))).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Adds the long flags of a command and of its subcommands.
fn add_flags(command: &clap::Command, flags: &mut BTreeSet<String>) {
    flags.extend(command.get_arguments().filter_map(|arg| arg.get_long()).map(str::to_owned));
    command.get_subcommands().for_each(|sub| add_flags(sub, flags));
}

/// Whether a text has the flag, and not only a longer one.
fn mentions(text: &str, flag: &str) -> bool {
    let flag = format!("--{flag}");
    text.match_indices(&flag)
        .any(|(at, _)| !text[at + flag.len()..].starts_with(|c: char| c.is_alphanumeric() || c == '-'))
}

#[test]
fn every_flag_is_used_by_a_test() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut folders = ["tests", "scripts", "src/cli"].map(|name| root.join(name)).to_vec();
    let mut texts = Vec::new();
    while let Some(folder) = folders.pop() {
        for path in entries(&folder) {
            if path.is_dir() {
                folders.push(path);
            } else if !path.starts_with(root.join("src")) || path.ends_with("tests.rs") {
                // Fixtures are not texts.
                texts.extend(std::fs::read_to_string(&path));
            }
        }
    }
    let mut flags = BTreeSet::new();
    add_flags(&sonoweave::cli::command_line(), &mut flags);
    // Tests give it as -v.
    assert!(flags.len() > 150 && flags.remove("verbose"), "{flags:?}");
    let unused: Vec<_> = flags.iter().filter(|flag| !texts.iter().any(|text| mentions(text, flag))).collect();
    assert!(unused.is_empty(), "no test uses {unused:?}");
    assert!(mentions("a --fill b", "fill") && !mentions("--fill-radius 2", "fill"));
}

#[test]
fn invalid_commands_are_detected() {
    let text = "Say `sonoweave live --key` or:\n```\n$ sonoweave devices --watch   # all\nsonoweave: no\n```\n1. Or:\n   ```\n   $ sudo -u sonoweave sonoweave phantom > f\n   ```\n";
    let told = commands(text);
    let seen: Vec<_> = told.iter().map(|told| (told.command.as_str(), told.whole)).collect();
    assert_eq!(
        seen,
        [("sonoweave live --key", false), ("sonoweave devices --watch", true), ("sonoweave phantom", true)]
    );
    assert!(refused(&told[0]).is_some_and(|why| why.contains("--keys")));
    assert_eq!(refused(&told[1]), None);
    assert!(refused(&told[2]).is_some_and(|why| why.contains("--output")));
    assert_eq!(refused(&QuotedCommand { whole: false, command: "sonoweave phantom".into() }), None, "only spoken of");
    assert_eq!(words("a \"b c\" d"), ["a", "b c", "d"]);
}
