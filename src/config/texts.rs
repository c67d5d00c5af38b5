//! Files by their texts: read from the disk and remembered, so that a session can keep what it was configured by; or as they were remembered.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use calibration::file::read_text;
use calibration::keys::FileError;

/// Texts by the files' paths, as they were named.
pub type ByPath = BTreeMap<PathBuf, String>;

/// Where texts come from.
#[derive(Debug, Default)]
pub struct Texts {
    /// `None`: the disk.
    kept: Option<ByPath>,
    read: RefCell<ByPath>,
}

impl Texts {
    /// Of the disk.
    pub fn on_disk() -> Self {
        Self::default()
    }

    /// Of what was remembered, and nothing else.
    pub fn kept(texts: ByPath) -> Self {
        Self { kept: Some(texts), read: RefCell::default() }
    }

    /// The text of a file of at most `limit` bytes.
    ///
    /// # Errors
    /// [`FileError`]: unreadable, not UTF-8, larger; or not among what was remembered.
    pub fn text(&self, path: &Path, limit: u64) -> Result<String, FileError> {
        let text = match &self.kept {
            None => read_text(path, limit)?,
            Some(kept) => kept.get(path).cloned().ok_or_else(|| FileError::Io {
                path: path.to_owned(),
                doing: "finding the file among those that the session was configured by",
                source: io::ErrorKind::NotFound.into(),
            })?,
        };
        self.read.borrow_mut().insert(path.to_owned(), text.clone());
        Ok(text)
    }

    /// What was read.
    pub fn into_read(self) -> ByPath {
        self.read.into_inner()
    }
}
