//! The log of an unfinished volume: a line for each shard that is on the disk.
//!
//! The first line has the hash of the volume's description. Each further one has a shard's key,
//! then length and SHA-256 of its file. A shard without file has the word `empty` instead, and one
//! that is to be written again has `again`. The log is locked while its volume is written.

use std::collections::HashMap;
use std::fs::File;
use std::io::{ErrorKind, Read as _, Seek as _, SeekFrom, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};
use sha2::{Digest as _, Sha256};

use crate::error::OmeZarrError;
use crate::metadata::hex;

/// Name of the log in the unfinished volume.
pub(crate) const NAME: &str = "shards.log";
/// First word of the log.
const MAGIC: &str = "sonoweave-ome-zarr-1";

/// The log, open and locked.
pub(crate) struct Log {
    file: File,
    path: PathBuf,
    /// Length of each shard's file that is on the disk; `None` for those without a file.
    lengths: HashMap<String, Option<u64>>,
}

impl Log {
    /// Opens the log of an unfinished volume, or begins one, and locks it. Returns the hash of the
    /// description by which it was begun, if there was one.
    pub(crate) fn open(folder: &Path) -> Result<(Self, Option<String>), OmeZarrError> {
        let path = folder.join(NAME);
        let file = lock(folder, &path)?;
        let mut log = Self { file, path, lengths: HashMap::new() };
        let fingerprint = log.read()?;
        Ok((log, fingerprint))
    }

    /// Reads the lines that are whole, and cuts off the rest, which a power cut has left.
    fn read(&mut self) -> Result<Option<String>, OmeZarrError> {
        let mut bytes = Vec::new();
        self.file.read_to_end(&mut bytes).map_err(OmeZarrError::io(&self.path, "reading"))?;
        let mut whole = 0;
        let mut fingerprint = None;
        for line in bytes.split_inclusive(|byte| *byte == b'\n') {
            let Some(words) = line.strip_suffix(b"\n").and_then(|line| std::str::from_utf8(line).ok()) else { break };
            let words: Vec<&str> = words.split(' ').collect();
            match (&fingerprint, words.as_slice()) {
                (None, [MAGIC, hash]) => fingerprint = Some((*hash).to_owned()),
                (Some(_), [key, "empty"]) => {
                    self.lengths.insert((*key).to_owned(), None);
                }
                (Some(_), [key, "again"]) => {
                    self.lengths.remove(*key);
                }
                (Some(_), [key, length, hash]) if hash.len() == 64 => {
                    let Ok(length) = length.parse() else { break };
                    self.lengths.insert((*key).to_owned(), Some(length));
                }
                _ => break,
            }
            whole += line.len();
        }
        self.cut(whole as u64)?;
        Ok(fingerprint)
    }

    fn cut(&mut self, length: u64) -> Result<(), OmeZarrError> {
        let cut = self.file.set_len(length).and_then(|()| self.file.seek(SeekFrom::End(0)));
        cut.map(drop).map_err(OmeZarrError::io(&self.path, "writing"))
    }

    /// Begins the log anew for a description.
    pub(crate) fn restart(&mut self, fingerprint: &str) -> Result<(), OmeZarrError> {
        self.lengths.clear();
        self.cut(0)?;
        self.line(&format!("{MAGIC} {fingerprint}"))?;
        self.file.sync_all().map_err(OmeZarrError::io(&self.path, "syncing"))
    }

    fn line(&mut self, line: &str) -> Result<(), OmeZarrError> {
        // One call, so that lines are not mixed with half ones.
        self.file.write_all(format!("{line}\n").as_bytes()).map_err(OmeZarrError::io(&self.path, "writing"))
    }

    /// Keeps only the shards whose files have the length of their line.
    pub(crate) fn keep_whole(&mut self, folder: &Path) {
        self.lengths.retain(|key, length| match (folder.join(key).metadata(), length) {
            (Ok(there), Some(length)) => there.is_file() && there.len() == *length,
            (there, None) => there.is_err(),
            (Err(_), Some(_)) => false,
        });
    }

    /// Enters a shard: its file's content, which is on the disk, or `None`.
    pub(crate) fn enter(&mut self, key: &str, file: Option<&[u8]>) -> Result<(), OmeZarrError> {
        match file {
            Some(bytes) => self.line(&format!("{key} {} {}", bytes.len(), hex(&Sha256::digest(bytes))))?,
            None => self.line(&format!("{key} empty"))?,
        }
        self.lengths.insert(key.to_owned(), file.map(|bytes| bytes.len() as u64));
        Ok(())
    }

    /// Marks a shard that is to be written again.
    pub(crate) fn reopen(&mut self, key: &str) -> Result<(), OmeZarrError> {
        if self.lengths.remove(key).is_some() { self.line(&format!("{key} again")) } else { Ok(()) }
    }

    /// Returns whether a shard is on the disk.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.lengths.contains_key(key)
    }

    /// Returns whether a shard is on the disk, with a file.
    pub(crate) fn has_file(&self, key: &str) -> bool {
        self.lengths.get(key).is_some_and(Option::is_some)
    }

    /// Number of shards on the disk.
    pub(crate) fn len(&self) -> usize {
        self.lengths.len()
    }
}

impl Drop for Log {
    fn drop(&mut self) {
        // A process that is being started may have the file for a moment, and the lock with it.
        let _ = flock(&self.file, FlockOperation::Unlock);
    }
}

/// Opens and locks a file. A writer that ends may rename its folder meanwhile; the lock would then
/// be of another folder's log.
fn lock(folder: &Path, path: &Path) -> Result<File, OmeZarrError> {
    let busy = || OmeZarrError::Busy { path: folder.into() };
    let file = File::options().read(true).write(true).create(true).truncate(false).open(path);
    let file = file.map_err(OmeZarrError::io(path, "opening"))?;
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Err(error) if error.kind() == ErrorKind::WouldBlock => return Err(busy()),
        done => done.map_err(|error| OmeZarrError::io(path, "locking")(error.into()))?,
    }
    let ours = file.metadata().map_err(OmeZarrError::io(path, "locking"))?.ino();
    let is_ours = path.metadata().is_ok_and(|there| there.ino() == ours);
    if is_ours { Ok(file) } else { Err(busy()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_is_locked_and_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let (mut log, begun) = Log::open(folder.path()).unwrap();
        assert_eq!(begun, None);
        log.restart("abc").unwrap();
        std::fs::write(folder.path().join("a"), "12").unwrap();
        log.enter("a", Some(b"12")).unwrap();
        log.enter("b", None).unwrap();
        log.enter("c", Some(b"12")).unwrap();
        log.enter("d", None).unwrap();
        log.reopen("d").unwrap();
        assert!(matches!(Log::open(folder.path()), Err(OmeZarrError::Busy { .. })));
        drop(log);
        let (mut log, begun) = Log::open(folder.path()).unwrap();
        assert_eq!((begun.as_deref(), log.len()), (Some("abc"), 3));
        log.keep_whole(folder.path());
        assert_eq!(["a", "b", "c", "d"].map(|key| log.has(key)), [true, true, false, false]);
        assert!(log.has_file("a") && !log.has_file("b"));
    }

    #[test]
    fn half_line_at_the_end_is_cut_off() {
        let folder = tempfile::tempdir().unwrap();
        let hash = "0".repeat(64);
        for (tail, shards) in [("b 3", 1), ("b 3 \n", 1), ("\0\0\0\n", 1), ("b empty", 1), ("b empty\n", 2)] {
            let whole = format!("{MAGIC} abc\na 2 {hash}\n");
            std::fs::write(folder.path().join(NAME), format!("{whole}{tail}")).unwrap();
            let (mut log, _) = Log::open(folder.path()).unwrap();
            assert_eq!(log.len(), shards, "{tail:?}");
            log.enter("z", None).unwrap();
            drop(log);
            let (log, begun) = Log::open(folder.path()).unwrap();
            assert_eq!((begun.as_deref(), log.len()), (Some("abc"), shards + 1));
        }
        std::fs::write(folder.path().join(NAME), "a empty\n").unwrap();
        let (log, begun) = Log::open(folder.path()).unwrap();
        assert_eq!((begun, log.len()), (None, 0));
    }
}
