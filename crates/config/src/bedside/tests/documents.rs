//! TOML in the documents: each fence is read as the file that it shows, or of which it is a part.

use std::fs;

use render::classify::transfer::Transfer;
use render::crop::Crop;
use toml::{Table, Value};

use super::*;
use crate::phantom::PhantomSettings;

/// Returns the fences of TOML in a page, with their lines.
fn fences(page: &str) -> Vec<(usize, String)> {
    let mut all = Vec::new();
    let mut open: Option<(usize, &str, String)> = None;
    for (at, line) in page.lines().enumerate() {
        let line = line.trim_start();
        match (open.as_mut(), line.strip_prefix("```")) {
            (None, Some(kind)) => open = Some((at + 1, kind, String::new())),
            (Some(_), Some(_)) => all.extend(open.take()),
            (Some((_, _, text)), None) => *text += &format!("{line}\n"),
            (None, None) => {}
        }
    }
    all.into_iter().filter(|(_, kind, _)| *kind == "toml").map(|(line, _, text)| (line, text)).collect()
}

/// Adds a part of a configuration to the rest; its values replace others.
fn add(to: &mut Table, part: Table) {
    for (key, value) in part {
        match value {
            Value::Table(part) if to.get(&key).is_some_and(Value::is_table) => {
                add(to[&key].as_table_mut().unwrap(), part);
            }
            value => drop(to.insert(key, value)),
        }
    }
}

/// Returns why a fence would be refused. A part of a session's configuration is read with the
/// least that it needs besides.
fn refused(text: &str) -> Option<String> {
    let path = Path::new("fence.toml");
    let shown = match text.parse::<Table>() {
        Ok(shown) => shown,
        Err(error) => return Some(error.to_string()),
    };
    match shown.get("format").and_then(Value::as_str) {
        Some("sonoweave-calibration") => CalibrationFile::parse(path, text).err().map(|e| e.to_string()),
        Some("sonoweave-transfer") => Transfer::parse(path, text).err().map(|e| e.to_string()),
        Some("sonoweave-crop") => Crop::parse(path, text).err().map(|e| e.to_string()),
        Some("sonoweave-phantom") => PhantomSettings::parse(path, text).err().map(|e| e.to_string()),
        Some(_) if shown.contains_key("grabber") => parse(text).err(),
        _ => {
            let mut whole: Table = LEAST.parse().unwrap();
            if ["arm", "remote"].iter().any(|other| shown.contains_key(*other)) {
                whole.remove("tracker");
            }
            add(&mut whole, shown);
            parse(&whole.to_string()).err()
        }
    }
}

#[test]
fn configurations_in_documents_are_valid() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let pages = fs::read_dir(root.join("docs")).unwrap().map(|entry| entry.unwrap().path());
    let pages = pages.chain([root.join("README.md")]).filter(|path| path.extension().is_some_and(|end| end == "md"));
    let mut count = 0;
    let mut wrong = Vec::new();
    for page in pages {
        for (line, text) in fences(&fs::read_to_string(&page).unwrap()) {
            count += 1;
            wrong.extend(refused(&text).map(|why| format!("{}:{line}: {why}", page.display())));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(count > 5, "only {count} configurations found");
}

#[test]
fn invalid_configuration_in_a_page_is_detected() {
    let page = "```\n$ ls\n```\n1. One:\n\n   ```toml\n   [igtl]\n   alow = []\n   ```\n";
    let found = fences(page);
    assert_eq!(found, [(6, "[igtl]\nalow = []\n".to_owned())]);
    assert!(refused(&found[0].1).is_some_and(|why| why.contains("did you mean allow?")));
    for (text, says) in [
        ("[status]\nlisten = 3\n", "listen"),
        ("[arm]\nkind = \"ea2\"\nport = \"virtual\"\n", "kind"),
        ("[nothing]\n", "nothing"),
        ("[igtl\n", "TOML parse error"),
        ("format = \"sonoweave-bedside\"\nversion = 1\n[grabber]\ndevice = \"virtual\"\n", "neither [tracker]"),
        ("format = \"sonoweave-calibration\"\nversion = 1\nprovenence = \"a\"\n", "provenance"),
        ("format = \"sonoweave-transfer\"\nversion = 1\n", "opacity"),
    ] {
        assert!(refused(text).is_some_and(|why| why.contains(says)), "{text}: {:?}", refused(text));
    }
    assert_eq!(refused("[status]\nlisten = \"127.0.0.1:9110\"\n"), None);
    assert_eq!(refused("[arm]\nkind = \"ea1\"\nport = \"virtual\"\n"), None);
}
