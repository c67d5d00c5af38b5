//! The crates that are linked into the program, their licences, and the licence texts that must
//! be distributed.
//!
//! cargo-about does the same, but each developer would have to install it, and it takes texts from
//! the network or from templates where a crate has none.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};

use cargo_metadata::{DependencyKind, Metadata, MetadataCommand, NodeDep, Package, PackageId, Target};

/// A file is a licence text if its name begins with one of these, in upper or lower case.
const TEXTS: [&str; 6] = ["license", "licence", "copying", "copyright", "notice", "unlicense"];

/// A third-party crate.
#[derive(Debug)]
pub struct Linked {
    /// Name and version.
    pub name: String,
    /// Licence as its author declares it, an SPDX expression.
    pub licence: String,
    /// Folder of its source.
    folder: PathBuf,
}

/// Returns cargo's metadata of the workspace in `root` for the target machine, such as
/// x86_64-unknown-linux-gnu.
///
/// # Errors
/// If cargo cannot be run, or refuses.
pub fn metadata(root: &Path, machine: &str) -> io::Result<Metadata> {
    let options = ["--locked", "--filter-platform", machine].map(str::to_owned);
    MetadataCommand::new().current_dir(root).other_options(options).exec().map_err(io::Error::other)
}

/// Returns the packages that `package` is linked with, itself and the workspace's included.
///
/// # Errors
/// If the workspace has no such package.
pub fn reached<'a>(metadata: &'a Metadata, package: &str) -> io::Result<Vec<&'a Package>> {
    let Metadata { packages, resolve, .. } = metadata;
    let begin = packages.iter().find(|p| p.name == package && p.source.is_none());
    let begin = begin.ok_or_else(|| io::Error::other(format!("there is no package {package} in the workspace")))?;
    let nodes = resolve.iter().flat_map(|resolve| &resolve.nodes);
    let of_id: BTreeMap<&PackageId, &Package> = packages.iter().map(|package| (&package.id, package)).collect();
    let edges: BTreeMap<&PackageId, &[NodeDep]> = nodes.map(|node| (&node.id, node.deps.as_slice())).collect();
    let (mut seen, mut ahead) = (BTreeSet::new(), vec![&begin.id]);
    while let Some(id) = ahead.pop() {
        // A macro runs in the compiler and is not linked.
        let is_macro = |package: &&Package| package.targets.iter().any(Target::is_proc_macro);
        if of_id.get(id).is_none_or(is_macro) || !seen.insert(id) {
            continue;
        }
        let normal = |edge: &&NodeDep| edge.dep_kinds.iter().any(|kind| kind.kind == DependencyKind::Normal);
        ahead.extend(edges.get(id).copied().unwrap_or_default().iter().filter(normal).map(|edge| &edge.pkg));
    }
    Ok(seen.into_iter().filter_map(|id| of_id.get(id).copied()).collect())
}

/// Returns the third-party crates that `package` is linked with, by name and version.
///
/// # Errors
/// If the workspace has no such package.
pub fn linked(metadata: &Metadata, package: &str) -> io::Result<Vec<Linked>> {
    let others = reached(metadata, package)?.into_iter().filter(|package| package.source.is_some());
    let mut all: Vec<Linked> = others
        .map(|package| Linked {
            name: format!("{} {}", package.name, package.version),
            licence: package.license.clone().unwrap_or_else(|| "as its text says".into()),
            folder: package.manifest_path.parent().map(Into::into).unwrap_or_default(),
        })
        .collect();
    all.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(all)
}

/// Lists all crates, then each distinct text once, with the crates that contain it.
///
/// # Errors
/// If a crate's source cannot be read.
pub fn notices(linked: &[Linked]) -> io::Result<String> {
    let mut all = String::from(
        "sonoweave is linked with these crates, and with Rust's standard library (MIT OR Apache-2.0, by the Rust project's developers).\n\n",
    );
    let mut texts: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for Linked { name, licence, folder } in linked {
        let _ = writeln!(all, "  {name}: {licence}");
        for text in texts_of(folder)? {
            let names = texts.entry(text).or_default();
            if names.last() != Some(&name.as_str()) {
                names.push(name);
            }
        }
    }
    // Sorts the texts by the first crate that contains them.
    let mut texts: Vec<_> = texts.into_iter().collect();
    texts.sort_by(|(text, names), (other, others)| names.cmp(others).then(text.cmp(other)));
    for (text, names) in texts {
        let _ = write!(all, "\n{}\nWith {}:\n\n{text}\n", "-".repeat(80), names.join(", "));
    }
    Ok(all)
}

/// Returns the licence texts in a crate's folder, ordered by file name, without trailing blanks.
fn texts_of(folder: &Path) -> io::Result<Vec<String>> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().to_lowercase();
        if entry.file_type()?.is_file() && TEXTS.iter().any(|begin| name.starts_with(begin)) {
            files.push((name, entry.path()));
        }
    }
    files.sort();
    let read = |(_, path): (String, PathBuf)| {
        let text = String::from_utf8_lossy(&std::fs::read(path)?).into_owned();
        Ok(text.lines().map(str::trim_end).collect::<Vec<_>>().join("\n").trim_matches('\n').to_owned())
    };
    files.into_iter().map(read).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notices_list_linked_crates_only() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let metadata = metadata(&root, "x86_64-unknown-linux-gnu").unwrap();
        let linked = linked(&metadata, "sonoweave").unwrap();
        assert!(super::linked(&metadata, "serde").is_err());
        let has = |name: &str| linked.iter().any(|one| one.name.starts_with(&format!("{name} ")));
        for name in ["clap", "glam", "mcap", "serialport", "nusb"] {
            assert!(has(name), "{name}");
        }
        // A macro, a test dependency, one of the figures, one of this crate, another system's,
        // and our own.
        for name in ["serde_derive", "proptest", "resvg", "cargo_metadata", "core-foundation", "sonoweave-drivers"] {
            assert!(!has(name), "{name}");
        }
        let text = notices(&linked).unwrap();
        assert!(linked.iter().all(|one| text.contains(&format!("  {}: {}\n", one.name, one.licence))));
        assert!(text.contains("Permission is hereby granted, free of charge"));
        let rule = format!("\n{}\nWith ", "-".repeat(80));
        let texts: Vec<&str> = text.split(&rule).skip(1).map(|part| part.split_once(":\n\n").unwrap().1).collect();
        assert!(texts.len() > 10 && texts.iter().collect::<BTreeSet<_>>().len() == texts.len(), "each once");
    }

    #[test]
    fn licence_texts_are_found_by_file_name() {
        let folder = tempfile::tempdir().unwrap();
        let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        put("LICENSE-MIT", "\nmine \r\nyours\n\n");
        put("Copying.txt", "theirs");
        put("README.md", "nothing");
        assert_eq!(texts_of(folder.path()).unwrap(), ["theirs", "mine\nyours"]);
    }
}
