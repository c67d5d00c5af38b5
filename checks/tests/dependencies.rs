//! Checks the crates of the workspace against `deny.toml`: licences, sources, crates that are
//! refused, and versions. cargo-deny does the same and compares the advisories, which needs a
//! network: `make deny`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use cargo_metadata::MetadataCommand;
use cargo_metadata::semver::{Version, VersionReq};
use serde::Deserialize;
use spdx::{Expression, ParseMode};

#[derive(Deserialize)]
struct Policy {
    graph: Graph,
    advisories: Advisories,
    licenses: Licenses,
    bans: Bans,
    sources: Sources,
}

#[derive(Deserialize)]
struct Graph {
    targets: Vec<String>,
}

#[derive(Deserialize)]
struct Advisories {
    ignore: Vec<Ignored>,
}

#[derive(Deserialize)]
struct Ignored {
    id: String,
    reason: String,
}

#[derive(Deserialize)]
struct Licenses {
    allow: Vec<String>,
    exceptions: Vec<Exception>,
}

#[derive(Deserialize)]
struct Exception {
    #[serde(rename = "crate")]
    name: String,
    allow: Vec<String>,
}

#[derive(Deserialize)]
struct Bans {
    skip: Vec<Entry>,
    deny: Vec<Entry>,
}

/// A crate, as `name` or `name@version`.
#[derive(Deserialize)]
struct Entry {
    #[serde(rename = "crate")]
    spec: String,
}

#[derive(Deserialize)]
struct Sources {
    #[serde(rename = "allow-registry")]
    allow_registry: Vec<String>,
}

/// A crate of the dependency graph.
struct Crate {
    name: String,
    version: Version,
    licence: Option<String>,
    /// `None` for the workspace's own.
    source: Option<String>,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the repository's root")
}

fn policy() -> Policy {
    let text = std::fs::read_to_string(root().join("deny.toml")).expect("deny.toml");
    toml::from_str(&text).expect("deny.toml")
}

/// Returns the crates that the target machines of the policy need.
fn crates(targets: &[String]) -> Vec<Crate> {
    let platforms = targets.iter().flat_map(|target| ["--filter-platform".to_owned(), target.clone()]);
    let options: Vec<String> = std::iter::once("--locked".to_owned()).chain(platforms).collect();
    let metadata = MetadataCommand::new().current_dir(root()).other_options(options).exec().expect("cargo metadata");
    let nodes = metadata.resolve.expect("a graph").nodes;
    let needed: BTreeSet<_> = nodes.iter().map(|node| &node.id).collect();
    let packages = metadata.packages.into_iter().filter(|package| needed.contains(&package.id));
    packages
        .map(|package| Crate {
            name: package.name.to_string(),
            version: package.version,
            licence: package.license,
            source: package.source.map(|source| source.repr),
        })
        .collect()
}

/// Whether an entry of the policy names this crate.
fn names(spec: &str, one: &Crate) -> bool {
    let (name, version) = spec.split_once('@').unwrap_or((spec, "*"));
    name == one.name && VersionReq::parse(version).is_ok_and(|req| req.matches(&one.version))
}

fn licence_finding(policy: &Licenses, one: &Crate) -> Option<String> {
    let Some(licence) = &one.licence else { return Some("declares no licence".into()) };
    let expression = match Expression::parse_mode(licence, ParseMode::LAX) {
        Ok(expression) => expression,
        Err(error) => return Some(format!("licence {licence:?} is not understood: {}", error.reason)),
    };
    let own = policy.exceptions.iter().filter(|exception| exception.name == one.name).flat_map(|e| &e.allow);
    let allowed: BTreeSet<&str> = policy.allow.iter().chain(own).map(String::as_str).collect();
    let accepted = expression.evaluate(|required| allowed.contains(required.to_string().as_str()));
    (!accepted).then(|| format!("licence {licence} is not allowed"))
}

/// Returns what does not follow the policy, and the entries of the policy that have lost their use.
fn findings(policy: &Policy, crates: &[Crate]) -> Vec<String> {
    let mut findings = Vec::new();
    let mut versions: BTreeMap<&str, BTreeSet<&Version>> = BTreeMap::new();
    for one in crates {
        let mut add = |sentence: String| findings.push(format!("{} {}: {sentence}", one.name, one.version));
        licence_finding(&policy.licenses, one).into_iter().for_each(&mut add);
        if let Some(source) = &one.source {
            let registry = source.strip_prefix("registry+").unwrap_or_default();
            if !policy.sources.allow_registry.iter().any(|allowed| allowed == registry) {
                add(format!("source {source} is not allowed"));
            }
        }
        if policy.bans.deny.iter().any(|entry| names(&entry.spec, one)) {
            add("this crate is refused".into());
        }
        if !policy.bans.skip.iter().any(|entry| names(&entry.spec, one)) {
            versions.entry(&one.name).or_default().insert(&one.version);
        }
    }
    for (name, several) in versions.into_iter().filter(|(_, versions)| versions.len() > 1) {
        findings.push(format!("{name}: {} versions; update, or enter the older one under [bans] skip", several.len()));
    }
    for Entry { spec } in &policy.bans.skip {
        let name = spec.split('@').next();
        let is_old = crates.iter().any(|one| names(spec, one));
        if !is_old || !crates.iter().any(|one| Some(one.name.as_str()) == name && !names(spec, one)) {
            findings.push(format!("{spec}: there is one version; remove it from [bans] skip"));
        }
    }
    let stale = |name: &str| !crates.iter().any(|one| one.name == name);
    for Ignored { id, reason } in &policy.advisories.ignore {
        if reason.split_once(": ").is_none_or(|(name, _)| stale(name)) {
            findings.push(format!("{id}: its reason does not begin with a crate in use; remove it"));
        }
    }
    for Exception { name, .. } in policy.licenses.exceptions.iter().filter(|exception| stale(&exception.name)) {
        findings.push(format!("{name}: not in use; remove it from [licenses] exceptions"));
    }
    findings
}

#[test]
fn crates_follow_policy() {
    let policy = policy();
    let crates = crates(&policy.graph.targets);
    assert!(crates.len() > 200, "only {} crates found", crates.len());
    let findings = findings(&policy, &crates);
    assert!(findings.is_empty(), "{} findings\n{}", findings.len(), findings.join("\n"));
}

#[test]
fn each_breach_of_policy_is_found() {
    let policy: Policy = toml::from_str(
        r#"
        graph.targets = []
        advisories.ignore = [{ id = "A-1", reason = "gone: old" }, { id = "A-2", reason = "fine: why" }]
        licenses.allow = ["MIT"]
        licenses.exceptions = [{ crate = "special", allow = ["MPL-2.0"] }, { crate = "left", allow = ["ISC"] }]
        bans.skip = [{ crate = "two@1" }, { crate = "one@1" }]
        bans.deny = [{ crate = "bad" }]
        sources.allow-registry = ["https://here"]
        "#,
    )
    .expect("a policy");
    let here = "registry+https://here";
    let of = |name: &str, version: &str, licence: Option<&str>, source: &str| Crate {
        name: name.into(),
        version: Version::parse(version).expect("a version"),
        licence: licence.map(Into::into),
        source: Some(source.into()),
    };
    let crates = [
        of("fine", "1.0.0", Some("Apache-2.0/MIT"), here),
        of("special", "1.0.0", Some("MPL-2.0"), here),
        of("other", "1.0.0", Some("MPL-2.0"), here),
        of("both", "1.0.0", Some("MIT AND ISC"), here),
        of("silent", "1.0.0", None, here),
        of("bad", "1.0.0", Some("MIT"), here),
        of("away", "1.0.0", Some("MIT"), "git+https://there"),
        of("one", "1.0.0", Some("MIT"), here),
        of("two", "1.2.0", Some("MIT"), here),
        of("two", "2.0.0", Some("MIT"), here),
        of("three", "1.0.0", Some("MIT"), here),
        of("three", "2.0.0", Some("MIT"), here),
    ];
    let found = findings(&policy, &crates);
    let begins: Vec<&str> = found.iter().filter_map(|line| line.split(": ").next()).collect();
    let want =
        ["other 1.0.0", "both 1.0.0", "silent 1.0.0", "bad 1.0.0", "away 1.0.0", "three", "one@1", "A-1", "left"];
    assert_eq!(begins, want, "{found:#?}");
}

/// Every package of a selection with its features, for tests.
fn features(selection: &[&str]) -> BTreeSet<String> {
    let tree = ["tree", "--locked", "--edges", "normal,build,dev", "--prefix", "none"];
    let mut command = Command::new(env!("CARGO"));
    let tree = command.current_dir(root()).args(tree).args(["--format", "{p} [{f}]"]).args(selection);
    let output = tree.output().expect("cargo tree");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).expect("text");
    text.lines().map(|line| line.trim_end_matches(" (*)").to_owned()).collect()
}

#[test]
fn tests_of_one_crate_share_the_build_of_all() {
    let others = ["sonoweave-figures", "sonoweave-python"];
    let all = features(&["--workspace", "--exclude", others[0], "--exclude", others[1]]);
    let metadata = MetadataCommand::new().current_dir(root()).no_deps().exec().expect("cargo metadata");
    for member in metadata.packages.iter().filter(|member| !others.contains(&member.name.as_str())) {
        let one = features(&["-p", "sonoweave", "-p", &member.name]);
        let different: Vec<_> = one.difference(&all).collect();
        assert!(one.len() > 100 && different.is_empty(), "{} is built again with {different:?}", member.name);
    }
}
