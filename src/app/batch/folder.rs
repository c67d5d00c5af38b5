//! The folder of a batch.

use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};

use super::owner;
use crate::failure::{Failure, FailureKind};

/// File of the plan.
pub(crate) const PLAN: &str = "plan.jsonl";
/// Folder of the results.
const SWEEPS: &str = "sweeps";
/// Folder of the accounts of tries.
const ATTEMPTS: &str = "attempts";

/// The folder of a batch: `plan.jsonl`, `sweeps/ID/` with the results and `attempts/ID/` with the
/// accounts of all tries.
#[derive(Debug, Clone)]
pub(crate) struct RunFolder(PathBuf);

impl RunFolder {
    /// Makes the folder for a plan.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be made, or is another folder with files in it.
    pub(crate) fn create(path: &Path) -> Result<Self, Failure> {
        if path.exists() && !path.is_dir() {
            return Err(Failure::new(format!("{}: is a file; give a folder", path.display())).of(FailureKind::Output));
        }
        std::fs::create_dir_all(path).map_err(|e| Failure::io(path, "making the folder", &e))?;
        let made = Self(path.canonicalize().map_err(|e| Failure::io(path, "making the folder", &e))?);
        owner::clean(path, false).map_err(|e| Failure::io(path, "removing files of a killed run", &e))?;
        let entries = std::fs::read_dir(path).map_err(|e| Failure::io(path, "reading", &e))?;
        let is_ours = |name: &OsStr| [PLAN, SWEEPS, ATTEMPTS].iter().any(|ours| name == *ours);
        // A workflow engine may have removed the plan, to have it made again.
        if !made.plan().is_file() && entries.flatten().any(|entry| !is_ours(&entry.file_name())) {
            let sentence = format!("{}: holds other files, and no plan; give a new folder", path.display());
            return Err(Failure::new(sentence).of(FailureKind::Output));
        }
        Ok(made)
    }

    /// Opens the folder of a plan.
    ///
    /// # Errors
    /// [`Failure`] when it holds no plan.
    pub(crate) fn open(path: &Path) -> Result<Self, Failure> {
        let made = Self(path.to_owned());
        if !made.plan().is_file() {
            let sentence = format!("{}: has no {PLAN}; make it by `sonoweave batch plan`", path.display());
            return Err(Failure::new(sentence).of(FailureKind::Input));
        }
        let whole = path.canonicalize().map_err(|e| Failure::io(path, "opening", &e))?;
        Ok(Self(whole))
    }

    /// Returns the folder.
    pub(crate) fn path(&self) -> &Path {
        &self.0
    }

    /// Returns the file of the plan.
    pub(crate) fn plan(&self) -> PathBuf {
        self.0.join(PLAN)
    }

    /// Returns the folder of a sweep's results.
    pub(crate) fn sweep(&self, id: &str) -> PathBuf {
        self.0.join(SWEEPS).join(id)
    }

    /// Returns the folder of the accounts of a sweep's tries.
    pub(crate) fn attempts(&self, id: &str) -> PathBuf {
        self.0.join(ATTEMPTS).join(id)
    }

    /// Removes what killed runs have left of a sweep; see [`owner::clean`].
    ///
    /// # Errors
    /// [`Failure`] of the file system.
    pub(crate) fn clean(&self, id: &str, is_done: bool) -> Result<(), Failure> {
        let clean = |folder: PathBuf| {
            owner::clean(&folder, is_done).map_err(|e| Failure::io(&folder, "removing files of a killed run", &e))
        };
        clean(self.sweep(id))?;
        clean(self.attempts(id))
    }

    /// Writes a file of the batch, whole or not at all, in a folder that is made if it is missing.
    ///
    /// # Errors
    /// [`Failure`] of the file system.
    pub(crate) fn write(&self, path: &Path, content: &[u8]) -> Result<(), Failure> {
        let folder = path.parent().unwrap_or(&self.0);
        let made: io::Result<()> = std::fs::create_dir_all(folder);
        made.and_then(|()| owner::write(path, content)).map_err(|e| Failure::io(path, "writing", &e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_new_folders_and_those_of_plans_are_taken() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("run");
        let folder = RunFolder::create(&path).unwrap();
        assert_eq!(RunFolder::open(&path).unwrap_err().0.kind, FailureKind::Input);
        folder.write(&folder.plan(), b"{}").unwrap();
        assert!(RunFolder::open(&path).is_ok() && RunFolder::create(&path).is_ok());
        std::fs::create_dir_all(folder.sweep("a")).unwrap();
        std::fs::remove_file(folder.plan()).unwrap();
        assert!(RunFolder::create(&path).is_ok(), "a plan that was removed");
        std::fs::write(place.path().join("file"), "").unwrap();
        for wrong in [place.path().join("file"), place.path().to_owned()] {
            assert_eq!(RunFolder::create(&wrong).unwrap_err().0.kind, FailureKind::Output);
        }
    }
}
