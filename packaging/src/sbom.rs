//! The list of all crates as CycloneDX 1.5: the crates of Cargo.lock, no more and no fewer.
//!
//! Crates that are linked into the program are `required`. Those that only build or test it, and
//! those of other systems, are `excluded`, which is CycloneDX's word for a component that is not
//! there at run time. cargo-cyclonedx does the same, but each developer would have to install it,
//! and it has the time in each file.

use std::collections::{BTreeMap, BTreeSet};
use std::io;

use cargo_metadata::{Metadata, Package};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::notices::reached;

/// The part of Cargo.lock that is read.
#[derive(Debug, Deserialize)]
struct Lock {
    package: Vec<Locked>,
}

#[derive(Debug, Deserialize)]
struct Locked {
    name: String,
    version: String,
    /// SHA-256 of a registry's file.
    checksum: Option<String>,
    /// Names, with a version where the lock has several.
    #[serde(default)]
    dependencies: Vec<String>,
}

impl Locked {
    /// Returns the name by which scanners know the crate.
    fn purl(&self) -> String {
        format!("pkg:cargo/{}@{}", self.name, self.version)
    }
}

/// Returns the list for `program`, a package of the workspace, as JSON. `lock` is the text of
/// Cargo.lock; `metadata` is that of the program's target machine.
///
/// # Errors
/// If the lock is not one, or lacks the program.
pub fn sbom(lock: &str, metadata: &Metadata, program: &str) -> io::Result<Vec<u8>> {
    let Lock { package: locked } = toml::from_str(lock).map_err(io::Error::other)?;
    let key = |package: &Package| (package.name.to_string(), package.version.to_string());
    let linked: BTreeSet<_> = reached(metadata, program)?.into_iter().map(key).collect();
    let licences: BTreeMap<_, _> = metadata.packages.iter().map(|p| (key(p), p.license.as_deref())).collect();
    let component = |one: &Locked| {
        let key = (one.name.clone(), one.version.clone());
        let mut all = json!({
            "type": if one.name == program { "application" } else { "library" },
            "bom-ref": one.purl(),
            "name": one.name,
            "version": one.version,
            "scope": if linked.contains(&key) { "required" } else { "excluded" },
            "purl": one.purl(),
        });
        if let Some(Some(licence)) = licences.get(&key) {
            // Older manifests separate alternatives by a slash.
            let expression = licence.split('/').map(str::trim).collect::<Vec<_>>().join(" OR ");
            all["licenses"] = json!([{ "expression": expression }]);
        }
        if let Some(checksum) = &one.checksum {
            all["hashes"] = json!([{ "alg": "SHA-256", "content": checksum }]);
        }
        all
    };
    let own = locked.iter().find(|one| one.name == program);
    let own = own.ok_or_else(|| io::Error::other(format!("Cargo.lock has no package {program}")))?;
    let purl_of = |dependency: &String| {
        let mut words = dependency.split(' ');
        let (name, version) = (words.next(), words.next());
        let fits = |one: &&Locked| Some(one.name.as_str()) == name && version.is_none_or(|v| v == one.version);
        locked.iter().find(fits).map(Locked::purl)
    };
    let edges = |one: &Locked| -> Value {
        let others: Vec<String> = one.dependencies.iter().filter_map(purl_of).collect();
        json!({ "ref": one.purl(), "dependsOn": others })
    };
    let all = json!({
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": { "component": component(own) },
        "components": locked.iter().filter(|one| one.name != program).map(component).collect::<Vec<_>>(),
        "dependencies": locked.iter().map(edges).collect::<Vec<_>>(),
    });
    let mut bytes = serde_json::to_vec_pretty(&all)?;
    bytes.push(b'\n');
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::notices::{linked, metadata};

    #[test]
    fn list_has_crates_of_lock_and_marks_linked_ones() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let lock = std::fs::read_to_string(root.join("Cargo.lock")).unwrap();
        let metadata = metadata(&root, "x86_64-unknown-linux-musl").unwrap();
        let list: Value = serde_json::from_slice(&sbom(&lock, &metadata, "sonoweave").unwrap()).unwrap();
        let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
        let mut components = list["components"].as_array().unwrap().clone();
        components.push(list["metadata"]["component"].clone());
        let name = |one: &Value| format!("{} {}", text(&one["name"]), text(&one["version"]));

        // The lock is read by its lines here, not by the reader above.
        let value = |line: &str, key: &str| Some(line.strip_prefix(key)?.trim_matches('"').to_owned());
        let names = lock.lines().filter_map(|line| value(line, "name = "));
        let versions = lock.lines().skip(3).filter_map(|line| value(line, "version = "));
        let mut want: Vec<String> = names.zip(versions).map(|(name, version)| format!("{name} {version}")).collect();
        let mut have: Vec<String> = components.iter().map(name).collect();
        want.sort();
        have.sort();
        assert_eq!(have, want);
        let sums = components.iter().filter(|one| one["hashes"][0]["content"].is_string()).count();
        assert_eq!(sums, lock.lines().filter(|line| line.starts_with("checksum = ")).count());

        let required = components.iter().filter(|one| one["scope"] == "required" && one["hashes"].is_array());
        let required: BTreeSet<String> = required.map(name).collect();
        let linked = linked(&metadata, "sonoweave").unwrap();
        assert_eq!(required, linked.into_iter().map(|one| one.name).collect());

        let known: BTreeSet<String> = components.iter().map(|one| text(&one["bom-ref"])).collect();
        assert_eq!(known.len(), components.len(), "each has a name of its own");
        let mut edges = 0;
        for one in list["dependencies"].as_array().unwrap() {
            let others = one["dependsOn"].as_array().unwrap();
            edges += others.len();
            assert!(known.contains(&text(&one["ref"])) && others.iter().all(|to| known.contains(&text(to))), "{one}");
        }
        assert_eq!(edges, lock.lines().filter(|line| line.starts_with(" \"")).count());
    }

    #[test]
    fn lock_without_program_is_refused() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let metadata = metadata(&root, "x86_64-unknown-linux-gnu").unwrap();
        assert!(sbom("package = []", &metadata, "sonoweave").is_err());
        assert!(sbom("no lock", &metadata, "sonoweave").is_err());
    }
}
