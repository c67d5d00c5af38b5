//! A copy of the tree with all mutants in it, built; and its tests, run with one of them on.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::list::{Mutant, SWITCH, switched};

/// What the project is built of.
const TREE: [&str; 11] = [
    "Cargo.toml",
    "Cargo.lock",
    "clippy.toml",
    "src",
    "tests",
    "benches",
    "drivers",
    "calibration",
    "figures",
    "packaging",
    "docs",
];
/// The crates' roots, which hold the switch.
const LIBRARIES: [&str; 3] = ["src/lib.rs", "drivers/src/lib.rs", "calibration/src/lib.rs"];
/// The crates beside the daemon's, as suites name them, and by their packages.
const CRATES: [(&str, &str); 2] = [("drivers", "sonoweave-drivers"), ("calibration", "sonoweave-calibration")];
/// A mutant that runs longer than this does not end.
const PATIENCE: Duration = Duration::from_secs(120);

/// The built tests by suite.
pub(crate) struct Build {
    tree: PathBuf,
    programs: BTreeMap<String, PathBuf>,
}

/// What a suite said.
pub(crate) enum Outcome {
    /// So many tests passed.
    Passed(usize),
    /// At least one failed, or the program did not end; its output.
    Failed(String),
}

impl Build {
    /// # Errors
    /// In words: a mutant that has no place or does not compile.
    pub(crate) fn new(mutants: &[Mutant]) -> Result<Self, String> {
        let from = Path::new(env!("CARGO_MANIFEST_DIR"));
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mutants");
        let tree = folder.join("tree");
        std::fs::create_dir_all(&tree).map_err(|e| format!("{}: {e}", tree.display()))?;
        for name in TREE {
            copy(&from.join(name), &tree.join(name), &|path, source| {
                let file = path.strip_prefix(from).unwrap_or(path).to_string_lossy().into_owned();
                let mut source = switched(&file, source, mutants)?;
                if LIBRARIES.contains(&file.as_str()) {
                    source += SWITCH;
                }
                Ok(source)
            })?;
        }
        if let Some(mutant) = mutants.iter().find(|m| !from.join(&m.file).is_file()) {
            return Err(format!(
                "mutant {:?}: there is no {}; update tests/mutants/list.toml",
                mutant.name, mutant.file
            ));
        }
        let suites: BTreeSet<(&str, &str)> = mutants.iter().map(|m| split(&m.suite)).collect();
        let mut cargo = Command::new(env!("CARGO"));
        cargo.current_dir(&tree).args([
            "test",
            "--locked",
            "--package",
            "sonoweave",
            "--no-run",
            "--message-format=json",
        ]);
        let used = |name: &str| suites.iter().any(|(of, _)| *of == name);
        cargo.args(CRATES.iter().filter(|(name, _)| used(name)).flat_map(|(_, package)| ["--package", package]));
        // A target's name is looked for in all packages.
        for target in suites.iter().map(|(_, target)| *target).collect::<BTreeSet<_>>() {
            match target {
                "lib" => cargo.arg("--lib"),
                name => cargo.args(["--test", name]),
            };
        }
        // What cargo says to this program is not meant for the other build.
        for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_string_lossy().starts_with("CARGO_")) {
            if name != "CARGO_HOME" {
                cargo.env_remove(name);
            }
        }
        cargo.env("CARGO_TARGET_DIR", folder.join("build")).env("CARGO_PROFILE_DEV_DEBUG", "0");
        let output = cargo.stdin(Stdio::null()).output().map_err(|e| format!("cargo: {e}"))?;
        let messages: Vec<serde_json::Value> =
            output.stdout.split(|b| *b == b'\n').filter_map(|line| serde_json::from_slice(line).ok()).collect();
        if !output.status.success() {
            let errors: String = messages
                .iter()
                .filter(|m| m["message"]["level"] == "error")
                .filter_map(|m| m["message"]["rendered"].as_str())
                .collect();
            return Err(format!(
                "the tree with the mutants in it does not compile; is_on(N) in the lines below is the mutant of place N, from 0, in \
                 tests/mutants/list.toml\n{errors}{}",
                String::from_utf8_lossy(&output.stderr)
            ));
        }
        let programs = messages
            .iter()
            .filter(|m| m["reason"] == "compiler-artifact" && m["profile"]["test"] == true)
            .filter_map(|m| {
                let target = if m["target"]["kind"][0] == "lib" { "lib" } else { m["target"]["name"].as_str()? };
                let manifest = Path::new(m["manifest_path"].as_str()?).strip_prefix(&tree).ok()?;
                let suite = match manifest.parent()?.to_str()? {
                    "" => target.to_owned(),
                    of => format!("{of}/{target}"),
                };
                Some((suite, PathBuf::from(m["executable"].as_str()?)))
            })
            .collect();
        Ok(Self { tree, programs })
    }

    /// Runs the tests of a suite whose names hold `filter`, with one mutant on or none.
    pub(crate) fn run(&self, suite: &str, filter: &str, mutant: Option<usize>) -> Outcome {
        let Some(program) = self.programs.get(suite) else { return Outcome::Passed(0) };
        let mut command = Command::new(program);
        command.arg(filter).current_dir(&self.tree).env("RUST_BACKTRACE", "0").env_remove("SONOWEAVE_STRESS");
        match mutant {
            Some(number) => command.env("SONOWEAVE_MUTANT", number.to_string()),
            None => command.env_remove("SONOWEAVE_MUTANT"),
        };
        let log = self.tree.join(
            format!("run-{}", mutant.map_or(format!("none-{suite}-{filter}"), |n| n.to_string()))
                .replace([':', ' ', '/'], "-"),
        );
        let file = std::fs::File::create(&log).unwrap();
        let child = command.stdin(Stdio::null()).stdout(file.try_clone().unwrap()).stderr(file).spawn().unwrap();
        let passed = ended_well(child);
        let output = String::from_utf8_lossy(&std::fs::read(&log).unwrap()).into_owned();
        if passed {
            let count = output.split("test result: ok. ").nth(1).and_then(|rest| rest.split(' ').next()?.parse().ok());
            Outcome::Passed(count.unwrap_or(0))
        } else {
            Outcome::Failed(output)
        }
    }
}

/// A suite's crate, empty for the daemon's, and its target.
fn split(suite: &str) -> (&str, &str) {
    suite.split_once('/').unwrap_or(("", suite))
}

/// Whether a program ends in time and without an error; it is ended if not.
fn ended_well(mut child: Child) -> bool {
    let began = Instant::now();
    loop {
        match child.try_wait().unwrap() {
            Some(status) => return status.success(),
            None if began.elapsed() > PATIENCE => {
                child.kill().unwrap();
                child.wait().unwrap();
                return false;
            }
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    }
}

/// Copies a file or folder, sources through `change`. What has not changed is not written, so that it is not built again.
fn copy(from: &Path, to: &Path, change: &dyn Fn(&Path, &str) -> Result<String, String>) -> Result<(), String> {
    let wrong = |e: std::io::Error| format!("{}: {e}", from.display());
    if from.is_dir() {
        std::fs::create_dir_all(to).map_err(wrong)?;
        for entry in std::fs::read_dir(from).map_err(wrong)? {
            let name = entry.map_err(wrong)?.file_name();
            copy(&from.join(&name), &to.join(&name), change)?;
        }
        // What is gone here, or was copied earlier, is not to be built there.
        for entry in std::fs::read_dir(to).map_err(wrong)? {
            let path = entry.map_err(wrong)?.path();
            let gone = path.file_name().is_some_and(|name| !from.join(name).exists());
            match gone {
                true if path.is_dir() => std::fs::remove_dir_all(&path).map_err(wrong)?,
                true => std::fs::remove_file(&path).map_err(wrong)?,
                false => {}
            }
        }
        return Ok(());
    }
    let mut content = std::fs::read(from).map_err(wrong)?;
    if from.extension().is_some_and(|e| e == "rs")
        && let Ok(source) = std::str::from_utf8(&content)
    {
        content = change(from, source)?.into_bytes();
    }
    if std::fs::read(to).ok().as_ref() != Some(&content) {
        std::fs::write(to, content).map_err(|e| format!("{}: {e}", to.display()))?;
    }
    Ok(())
}
