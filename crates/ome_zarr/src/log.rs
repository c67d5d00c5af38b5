//! The log of an unfinished volume: a line for each shard that is on the disk.
//!
//! The first line has the hash of the volume's description. Each further one has a shard's key,
//! then length and SHA-256 of its file. A shard without file has the word `empty` instead, and one
//! that is to be written again has `again`. The log is locked while its volume is written: by one
//! writer of the whole, or by any number of writers of regions, which collect their lines for logs
//! of their own.

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
/// Folder of the regions' logs in the unfinished volume.
pub(crate) const REGIONS: &str = "regions";
/// First word of the log.
const MAGIC: &str = "sonoweave-ome-zarr-1";

/// Length and SHA-256 of a shard's file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ShardFile {
    length: u64,
    sha256: String,
}

impl ShardFile {
    /// Hashes a file's content. Not while the log is locked: others wait for it.
    pub(crate) fn of(bytes: &[u8]) -> Self {
        Self { length: bytes.len() as u64, sha256: hex(&Sha256::digest(bytes)) }
    }
}

/// Shards that are on the disk, by key; those without a file have `None`.
pub(crate) type Shards = HashMap<String, Option<ShardFile>>;

/// The log, open and locked.
pub(crate) struct Log {
    file: File,
    path: PathBuf,
    fingerprint: String,
    shards: Shards,
    /// Lines of a region's writer; `None` for the writer of the whole.
    lines: Option<String>,
}

/// Content of a log, as far as its lines are whole.
pub(crate) struct Content {
    /// Hash of the description, if the first line is one of a log.
    pub(crate) fingerprint: Option<String>,
    pub(crate) shards: Shards,
    /// Text of the last line after the word `note`.
    pub(crate) note: Option<String>,
    /// Bytes of all whole lines.
    whole: usize,
}

impl Content {
    /// Parses a log up to the first line that is not whole, which a power cut has left.
    pub(crate) fn of(bytes: &[u8]) -> Self {
        let mut content = Self { fingerprint: None, shards: Shards::new(), note: None, whole: 0 };
        for line in bytes.split_inclusive(|byte| *byte == b'\n') {
            let Some(text) = line.strip_suffix(b"\n").and_then(|line| std::str::from_utf8(line).ok()) else { break };
            let words: Vec<&str> = text.split(' ').collect();
            match (&content.fingerprint, words.as_slice()) {
                (None, [MAGIC, hash]) => content.fingerprint = Some((*hash).to_owned()),
                (Some(_), ["note", ..]) => content.note = text.strip_prefix("note ").map(str::to_owned),
                (Some(_), [key, "empty"]) => {
                    content.shards.insert((*key).to_owned(), None);
                }
                (Some(_), [key, "again"]) => {
                    content.shards.remove(*key);
                }
                (Some(_), [key, length, hash]) if hash.len() == 64 => {
                    let Ok(length) = length.parse() else { break };
                    content.shards.insert((*key).to_owned(), Some(ShardFile { length, sha256: (*hash).to_owned() }));
                }
                _ => break,
            }
            content.whole += line.len();
        }
        content
    }
}

impl Log {
    /// Opens the log of an unfinished volume, or begins one, and locks it. Returns the hash of the
    /// description by which it was begun, if there was one.
    pub(crate) fn open(folder: &Path) -> Result<(Self, Option<String>), OmeZarrError> {
        let path = folder.join(NAME);
        let file = lock(folder, &path, FlockOperation::NonBlockingLockExclusive)?;
        let mut log = Self { file, path, fingerprint: String::new(), shards: Shards::new(), lines: None };
        let content = log.read()?;
        log.cut(content.whole as u64)?;
        log.shards = content.shards;
        log.fingerprint = content.fingerprint.clone().unwrap_or_default();
        Ok((log, content.fingerprint))
    }

    /// Opens the log of a volume that was begun by a description, for the writer of a region.
    /// Returns `None` if it was begun by another one.
    pub(crate) fn join(folder: &Path, fingerprint: &str) -> Result<Option<Self>, OmeZarrError> {
        let path = folder.join(NAME);
        let file = lock(folder, &path, FlockOperation::NonBlockingLockShared)?;
        let lines = Some(String::new());
        let mut log = Self { file, path, fingerprint: fingerprint.to_owned(), shards: Shards::new(), lines };
        let content = log.read()?;
        log.shards = content.shards;
        Ok((content.fingerprint.as_deref() == Some(fingerprint)).then_some(log))
    }

    /// Hash of the description.
    pub(crate) fn fingerprint(&self) -> &str {
        &self.fingerprint
    }

    fn read(&mut self) -> Result<Content, OmeZarrError> {
        let mut bytes = Vec::new();
        self.file.read_to_end(&mut bytes).map_err(OmeZarrError::io(&self.path, "reading"))?;
        Ok(Content::of(&bytes))
    }

    fn cut(&mut self, length: u64) -> Result<(), OmeZarrError> {
        let cut = self.file.set_len(length).and_then(|()| self.file.seek(SeekFrom::End(0)));
        cut.map(drop).map_err(OmeZarrError::io(&self.path, "writing"))
    }

    /// Begins the log anew for a description.
    pub(crate) fn restart(&mut self, fingerprint: &str) -> Result<(), OmeZarrError> {
        self.shards.clear();
        fingerprint.clone_into(&mut self.fingerprint);
        self.cut(0)?;
        self.line(&first_line(fingerprint))?;
        self.file.sync_all().map_err(OmeZarrError::io(&self.path, "syncing"))
    }

    fn line(&mut self, line: &str) -> Result<(), OmeZarrError> {
        match &mut self.lines {
            Some(lines) => {
                *lines += line;
                lines.push('\n');
                Ok(())
            }
            // One call, so that lines are not mixed with half ones.
            None => {
                self.file.write_all(format!("{line}\n").as_bytes()).map_err(OmeZarrError::io(&self.path, "writing"))
            }
        }
    }

    /// Returns the text of a region's own log, and begins the next region's.
    pub(crate) fn take_text(&mut self, note: &str) -> String {
        let lines = self.lines.as_mut().map(std::mem::take).unwrap_or_default();
        format!("{}\n{lines}note {note}\n", first_line(&self.fingerprint))
    }

    /// Keeps only the shards whose files have the length of their line.
    pub(crate) fn keep_whole(&mut self, folder: &Path) {
        self.shards.retain(|key, shard| match (folder.join(key).metadata(), shard) {
            (Ok(there), Some(shard)) => there.is_file() && there.len() == shard.length,
            (there, None) => there.is_err(),
            (Err(_), Some(_)) => false,
        });
    }

    /// Returns the keys of all shards with a file, sorted.
    pub(crate) fn keys_of_files(&self) -> Vec<String> {
        let mut keys: Vec<String> =
            self.shards.iter().filter(|(_, file)| file.is_some()).map(|(key, _)| key.clone()).collect();
        keys.sort_unstable();
        keys
    }

    /// Whether a file is that which was entered for a shard.
    pub(crate) fn is_entered(&self, key: &str, file: &ShardFile) -> bool {
        self.shards.get(key).is_some_and(|entered| entered.as_ref() == Some(file))
    }

    /// Leaves out a shard whose file was removed, for this process; the next one finds that the
    /// file is missing.
    pub(crate) fn forget(&mut self, key: &str) {
        self.shards.remove(key);
    }

    /// Enters a shard: its file, which is on the disk, or `None`.
    pub(crate) fn enter(&mut self, key: &str, file: Option<ShardFile>) -> Result<(), OmeZarrError> {
        match &file {
            Some(ShardFile { length, sha256 }) => self.line(&format!("{key} {length} {sha256}"))?,
            None => self.line(&format!("{key} empty"))?,
        }
        self.shards.insert(key.to_owned(), file);
        Ok(())
    }

    /// Enters the shards of a region's log. Coarser levels are to be written again, if one of the
    /// shards is new.
    pub(crate) fn enter_all(&mut self, shards: Shards) -> Result<(), OmeZarrError> {
        let mut new: Vec<_> = shards.into_iter().filter(|(key, file)| self.shards.get(key) != Some(file)).collect();
        new.sort_by(|(a, _), (b, _)| a.cmp(b));
        if !new.is_empty() {
            let coarser: Vec<String> = self.shards.keys().filter(|key| !is_finest(key)).cloned().collect();
            coarser.iter().try_for_each(|key| self.reopen(key))?;
        }
        new.into_iter().try_for_each(|(key, file)| self.enter(&key, file))
    }

    /// Enters the shards of a region's log that another process has written.
    pub(crate) fn learn(&mut self, shards: Shards) {
        self.shards.extend(shards);
    }

    /// Marks a shard that is to be written again.
    pub(crate) fn reopen(&mut self, key: &str) -> Result<(), OmeZarrError> {
        if self.shards.remove(key).is_some() { self.line(&format!("{key} again")) } else { Ok(()) }
    }

    /// Returns whether a shard is on the disk.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.shards.contains_key(key)
    }

    /// Returns whether a shard is on the disk, with a file.
    pub(crate) fn has_file(&self, key: &str) -> bool {
        self.shards.get(key).is_some_and(Option::is_some)
    }

    /// Number of shards on the disk.
    pub(crate) fn len(&self) -> usize {
        self.shards.len()
    }
}

impl Drop for Log {
    fn drop(&mut self) {
        // A process that is being started may have the file for a moment, and the lock with it.
        let _ = flock(&self.file, FlockOperation::Unlock);
    }
}

fn first_line(fingerprint: &str) -> String {
    format!("{MAGIC} {fingerprint}")
}

/// Whether a key is that of a log: the volume's or a region's.
pub(crate) fn is_log(key: &str) -> bool {
    key == NAME || key.strip_prefix(REGIONS).is_some_and(|rest| rest.starts_with('/'))
}

/// Whether a shard is one of level 0.
fn is_finest(key: &str) -> bool {
    key.split("/c/").next().and_then(|array| array.rsplit('/').next()) == Some("0")
}

/// Opens and locks a file. A writer that ends may rename its folder meanwhile; the lock would then
/// be of another folder's log.
fn lock(folder: &Path, path: &Path, operation: FlockOperation) -> Result<File, OmeZarrError> {
    let busy = || OmeZarrError::Busy { path: folder.into() };
    let is_owner = operation == FlockOperation::NonBlockingLockExclusive;
    let file = File::options().read(true).write(true).create(is_owner).truncate(false).open(path);
    let file = file.map_err(OmeZarrError::io(path, "opening"))?;
    match flock(&file, operation) {
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
        log.enter("a", Some(ShardFile::of(b"12"))).unwrap();
        log.enter("b", None).unwrap();
        log.enter("c", Some(ShardFile::of(b"12"))).unwrap();
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
