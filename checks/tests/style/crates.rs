//! Dependencies between the crates: each depends only on crates above it in the workspace's list.

use crate::findings::Finding;
use crate::sources::Sources;

/// The only users of `drivers` and `calibration`, which stand outside the order of the others.
const BESIDE: [(&str, &[&str]); 2] = [
    ("drivers", &["phantom", "config", "pipeline", "igtl", "console"]),
    ("calibration", &["mask", "phantom", "export", "config", "pipeline", "measure", "igtl", "console"]),
];

/// Dependencies of the two themselves.
const THEIR_OWN: [(&str, &[&str]); 2] =
    [("drivers", &["sonoweave_core", "formats"]), ("calibration", &["sonoweave_core", "formats"])];

/// A line `name = …` or `name.key = …` of a manifest.
struct Entry<'a> {
    section: &'a str,
    name: &'a str,
    value: &'a str,
    line: usize,
}

/// Returns the dependencies of the workspace's crates that do not follow the order.
pub(crate) fn check(sources: &Sources) -> Vec<Finding> {
    let root = sources.get("Cargo.toml").map_or("", |source| source.text);
    let order: Vec<(&str, &str)> = entries(root)
        .into_iter()
        .filter(|e| e.section == "workspace.dependencies")
        .filter_map(|e| Some((e.name, quoted(e.value.split_once("path =")?.1)?)))
        .collect();
    let mut findings = Vec::new();
    for source in sources.manifests() {
        let manifest = source.path.as_str();
        let Some(folder) = manifest.strip_suffix("/Cargo.toml") else { continue };
        let place = order.iter().position(|(_, path)| *path == folder);
        let Some(place) = place else {
            if folder.starts_with("crates/") {
                findings.push(Finding::new(manifest, 1, "the root's [workspace.dependencies] lacks this crate"));
            }
            continue;
        };
        for entry in entries(source.text) {
            let section = entry.section.rsplit_once('.').map_or(entry.section, |(_, last)| last);
            let name = if section == "dependencies" {
                entry.name
            } else if let Some((_, name)) = entry.section.split_once("dependencies.").filter(|(s, _)| !s.ends_with('-'))
            {
                name
            } else {
                continue;
            };
            let by_path = entry.value.split_once("path =").map(|(_, path)| path);
            if let Some(path) = by_path.and_then(quoted) {
                findings.push(Finding::new(
                    manifest,
                    entry.line,
                    format!("{name} by its path {path:?}; write {name}.workspace = true"),
                ));
            }
            let Some(other) = order.iter().position(|(n, _)| *n == name) else { continue };
            let user = order[place].0;
            if !permitted(user, name, other < place) {
                let sentence = format!("{user} depends on {name}, which is not above it in [workspace.dependencies]");
                findings.push(Finding::new(manifest, entry.line, sentence));
            }
        }
    }
    findings
}

fn permitted(user: &str, name: &str, is_above: bool) -> bool {
    let find =
        |list: &[(&str, &'static [&'static str])], key: &str| list.iter().find(|(n, _)| *n == key).map(|(_, l)| *l);
    if let Some(own) = find(&THEIR_OWN, user) {
        return own.contains(&name);
    }
    find(&BESIDE, name).map_or(is_above, |users| users.contains(&user))
}

fn entries(text: &str) -> Vec<Entry<'_>> {
    let mut section = "";
    let mut all = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let line = line.trim();
        if let Some(heading) = line.strip_prefix('[') {
            section = heading.trim_end_matches(']').trim();
        } else if let Some((key, value)) = line.split_once('=').filter(|_| !line.starts_with('#')) {
            let name = key.trim().split('.').next().unwrap_or_default();
            all.push(Entry { section, name, value, line: i + 1 });
        }
    }
    all
}

fn quoted(text: &str) -> Option<&str> {
    text.split('"').nth(1)
}

#[test]
fn crates_out_of_order_are_found() {
    let root = "[workspace.dependencies]\n\
        sonoweave_core = { package = \"c\", path = \"crates/core\" }\n\
        formats = { package = \"f\", path = \"crates/formats\" }\n\
        drivers = { package = \"d\", path = \"drivers\" }\n\
        glam = \"1\"\n";
    let core = "[dependencies]\nglam.workspace = true\nformats.workspace = true\n";
    let formats = "[dependencies]\nsonoweave_core.workspace = true\n[target.'cfg(unix)'.dependencies]\ndrivers.workspace = true\n";
    let drivers = "[dependencies]\nformats = { path = \"../formats\" }\n[dev-dependencies]\nglam = \"1\"\n";
    let sources = Sources::of(&[
        ("Cargo.toml", root),
        ("crates/core/Cargo.toml", core),
        ("crates/formats/Cargo.toml", formats),
        ("crates/new/Cargo.toml", ""),
        ("drivers/Cargo.toml", drivers),
    ]);
    let found: Vec<(String, usize)> = check(&sources).into_iter().map(|f| (f.file, f.line)).collect();
    let expected = [("crates/core", 3), ("crates/formats", 4), ("crates/new", 1), ("drivers", 2)];
    assert_eq!(found, expected.map(|(folder, line)| (format!("{folder}/Cargo.toml"), line)));
}
