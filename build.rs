//! Tells the program its commit and its cargo features, for `--version`.
//!
//! The commit is that of the environment variable `SONOWEAVE_COMMIT`, or git's for an optimised
//! build in the project's own repository. Other builds name none: a development build would have to
//! be built again after every commit, and a source archive has no git. Nothing depends on the time,
//! the user or the folder, so that the same source gives the same bytes.

use std::env;
use std::path::Path;
use std::process::Command;

/// Sources whose change makes the build differ from its commit.
const SOURCES: [&str; 6] = ["build.rs", "Cargo.toml", "Cargo.lock", "src", "crates", "drivers"];

fn main() {
    println!("cargo:rerun-if-env-changed=SONOWEAVE_COMMIT");
    println!("cargo:rerun-if-changed=build.rs");
    let given = env::var("SONOWEAVE_COMMIT").ok();
    let is_optimised = env::var("PROFILE").is_ok_and(|profile| profile == "release");
    let commit = given.or_else(|| if is_optimised { from_git() } else { None });
    println!("cargo:rustc-env=SONOWEAVE_BUILT_FROM={}", commit.unwrap_or_default());
    let features = env::vars().filter_map(|(name, _)| Some(name.strip_prefix("CARGO_FEATURE_")?.to_lowercase()));
    let mut features: Vec<String> = features.collect();
    features.sort();
    println!("cargo:rustc-env=SONOWEAVE_FEATURES={}", features.join(" "));
}

/// Returns the commit, with `-dirty` if files differ from it; `None` outside the repository.
fn from_git() -> Option<String> {
    let here = env::current_dir().ok()?.canonicalize().ok()?;
    // An archive that was unpacked within another repository is not of that repository's commit.
    if Path::new(&git(&["rev-parse", "--show-toplevel"])?).canonicalize().ok()? != here {
        return None;
    }
    let reference = git(&["symbolic-ref", "-q", "HEAD"]).unwrap_or_default();
    for name in ["HEAD", "packed-refs", &reference] {
        let path = git(&["rev-parse", "--git-path", name])?;
        // A missing file would count as changed in every build.
        if !name.is_empty() && Path::new(&path).exists() {
            println!("cargo:rerun-if-changed={path}");
        }
    }
    SOURCES.iter().for_each(|path| println!("cargo:rerun-if-changed={path}"));
    git(&["describe", "--always", "--dirty", "--abbrev=12", "--exclude", "*"])
}

/// Returns git's answer.
fn git(words: &[&str]) -> Option<String> {
    let output = Command::new("git").args(words).output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}
