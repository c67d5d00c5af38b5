//! Settings overrides: a recorded session's configuration with other settings, applied to the
//! same readings.
//!
//! The overrides can change the insertion of slices and their rendering: calibration, latencies,
//! pairing, volume and picture. The device settings are already part of the readings. Viewers
//! may not change the session's share of the machine's resources. Only files beside the session
//! can be named.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value;

use sonoweave_core::keys::{FileError, read_text};

use super::{Bedside, MAX_BYTES, schema};
use crate::{Error, Kind};

/// Values by dotted key; `null` resets a key to its default.
pub type SettingsOverride = BTreeMap<String, Value>;

/// Sections whose keys can be overridden, and their keys that cannot.
const TRIED: [(&str, &[&str]); 4] = [
    ("calibration", &["warn_after_days"]),
    ("pairing", &[]),
    ("volume", &["threads", "max_memory_gib"]),
    ("picture", &["most_hz", "image_size", "cache", "cache_mib", "draw", "parts", "threads"]),
];
/// Keys whose values may name a file.
const FILES: [&str; 3] = ["calibration.file", "picture.crop", "picture.transfer"];
/// Largest number of listed files beside a session.
const MOST_FILES: usize = 100;
/// Sections of devices; their `latency_ms` can be overridden.
const DEVICES: [&str; 4] = ["tracker", "arm", "remote", "grabber"];

/// A key that can be overridden.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Setting {
    /// Dotted.
    pub key: String,
    /// Its valid values.
    pub takes: &'static str,
    /// Its meaning, and its default.
    pub about: &'static str,
    /// Its present value; `null` if nothing is given and something else decides.
    pub value: Value,
    /// The available files, for a key that names a file.
    pub files: Vec<String>,
}

fn is_tried(dotted: &str) -> bool {
    let Some((heading, name)) = dotted.rsplit_once('.') else { return false };
    let is_latency = DEVICES.contains(&heading) && name == "latency_ms";
    let of_section = TRIED.iter().any(|(section, not)| *section == heading && !not.contains(&name));
    (is_latency || of_section) && schema::key(dotted).is_some()
}

/// Returns the names of files beside a session that a setting may name.
fn files(folder: &Path, key: &str) -> Vec<String> {
    let endings: &[&str] = if key == "calibration.file" { &["toml", "xml"] } else { &["toml"] };
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let named = entries.flatten().filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_file()));
    let names = named.filter_map(|entry| entry.file_name().into_string().ok());
    let fits = |name: &String| Path::new(name).extension().is_some_and(|ending| endings.iter().any(|e| ending == *e));
    let mut names: Vec<String> = names.filter(fits).take(MOST_FILES).collect();
    names.sort_unstable();
    names
}

impl Bedside {
    /// Returns the keys that can be overridden, with present values and the files in this
    /// folder.
    pub fn settings(&self, folder: &Path) -> Vec<Setting> {
        let keys = self.effective.iter().filter(|(key, _)| is_tried(key));
        let setting = |(key, value): (&String, &Value)| {
            let known = schema::key(key)?;
            let files = if FILES.contains(&key.as_str()) { files(folder, key) } else { Vec::new() };
            Some(Setting { key: key.clone(), takes: &known.takes, about: &known.about, value: value.clone(), files })
        };
        keys.filter_map(setting).collect()
    }

    /// Returns this configuration with overrides; files that they name are in this folder.
    ///
    /// # Errors
    /// [`Error`]: a key that cannot be overridden, an invalid value, or a missing file. Also for a
    /// PLUS device set, which has no such keys.
    pub fn tried(&self, trial: &SettingsOverride, folder: &Path) -> Result<Self, Error> {
        if self.kind != Kind::Bedside {
            let problem = "is a PLUS device set, which has no such keys; replay with a session configuration".into();
            return Err(Error::DeviceSet { path: self.path.clone(), problem });
        }
        if let Some(key) = trial.keys().find(|key| !is_tried(key)) {
            return Err(refused(key, "cannot be changed for a recorded session"));
        }
        let text = self.texts.get(&self.path).map_or("", String::as_str);
        let mut texts = self.texts.clone();
        let first = Self::of_texts(&self.path, texts.clone()).map_err(unplaced)?;
        let mut root: toml::Table =
            toml::from_str(text.trim_start_matches('\u{feff}')).map_err(|e| Error::Value(e.to_string()))?;
        // Changes that the session adopted while it ran are kept, unless overridden.
        let adopted = first.changes(self).at_once.into_iter().filter(|change| !trial.contains_key(&change.key));
        for change in adopted {
            set(&mut root, &change.key, &change.to)?;
        }
        // The image plane comes from one of the two keys, not from both.
        let given = |key: &str| trial.get(key).is_some_and(|value| !value.is_null());
        if given("calibration.file") && !given("calibration.image_to_probe") {
            set(&mut root, "calibration.image_to_probe", &Value::Null)?;
            set(&mut root, "calibration.preset", &Value::Null)?;
        } else if given("calibration.image_to_probe") && !given("calibration.file") {
            set(&mut root, "calibration.file", &Value::Null)?;
            set(&mut root, "calibration.preset", &Value::Null)?;
        }
        for (key, value) in trial {
            let file = FILES.contains(&key.as_str()).then(|| self.named(key, value, folder)).transpose()?.flatten();
            match file {
                Some((path, text)) => {
                    set(&mut root, key, &Value::from(path.display().to_string()))?;
                    texts.insert(path, text);
                }
                None => set(&mut root, key, value)?,
            }
        }
        let text = toml::to_string(&root).map_err(|error| Error::Value(error.to_string()))?;
        texts.insert(self.path.clone(), text);
        let bedside = Self::of_texts(&self.path, texts).map_err(unplaced)?;
        bedside.calibrated().map_err(unplaced)?;
        Ok(bedside)
    }

    /// Returns the file that a value names, with its text; `None` if it names none, or the
    /// present one.
    fn named(&self, key: &str, value: &Value, folder: &Path) -> Result<Option<(PathBuf, String)>, Error> {
        let Some(name) = value.as_str().filter(|name| self.effective.get(key).is_none_or(|held| held != *name)) else {
            return Ok(None);
        };
        if !files(folder, key).iter().any(|known| known == name) {
            let is_file = key == "calibration.file" || name.contains(['/', '\\', '.']);
            return if is_file {
                Err(refused(key, format!("there is no file {name:?} in the session's folder")))
            } else {
                Ok(None)
            };
        }
        let path = std::path::absolute(folder.join(name)).map_err(|error| refused(key, error.to_string()))?;
        let text = read_text(&path, MAX_BYTES).map_err(|error| refused(key, error.to_string()))?;
        Ok(Some((path, text)))
    }
}

/// Sets a key, or removes it.
pub(super) fn set(root: &mut toml::Table, dotted: &str, value: &Value) -> Result<(), Error> {
    let Some((heading, name)) = dotted.rsplit_once('.') else {
        return Err(refused(dotted, "has no section; give SECTION.KEY"));
    };
    let mut table = root;
    for part in heading.split('.') {
        let inner = table.entry(part).or_insert_with(|| toml::Table::new().into());
        table = inner.as_table_mut().ok_or_else(|| refused(part, "is not a section; give a table"))?;
    }
    if value.is_null() {
        table.remove(name);
        return Ok(());
    }
    let value = toml::Value::try_from(value).map_err(|error| refused(dotted, error.to_string()))?;
    table.insert(name.to_owned(), value);
    Ok(())
}

fn refused(key: &str, problem: impl Into<String>) -> Error {
    Error::Override { key: key.to_owned(), problem: problem.into() }
}

/// Removes the line number: the user has not seen the text.
fn unplaced(error: Error) -> Error {
    match error {
        Error::File(FileError::Key { key, problem, .. }) => Error::Override { key, problem },
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const TEXT: &str = "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\n[grabber]\ndevice = \"virtual\"\nsize = \"64x48\"\nrate_hz = 30\n[volume]\nspacing_mm = 1.0\n";

    fn bedside() -> Bedside {
        Bedside::parse(Path::new("bed.toml"), TEXT).unwrap()
    }

    fn trial(keys: &[(&str, Value)]) -> SettingsOverride {
        keys.iter().map(|(key, value)| ((*key).to_owned(), value.clone())).collect()
    }

    #[test]
    fn tried_changes_only_overridden_keys() {
        let (bedside, folder) = (bedside(), tempfile::tempdir().unwrap());
        let keys = [("volume.spacing_mm", json!(0.5)), ("grabber.latency_ms", json!(40))];
        let tried = bedside.tried(&trial(&keys), folder.path()).unwrap();
        let changes = bedside.changes(&tried);
        let changed = changes.at_once.iter().chain(&changes.next_session).map(|change| change.key.as_str());
        assert_eq!(changed.collect::<Vec<_>>(), ["grabber.latency_ms", "volume.spacing_mm"]);
        assert_eq!((tried.grabber.latency_ns, tried.volume.settings.spacing_mm.x), (40_000_000, 0.5));
        // Overrides an overridden configuration, and resets a key.
        let back = tried.tried(&trial(&[("grabber.latency_ms", Value::Null)]), folder.path()).unwrap();
        assert_eq!((back.grabber.latency_ns, back.volume.settings.spacing_mm.x), (0, 0.5));
    }

    #[test]
    fn adopted_changes_kept_unless_overridden() {
        let folder = tempfile::tempdir().unwrap();
        let mut bedside = bedside();
        let newer = TEXT.replace("rate_hz = 30\n", "rate_hz = 30\nlatency_ms = 25\n");
        bedside.adopt(&Bedside::parse(Path::new("bed.toml"), &newer).unwrap());
        let tried = bedside.tried(&trial(&[("volume.spacing_mm", json!(2))]), folder.path()).unwrap();
        assert_eq!((tried.grabber.latency_ns, tried.volume.settings.spacing_mm.x), (25_000_000, 2.0));
        let tried = bedside.tried(&trial(&[("grabber.latency_ms", json!(-5.5))]), folder.path()).unwrap();
        assert_eq!(tried.grabber.latency_ns, -5_500_000);
    }

    #[test]
    fn calibration_files_must_lie_beside_session() {
        let (bedside, folder) = (bedside(), tempfile::tempdir().unwrap());
        let inside = folder.path().join("inside");
        std::fs::create_dir(&inside).unwrap();
        let found = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/examples/probe.toml");
        std::fs::copy(found, inside.join("probe.toml")).unwrap();
        std::fs::copy(found, folder.path().join("outside.toml")).unwrap();
        std::fs::write(inside.join("patient.txt"), "nobody's business").unwrap();
        let file = |name: &str| bedside.tried(&trial(&[("calibration.file", json!(name))]), &inside);
        let tried = file("probe.toml").unwrap();
        assert_ne!(tried.calibration.transforms, bedside.calibration.transforms);
        let files = |bedside: &Bedside| {
            let settings = bedside.settings(&inside);
            settings.into_iter().find(|setting| setting.key == "calibration.file").unwrap().files
        };
        assert_eq!(files(&bedside), ["probe.toml"]);
        for name in ["outside.toml", "../outside.toml", "patient.txt", "/etc/passwd", "", "inside"] {
            let why = file(name).unwrap_err().to_string();
            assert_eq!(why, format!("calibration.file: there is no file {name:?} in the session's folder"));
        }
        let why =
            bedside.tried(&trial(&[("picture.transfer", json!("../outside.toml"))]), &inside).unwrap_err().to_string();
        assert!(why.contains("in the session's folder"), "{why}");
    }

    #[test]
    fn forbidden_overrides_refused_by_key() {
        let (bedside, folder) = (bedside(), tempfile::tempdir().unwrap());
        for key in
            ["tracker.port", "volume.max_memory_gib", "record.folder", "status.listen", "volume", "volume.nothing", ""]
        {
            let why = bedside.tried(&trial(&[(key, json!(1))]), folder.path()).unwrap_err().to_string();
            assert_eq!(why, format!("{key}: cannot be changed for a recorded session"));
        }
        for (key, value) in [
            ("volume.spacing_mm", json!(-1)),
            ("volume.spacing_mm", json!({})),
            ("volume.method", json!("cubic")),
            ("grabber.latency_ms", json!("x")),
        ] {
            let why = bedside.tried(&trial(&[(key, value)]), folder.path()).unwrap_err().to_string();
            assert!(why.starts_with(key), "{why}");
        }
        assert!(bedside.settings(folder.path()).iter().all(|setting| is_tried(&setting.key)));
    }
}
