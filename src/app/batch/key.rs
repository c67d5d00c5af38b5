//! Content keys: hashes of everything that a sweep's files follow from.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use super::once::Once;
use crate::app::{input, sha256};
use crate::failure::Failure;

/// Version of the layout of results; another one gives other keys.
const LAYOUT: &str = "sonoweave-batch 1";

/// A file that a sweep follows from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Input {
    pub(crate) path: PathBuf,
    pub(crate) bytes: u64,
    pub(crate) sha256: String,
}

impl Input {
    fn read(path: &Path) -> Result<Self, Failure> {
        let there = path.metadata().map_err(|e| Failure::io(path, "reading", &e))?;
        Ok(Self { path: path.to_owned(), bytes: there.len(), sha256: input::hash(path)? })
    }

    /// Checks that the file is as it was.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read, or has another content.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        let now = Self::read(&self.path)?;
        if now == *self {
            return Ok(());
        }
        let sentence =
            format!("{}: has changed since the batch was planned; plan the batch again", self.path.display());
        Err(Failure::new(sentence).of(crate::failure::FailureKind::Input))
    }
}

/// The files of all sweeps. Those that several have in common are read once.
#[derive(Debug, Default)]
pub(crate) struct Inputs {
    files: Once<PathBuf, Result<Input, String>>,
    recordings: Once<PathBuf, (Vec<PathBuf>, u64)>,
}

impl Inputs {
    /// Returns a file's content hash.
    ///
    /// # Errors
    /// A sentence when it cannot be read.
    pub(crate) fn read(&self, path: &Path) -> Result<Input, String> {
        self.files.get(path.to_owned(), || Input::read(path).map_err(|failure| failure.0.sentence))
    }

    /// Returns the files of a recording, and its cost.
    pub(crate) fn recording(&self, path: &Path) -> (Vec<PathBuf>, u64) {
        self.recordings.get(path.to_owned(), || input::recording(path))
    }
}

/// Returns the content key of a sweep.
pub(crate) fn content_key(inputs: &[Input], settings: &[String], outputs: &[String], program: &str) -> String {
    let mut hasher = Sha256::new();
    let mut enter = |part: &str| {
        // A length before each part, so that no two lists of parts have the same bytes.
        hasher.update((part.len() as u64).to_le_bytes());
        hasher.update(part);
    };
    enter(LAYOUT);
    enter(program);
    for list in [settings, outputs] {
        enter(&list.len().to_string());
        list.iter().for_each(|part| enter(part));
    }
    for input in inputs {
        // Headers of volumes hold the name.
        enter(&input::name_of(&input.path));
        enter(&input.sha256);
    }
    sha256::text(hasher)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_changes_the_key() {
        let input = |name: &str, sha256: &str| Input { path: name.into(), bytes: 1, sha256: sha256.into() };
        let list = |items: &[&str]| items.iter().map(|&item| item.to_owned()).collect::<Vec<_>>();
        let key = |inputs: &[Input], settings: &[&str], outputs: &[&str], program: &str| {
            content_key(inputs, &list(settings), &list(outputs), program)
        };
        let first = key(&[input("f/a", "1")], &["x", "y"], &["v"], "1");
        assert_eq!(first, key(&[input("g/a", "1")], &["x", "y"], &["v"], "1"), "folders do not count");
        let others = [
            key(&[input("f/b", "1")], &["x", "y"], &["v"], "1"),
            key(&[input("f/a", "2")], &["x", "y"], &["v"], "1"),
            key(&[input("f/a", "1"), input("f/a", "1")], &["x", "y"], &["v"], "1"),
            key(&[input("f/a", "1")], &["xy"], &["v"], "1"),
            key(&[input("f/a", "1")], &["x"], &["y", "v"], "1"),
            key(&[input("f/a", "1")], &["x", "y"], &["w"], "1"),
            key(&[input("f/a", "1")], &["x", "y"], &["v"], "2"),
        ];
        let all: std::collections::BTreeSet<&String> = others.iter().chain([&first]).collect();
        assert_eq!(all.len(), 8);
        assert_eq!(first.len(), 64);
    }

    #[test]
    fn changed_file_is_refused() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("a");
        std::fs::write(&path, "one").unwrap();
        let input = Inputs::default().read(&path).unwrap();
        assert!(input.check().is_ok());
        std::fs::write(&path, "two").unwrap();
        assert!(input.check().unwrap_err().0.sentence.contains("has changed since the batch was planned"));
        std::fs::remove_file(&path).unwrap();
        assert_eq!(input.check().unwrap_err().0.kind, crate::failure::FailureKind::Input);
    }
}
