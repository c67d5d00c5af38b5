//! Checks YAML files: the workflows of GitHub Actions, and the citation.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use yaml_rust2::{Yaml, YamlLoader};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the repository's root")
}

fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// Whether an action is named by a full commit, which cannot be changed afterwards.
fn is_pinned(action: &str) -> bool {
    let commit = action.split_once('@').map_or("", |(_, commit)| commit);
    commit.len() == 40 && commit.bytes().all(|b| b.is_ascii_hexdigit())
}

/// Returns the errors of a workflow: unknown keys, a job without permissions of its own or of the
/// workflow, steps that do nothing or two things, actions without a commit, and targets that the
/// Makefile lacks.
fn findings(text: &str, targets: &BTreeSet<&str>) -> Vec<String> {
    let documents = match YamlLoader::load_from_str(text) {
        Ok(documents) if documents.len() == 1 => documents,
        Ok(documents) => return vec![format!("{} documents", documents.len())],
        Err(error) => return vec![error.to_string()],
    };
    let mut findings = Vec::new();
    let workflow = &documents[0];
    for key in keys(workflow) {
        if !["name", "on", "permissions", "concurrency", "env", "jobs"].contains(&key) {
            findings.push(format!("unknown key {key}"));
        }
    }
    if workflow["on"].is_badvalue() {
        findings.push("it is never run: on is missing".into());
    }
    if keys(&workflow["jobs"]).is_empty() {
        findings.push("no jobs".into());
    }
    for name in keys(&workflow["jobs"]) {
        let job = &workflow["jobs"][name];
        if job["runs-on"].as_str().is_none() {
            findings.push(format!("{name}: runs-on is missing"));
        }
        if job["permissions"].is_badvalue() && workflow["permissions"].is_badvalue() {
            findings.push(format!("{name}: permissions are missing"));
        }
        let steps = job["steps"].as_vec().map(Vec::as_slice).unwrap_or_default();
        if steps.is_empty() {
            findings.push(format!("{name}: no steps"));
        }
        for step in steps {
            match (step["uses"].as_str(), step["run"].as_str()) {
                (Some(action), None) if is_pinned(action) => {}
                (Some(action), None) => findings.push(format!("{name}: {action} is not named by a commit")),
                (None, Some(script)) => {
                    for target in script.split("make ").skip(1).filter_map(|rest| rest.split_whitespace().next()) {
                        if !targets.contains(target) {
                            findings.push(format!("{name}: the Makefile has no target {target}"));
                        }
                    }
                }
                _ => findings.push(format!("{name}: a step has neither uses nor run, or both")),
            }
        }
    }
    findings
}

fn keys(yaml: &Yaml) -> Vec<&str> {
    yaml.as_hash().map(|hash| hash.keys().filter_map(Yaml::as_str).collect()).unwrap_or_default()
}

/// Returns the Makefile's targets.
fn targets(makefile: &str) -> BTreeSet<&str> {
    let names = makefile.lines().filter_map(|line| line.split_once(':').map(|(name, _)| name));
    names.filter(|name| name.bytes().all(|b| b.is_ascii_lowercase() || b == b'-')).collect()
}

#[test]
fn workflows_are_valid_and_pinned() {
    let makefile = read("Makefile");
    let folder = ".github/workflows";
    let mut files = 0;
    for entry in fs::read_dir(root().join(folder)).expect("workflows") {
        let name = entry.expect("an entry").file_name().into_string().expect("a name");
        assert_eq!(findings(&read(&format!("{folder}/{name}")), &targets(&makefile)), [""; 0], "{name}");
        files += 1;
    }
    assert!(files >= 2, "only {files} workflows found");
}

#[test]
fn each_error_of_workflow_is_found() {
    let targets = BTreeSet::from(["test"]);
    let right = format!(
        "on: push\npermissions: {{}}\njobs:\n  a:\n    runs-on: x\n    steps:\n      - uses: a/b@{}\n      - run: make test\n",
        "0a".repeat(20)
    );
    assert_eq!(findings(&right, &targets), [""; 0]);
    for (old, new, want) in [
        ("on: push", "at: push", "unknown key at"),
        ("on: push\n", "", "it is never run: on is missing"),
        ("permissions: {}\n", "", "a: permissions are missing"),
        ("runs-on: x", "runs: x", "a: runs-on is missing"),
        ("0a0a", "v4", "a: a/b@v4"),
        ("make test", "make tea", "a: the Makefile has no target tea"),
        ("run: make", "name: make", "a: a step has neither"),
        ("steps:", "steps: []\n    other:", "a: no steps"),
        ("jobs:", "jobs: {}\nenv:", "no jobs"),
    ] {
        let found = findings(&right.replacen(old, new, 1), &targets);
        assert!(found.iter().any(|finding| finding.starts_with(want)), "{want}: {found:?}");
    }
    assert_eq!(findings("on: [", &targets).len(), 1);
}

#[test]
fn citation_is_of_this_version() {
    let citation = YamlLoader::load_from_str(&read("CITATION.cff")).expect("YAML");
    assert_eq!(citation[0]["cff-version"].as_str(), Some("1.2.0"));
    assert_eq!(citation[0]["version"].as_str(), Some(env!("CARGO_PKG_VERSION")));
    assert_eq!(citation[0]["references"][0]["year"].as_i64(), Some(1992));
}
