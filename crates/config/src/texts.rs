//! Texts of files, read from disk and kept, so that a recorded session contains its
//! configuration. A replay uses the kept texts instead of the disk.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use sonoweave_core::keys::{FileError, read_text};

/// Texts by the files' paths, as they were named.
pub type ByPath = BTreeMap<PathBuf, String>;

/// Source of texts.
#[derive(Debug, Default)]
pub struct Texts {
    /// Kept texts; `None` for the disk.
    kept: Option<ByPath>,
    read: RefCell<ByPath>,
}

impl Texts {
    /// Reads from disk.
    pub fn on_disk() -> Self {
        Self::default()
    }

    /// Uses only these kept texts.
    pub fn kept(texts: ByPath) -> Self {
        Self { kept: Some(texts), read: RefCell::default() }
    }

    /// Returns the text of a file of at most `limit` bytes.
    ///
    /// # Errors
    /// [`FileError`]: unreadable, not UTF-8, or larger; or not among the kept texts.
    pub fn text(&self, path: &Path, limit: u64) -> Result<String, FileError> {
        let text = match &self.kept {
            None => read_text(path, limit)?,
            Some(kept) => kept.get(path).cloned().ok_or_else(|| FileError::Io {
                path: path.to_owned(),
                doing: "finding the file among the configuration files that the session recorded",
                source: io::ErrorKind::NotFound.into(),
            })?,
        };
        self.read.borrow_mut().insert(path.to_owned(), text.clone());
        Ok(text)
    }

    /// Returns the texts that were read.
    pub fn into_read(self) -> ByPath {
        self.read.into_inner()
    }
}
