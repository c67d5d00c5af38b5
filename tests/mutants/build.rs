//! Builds a copy of the tree with all mutants in it, and runs its tests with one of them
//! enabled.

use std::collections::{BTreeMap, BTreeSet};
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::io::Errno;
use rustix::process::{Pid, Resource, Rlimit, Signal, prlimit};
use serde_json::Value;

use crate::list::{Mutant, SWITCH, switched};

/// Limit of a run's processor time, in seconds. Other work on the machine does not change it.
pub(crate) const PROCESSOR_SECONDS: u64 = 120;

/// Time limit of a run, for what waits without end.
pub(crate) const PATIENCE: Duration = Duration::from_secs(600);

/// The built tests by suite.
pub(crate) struct Build {
    tree: PathBuf,
    logs: PathBuf,
    programs: BTreeMap<String, PathBuf>,
}

/// Result of a suite.
pub(crate) enum Outcome {
    /// This number of tests passed.
    Passed(usize),
    /// At least one test failed; the output.
    Failed(String),
    /// The program did not end within [`PROCESSOR_SECONDS`] or [`PATIENCE`].
    TimedOut,
}

/// A crate of the workspace. Paths are relative to the workspace.
struct Member {
    package: String,
    /// Its folder, empty for the root's crate.
    folder: String,
    /// The root of its library, if it has one.
    library: Option<String>,
}

impl Member {
    /// Returns its name in suites: the last name of its folder.
    fn name(&self) -> &str {
        last(&self.folder)
    }
}

impl Build {
    /// Builds the copy with these mutants, and of its tests these suites.
    ///
    /// # Errors
    /// A sentence: a mutant that does not apply or does not compile.
    pub(crate) fn new(mutants: &[Mutant], suites: &BTreeSet<&str>) -> Result<Self, String> {
        let from = Path::new(env!("CARGO_MANIFEST_DIR"));
        let temporary = Path::new(env!("CARGO_TARGET_TMPDIR"));
        let folder = temporary.join("mutants");
        let (tree, logs) = (folder.join("tree"), folder.join("logs"));
        for folder in [&tree, &logs] {
            std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        }
        let members = members(from)?;
        plant(from, &tree, mutants, &members)?;
        let mut command = cargo(&tree);
        command.args(["test", "--locked", "--no-run", "--message-format=json"]);
        // The copy's dependencies are those of the project's own build, in whose folder they are
        // looked for. Programs go elsewhere, so that the project's own stay as they are.
        if let Some(target) = temporary.parent() {
            command.env("CARGO_BUILD_BUILD_DIR", target);
        }
        command.env("CARGO_TARGET_DIR", folder.join("target"));
        // Cargo tells crates of a workspace apart by their places within it and their settings.
        // Without a setting of their own, crates with mutants would replace the project's.
        for member in &members {
            command.arg("--config").arg(format!("profile.dev.package.{}.codegen-units=3", member.package));
        }
        // The root's crate uses all others: with it, dependencies have the same features as in
        // the project's own build.
        let suites: BTreeSet<(&str, &str)> = suites.iter().map(|suite| split(suite)).collect();
        for member in &members {
            if member.folder.is_empty() || suites.iter().any(|(name, _)| *name == member.name()) {
                command.arg("--package").arg(&member.package);
            }
        }
        // Cargo searches all packages for a target's name.
        for target in suites.iter().map(|(_, target)| *target).collect::<BTreeSet<_>>() {
            match target {
                "lib" => command.arg("--lib"),
                name => command.args(["--test", name]),
            };
        }
        let output = command.stdin(Stdio::null()).output().map_err(|e| format!("cargo: {e}"))?;
        let messages: Vec<Value> =
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
                let suite = match last(manifest.parent()?.to_str()?) {
                    "" => target.to_owned(),
                    of => format!("{of}/{target}"),
                };
                Some((suite, PathBuf::from(m["executable"].as_str()?)))
            })
            .collect();
        Ok(Self { tree, logs, programs })
    }

    /// Runs the tests of a suite whose names contain `filter`, with one mutant enabled or none.
    pub(crate) fn run(&self, suite: &str, filter: &str, mutant: Option<usize>) -> Outcome {
        let Some(program) = self.programs.get(suite) else { return Outcome::Passed(0) };
        let mut command = Command::new(program);
        command.arg(filter).current_dir(&self.tree).env("RUST_BACKTRACE", "0").env_remove("SONOWEAVE_STRESS");
        match mutant {
            Some(number) => command.env("SONOWEAVE_MUTANT", number.to_string()),
            None => command.env_remove("SONOWEAVE_MUTANT"),
        };
        let name = mutant.map_or(format!("none-{suite}-{filter}"), |n| n.to_string());
        let log = self.logs.join(name.replace([':', ' ', '/'], "-"));
        let file = std::fs::File::create(&log).unwrap();
        let child = command.stdin(Stdio::null()).stdout(file.try_clone().unwrap()).stderr(file).spawn().unwrap();
        let Some(passed) = ended_well(child) else { return Outcome::TimedOut };
        let output = String::from_utf8_lossy(&std::fs::read(&log).unwrap()).into_owned();
        if passed {
            let count = output.split("test result: ok. ").nth(1).and_then(|rest| rest.split(' ').next()?.parse().ok());
            Outcome::Passed(count.unwrap_or(0))
        } else {
            Outcome::Failed(output)
        }
    }
}

/// Returns a suite's crate, empty for the root's, and its target.
fn split(suite: &str) -> (&str, &str) {
    suite.split_once('/').unwrap_or(("", suite))
}

/// Returns the last name of a path.
fn last(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

/// Returns cargo, to be run in a folder.
fn cargo(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO"));
    command.current_dir(folder);
    // Cargo's variables for this program must not affect the other build: what depends on them
    // would be built again.
    for (name, _) in std::env::vars_os() {
        if ["CARGO_PKG_", "CARGO_MANIFEST_", "CARGO_BIN_"].iter().any(|of| name.to_string_lossy().starts_with(of)) {
            command.env_remove(name);
        }
    }
    command
}

/// Returns the crates of a workspace.
fn members(root: &Path) -> Result<Vec<Member>, String> {
    let output = cargo(root)
        .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
        .output()
        .map_err(|e| format!("cargo metadata: {e}"))?;
    let unread = || format!("cargo metadata names no crates:\n{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).map_err(|_| unread())?;
    let relative = |path: &Value| -> Option<String> {
        Some(Path::new(path.as_str()?).strip_prefix(root).ok()?.to_str()?.to_owned())
    };
    let member = |package: &Value| -> Option<Member> {
        let library = package["targets"].as_array()?.iter().find(|target| target["kind"][0] == "lib");
        Some(Member {
            package: package["name"].as_str()?.to_owned(),
            folder: Path::new(&relative(&package["manifest_path"])?).parent()?.to_str()?.to_owned(),
            library: library.and_then(|target| relative(&target["src_path"])),
        })
    };
    let packages = metadata["packages"].as_array().ok_or_else(unread)?;
    Ok(packages.iter().filter_map(member).collect())
}

/// Makes the copy of the tree, with all mutants and their switches in it.
fn plant(from: &Path, tree: &Path, mutants: &[Mutant], members: &[Member]) -> Result<(), String> {
    let mut libraries: BTreeSet<&str> = BTreeSet::new();
    for mutant in mutants {
        let Mutant { name, file, .. } = mutant;
        if !from.join(file).is_file() {
            return Err(format!("mutant {name:?}: there is no {file}; update tests/mutants/list.toml"));
        }
        let around = members.iter().filter(|member| Path::new(file).starts_with(&member.folder));
        let owner = around.max_by_key(|member| member.folder.len());
        match owner.and_then(|member| member.library.as_deref()) {
            Some(library) => libraries.insert(library),
            None => return Err(format!("mutant {name:?}: {file} is not of a library, which it must be")),
        };
    }
    let change = |path: &Path, source: &str| -> Result<String, String> {
        let file = path.strip_prefix(from).unwrap_or(path).to_string_lossy().into_owned();
        let mut source = switched(&file, source, mutants)?;
        if libraries.contains(file.as_str()) {
            source += SWITCH;
        }
        Ok(source)
    };
    let wrong = |e: std::io::Error| format!("{}: {e}", from.display());
    let ignored = std::fs::read_to_string(from.join(".gitignore")).unwrap_or_default();
    for entry in std::fs::read_dir(from).map_err(wrong)? {
        let path = entry.map_err(wrong)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let is_ignored = ignored.lines().any(|line| line.trim_start_matches('/') == name);
        if !name.starts_with('.') && !is_ignored && !tree.starts_with(&path) {
            copy(&path, &tree.join(&name), &change)?;
        }
    }
    remove_gone(from, tree)
}

/// Returns whether a program ends without an error; none if it reaches a limit and is killed.
fn ended_well(mut child: Child) -> Option<bool> {
    let limit = Rlimit { current: Some(PROCESSOR_SECONDS), maximum: Some(PROCESSOR_SECONDS + 1) };
    // A program that has ended already needs no limit.
    match prlimit(Some(Pid::from_child(&child)), Resource::Cpu, limit) {
        Ok(_) | Err(Errno::SRCH) => {}
        Err(error) => panic!("a limit of processor time: {error}"),
    }
    let began = Instant::now();
    loop {
        match child.try_wait().unwrap() {
            Some(status) if status.signal() == Some(Signal::XCPU.as_raw()) => return None,
            Some(status) => return Some(status.success()),
            None if began.elapsed() > PATIENCE => {
                child.kill().unwrap();
                child.wait().unwrap();
                return None;
            }
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    }
}

/// Copies a file or folder, sources through `change`. Unchanged files are not written, so that
/// they are not rebuilt.
fn copy(from: &Path, to: &Path, change: &dyn Fn(&Path, &str) -> Result<String, String>) -> Result<(), String> {
    let wrong = |e: std::io::Error| format!("{}: {e}", from.display());
    if from.is_dir() {
        std::fs::create_dir_all(to).map_err(wrong)?;
        for entry in std::fs::read_dir(from).map_err(wrong)? {
            let name = entry.map_err(wrong)?.file_name();
            copy(&from.join(&name), &to.join(&name), change)?;
        }
        return remove_gone(from, to);
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

/// Removes from a copy what its original has no longer, as it must not be built.
fn remove_gone(from: &Path, to: &Path) -> Result<(), String> {
    let wrong = |e: std::io::Error| format!("{}: {e}", to.display());
    for entry in std::fs::read_dir(to).map_err(wrong)? {
        let path = entry.map_err(wrong)?.path();
        let is_gone = path.file_name().is_some_and(|name| !from.join(name).exists());
        match is_gone {
            true if path.is_dir() => std::fs::remove_dir_all(&path).map_err(wrong)?,
            true => std::fs::remove_file(&path).map_err(wrong)?,
            false => {}
        }
    }
    Ok(())
}
