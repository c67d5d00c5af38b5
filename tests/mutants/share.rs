//! The choice of mutants to try.
//!
//! `SONOWEAVE_MUTANTS` is `all` (the default) or `share`: mutants of changed files, and a
//! twentieth of the list that rotates by the day. Mutants of one suite are in the same part as far
//! as possible, so that few suites are built. Files have changed if git finds them different since
//! the common ancestor with `SONOWEAVE_MUTANTS_BASE`, or since `HEAD~1` if that is not set.
//!
//! After the time `SONOWEAVE_MUTANTS_UNTIL`, in seconds since 1970, only those of changed files are
//! tried. The others are named.

use std::collections::BTreeSet;
use std::process::Command;
use std::time::{SystemTime, UNIX_EPOCH};

use crate::list::Mutant;

/// Number of parts of the list. Each day tries one.
const PARTS: u64 = 20;
const DAY_S: u64 = 24 * 60 * 60;

/// The mutants to try.
pub(crate) struct Choice {
    /// Places in the list.
    pub(crate) all: Vec<usize>,
    /// Those that are left out when the time is up.
    pub(crate) if_time: BTreeSet<usize>,
    /// A line that tells the choice.
    pub(crate) line: String,
}

/// Returns whether the time for mutants that may be left out is up.
pub(crate) fn is_time_up() -> bool {
    let until = std::env::var("SONOWEAVE_MUTANTS_UNTIL").ok().and_then(|until| until.parse().ok());
    until.is_some_and(|until: u64| now_s() > until)
}

fn now_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs()
}

/// Returns the mutants to try.
///
/// # Errors
/// A sentence: a choice that does not exist.
pub(crate) fn chosen(mutants: &[Mutant]) -> Result<Choice, String> {
    let choice = std::env::var("SONOWEAVE_MUTANTS").unwrap_or_default();
    let count = mutants.len();
    match choice.as_str() {
        "" | "all" => {
            let line = format!("mutants: all {count}");
            Ok(Choice { all: (0..count).collect(), if_time: BTreeSet::new(), line })
        }
        "share" => Ok(share(mutants, now_s() / DAY_S % PARTS, changed())),
        other => Err(format!("SONOWEAVE_MUTANTS is all or share, not {other:?}")),
    }
}

/// Returns the mutants of changed files, and those of the day's part.
fn share(mutants: &[Mutant], part: u64, changed: Option<(String, BTreeSet<String>)>) -> Choice {
    let is_changed = |n: &usize| changed.as_ref().is_some_and(|(_, files)| files.contains(&mutants[*n].file));
    let mut by_suite: Vec<usize> = (0..mutants.len()).collect();
    by_suite.sort_by_key(|n| &mutants[*n].suite);
    let at = |part: u64| mutants.len() * part as usize / PARTS as usize;
    let due: BTreeSet<usize> = by_suite[at(part)..at(part + 1)].iter().copied().collect();
    let is_due = |n: &usize| due.contains(n);
    let chosen: Vec<usize> = (0..mutants.len()).filter(|n| is_changed(n) || is_due(n)).collect();
    let if_time: BTreeSet<usize> = chosen.iter().copied().filter(|n| !is_changed(n)).collect();
    let of_changed = chosen.len() - if_time.len();
    let since = match &changed {
        Some((base, _)) => format!("{of_changed} of files that changed since {base}"),
        None => "none of changed files, as git does not name any".to_owned(),
    };
    let rest = if_time.len();
    let line = format!(
        "mutants: {} of {}: {since}, and {rest} more of today's twentieth (number {part})",
        chosen.len(),
        mutants.len()
    );
    Choice { all: chosen, if_time, line }
}

/// Returns a commit and the files that differ from it, if git tells them.
fn changed() -> Option<(String, BTreeSet<String>)> {
    let base = std::env::var("SONOWEAVE_MUTANTS_BASE").ok().filter(|base| !base.is_empty());
    let commit = match base {
        Some(base) => git(&["merge-base", &base, "HEAD"])?.trim().to_owned(),
        None => "HEAD~1".to_owned(),
    };
    let files = git(&["diff", "--name-only", "--relative", &commit])?;
    Some((commit, files.lines().map(str::to_owned).collect()))
}

/// Returns what git prints, if it succeeds.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").current_dir(env!("CARGO_MANIFEST_DIR")).args(arguments).output().ok()?;
    if output.status.success() { String::from_utf8(output.stdout).ok() } else { None }
}
